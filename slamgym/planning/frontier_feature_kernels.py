"""Kernels of frontiers' features: a coarse map, the unknown region behind a frontier, and sight."""

import numpy as np
from numpy.typing import NDArray

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, ByteArray, FloatArray, Int32Array, IntArray
from slamgym.planning.costmap import LETHAL_COST, NO_INFORMATION

Int16Array = NDArray[np.int16]

FREE_CLASS = 1
OCCUPIED_CLASS = 2

UNKNOWN_CLASS = 0

RAYS = 72
"""Directions in which the unknown in sight of a cell is looked for."""
UNKNOWN_REGION = ("near", "far", "outside", "is_enclosed", "free", "occupied", "frontiers")
"""What is measured of the unknown region behind a frontier, flooded from it up to some distance, in coarse cells: those
within a first distance and within the second, the share of these outside the box of what is known, 1 if the flood ended
by itself, else 0; and those that it met, free, occupied, or of how many other frontiers."""


@kernel
def classify_costs(costs: ByteArray, coarsening: int) -> ByteArray:
    """Coarse classes of a costmap, shape (H // coarsening, W // coarsening).

    A coarse cell is occupied if any of its cells is, else free if any is, else unknown: walls stay closed.
    """
    height = costs.shape[0] // coarsening
    width = costs.shape[1] // coarsening
    classes = np.zeros((height, width), np.uint8)
    for row in range(height * coarsening):
        for col in range(width * coarsening):
            cost = costs[row, col]
            if cost == LETHAL_COST:
                classes[row // coarsening, col // coarsening] = OCCUPIED_CLASS
            elif cost != NO_INFORMATION:
                known = classes[row // coarsening, col // coarsening]
                classes[row // coarsening, col // coarsening] = max(known, FREE_CLASS)
    return classes


@kernel
def explore_unknown_regions(
    costs: ByteArray,
    cells: Int32Array,
    starts: IntArray,
    coarsening: int,
    steps: tuple[int, int],
    margin: int,
) -> FloatArray:
    """Flood the unknown region behind each frontier, on a coarse map.

    Args:
        costs: Costmap, shape (H, W).
        cells: The frontiers' cells, shape (M, 2); those beyond the coarse map count as on its edge.
        starts: Where each frontier begins, with the end appended, shape (N + 1,).
        coarsening: Side of a coarse cell [cells].
        steps: As for :func:`explore_unknown_region`, like the margin.
        margin: See there.

    Returns:
        What :data:`UNKNOWN_REGION` names of each, shape (N, 7).
    """
    classes = classify_costs(costs, coarsening)
    height, width = classes.shape
    count = len(starts) - 1
    coarse = np.empty((len(cells), 2), np.int64)
    labels = np.full(classes.shape, -1, np.int16)
    for label in range(count):
        for i in range(starts[label], starts[label + 1]):
            coarse[i, 0] = min(cells[i, 0] // coarsening, height - 1)
            coarse[i, 1] = min(cells[i, 1] // coarsening, width - 1)
            labels[coarse[i, 0], coarse[i, 1]] = label
    regions = np.empty((count, len(UNKNOWN_REGION)))
    for label in range(count):
        own = coarse[starts[label] : starts[label + 1]]
        regions[label] = explore_unknown_region(classes, labels, label, own, steps, margin, count)
    return regions


@kernel
def explore_unknown_region(
    classes: ByteArray,
    labels: Int16Array,
    label: int,
    cells: IntArray,
    steps: tuple[int, int],
    margin: int,
    num_labels: int,
) -> FloatArray:
    """Flood the unknown region behind a frontier, 4-connected.

    Args:
        classes: Coarse classes, shape (h, w).
        labels: The frontier that each coarse cell belongs to, -1 for none, shape (h, w).
        label: Of this frontier.
        cells: Its coarse cells, shape (N, 2).
        steps: First distance, and the second, where the flood ends [cells].
        margin: Cells this near to the edge of the grid lie outside the bounding box of what is known.
        num_labels: Number of frontiers.

    Returns:
        What :data:`UNKNOWN_REGION` names.
    """
    near_steps, far_steps = steps
    height, width = classes.shape
    seen = np.zeros(height * width, np.bool_)
    queue = np.empty(height * width, np.int32)
    met = np.zeros(num_labels, np.bool_)
    tail = _seed_unknown_region(classes, cells, seen, queue)
    head = 0
    end = tail
    ring = 0
    near = tail
    outside = 0
    free = 0
    occupied = 0
    others = 0
    while head < end and ring < far_steps:
        while head < end:
            cell = queue[head]
            head += 1
            row = cell // width
            col = cell % width
            if row < margin or col < margin or row >= height - margin or col >= width - margin:
                outside += 1
            for dr, dc in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                r = row + dr
                c = col + dc
                if r < 0 or r >= height or c < 0 or c >= width or seen[r * width + c]:
                    continue
                seen[r * width + c] = True
                if labels[r, c] >= 0 and labels[r, c] != label:
                    others += int(not met[labels[r, c]])
                    met[labels[r, c]] = True
                if classes[r, c] == UNKNOWN_CLASS:
                    queue[tail] = r * width + c
                    tail += 1
                elif classes[r, c] == FREE_CLASS:
                    free += 1
                else:
                    occupied += 1
        end = tail
        ring += 1
        if ring == near_steps:
            near = tail
    if ring < near_steps:
        near = tail
    is_enclosed = 1.0 if head == tail else 0.0
    share = outside / tail if tail else 0.0
    return np.array([float(near), tail, share, is_enclosed, free, occupied, others])


@kernel
def _seed_unknown_region(
    classes: ByteArray, cells: IntArray, seen: BoolArray, queue: Int32Array
) -> int:
    """Queue the unknown cells at and next to a frontier; returns their number."""
    height, width = classes.shape
    tail = 0
    for i in range(len(cells)):
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                r = cells[i, 0] + dr
                c = cells[i, 1] + dc
                if r < 0 or r >= height or c < 0 or c >= width:
                    continue
                if classes[r, c] == UNKNOWN_CLASS and not seen[r * width + c]:
                    seen[r * width + c] = True
                    queue[tail] = r * width + c
                    tail += 1
    return tail


@kernel
def unknown_by_ray(costs: ByteArray, row: int, col: int, max_range: float) -> FloatArray:
    """Unknown area in sight of a cell in each direction, shape (RAYS,) [cells^2].

    Ray i points i * 5 degrees clockwise from +x. It stands for its sector, so a cell at distance r counts r
    times the angle between two rays. It ends at a lethal cell; beyond the costmap all is unknown.
    """
    height, width = costs.shape
    step = 2.0 * np.pi / RAYS
    areas = np.zeros(RAYS)
    for i in range(RAYS):
        dr = np.sin(i * step)
        dc = np.cos(i * step)
        for r in range(1, int(max_range) + 1):
            rr = int(np.floor(row + r * dr + 0.5))
            cc = int(np.floor(col + r * dc + 0.5))
            cost = NO_INFORMATION
            if 0 <= rr < height and 0 <= cc < width:
                cost = costs[rr, cc]
            if cost == LETHAL_COST:
                break
            if cost == NO_INFORMATION:
                areas[i] += r * step
    return areas


@kernel
def unknown_by_rays(costs: ByteArray, cells: IntArray, max_range: float) -> FloatArray:
    """:func:`unknown_by_ray` of several cells (N, 2), shape (N, RAYS)."""
    areas = np.empty((len(cells), RAYS))
    for i in range(len(cells)):
        areas[i] = unknown_by_ray(costs, cells[i, 0], cells[i, 1], max_range)
    return areas
