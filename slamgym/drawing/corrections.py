"""Where the map overrules the model: floor that only rays or nobody has seen, and walls that were seen long.

Rays that leave through a window or a far door make stripes of free cells. What lies behind echoes and was never seen
is mostly furniture in the homes that models learn from, and mostly no floor in maps of real robots: it takes a sure
model. Straight rows of occupied cells with free cells on both sides are walls, whatever a model that has learnt to
remove furniture makes of them.
"""

import math

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, Float32Array, OccupancyGrid
from slamgym.drawing.floor import faces_within_cells, opened
from slamgym.gan.translation.classical import disc, without_small
from slamgym.gan.translation.derotation import padded_for_turning, transformed
from slamgym.metrics.maps import distance_to
from slamgym.metrics.rooms import label_rooms

SINGLE_RAYS = 0.2
"""Free space narrower than this was seen by single rays; no floor is drawn for it alone [m]."""
SHORTEST_LOST_WALL = 1.0
"""Straight walls of this length that were seen from both sides are drawn against the model [m]."""
SHORTEST_OBLIQUE_WALL = 1.3
"""The same in other directions than the main ones, in which leaves of open doors stand, too [m] ..."""
CLEAR_OF_OBLIQUE, MOSTLY = 0.3, 0.75
"""... and so far from it on both sides so many of the cells must be free, as they are not amid clutter [m]."""
SURE_OF_UNSEEN = 0.8
"""Floor that nobody has seen is drawn from this probability on, where seen floor needs a half."""
BESIDE_FREE = 0.1
"""Cells so near to free ones hold echoes and the faces of walls: the model is right about them [m]."""
SURE_WITHIN = 0.4
"""Standard deviation of the Gaussian over which the probability of unseen floor is averaged [m]."""
NARROWEST_UNSEEN = 0.2
"""Unseen floor that is sure is drawn where discs of this radius fit in [m]."""
SMALLEST_DOUBTED = 0.1
"""Smaller patches of doubted floor are left as they are [m2]."""
CONTACT = 0.8
"""A patch of unseen floor lies at a room or at a wall if it touches it along so much [m]."""
WIDEST_UNSEEN = 2.0
"""Unseen places between free cells at most so far apart may be floor: under a bed, behind a wardrobe [m]."""
LARGEST_POCKET = 2.0
"""Unknown cells amid free ones that no echo borders are floor up to this [m2]."""
BEYOND_FREE = 0.6
"""Floor goes on beyond what was seen free by at most this: behind a wall's echoes, drift, furniture [m]."""
SMALLEST_WIDE = 0.5
"""Separate wide free space smaller than this is left to the rays [m2]."""
BROKEN_ECHOES = 0.15
"""Gaps in a row of echoes at most so long belong to its wall [m]."""
THICKEST_LOST_WALL = 0.35
"""A row of echoes between two free spaces is a wall up to this thickness [m]."""
BETWEEN_DIRECTIONS = 7.5
"""Lost walls are looked for in directions so far apart, beginning with the main ones [deg]."""
BOTH_SIDES = 0.7
"""Of a wall that is drawn against the model so much of the length has free cells on both sides."""
ATTACHED_WITHIN = 0.25
"""Its end lies so near to a wall that the model has drawn [m]."""


def corrected(probability: Float32Array, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
    """A model's picture where the map bears it out.

    Args:
        probability: Of being floor, shape of the map.
        grid: The map.
        angle_deg: Direction of the main walls, counter-clockwise from the x axis.
    """
    cell = grid.frame.resolution
    result = np.where(believable(grid.cells == FREE, cell), probability, 0.0).astype(np.float32)
    result[empty_pockets(grid.cells, cell)] = 1.0
    result[lost_walls(result, grid, angle_deg)] = 0.0
    result = without(result, doubted_floor(result, grid))
    return without(result, dividing_floor(result, grid))


def empty_pockets(cells: ByteArray, cell: float) -> BoolArray:
    """Unknown cells amid free ones without an echo beside them: mappers leave some along the robot's path.

    Args:
        cells: Of the map, shape (rows, cols).
        cell: [m]
    """
    unknown = (cells == UNKNOWN).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(unknown, connectivity=8)
    small = stats[:, cv2.CC_STAT_AREA] <= LARGEST_POCKET / cell**2
    beside = cv2.dilate((cells == OCCUPIED).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    small[labels[beside]] = False
    small[[0, *labels[0], *labels[-1], *labels[:, 0], *labels[:, -1]]] = False
    result: BoolArray = small[labels]
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


def doubted_floor(probability: Float32Array, grid: OccupancyGrid) -> BoolArray:
    """Cells of floor that nobody has seen and of which the model isn't sure, with the echoes before them.

    Args:
        probability: Of being floor, shape of the map.
        grid: The map.
    """
    cell = grid.frame.resolution
    free = grid.cells == FREE
    unseen = _unseen(probability, free, cell)
    if not unseen.any():
        return unseen
    total, weight = (
        cv2.GaussianBlur(image.astype(np.float32), (0, 0), SURE_WITHIN / cell)
        for image in (np.where(unseen, probability, 0.0), unseen)
    )
    doubted = unseen & (total < SURE_OF_UNSEEN * weight)
    sure = opened(unseen & ~doubted, max(1, round(NARROWEST_UNSEEN / cell)))
    patches = without_small(doubted, SMALLEST_DOUBTED / cell**2)
    return _with_echoes(patches, free, cell) & ~sure


def _unseen(probability: Float32Array, free: BoolArray, cell: float) -> BoolArray:
    """Cells of floor that nobody has seen, but for those beside free ones."""
    unseen: BoolArray = ~free & (probability >= 0.5) & (distance_to(free) > BESIDE_FREE / cell)
    return unseen


def _with_echoes(patches: BoolArray, free: BoolArray, cell: float) -> BoolArray:
    """Patches of unseen floor and the echoes before them, up to the free cells."""
    reach = max(1, round(BESIDE_FREE / cell)) + 1
    result: BoolArray = (cv2.dilate(patches.astype(np.uint8), disc(2 * reach + 1)) > 0) & ~free
    return result


def dividing_floor(probability: Float32Array, grid: OccupancyGrid) -> BoolArray:
    """Patches of floor that nobody has seen through which rooms would run together, with the echoes before them.

    A place that was never seen between two rooms is a wall, a shaft or a cupboard that opens to one of them. One that
    doesn't touch a wall, or that only one room is left at when all such patches are gone, is furniture.

    Args:
        probability: Of being floor, shape of the map.
        grid: The map.
    """
    cell = grid.frame.resolution
    free, floor = grid.cells == FREE, probability >= 0.5
    unseen = without_small(_unseen(probability, free, cell), SMALLEST_DOUBTED / cell**2)
    patches = _with_echoes(unseen, free, cell) & floor
    count, labels, stats, _ = cv2.connectedComponentsWithStats(patches.astype(np.uint8), connectivity=4)
    contact = CONTACT / cell
    parts = []
    for number in range(1, count):
        left, top, width, height = stats[number, :4]
        box = np.s_[max(0, top - 1) : top + height + 1, max(0, left - 1) : left + width + 1]
        part = labels[box] == number
        ring = (cv2.dilate(part.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & ~part
        if np.count_nonzero(ring & ~floor[box]) >= contact:
            parts.append((box, part, ring))
    while True:
        result = np.zeros_like(patches)
        for box, part, _ in parts:
            result[box] |= part
        if not parts:
            return result
        rooms = label_rooms(without(probability, result) >= 0.5, cell)
        # What isn't between rooms becomes floor again, and passages beside it grow wider than doors.
        between = [
            (box, part, ring)
            for box, part, ring in parts
            if np.count_nonzero(np.bincount(rooms[box][ring])[1:] >= contact) > 1
        ]
        if len(between) == len(parts):
            return result
        parts = between


def without(probability: Float32Array, taken: BoolArray) -> Float32Array:
    """A picture without some of its floor: what becomes a wall there has its faces in its first cells."""
    if not taken.any():
        return probability
    floor = (probability >= 0.5) & ~taken
    faces = faces_within_cells(floor)
    near = cv2.dilate(taken.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    changed = np.where(floor, faces, np.minimum(faces, probability))
    return np.where(near, changed, probability).astype(np.float32)


def lost_walls(probability: Float32Array, grid: OccupancyGrid, angle_deg: float) -> BoolArray:
    """Cells of straight walls that were seen from both sides and aren't drawn.

    Args:
        probability: Of being floor, shape of the map.
        grid: The map.
        angle_deg: Direction of the main walls.
    """
    floor = probability >= 0.5
    seen = grid.cells == OCCUPIED, grid.cells == FREE
    lost = np.zeros_like(floor)
    # The main directions come first: what leans on a wall that is found there is found, too.
    for turn in np.arange(0.0, 90.0, BETWEEN_DIRECTIONS):
        lost |= _lost_along(
            (*seen, floor & ~lost), grid.frame.resolution, angle_deg + float(turn), turn != 0.0
        )
    return lost


def _lost_along(
    masks: tuple[BoolArray, BoolArray, BoolArray], cell: float, angle_deg: float, is_oblique: bool
) -> BoolArray:
    """Cells of lost walls along a direction and across it, from those of echoes, free space and drawn floor."""
    turned = [_turned(mask.astype(np.uint8), -angle_deg) > 0 for mask in masks]
    found = np.zeros(turned[0].shape, np.bool_)
    for flip in (False, True):
        echoes, free, floor = (np.ascontiguousarray(mask.T) if flip else mask for mask in turned)
        rows = _rows_of_echoes(echoes, free, floor, cell, is_oblique)
        found |= rows.T if flip else rows
    back: BoolArray = _turned(found.astype(np.uint8), angle_deg, masks[2].shape) > 0
    return back & masks[2]


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


def _free_before(free: BoolArray, part: BoolArray, clear: int) -> BoolArray:
    """Columns of a part before which any cell is free, or most of ``clear`` but for the next, shape (cols,)."""
    if not clear:
        any_free: BoolArray = (free & (np.cumsum(part, axis=0) == 0)).any(axis=0)
        return any_free
    rows = part.argmax(axis=0)[None] - 2 - np.arange(clear)[:, None]
    picked = np.take_along_axis(free, np.maximum(rows, 0), axis=0)
    most_free: BoolArray = (picked & (rows >= 0)).mean(axis=0) >= MOSTLY
    return most_free


def _rows_of_echoes(
    echoes: BoolArray, free: BoolArray, floor: BoolArray, cell: float, is_oblique: bool
) -> BoolArray:
    """Horizontal walls in drawn floor that were seen from both sides."""
    shortest = SHORTEST_OBLIQUE_WALL if is_oblique else SHORTEST_LOST_WALL
    length, gap, thick = (
        max(1, round(size / cell)) for size in (shortest, BROKEN_ECHOES, THICKEST_LOST_WALL)
    )
    clear = max(1, round(CLEAR_OF_OBLIQUE / cell)) if is_oblique else 0
    image = cv2.dilate(echoes.astype(np.uint8), np.ones((3, 1), np.uint8))  # a wall may lie between two rows
    image = cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((1, 2 * (gap // 2) + 1), np.uint8))
    image = cv2.morphologyEx(image, cv2.MORPH_OPEN, np.ones((1, length), np.uint8))
    result = np.zeros(echoes.shape, np.bool_)
    if not image.any():
        return result
    count, labels, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
    drawn = (
        cv2.dilate((~floor).astype(np.uint8), np.ones((1, 2 * round(ATTACHED_WITHIN / cell) + 1), np.uint8))
        > 0
    )
    for number in range(1, count):
        left, top, width, height = (int(stats[number, k]) for k in range(4))
        if height - 2 > thick:
            continue
        here = np.s_[max(0, top - thick) : top + height + thick, left : left + width]
        part = labels[here] == number
        inside = (part & floor[here]).any(axis=0) & ~(part & ~floor[here]).any(axis=0)
        sides = [_free_before(free[here][::step], part[::step], clear) for step in (1, -1)]
        ends = part & ((np.arange(width) < 2) | (np.arange(width) >= width - 2))[None]
        if (inside & sides[0] & sides[1]).mean() >= BOTH_SIDES and drawn[here][ends].any():
            result[here] |= part
    return result
