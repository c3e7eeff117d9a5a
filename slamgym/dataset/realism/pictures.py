"""Pictures of the realism page: examples of what tells, confident patches, and maps mixed for a blind look."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.core.types import FREE, ByteArray, IntArray
from slamgym.dataset.realism.comparison import StatisticRow, most_unlike
from slamgym.dataset.realism.map_sets import MapSet, MeasuredMap
from slamgym.metrics.maps import free_boundary
from slamgym.viz.canvas import UNKNOWN_TINT, blank, colour_cells, with_heading
from slamgym.viz.sheets import Card, draw_sheet

EXAMPLES = 4
"""Maps of either side that are shown for a statistic."""
_WINDOW = 128  # [cells] of an example
_PANEL_PX = 256
_MIXED_WINDOW = 320  # [cells] of a map in the mixture: 16 m
_PATCH_PX = 160
_MIXED_COLUMNS = 6


class Figure(NamedTuple):
    """A picture of the page."""

    heading: str
    picture: ByteArray
    """RGB, (H, W, 3)."""


class KeyEntry(NamedTuple):
    """What a number on the mixed sheet stands for."""

    number: int
    set: str
    name: str


def draw_examples(own: MapSet, references: Sequence[MapSet], row: StatisticRow) -> Figure:
    """Draw maps of the dataset and of the references at their ends of a statistic."""
    others = [(reference.name, one) for reference in references for one in reference.maps]
    mine, theirs = most_unlike(own.maps, [one for _, one in others], row.name, EXAMPLES)
    chosen = [(own.name, own.maps[i]) for i in mine] + [others[i] for i in theirs]
    cards = [
        Card((_window(one, _WINDOW),), (f"{one.statistics[row.name]:.3g}  {name}", one.name[-40:]))
        for name, one in chosen
    ]
    return Figure(f"{row.label}: {own.name} above, references below", draw_sheet(cards, EXAMPLES, _PANEL_PX))


def draw_patches(title: str, sides: Mapping[str, Sequence[tuple[str, ByteArray, float]]]) -> Figure:
    """Draw patches that a network was sure of.

    Args:
        title: Of the figure.
        sides: By set, the map's name, the patch (side, side) and the probability of that set, for each patch; as
            many for each set.
    """
    cards = [
        Card((colour_cells(patch),), (f"{probability:.3f}  {side}", name[-28:]))
        for side, patches in sides.items()
        for name, patch, probability in patches
    ]
    return Figure(title, draw_sheet(cards, len(cards) // len(sides), _PATCH_PX))


def draw_mixed(
    own: MapSet, references: Sequence[MapSet], count: int, seed: int = 0
) -> tuple[ByteArray, list[KeyEntry]]:
    """Draw maps of the dataset and as many of the references in a random order, all at one scale, numbered alone.

    Args:
        own: The dataset.
        references: They take turns.
        count: Maps of either side; fewer if there are not so many.
        seed: Of the choice and the order.

    Returns:
        The sheet, and what its numbers stand for.
    """
    rng = np.random.default_rng(seed)
    mine = [(own.name, own.maps[i]) for i in rng.permutation(len(own.maps))]
    orders = [(s, rng.permutation(len(s.maps)).tolist()) for s in references]
    rounds = range(max(len(order) for _, order in orders))
    theirs = [(s.name, s.maps[order[k]]) for k in rounds for s, order in orders if k < len(order)]
    count = min(count, len(mine), len(theirs))
    both = [*mine[:count], *theirs[:count]]
    shown = [both[i] for i in rng.permutation(len(both))]
    cards = [
        Card((_window(one, _MIXED_WINDOW),), (f"{number}",)) for number, (_, one) in enumerate(shown, start=1)
    ]
    key = [KeyEntry(number, name, one.name) for number, (name, one) in enumerate(shown, start=1)]
    return draw_sheet(cards, _MIXED_COLUMNS, _MIXED_WINDOW), key


def stack_figures(figures: Sequence[Figure]) -> ByteArray:
    """All figures under each other, each below its heading."""
    width = max(figure.picture.shape[1] for figure in figures)
    padded = [
        np.pad(f.picture, ((0, 0), (0, width - f.picture.shape[1]), (0, 0)), constant_values=255)
        for f in figures
    ]
    return np.vstack([with_heading(p, f.heading) for p, f in zip(padded, figures, strict=True)])


def _window(one: MeasuredMap, side: int) -> ByteArray:
    """The square of a map with most border of free space in it, RGB; smaller maps lie in its middle."""
    floor = one.floor
    size = tuple(min(side, n) for n in floor.shape)
    sums: IntArray = cv2.integral(free_boundary(floor == FREE).astype(np.uint8)).astype(np.int64)
    rows, cols = size
    inside = sums[rows:, cols:] - sums[:-rows, cols:] - sums[rows:, :-cols] + sums[:-rows, :-cols]
    top, left = np.unravel_index(int(inside.argmax()), inside.shape)
    picture = blank((side, side), UNKNOWN_TINT)
    y, x = (side - rows) // 2, (side - cols) // 2
    picture[y : y + rows, x : x + cols] = colour_cells(floor[top : top + rows, left : left + cols])
    return picture
