"""Where the map overrules the model: floor that was never seen, and walls that were seen long.

Unseen floor takes a sure model, and must not join two rooms. Straight rows of occupied cells with free cells on both
sides are walls, even if a model that has learnt to remove furniture removes them.
"""

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, BoolArray, Float32Array, OccupancyGrid
from slamgym.drawing.floor import faces_within_cells
from slamgym.metrics.cleaning import disc, without_small
from slamgym.metrics.maps import distance_to
from slamgym.metrics.rooms import label_rooms
from slamgym.metrics.wall_direction import padded_for_turning, transformed

SHORTEST_LOST_WALL = 1.0
"""Straight walls of this length that were seen from both sides are drawn against the model [m]."""
SURE_OF_UNSEEN = 0.8
"""Floor that was never seen is drawn from this probability on, where seen floor needs a half."""
SURE_WITHIN = 0.4
"""Standard deviation of the Gaussian over which the probability of unseen floor is averaged [m]."""
BESIDE_FREE = 0.1
"""Cells so near to free ones hold echoes and the faces of walls: the model is right about them [m]."""
SMALLEST_UNSEEN = 0.1
"""Smaller patches of unseen floor are left as they are [m2]."""
CONTACT = 0.8
"""A patch of unseen floor lies at a room or at a wall if it touches it along so much [m]."""
BROKEN_ECHOES = 0.15
"""Gaps in a row of echoes at most so long belong to its wall [m]."""
THICKEST_LOST_WALL = 0.35
"""A row of echoes between two free spaces is a wall up to this thickness [m]."""
BOTH_SIDES = 0.7
"""A wall that is drawn against the model has free cells on both sides along this share of its length."""
ATTACHED_WITHIN = 0.25
"""Its end lies so near to a wall that the model has drawn [m]."""


def corrected(probability: Float32Array, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
    """A model's picture where the map bears it out.

    Args:
        probability: Probability of being floor, shape of the map.
        grid: The map.
        angle_deg: Direction of the main walls, counter-clockwise from the x axis.
    """
    result = np.where(lost_walls(probability, grid, angle_deg), 0.0, probability).astype(np.float32)
    result = without(result, doubted_floor(result, grid))
    return without(result, dividing_floor(result, grid))


def doubted_floor(probability: Float32Array, grid: OccupancyGrid) -> BoolArray:
    """Cells of floor that were never seen and of which the model isn't sure, with the echoes before them.

    Without this rule 9.8 % of the floor drawn of real maps was never seen instead of 6.4 %.

    Args:
        probability: Probability of being floor, shape of the map.
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
    return _with_echoes(without_small(doubted, SMALLEST_UNSEEN / cell**2), free, cell)


def _unseen(probability: Float32Array, free: BoolArray, cell: float) -> BoolArray:
    """Cells of floor that were never seen, except those next to free ones."""
    return ~free & (probability >= 0.5) & (distance_to(free) > BESIDE_FREE / cell)


def _with_echoes(patches: BoolArray, free: BoolArray, cell: float) -> BoolArray:
    """Patches of unseen floor and the echoes before them, up to the free cells."""
    reach = max(1, round(BESIDE_FREE / cell)) + 1
    return (cv2.dilate(patches.astype(np.uint8), disc(2 * reach + 1)) > 0) & ~free


def dividing_floor(probability: Float32Array, grid: OccupancyGrid) -> BoolArray:
    """Patches of floor that were never seen and through which rooms would join, with the echoes before them.

    A place that was never seen between two rooms is a wall, a shaft or a cupboard that opens to one of them. One that
    doesn't touch a wall, or that only one room is left at when all such patches are gone, is furniture. Without this
    rule room F1 of real maps falls by 0.12.

    Args:
        probability: Probability of being floor, shape of the map.
        grid: The map.
    """
    cell = grid.frame.resolution
    free, floor = grid.cells == FREE, probability >= 0.5
    unseen = without_small(_unseen(probability, free, cell), SMALLEST_UNSEEN / cell**2)
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
        # What isn't between rooms becomes floor again, and passages next to it grow wider than doors.
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
    """Cells of straight walls along the main directions that were seen from both sides and aren't drawn.

    Without this rule room F1 of real maps falls by 0.01.

    Args:
        probability: Probability of being floor, shape of the map.
        grid: The map.
        angle_deg: Direction of the main walls.
    """
    drawn = probability >= 0.5
    masks = (grid.cells == OCCUPIED, grid.cells == FREE, drawn)
    echoes, free, floor = (_turned(mask.astype(np.uint8), -angle_deg) > 0 for mask in masks)
    found = _rows_of_echoes(echoes, free, floor, grid.frame.resolution)
    echoes, free, floor = (np.ascontiguousarray(mask.T) for mask in (echoes, free, floor))
    found |= _rows_of_echoes(echoes, free, floor, grid.frame.resolution).T
    back: BoolArray = _turned(found.astype(np.uint8), angle_deg, drawn.shape) > 0
    return back & drawn


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
    """Horizontal walls in drawn floor that were seen from both sides."""
    length, gap, thick = (
        max(1, round(size / cell)) for size in (SHORTEST_LOST_WALL, BROKEN_ECHOES, THICKEST_LOST_WALL)
    )
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
        sides = [
            (free[here][::step] & (np.cumsum(part[::step], axis=0) == 0)).any(axis=0) for step in (1, -1)
        ]
        ends = part & ((np.arange(width) < 2) | (np.arange(width) >= width - 2))[None]
        if (inside & sides[0] & sides[1]).mean() >= BOTH_SIDES and drawn[here][ends].any():
            result[here] |= part
    return result
