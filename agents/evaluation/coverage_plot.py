"""Coverage over time, all explorers in one picture, with bands."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slamgym.agents.evaluation.coverage_curve import mean_coverage
from slamgym.agents.evaluation.trial import Trial
from slamgym.core.intervals import mean_band
from slamgym.viz.plots import Curve, CurvePanel, plot_curves

_POINTS = 200
_LEVELS = ("0.95", "0.99")


def draw_coverage(trials: Sequence[Trial], path: Path, title: str = "") -> None:
    """Draw mean coverage over time with bands, and how many explorations had seen 95 % and 99 % when.

    Bands are 95 % bootstrap intervals of the mean over explorations. Time is robot time per floor area, so that
    plans of different sizes can be averaged.

    Args:
        trials: Of all explorers.
        path: PNG to write.
        title: Heading of the picture.

    Raises:
        SlamgymError: If matplotlib is not installed.
        InputFileError: If the picture can't be written.
    """
    end = _end(trials)
    times = np.linspace(0.0, end, _POINTS)  # [s/m2]
    means: list[Curve] = []
    reached: dict[str, list[Curve]] = {level: [] for level in _LEVELS}
    for name in dict.fromkeys(trial.explorer for trial in trials):
        own = [trial for trial in trials if trial.explorer == name]
        curves = np.vstack([mean_coverage([t.coverage_curve], times * t.area)[0] for t in own])
        means.append(Curve(f"{name} ({len(own)})", times, curves.mean(axis=0), mean_band(curves)))
        for level, shares in reached.items():
            share = (np.array([_per_area(t, level) for t in own])[:, None] <= times).mean(axis=0)
            shares.append(Curve(name, times, share))
    axis = "robot time per floor area [s/m²]"
    title = title or "mean, with its 95 % interval"
    panels = [CurvePanel(means, axis, "share of the reachable floor seen", title, is_share=True)]
    for level, shares in reached.items():
        title = f"explorations that have seen {100 * float(level):g} %"
        panels.append(CurvePanel(shares, axis, "share of explorations", title, is_share=True))
    plot_curves(path, panels)


def _per_area(trial: Trial, level: str) -> float:
    """Time to a level per floor area [s/m2]; inf if it was never reached."""
    value = trial.time_to[level]
    return np.inf if value is None else value / trial.area


def _end(trials: Sequence[Trial]) -> float:
    """Right end of the time axis [s/m2]: by then nine of ten explorations have reached 99 %."""
    reached = [_per_area(trial, "0.99") for trial in trials if trial.time_to["0.99"] is not None]
    return float(np.percentile(reached, 90.0)) if reached else 10.0
