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
    """The floods of all lines; the pictures have a border of one cell, and all lengths are in cells."""
    number, last = len(lines), len(steps)
    arrival = np.full((2, free.size), -1, np.int64)
    queue = np.empty((2, free.size), np.int64)
    count = np.zeros((number, 2, last), np.int64)
    widest = np.zeros((number, 2, last))
    shared = np.zeros((number, last), np.int64)
    for n in range(number):
        for side in range(2):
            size = _begin(lines[n], side, free, arrival[side], queue[side])
            _walk(lines[n], free, steps, seal, arrival[side], queue[side], size, count[n, side])
            wide = 0.0
            first = 0
            for k in range(last):
                for at in queue[side, first : count[n, side, k]]:
                    wide = max(wide, clearance.ravel()[at])
                first = count[n, side, k]
                widest[n, side, k] = wide
        for at in queue[0, : count[n, 0, -1]]:
            for k in range(last):
                later = max(arrival[0, at], arrival[1, at])
                shared[n, k] += arrival[1, at] >= 0 and later <= steps[k]
        for side in range(2):
            for at in queue[side, : count[n, side, -1]]:
                arrival[side, at] = -1
    return count, widest, shared


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
def _begin(line: FloatArray, side: int, free: BoolArray, arrival: IntArray, queue: IntArray) -> int:
    """Put the free cells right beside a line into the queue; returns how many they are."""
    rows, cols = free.shape
    margin = HALF_LINE + BESIDE_LINE + 1.0
    size = 0
    for row in range(
        max(1, int(line[:, 1].min() - margin)), min(rows - 1, int(line[:, 1].max() + margin) + 1)
    ):
        for col in range(
            max(1, int(line[:, 0].min() - margin)),
            min(cols - 1, int(line[:, 0].max() + margin) + 1),
        ):
            along, aside, length = _place(line, row, col)
            is_side = (aside > 0.0) == (side == 1)
            is_beside = HALF_LINE < abs(aside) <= HALF_LINE + BESIDE_LINE
            if is_side and is_beside and 0.0 <= along <= length and free[row, col]:
                arrival[row * cols + col] = 0
                queue[size] = row * cols + col
                size += 1
    return size


@kernel
def _walk(
    line: FloatArray,
    free: BoolArray,
    steps: IntArray,
    seal: float,
    arrival: IntArray,
    queue: IntArray,
    size: int,
    count: IntArray,
) -> None:
    """Breadth-first flood to four neighbours and to eight by turns: circles become octagons, 6 % off at most."""
    cols = free.shape[1]
    is_free = free.ravel()
    moves = np.array([1, -1, cols, -cols, cols + 1, cols - 1, 1 - cols, -1 - cols])
    margin = HALF_LINE + seal + 1.0
    left, right = line[:, 0].min() - margin, line[:, 0].max() + margin
    top, bottom = line[:, 1].min() - margin, line[:, 1].max() + margin
    first = 0
    k = 0
    for level in range(1, steps[-1] + 1):
        end = size
        for at in queue[first:end]:
            for turn in range(4 if level % 2 else 8):
                to = at + moves[turn]
                if arrival[to] >= 0 or not is_free[to]:
                    continue
                row = to // cols
                col = to - row * cols
                if top <= row <= bottom and left <= col <= right:
                    along, aside, length = _place(line, row, col)
                    if abs(aside) <= HALF_LINE and -seal <= along <= length + seal:
                        continue
                arrival[to] = level
                queue[size] = to
                size += 1
        first = end
        if level == steps[k]:
            count[k] = size
            k += 1
