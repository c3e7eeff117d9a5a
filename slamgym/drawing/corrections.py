"""Where the map overrules the model: floor that only rays have seen isn't drawn, walls that were seen long are.

Rays that leave through a window or a far door make stripes of free cells. Straight rows of occupied cells with free
cells on both sides are walls, whatever a model that has learnt to remove furniture makes of them.
"""

import math

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, BoolArray, Float32Array, OccupancyGrid
from slamgym.gan.translation.classical import without_small
from slamgym.gan.translation.derotation import padded_for_turning, transformed
from slamgym.metrics.maps import distance_to

SINGLE_RAYS = 0.2
"""Free space narrower than this was seen by single rays; no floor is drawn for it alone [m]."""
SHORTEST_LOST_WALL = 1.0
"""Straight walls of this length that were seen from both sides are drawn against the model [m]."""
LONGEST_FRONT = 3.2
"""A straight front of this length with nothing seen behind it is a wall, not a piece of furniture [m]."""
WIDEST_UNSEEN = 2.0
"""Unseen places between free cells at most so far apart may be floor: under a bed, behind a wardrobe [m]."""
BEYOND_FREE = 0.6
"""Floor goes on beyond what was seen free by at most this: behind a wall's echoes, drift, furniture [m]."""
SMALLEST_WIDE = 0.5
"""Separate wide free space smaller than this is left to the rays [m2]."""
BROKEN_ECHOES = 0.15
"""Gaps in a row of echoes at most so long belong to its wall [m]."""
THICKEST_LOST_WALL = 0.35
"""A row of echoes between two free spaces is a wall up to this thickness [m]."""
BOTH_SIDES = 0.7
"""Of a wall that is drawn against the model so much of the length has free cells on both sides."""
ATTACHED_WITHIN = 0.25
"""Its end lies so near to a wall that the model has drawn [m]."""
LEAST_BEHIND = 0.3
"""A front that the model has drawn less than so far behind its echoes is its wall already [m]."""
DEEPEST_BEHIND = 1.5
"""What is drawn behind a wall that was seen from one side is taken away up to this depth [m]."""


def corrected(probability: Float32Array, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
    """A model's picture where the map bears it out.

    Args:
        probability: Of being floor, shape of the map.
        grid: The map.
        angle_deg: Direction of the main walls, counter-clockwise from the x axis.
    """
    cell = grid.frame.resolution
    result = np.where(believable(grid.cells == FREE, cell), probability, 0.0).astype(np.float32)
    result[lost_walls(result, grid, angle_deg)] = 0.0
    return result


def believable(free: BoolArray, cell: float) -> BoolArray:
    """Where floor may be: near to free space that is wider than rays.

    Args:
        free: Free cells, shape (rows, cols).
        cell: [m]
    """
    border = math.ceil(0.5 * WIDEST_UNSEEN / cell) + 2
    padded = np.pad(free, border)
    half_ray, half_gap = 0.5 * SINGLE_RAYS / cell, 0.5 * WIDEST_UNSEEN / cell
    wide = distance_to(distance_to(~padded) > half_ray) <= half_ray
    wide = without_small(wide, SMALLEST_WIDE / cell**2)
    if not wide.any():
        return np.ones_like(free)
    closed = distance_to(distance_to(wide) > half_gap) > half_gap
    near: BoolArray = distance_to(closed) <= BEYOND_FREE / cell
    return near[border:-border, border:-border]


def lost_walls(probability: Float32Array, grid: OccupancyGrid, angle_deg: float) -> BoolArray:
    """Cells of walls along the main directions that were seen and aren't drawn, and what is drawn behind them.

    Args:
        probability: Of being floor, shape of the map.
        grid: The map.
        angle_deg: Direction of the main walls.
    """
    turned = [
        _turned(mask.astype(np.uint8), -angle_deg) > 0
        for mask in (grid.cells == OCCUPIED, grid.cells == FREE, probability >= 0.5)
    ]
    found = np.zeros(turned[0].shape, np.bool_)
    for flip in (False, True):
        echoes, free, floor = (np.ascontiguousarray(mask.T) if flip else mask for mask in turned)
        rows = _rows_of_echoes(echoes, free, floor, grid.frame.resolution)
        found |= rows.T if flip else rows
    back = _turned(found.astype(np.uint8), angle_deg, grid.cells.shape) > 0
    return back & (probability >= 0.5)


def _turned(mask: np.ndarray, angle_deg: float, shape: tuple[int, int] | None = None) -> np.ndarray:
    """A mask turned about its middle; with a shape, cut back to it."""
    padded = mask if shape is not None else padded_for_turning(mask, angle_deg, 0)
    rows, cols = padded.shape
    matrix = cv2.getRotationMatrix2D((0.5 * (cols - 1), 0.5 * (rows - 1)), angle_deg, 1.0)
    image = transformed(padded, matrix, 0.0)
    if shape is None:
        return image
    above, beside = (rows - shape[0]) // 2, (cols - shape[1]) // 2
    return image[above : above + shape[0], beside : beside + shape[1]]


def _rows_of_echoes(echoes: BoolArray, free: BoolArray, floor: BoolArray, cell: float) -> BoolArray:
    """Horizontal walls in drawn floor, with what is drawn behind those that were seen from one side."""
    length, gap, thick, deep = (
        max(1, round(size / cell))
        for size in (SHORTEST_LOST_WALL, BROKEN_ECHOES, THICKEST_LOST_WALL, DEEPEST_BEHIND)
    )
    image = cv2.dilate(echoes.astype(np.uint8), np.ones((3, 1), np.uint8))  # a wall may lie between two rows
    image = cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((1, 2 * (gap // 2) + 1), np.uint8))
    image = cv2.morphologyEx(image, cv2.MORPH_OPEN, np.ones((1, length), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
    result = np.zeros(echoes.shape, np.bool_)
    drawn = (
        cv2.dilate((~floor).astype(np.uint8), np.ones((1, 2 * round(ATTACHED_WITHIN / cell) + 1), np.uint8))
        > 0
    )
    for number in range(1, count):
        left, top, width, height = (int(stats[number, k]) for k in range(4))
        if height - 2 > thick:
            continue
        columns = slice(left, left + width)
        near, behind = (slice(max(0, top - reach), top + height + reach) for reach in (thick, deep))
        part = labels[near, columns] == number
        above, below = np.cumsum(part, axis=0) == 0, np.cumsum(part[::-1], axis=0)[::-1] == 0
        inside = (part & floor[near, columns]).any(axis=0) & ~(part & ~floor[near, columns]).any(axis=0)
        sides = [(free[near, columns] & side).any(axis=0) for side in (above, below)]
        ends = part & ((np.arange(width) < 2) | (np.arange(width) >= width - 2))[None]
        if (inside & sides[0] & sides[1]).mean() >= BOTH_SIDES and drawn[near, columns][ends].any():
            result[near, columns] |= part
        elif width * cell >= LONGEST_FRONT and (inside & (sides[0] ^ sides[1])).mean() >= BOTH_SIDES:
            part, open_floor = (
                labels[behind, columns] == number,
                ~free[behind, columns] & floor[behind, columns],
            )
            upwards = sides[1].mean() > sides[0].mean()
            if not upwards:
                part, open_floor = part[::-1], open_floor[::-1]
            # From the echoes on away from the free side, as far as nothing was seen free.
            start = np.argmax(part, axis=0)
            numbers = np.arange(len(part))[:, None]
            blocked = np.where(~open_floor & ~part & (numbers < start), numbers, -1).max(axis=0)
            if np.median((start - blocked - 1)[part.any(axis=0)]) * cell < LEAST_BEHIND:
                continue
            hidden = part | ((numbers > blocked) & (numbers < start))
            result[behind, columns] |= hidden if upwards else hidden[::-1]
    return result
