"""Where the floor is: what a trained translator (or cleaning) says, where the map bears it out.

The map decides which places belong together: cells that a beam crossed are open, rows of echoes are closed. The
translator decides how straight and how thick walls are, and what the floor under furniture is.
"""

import math
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np

from slamgym.core.types import FREE, BoolArray, Float32Array, IntArray, OccupancyGrid
from slamgym.drawing.settings import SMALLEST_ROOM, THICKEST_WALL
from slamgym.metrics.cleaning import clean_map, without_small
from slamgym.metrics.layers import MapLayers, door_cells, without_rays
from slamgym.metrics.maps import distance_to

if TYPE_CHECKING:
    from slamgym.gan.translation.translate import LearnedTranslator

NO_MODEL = "none"
"""Name of the cleaning without a network."""
FACE_DEPTH = 0.5
"""Mean depth of a wall's face in the wall's first cell [cells]: a cell is occupied from its first echo on."""
THIN_DEPTH = 0.25
"""The same for walls of one or two cells, so that they don't vanish."""
SURE_OF_UNSEEN = 0.8
"""Least probability of floor that was never seen."""
SHORTEST_WALL = 0.5
"""Thin things in the free space from this length on are walls [m]."""
BESIDE_SEEN = 0.1
"""Cells so near to the free space hold echoes and the faces of walls: the model is right about them [m]."""
GROWTH = 0.6
"""Floor belongs to a room up to so far from what was seen of it [m]."""


class FloorModel(Protocol):
    """Something that finds floor, walls and doors of a map."""

    def layers(self, grid: OccupancyGrid, angle_deg: float) -> MapLayers:
        """The layers of a map, of its shape; the faces of walls lie where its free space is 0.5.

        Args:
            grid: The map.
            angle_deg: Direction of its main walls, counter-clockwise from the x axis.
        """
        ...


class CleanedFloor:
    """The floor by classical cleaning, doors where the watershed of its distance to walls has them; needs no torch."""

    def layers(self, grid: OccupancyGrid, angle_deg: float) -> MapLayers:  # noqa: ARG002 - part of the protocol
        """The layers of a map, all that isn't floor wall."""
        clean = clean_map(grid.cells, grid.frame.resolution)
        free = faces_within_cells(clean)
        return MapLayers.of_floor(free, door_cells(clean, grid.frame.resolution))


class TranslatedFloor:
    """The floor by a trained translator."""

    def __init__(self, translator: "LearnedTranslator") -> None:
        self._translator = translator

    def layers(self, grid: OccupancyGrid, angle_deg: float) -> MapLayers:
        """The layers of a map, by the network."""
        return self._translator.layers(grid.cells, grid.frame.resolution, angle_deg=angle_deg)


def load_floor_model(name: str) -> FloorModel:
    """A model by its name.

    Args:
        name: ``none``, pretrained weights, a .safetensors file, the folder of a run.

    Raises:
        SlamgymError: If there is no such model.
    """
    if name == NO_MODEL:
        return CleanedFloor()
    from slamgym.gan.translation.translate import load_translator

    return TranslatedFloor(load_translator(name, "slam2cad"))


def faces_within_cells(free: BoolArray) -> Float32Array:
    """A picture whose level 0.5 runs through the first cells of walls, where their faces lie.

    Args:
        free: Free cells of a map, shape (rows, cols).
    """
    walls = np.pad((~free).astype(np.uint8), 2, constant_values=1)
    thick = cv2.morphologyEx(walls, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))[2:-2, 2:-2] > 0
    depth = np.where(thick, FACE_DEPTH, THIN_DEPTH)
    inside, outside = (distance_to(mask) - 0.5 for mask in (~free, free))
    signed = np.where(free, inside, depth - outside)
    return (0.5 + 0.5 * np.clip(signed, -1.0, 1.0)).astype(np.float32)


def seen_space(grid: OccupancyGrid) -> BoolArray:
    """The space that the robot saw free, without rays and patches too small for a room."""
    cell, free = grid.frame.resolution, grid.cells == FREE
    return without_small(free & without_rays(free, cell), SMALLEST_ROOM / cell**2)


def floor_of_rooms(
    layers: MapLayers, seen: BoolArray, rooms: IntArray, doors: BoolArray, cell: float
) -> Float32Array:
    """The model's floor, with walls wherever the map has them.

    Args:
        layers: What the model says.
        seen: Free space that was seen, (H, W).
        rooms: Numbers of the rooms in it, 0 elsewhere.
        doors: Cells where two rooms may meet.
        cell: Resolution [m].

    Returns:
        Probability of being floor, (H, W).
    """
    floor = (layers.free >= 0.5) & ~_thin_walls(seen, cell)
    floor &= ~_doubted(layers.free, floor, seen, rooms, cell)
    grown = np.where(floor, rooms, 0).astype(np.uint16)
    for _ in range(math.ceil(GROWTH / cell)):
        wider = cv2.dilate(grown, np.ones((3, 3), np.uint8))
        grown = np.where((grown == 0) & floor, wider, grown)
    taken = (layers.free >= 0.5) & (grown == 0)
    for first, second in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        meet = (grown[first] != grown[second]) & (grown[first] > 0) & (grown[second] > 0)
        taken[first] |= meet & ~doors[first]
        taken[second] |= meet & ~doors[second]
    return without(layers.free, taken)


def _thin_walls(seen: BoolArray, cell: float) -> BoolArray:
    """Thin things of some length in the free space that was seen: walls, whatever the model says."""
    half = 0.5 * THICKEST_WALL / cell
    closed = distance_to(distance_to(seen) > half) > half
    thin = closed & ~seen
    _, labels, stats, _ = cv2.connectedComponentsWithStats(thin.astype(np.uint8), connectivity=8)
    long = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) * cell >= SHORTEST_WALL
    long[0] = False
    return long[labels]


def _doubted(
    free: Float32Array, floor: BoolArray, seen: BoolArray, rooms: IntArray, cell: float
) -> BoolArray:
    """Patches of floor that was never seen and of which the model isn't sure, or that would join two rooms."""
    unseen = floor & (distance_to(seen) > BESIDE_SEEN / cell)
    count, labels = cv2.connectedComponents(unseen.astype(np.uint8), connectivity=4)
    mean = np.bincount(labels.ravel(), free.ravel(), minlength=count) / np.bincount(labels.ravel())
    reach = 2 * math.ceil(2.0 * BESIDE_SEEN / cell) + 1
    near = cv2.dilate(labels.astype(np.float32), np.ones((reach, reach), np.uint8)).astype(np.int64)
    pairs = near * (int(rooms.max()) + 1) + rooms
    beside = np.unique(pairs[(near > 0) & (rooms > 0)]) // (int(rooms.max()) + 1)
    doubted = (mean < SURE_OF_UNSEEN) | (np.bincount(beside, minlength=count) != 1)
    doubted[0] = False
    return doubted[labels]


def without(probability: Float32Array, taken: BoolArray) -> Float32Array:
    """A picture without some of its floor: what becomes a wall there has its faces in its first cells."""
    if not taken.any():
        return probability
    floor = (probability >= 0.5) & ~taken
    faces = faces_within_cells(floor)
    near = cv2.dilate(taken.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    changed = np.where(floor, faces, np.minimum(faces, probability))
    return np.where(near, changed, probability).astype(np.float32)
