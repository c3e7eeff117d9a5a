"""Plots by matplotlib: curves with bands, boxes."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.files import staged
from slamgym.core.types import FloatArray

_COLOURS = (
    "#1971c2", "#e03131", "#2f9e44", "#f08c00", "#9c36b5", "#0c8599", "#6741d9", "#66a80f", "#868e96", "#000000",
)  # fmt: skip


class Curve(NamedTuple):
    """A line, with a band if there is one."""

    label: str
    x: FloatArray  # (N,)
    y: FloatArray  # (N,)
    band: tuple[FloatArray, FloatArray] | None = None  # low and high (N,)


class CurvePanel(NamedTuple):
    """Curves of shares from 0 to 1 on one pair of axes."""

    curves: Sequence[Curve]
    x_label: str
    y_label: str
    title: str = ""


def plot_curves(path: Path, panels: Sequence[CurvePanel]) -> None:
    """Plot curves on panels side by side; the first has the legend.

    Args:
        path: PNG to write.
        panels: At least one. Curves at the same place of their panels have the same colour.

    Raises:
        SlamgymError: If matplotlib isn't installed.
        InputFileError: If the file can't be written.
    """
    with _figure(path, len(panels), (3.2 + 4.3 * len(panels), 4.7)) as axes:
        for axis, panel in zip(axes, panels, strict=True):
            for curve, colour in zip(panel.curves, itertools.cycle(_COLOURS)):
                axis.plot(curve.x, curve.y, color=colour, label=curve.label, linewidth=1.6)
                if curve.band is not None:
                    axis.fill_between(curve.x, *curve.band, color=colour, alpha=0.15, linewidth=0.0)
            axis.set_title(panel.title, fontsize=10)
            axis.set(xlabel=panel.x_label, ylabel=panel.y_label, ylim=(0.0, 1.01))
            axis.margins(x=0.0)
            axis.grid(alpha=0.25)
        if panels[0].curves:
            axes[0].legend(loc="best", fontsize=8, frameon=False)


def plot_boxes(path: Path, samples: Mapping[str, FloatArray], label: str) -> None:
    """Plot a box for each sample, with its mean, and a line at zero.

    Args:
        path: PNG to write.
        samples: By name, shape (N,).
        label: What the values are.

    Raises:
        SlamgymError: If matplotlib isn't installed.
        InputFileError: If the file can't be written.
    """
    with _figure(path, 1, (7.0, 1.2 + 0.62 * len(samples))) as (axis,):
        axis.boxplot(
            list(samples.values())[::-1],
            orientation="horizontal",
            widths=0.55,
            showmeans=True,
            medianprops={"color": "#1f5fa8", "linewidth": 1.6},
            meanprops=dict.fromkeys(("markerfacecolor", "markeredgecolor"), "#d9822b") | {"marker": "D"},
            flierprops={"marker": ".", "markersize": 3, "alpha": 0.5},
        )
        axis.set_yticks(range(1, len(samples) + 1), list(samples)[::-1])
        axis.axvline(0.0, color="0.5", linewidth=0.8, linestyle="--")
        axis.set_xlabel(label)
        axis.spines[["top", "right"]].set_visible(False)


@contextmanager
def _figure(path: Path, count: int, size: tuple[float, float]) -> Iterator[list[Any]]:
    """Give the axes of a figure that has no window; write it when the block ends well."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SlamgymError(
            "plots need matplotlib; install it with: pip install 'slamgym[agents]' or 'slamgym[gan]'"
        ) from error
    figure = Figure(figsize=size, dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    yield list(np.atleast_1d(figure.subplots(1, count)))
    with staged(path) as part:
        figure.savefig(part, format="png")
