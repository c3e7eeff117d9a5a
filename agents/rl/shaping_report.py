"""The outcome of a reward-shaping experiment: a table with intervals, learning curves, a page of pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slamgym.agents.rl.reward_presets import BASE
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
from slamgym.core.text import markdown
from slamgym.core.types import FloatArray
from slamgym.viz.plots import Curve, CurvePanel, Spread, plot_curves, plot_spreads

_POINTS = 60


@dataclass(frozen=True)
class Column:
    """A field of the outcomes."""

    field: str
    heading: str
    form: str
    """Format of its figures."""
    ratio: bool = False
    """Whether its mean is set against the reference's, too."""


@dataclass(frozen=True)
class ReportForm:
    """What of the outcomes a report shows."""

    columns: tuple[Column, ...]
    aggregate: str
    """Field of which the interquartile mean is shown."""
    improved: str
    """Field whose probability of improvement is shown ..."""
    improves: Literal["below", "above"]
    """... and where an improved one lies."""
    curve: str
    """What the learning curves show."""


DECISION_REPORT = ReportForm(
    (
        Column("time", "time until done [s]", "{:.0f}", ratio=True),
        Column("path", "path until done [m]", "{:.1f}"),
        Column("time_99", "time to 99 % [s]", "{:.0f}"),
        Column("coverage", "coverage", "{:.3f}"),
        Column("map_error", "map error [m]", "{:.4f}", ratio=True),
    ),
    aggregate="time",
    improved="map_error",
    improves="below",
    curve="mean duration of the latest 100 episodes [s]",
)
"""Of :class:`slamgym.agents.rl.validation.PolicyOutcome`."""
WHEELS_REPORT = ReportForm(
    (
        Column("coverage", "coverage", "{:.3f}", ratio=True),
        Column("contacts", "contacts in 5 min", "{:.1f}"),
        Column("path", "path [m]", "{:.1f}"),
    ),
    aggregate="coverage",
    improved="coverage",
    improves="above",
    curve="mean coverage of the latest 100 episodes",
)
"""Of :class:`slamgym.agents.wheels.validation.DriveOutcome`."""


def write_shaping_report(runs: Sequence[ShapingRun[Any]], form: ReportForm, out: Path) -> str:
    """Write ``shaping.md``, ``curves.png`` and ``outcomes.png``.

    Args:
        runs: All runs.
        form: What to show of their outcomes.
        out: Folder.

    Returns:
        The table.

    Raises:
        SlamgymError: If matplotlib isn't installed.
    """
    text = table(runs, form)
    write_text(out / "shaping.md", text)
    draw_curves(runs, form, out / "curves.png")
    draw_outcomes(runs, form, out / "outcomes.png")
    return text


def table(runs: Sequence[ShapingRun[Any]], form: ReportForm) -> str:
    """Means over seeds and plans with 95 % intervals, and what is set against the preset ``time``.

    Both are drawn again for an interval (:func:`slamgym.core.intervals.crossed_ratio`), so it holds for other plans
    and other seeds of the training. With one seed there is none: other plans alone would make it too narrow. The
    interquartile mean, and the probability that a plan comes out better than with the reference, are those of Agarwal
    et al. 2021.
    """
    names = list(dict.fromkeys(run.preset for run in runs))
    reference = BASE if BASE in names else names[0]
    by_field = {column.field: column for column in form.columns}
    compared = [column for column in form.columns if column.ratio]
    headings = [
        "preset",
        "seeds",
        *(column.heading for column in form.columns),
        *(f"{_bare(column)} / {reference}" for column in compared),
        f"{_bare(by_field[form.aggregate])}, IQM",
        f"{_bare(by_field[form.improved])} {form.improves} {reference}'s",
    ]
    base = [run for run in runs if run.preset == reference]
    rows = []
    for name in names:
        own = [run for run in runs if run.preset == name]
        seeds = min(len(own), len(base))
        cells = [name, str(len(own))]
        cells += [_cell(crossed_mean(_outcomes(own, c.field)), c.form, len(own)) for c in form.columns]
        for column in compared:
            ratio = crossed_ratio(_outcomes(own, column.field), _outcomes(base, column.field))
            cells.append(_cell(ratio, "{:.2f}", seeds))
        middle = interquartile_mean(_outcomes(own, form.aggregate))
        cells.append(_cell(middle, by_field[form.aggregate].form, len(own)))
        sign = -1.0 if form.improves == "above" else 1.0
        ours, theirs = (sign * _outcomes(each, form.improved) for each in (own, base))
        better = probability_of_improvement(ours, theirs)
        cells.append("-" if name == reference else _cell(better, "{:.2f}", seeds))
        rows.append(cells)
    text = markdown(headings, rows)
    if any(sum(run.preset == name for run in runs) < 2 for name in names):
        text += "\nNo interval where there is one seed: it would not show how much trainings differ.\n"
    return text


def _bare(column: Column) -> str:
    """Its heading without the unit."""
    return column.heading.partition(" [")[0]


def draw_curves(runs: Sequence[ShapingRun[Any]], form: ReportForm, path: Path) -> None:
    """Learning curves over decisions: mean of the seeds with its interval."""
    shown = []
    for name in dict.fromkeys(run.preset for run in runs):
        curves = [run.curve for run in runs if run.preset == name and len(run.curve) > 1]
        if not curves:  # runs too short to have one
            continue
        begin, end = max(c[0][0] for c in curves), min(c[-1][0] for c in curves)
        steps = np.linspace(begin, end, _POINTS)
        values = np.vstack([np.interp(steps, *np.array(curve).T) for curve in curves])
        shown.append(Curve(f"{name} ({len(curves)})", steps, values.mean(axis=0), mean_band(values)))
    plot_curves(path, [CurvePanel(shown, "decisions", form.curve)])


def draw_outcomes(runs: Sequence[ShapingRun[Any]], form: ReportForm, path: Path) -> None:
    """A page of pictures: every outcome of every preset, a dot for each seed and the interval of the mean."""
    names = list(dict.fromkeys(run.preset for run in runs))
    columns: dict[str, list[Spread]] = {column.heading: [] for column in form.columns}
    for column in form.columns:
        for name in names:
            values = _outcomes([run for run in runs if run.preset == name], column.field)
            interval = crossed_mean(values)
            columns[column.heading].append(Spread(values.mean(axis=1), interval.low, interval.high))
    plot_spreads(path, names, columns)


def _outcomes(runs: Sequence[ShapingRun[Any]], field: str) -> FloatArray:
    """A field of the outcomes, shape (runs, plans)."""
    return np.array([[getattr(outcome, field) for outcome in run.outcomes] for run in runs])


def _cell(interval: Interval, form: str, seeds: int) -> str:
    if seeds < 2:
        return form.format(interval.value)
    return f"{form.format(interval.value)} [{form.format(interval.low)}, {form.format(interval.high)}]"
