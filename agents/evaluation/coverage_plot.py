"""Coverage over time, all explorers in one picture, with bands."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.evaluation.coverage_curve import mean_coverage
from slamgym.agents.evaluation.trial import Trial
from slamgym.core.errors import ConfigError
from slamgym.core.files import staged
from slamgym.core.intervals import mean_band

_POINTS = 200
_LEVELS = ("0.95", "0.99")
_COLOURS = (
    "#1971c2", "#e03131", "#2f9e44", "#f08c00", "#9c36b5", "#0c8599", "#6741d9", "#e8590c", "#66a80f", "#868e96",
)  # fmt: skip


def draw_coverage(trials: Sequence[Trial], path: Path, title: str = "") -> None:
    """Draw mean coverage over time with bands, and how many explorations had seen 95 % and 99 % when.

    Bands are 95 % bootstrap intervals of the mean over explorations. Time is robot time per floor area, so that
    plans of different sizes can be averaged.

    Args:
        trials: Of all explorers.
        path: PNG to write.
        title: Heading of the picture.

    Raises:
        ConfigError: If matplotlib is not installed.
        InputFileError: If the picture can't be written.
    """
    figure, axes = _figure()
    left, *rights = axes
    names = list(dict.fromkeys(trial.explorer for trial in trials))
    end = _end(trials)
    times = np.linspace(0.0, end, _POINTS)  # [s/m2]
    for number, name in enumerate(names):
        own = [trial for trial in trials if trial.explorer == name]
        colour, label = _COLOURS[number % len(_COLOURS)], f"{name} ({len(own)})"
        curves = np.vstack([mean_coverage([t.coverage_curve], times * t.area)[0] for t in own])
        low, high = mean_band(curves)
        left.plot(times, curves.mean(axis=0), color=colour, label=label, linewidth=1.6)
        left.fill_between(times, low, high, color=colour, alpha=0.15, linewidth=0.0)
        for axis, level in zip(rights, _LEVELS, strict=True):
            reached = np.array([_per_area(t, level) for t in own])
            axis.plot(times, (reached[:, None] <= times).mean(axis=0), color=colour, linewidth=1.4)
    left.set_title(title or "mean, with its 95 % interval", fontsize=10)
    left.set_ylabel("share of the reachable floor seen")
    left.legend(loc="lower right", fontsize=8, frameon=False)
    for axis, level in zip(rights, _LEVELS, strict=True):
        axis.set_title(f"explorations that have seen {100 * float(level):g} %", fontsize=10)
        axis.set_ylabel("share of explorations")
    for axis in axes:
        axis.set(xlabel="robot time per floor area [s/m²]", xlim=(0, end), ylim=(0, 1.01))
        axis.grid(alpha=0.25)
    with staged(path) as part:
        figure.savefig(part, dpi=120)


def _figure() -> tuple[Any, Any]:
    """An empty figure with three axes, drawn without a window."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ConfigError(
            "the plot needs matplotlib; pip install 'slamgym[agents]', or leave it out with --no-plot"
        ) from error
    figure = Figure(figsize=(14.0, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, 3)


def _per_area(trial: Trial, level: str) -> float:
    """Time to a level per floor area [s/m2]; inf if it was never reached."""
    value = trial.time_to[level]
    return np.inf if value is None else value / trial.area


def _end(trials: Sequence[Trial]) -> float:
    """Right end of the time axis [s/m2]: by then nine of ten explorations have reached 99 %."""
    reached = [_per_area(trial, "0.99") for trial in trials if trial.time_to["0.99"] is not None]
    return float(np.percentile(reached, 90.0)) if reached else 10.0
