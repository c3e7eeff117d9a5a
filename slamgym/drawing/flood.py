"""How much floor lies on both sides of a line, and how much of it another way joins: a flood of limited reach."""

from typing import Any, NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, FloatArray, GridFrame, IntArray

REACHES = (1.6, 3.2, 4.8)
"""The flood is looked at after so much walking [m]."""
SEAL = 0.1
"""A line is closed so far beyond its ends, for outlines are straighter than cells [m]."""
HALF_LINE = 0.71
"""Half of a line's thickness: no step to one of eight neighbours leaps over it [cells]."""
BESIDE_LINE = 1.5
"""The flood begins so far to its sides [cells]."""


class Flood(NamedTuple):
    """What is reached on both sides of N lines within each of the R :data:`REACHES`."""

    area: FloatArray  # (N, 2, R) [m2]
    widest: FloatArray  # (N, 2, R): largest clearance of what is reached [m]
    shared: FloatArray  # (N, R): reached from both sides [m2]


def limited_flood(
    lines: FloatArray, free: BoolArray, clearance: FloatArray, frame: GridFrame
) -> Flood:
    """Walk away from closed lines to both sides.

    Args:
        lines: (N, 2, 2) [m].
        free: Where one may walk, (H, W).
        clearance: Distance to what isn't free, (H, W) [m].
        frame: Where the cells lie.
    """
    cell = frame.resolution
    top_left = np.array([frame.origin_x, frame.origin_y + frame.height_px * cell])
    columns_and_rows = (lines - top_left) * (1.0, -1.0) / cell + 0.5  # of the padded pictures
    steps = np.round(np.array(REACHES) / cell).astype(np.int64)
    count, widest, shared = _flood_all(
        np.ascontiguousarray(columns_and_rows),
        np.pad(free, 1),
        np.pad(clearance, 1),
        steps,
        SEAL / cell,
    )
    area = count.astype(np.float64) * cell**2
    both = shared.astype(np.float64) * cell**2
    return Flood(area, widest, both)


@kernel
def _flood_all(
    lines: FloatArray, free: BoolArray, clearance: FloatArray, steps: IntArray, seal: float
) -> tuple[IntArray, FloatArray, IntArray]:
    """The floods of all lines; the pictures have a border of one cell, and all lengths are in cells.

    Each goes through a window that holds all it can reach: so small a part of a map stays in the processor's cache.
    """
    number, last = len(lines), len(steps)
    count = np.zeros((number, 2, last), np.int64)
    widest = np.zeros((number, 2, last))
    shared = np.zeros((number, last), np.int64)
    margin = steps[-1] + int(HALF_LINE + BESIDE_LINE) + 2
    side = int(np.abs(lines[:, 1] - lines[:, 0]).max()) + 2 * margin + 3
    queues = np.empty((2, side**2), np.int64)
    first_met = np.full(side**2, last, np.int64)
    for n in range(number):
        left = max(0, int(lines[n, :, 0].min()) - margin)
        top = max(0, int(lines[n, :, 1].min()) - margin)
        line = lines[n] - np.array([left, top], np.float64)
        window = free[top : top + side, left : left + side].copy()
        clear = clearance[top : top + side, left : left + side].copy().ravel()
        _close(line, window, seal)
        for k in range(2):
            _walk(line, k, window, steps, queues[k], count[n, k])
            _find_widest(clear, queues[k], count[n, k], widest[n, k])
        _count_shared(queues, count[n], first_met, shared[n])
    return count, widest, shared


@kernel
def _find_widest(
    clearance: FloatArray, queue: IntArray, count: IntArray, widest: FloatArray
) -> None:
    """The largest clearance among the first cells of a queue, for each count of them."""
    wide = 0.0
    first = 0
    for k in range(len(count)):
        for at in queue[first : count[k]]:
            wide = max(wide, clearance[at])
        first = count[k]
        widest[k] = wide


@kernel
def _count_shared(queues: IntArray, count: IntArray, met: IntArray, shared: IntArray) -> None:
    """How many cells are among the first of both queues, for each count of them; ``met`` is scratch space."""
    last = len(shared)
    for side in range(2):
        first = 0
        for k in range(last):
            for at in queues[side, first : count[side, k]]:
                if side == 0:
                    met[at] = k
                elif met[at] < last:
                    shared[max(k, met[at])] += 1
            first = count[side, k]
    for k in range(1, last):
        shared[k] += shared[k - 1]
    met[queues[0, : count[0, -1]]] = last


@kernel
def _place(line: FloatArray, row: Any, col: Any) -> tuple[float, float, float]:
    """How far along a line and aside of it a cell lies, and the line's length."""
    x, y = line[0]
    across, down = line[1] - line[0]
    length = np.hypot(across, down)
    along = ((col - x) * across + (row - y) * down) / length
    aside = ((row - y) * across - (col - x) * down) / length
    return along, aside, length


@kernel
def _close(line: FloatArray, free: BoolArray, seal: float) -> None:
    """Take the cells of a line from the free ones."""
    margin = HALF_LINE + seal + 1.0
    rows = _stretch(line[:, 1], margin, free.shape[0])
    cols = _stretch(line[:, 0], margin, free.shape[1])
    for row in range(*rows):
        for col in range(*cols):
            along, aside, length = _place(line, row, col)
            if abs(aside) <= HALF_LINE and -seal <= along <= length + seal:
                free[row, col] = False


@kernel
def _begin(line: FloatArray, side: int, free: BoolArray, left: BoolArray, queue: IntArray) -> int:
    """Put the free cells right beside a line into the queue; returns how many they are."""
    rows, cols = free.shape
    margin = HALF_LINE + BESIDE_LINE + 1.0
    size = 0
    for row in range(*_stretch(line[:, 1], margin, rows)):
        for col in range(*_stretch(line[:, 0], margin, cols)):
            along, aside, length = _place(line, row, col)
            is_side = (aside > 0.0) == (side == 1)
            is_beside = HALF_LINE < abs(aside) <= HALF_LINE + BESIDE_LINE
            if is_side and is_beside and 0.0 <= along <= length and free[row, col]:
                left[row * cols + col] = False
                queue[size] = row * cols + col
                size += 1
    return size


@kernel
def _stretch(places: FloatArray, margin: float, end: int) -> tuple[int, int]:
    """The first cell round two places, and that behind the last, within the picture's border."""
    return max(1, int(places.min() - margin)), min(end - 1, int(places.max() + margin) + 1)


@kernel
def _walk(
    line: FloatArray, side: int, free: BoolArray, steps: IntArray, queue: IntArray, count: IntArray
) -> None:
    """Breadth-first flood to four neighbours and to eight by turns: circles become octagons, 6 % off at most."""
    cols = free.shape[1]
    left = free.copy().ravel()
    moves = np.array([1, -1, cols, -cols, cols + 1, cols - 1, 1 - cols, -1 - cols])
    size = _begin(line, side, free, left, queue)
    first = 0
    k = 0
    for level in range(1, steps[-1] + 1):
        end = size
        for at in queue[first:end]:
            for turn in range(4 if level % 2 else 8):
                to = at + moves[turn]
                if left[to]:
                    left[to] = False
                    queue[size] = to
                    size += 1
        first = end
        if level == steps[k]:
            count[k] = size
            k += 1
