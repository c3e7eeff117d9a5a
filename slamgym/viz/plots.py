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
    "#1971c2",
    "#e03131",
    "#2f9e44",
    "#f08c00",
    "#9c36b5",
    "#0c8599",
    "#6741d9",
    "#66a80f",
    "#868e96",
    "#000000",
)


class Curve(NamedTuple):
    """A line with a band."""

    label: str
    x: FloatArray  # (N,)
    y: FloatArray  # (N,)
    band: tuple[FloatArray, FloatArray]  # low and high (N,)


def plot_curves(path: Path, curves: Sequence[Curve], labels: tuple[str, str], title: str) -> None:
    """Plot curves of shares from 0 to 1.

    Args:
        path: PNG to write.
        curves: Each gets a colour of its own.
        labels: Of both axes.
        title: Above them.

    Raises:
        SlamgymError: If matplotlib isn't installed.
        InputFileError: If the file can't be written.
    """
    with _figure(path, (7.5, 4.7)) as axis:
        for curve, colour in zip(curves, itertools.cycle(_COLOURS)):
            axis.plot(curve.x, curve.y, color=colour, label=curve.label, linewidth=1.6)
            low, high = curve.band
            axis.fill_between(curve.x, low, high, color=colour, alpha=0.15, linewidth=0.0)
        axis.set_title(title, fontsize=10)
        x_label, y_label = labels
        axis.set(xlabel=x_label, ylabel=y_label, ylim=(0.0, 1.01))
        axis.margins(x=0.0)
        axis.grid(alpha=0.25)
        axis.legend(loc="best", fontsize=8, frameon=False)


def plot_losses(
    path: Path, epochs: FloatArray, panels: Mapping[str, FloatArray], changes: Mapping[float, str]
) -> None:
    """Plot losses over the epochs of a training, one above the other, as Figure 4 of the paper.

    Args:
        path: PNG to write.
        epochs: Where they were noted, shape (N,).
        panels: By name, shape (N,).
        changes: Epoch of each change to the words beside it.

    Raises:
        SlamgymError: If matplotlib isn't installed.
        InputFileError: If the file can't be written.
    """
    with _figure(path, (7.5, 2.6 * len(panels)), len(panels)) as axes:
        # One panel comes without a list around it.
        for axis, name, colour in zip(np.ravel(axes), panels, _COLOURS, strict=False):
            axis.plot(epochs, panels[name], color=colour, linewidth=1.2)
            axis.set(xlabel="epoch", ylabel=name)
            axis.margins(x=0.0)
            axis.grid(alpha=0.25)
            for epoch, words in changes.items():
                axis.axvline(epoch, color="0.4", linewidth=0.8, linestyle="--")
                place = (epoch, axis.get_ylim()[1])
                axis.annotate(words, place, (3, -9), textcoords="offset points", fontsize=8)


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
    with _figure(path, (7.0, 1.2 + 0.62 * len(samples))) as axis:
        axis.boxplot(
            list(samples.values())[::-1],
            orientation="horizontal",
            widths=0.55,
            showmeans=True,
            medianprops={"color": "#1f5fa8", "linewidth": 1.6},
            meanprops={"markerfacecolor": "#d9822b", "markeredgecolor": "#d9822b", "marker": "D"},
            flierprops={"marker": ".", "markersize": 3, "alpha": 0.5},
        )
        axis.set_yticks(range(1, len(samples) + 1), list(samples)[::-1])
        axis.axvline(0.0, color="0.5", linewidth=0.8, linestyle="--")
        axis.set_xlabel(label)
        axis.spines[["top", "right"]].set_visible(False)


@contextmanager
def _figure(path: Path, size: tuple[float, float], rows: int = 1) -> Iterator[Any]:
    """Give the axes of a figure that has no window, or those of several rows; write it when the block ends well."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SlamgymError(
            "plots need matplotlib; install it with: pip install 'slamgym[agents]' or 'slamgym[gan]'"
        ) from error
    figure = Figure(figsize=size, dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    yield figure.subplots(rows)
    with staged(path) as part:
        figure.savefig(part, format="png")
