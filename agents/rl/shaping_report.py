"""The outcome of a reward-shaping experiment: a table with intervals, learning curves, a page of pictures."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slamgym.agents.rl.reward_shaping import ShapingRun
from slamgym.core.files import write_text
from slamgym.core.intervals import (
    Interval,
    crossed_mean,
    crossed_ratio,
    interquartile_mean,
    mean_band,
    probability_of_improvement,
)
from slamgym.core.markdown import markdown
from slamgym.core.types import FloatArray
from slamgym.viz.plots import Curve, CurvePanel, Spread, plot_curves, plot_spreads

OUTCOME_COLUMNS = (
    ("time_95", "time to 95 % [s]", "{:.0f}"),
    ("time_99", "time to 99 % [s]", "{:.0f}"),
    ("path_99", "path to 99 % [m]", "{:.1f}"),
    ("coverage", "coverage", "{:.3f}"),
    ("map_error", "map error [m]", "{:.4f}"),
)
"""Field of :class:`slamgym.agents.rl.validation.PolicyOutcome`, heading, format."""

_POINTS = 60


def write_shaping_report(runs: Sequence[ShapingRun], out: Path) -> str:
    """Write ``shaping.md``, ``curves.png`` and ``outcomes.png``.

    Args:
        runs: All runs.
        out: Folder.

    Returns:
        The table.

    Raises:
        SlamgymError: If matplotlib isn't installed.
    """
    text = table(runs)
    write_text(out / "shaping.md", text)
    draw_curves(runs, out / "curves.png")
    draw_outcomes(runs, out / "outcomes.png")
    return text


def table(runs: Sequence[ShapingRun]) -> str:
    """Means over seeds and plans with 95 % intervals, and map error and time against ``time``.

    Both are drawn again for an interval (:func:`slamgym.core.intervals.crossed_ratio`), so it holds for other plans
    and other seeds of the training. With one seed there is none: other plans alone would make it too narrow. The
    interquartile mean, and the probability that a map of a plan is better than the reference's, are those of Agarwal et
    al. 2021.
    """
    names = list(dict.fromkeys(run.preset for run in runs))
    reference = "time" if "time" in names else names[0]
    headings = [
        "preset",
        "seeds",
        *(heading for _, heading, _ in OUTCOME_COLUMNS),
        f"time 99 / {reference}",
        f"error / {reference}",
        "time 99, IQM [s]",
        f"error below {reference}'s",
    ]
    rows = []
    for name in names:
        own = [run for run in runs if run.preset == name]
        cells = [name, str(len(own))]
        cells += [
            _cell(crossed_mean(_outcomes(own, field)), form, len(own)) for field, _, form in OUTCOME_COLUMNS
        ]
        base = [run for run in runs if run.preset == reference]
        for field in ("time_99", "map_error"):
            ratio = crossed_ratio(_outcomes(own, field), _outcomes(base, field))
            cells.append(_cell(ratio, "{:.2f}", min(len(own), len(base))))
        cells.append(_cell(interquartile_mean(_outcomes(own, "time_99")), "{:.0f}", len(own)))
        better = probability_of_improvement(_outcomes(own, "map_error"), _outcomes(base, "map_error"))
        cells.append("-" if name == reference else _cell(better, "{:.2f}", min(len(own), len(base))))
        rows.append(cells)
    text = markdown(headings, rows)
    if any(sum(run.preset == name for run in runs) < 2 for name in names):
        text += "\nNo interval where there is one seed: it would not show how much trainings differ.\n"
    return text


def draw_curves(runs: Sequence[ShapingRun], path: Path) -> None:
    """Learning curves: duration of the episodes of training over steps, mean of the seeds with its interval."""
    shown = []
    for name in dict.fromkeys(run.preset for run in runs):
        curves = [run.curve for run in runs if run.preset == name and len(run.curve) > 1]
        if not curves:  # runs too short to have one
            continue
        begin, end = max(c[0][0] for c in curves), min(c[-1][0] for c in curves)
        steps = np.linspace(begin, end, _POINTS)
        values = np.vstack([np.interp(steps, *np.array(curve).T) for curve in curves])
        shown.append(Curve(f"{name} ({len(curves)})", steps, values.mean(axis=0), mean_band(values)))
    plot_curves(path, [CurvePanel(shown, "decisions", "mean duration of the latest 100 episodes [s]")])


def draw_outcomes(runs: Sequence[ShapingRun], path: Path) -> None:
    """A page of pictures: every outcome of every preset, a dot for each seed and the interval of the mean."""
    names = list(dict.fromkeys(run.preset for run in runs))
    columns: dict[str, list[Spread]] = {heading: [] for _, heading, _ in OUTCOME_COLUMNS}
    for field, heading, _ in OUTCOME_COLUMNS:
        for name in names:
            values = _outcomes([run for run in runs if run.preset == name], field)
            interval = crossed_mean(values)
            columns[heading].append(Spread(values.mean(axis=1), interval.low, interval.high))
    plot_spreads(path, names, columns)


def _outcomes(runs: Sequence[ShapingRun], field: str) -> FloatArray:
    """A field of the outcomes, shape (runs, plans)."""
    return np.array([[getattr(outcome, field) for outcome in run.outcomes] for run in runs])


def _cell(interval: Interval, form: str, seeds: int) -> str:
    if seeds < 2:
        return form.format(interval.value)
    return f"{form.format(interval.value)} [{form.format(interval.low)}, {form.format(interval.high)}]"
