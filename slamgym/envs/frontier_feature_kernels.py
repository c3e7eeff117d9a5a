"""Kernels of the candidates' features: a coarse map, the unknown behind a frontier, a crop about it."""

import numpy as np
from numpy.typing import NDArray

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array

Int16Array = NDArray[np.int16]

UNKNOWN_CLASS = 0
FREE_CLASS = 1
OCCUPIED_CLASS = 2

_LETHAL = np.uint8(254)
_NO_INFORMATION = np.uint8(255)


@kernel
def classify(costs: ByteArray, coarsening: int) -> ByteArray:
    """Coarse classes of a costmap, shape (H // coarsening, W // coarsening).

    A coarse cell is occupied if any of its cells is, else free if any is, else unknown: walls stay closed.
    """
    height, width = costs.shape[0] // coarsening, costs.shape[1] // coarsening
    classes = np.zeros((height, width), np.uint8)
    for row in range(height):
        for col in range(width):
            found = 0
            for r in range(row * coarsening, (row + 1) * coarsening):
                for c in range(col * coarsening, (col + 1) * coarsening):
                    cost = costs[r, c]
                    if cost == _LETHAL:
                        found = 2
                    elif cost != _NO_INFORMATION and found == 0:
                        found = 1
            classes[row, col] = found
    return classes


@kernel
def explore_pocket(
    classes: ByteArray, labels: Int16Array, label: int, rows: NDArray[np.int64], cols: NDArray[np.int64],
    near_steps: int, far_steps: int, margin: int, num_labels: int,
) -> FloatArray:  # fmt: skip
    """What the unknown behind a frontier is like: flooded from the frontier, 4-connected, up to some distance.

    Args:
        classes: Coarse classes, shape (h, w).
        labels: The frontier that each coarse cell belongs to, -1 for none, shape (h, w).
        label: Of this frontier.
        rows: Its coarse cells.
        cols: Its coarse cells.
        near_steps: First distance [cells].
        far_steps: Second distance, where the flood ends [cells].
        margin: Cells this near to the edge of the grid lie outside the bounding box of what is known.
        num_labels: Number of frontiers.

    Returns:
        (cells within the first distance, cells within the second, share of these outside the box of the known,
        1 if the flood ended by itself, free cells met, occupied cells met, other frontiers met).
    """
    height, width = classes.shape
    seen = np.zeros(height * width, np.bool_)
    queue = np.empty(height * width, np.int32)
    met = np.zeros(num_labels, np.bool_)
    tail = _seed_pocket(classes, rows, cols, seen, queue)
    head, end, ring, near, outside = 0, tail, 0, tail, 0
    free, occupied = 0, 0
    while head < end and ring < far_steps:
        while head < end:
            cell = queue[head]
            head += 1
            row, col = cell // width, cell % width
            if row < margin or col < margin or row >= height - margin or col >= width - margin:
                outside += 1
            for k in range(4):
                r = row + (1 if k == 0 else (-1 if k == 1 else 0))
                c = col + (1 if k == 2 else (-1 if k == 3 else 0))
                if r < 0 or r >= height or c < 0 or c >= width or seen[r * width + c]:
                    continue
                seen[r * width + c] = True
                if labels[r, c] >= 0 and labels[r, c] != label:
                    met[labels[r, c]] = True
                if classes[r, c] == 0:
                    queue[tail] = r * width + c
                    tail += 1
                elif classes[r, c] == 1:
                    free += 1
                else:
                    occupied += 1
        end = tail
        ring += 1
        if ring == near_steps:
            near = tail
    if ring < near_steps:
        near = tail
    result = np.empty(7)
    result[0], result[1] = near, tail
    result[2] = outside / tail if tail else 0.0
    result[3] = 1.0 if head == tail else 0.0
    result[4], result[5], result[6] = free, occupied, np.count_nonzero(met)
    return result


@kernel
def _seed_pocket(
    classes: ByteArray, rows: NDArray[np.int64], cols: NDArray[np.int64], seen: BoolArray, queue: Int32Array
) -> int:
    """Queue the unknown cells at and beside a frontier; returns their number."""
    height, width = classes.shape
    tail = 0
    for i in range(len(rows)):
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                r, c = rows[i] + dr, cols[i] + dc
                if 0 <= r < height and 0 <= c < width and classes[r, c] == 0 and not seen[r * width + c]:
                    seen[r * width + c] = True
                    queue[tail] = r * width + c
                    tail += 1
    return tail


@kernel
def cut_frontier_crop(
    classes: ByteArray, row: float, col: float, direction: float, cell: float, crop: Float32Array
) -> None:
    """Fill a crop of the coarse map about a point, turned so that a direction points up.

    Args:
        classes: Coarse classes, shape (h, w); unknown beyond.
        row: Centre [coarse cells].
        col: Centre [coarse cells].
        direction: Counter-clockwise from +x [rad]; rows grow downwards.
        cell: Size of the crop's cells [coarse cells]; each takes the mean of 3 x 3 samples.
        crop: Shares of free and of occupied, shape (2, n, n); filled.
    """
    height, width = classes.shape
    size = crop.shape[1]
    sin, cos = np.sin(direction), np.cos(direction)
    half = 0.5 * size
    for i in range(size):
        for j in range(size):
            free, occupied = 0, 0
            for a in range(3):
                for b in range(3):
                    ahead = (half - i - (a + 0.5) / 3.0) * cell
                    right = (j + (b + 0.5) / 3.0 - half) * cell
                    r = int(np.floor(row - ahead * sin + right * cos + 0.5))
                    c = int(np.floor(col + ahead * cos + right * sin + 0.5))
                    if 0 <= r < height and 0 <= c < width:
                        free += classes[r, c] == 1
                        occupied += classes[r, c] == 2
            crop[0, i, j] = free / 9.0
            crop[1, i, j] = occupied / 9.0
