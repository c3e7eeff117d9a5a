"""Move the faces of a drawing's walls by less than a cell, so that rooms get their true size.

Networks that learnt from drawings with a line along every face draw walls too thick, by an amount that is the same
everywhere; the places of the walls are right. Moving all faces back is a dilation of the greys by a radius within a
cell. Walls that would vanish by it keep a cell.
"""

import math

import cv2
import numpy as np

from slamgym.core.types import BoolArray, Float32Array

DIRECTIONS = 16
"""In which a disc's rim is sampled."""
CLOSED = 0.45
"""What a cell is given at most where a wall would be lost: less than a half, so it stays closed."""


def moved_faces(free: Float32Array, shift_px: float) -> Float32Array:
    """Move every face by a distance, walls getting thinner.

    Args:
        free: Probability or share of floor, shape (H, W).
        shift_px: How far [cells]; 0 or less leaves the image as it is.

    Returns:
        (H, W) in [0, 1]. A wall of which nothing would be left keeps its middle at :data:`CLOSED`.
    """
    if shift_px <= 0.0:
        return free
    grown = free.copy()
    for number in range(DIRECTIONS):
        angle = 2.0 * math.pi * number / DIRECTIONS
        shift = np.array([[1.0, 0.0, shift_px * math.cos(angle)], [0.0, 1.0, shift_px * math.sin(angle)]])
        moved = cv2.warpAffine(free, shift, free.shape[::-1], flags=cv2.INTER_LINEAR)
        np.maximum(grown, moved, out=grown)
    closed = thin_walls(free, math.ceil(2.0 * shift_px), math.ceil(shift_px))
    grown[closed] = np.minimum(grown[closed], CLOSED)
    return np.asarray(grown, dtype=np.float32)


def thin_walls(free: Float32Array, thickest_px: int, ends_px: int) -> BoolArray:
    """The middles of walls with floor on both sides, along a row or a column, (H, W).

    Args:
        free: Probability or share of floor, shape (H, W).
        thickest_px: Thicker walls have no middle.
        ends_px: How far a middle goes on into the wall that it meets, which moves away from it.
    """
    found = np.zeros(free.shape, np.bool_)
    for floor, middles in ((free >= 0.5, found), (free.T >= 0.5, found.T)):
        wall = ~floor
        within = np.ones_like(floor)  # whether as many cells as now from here on are wall
        for thickness in range(1, min(thickest_px, len(floor) - 2) + 1):
            within = within[: len(floor) - thickness + 1] & wall[thickness - 1 :]
            run = floor[: -thickness - 1] & within[1:-1] & floor[thickness + 1 :]
            middles[1 + thickness // 2 :][: len(run)] |= run
        for _ in range(ends_px):
            ahead, behind = middles[:, :-1] & wall[:, 1:], middles[:, 1:] & wall[:, :-1]
            middles[:, 1:] |= ahead
            middles[:, :-1] |= behind
    return found
