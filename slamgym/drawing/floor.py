"""Where the floor is, as a picture of probabilities: by a trained translator, or by cleaning alone."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np

from slamgym.core.types import FREE, UNKNOWN, BoolArray, Float32Array, OccupancyGrid
from slamgym.gan.translation.classical import clean_map, disc, without_small
from slamgym.metrics.maps import distance_to

if TYPE_CHECKING:
    from slamgym.gan.translation.translate import LearnedTranslator

NO_MODEL = "none"
"""Name of the cleaning without a network."""
FACE_DEPTH = 0.5
"""How deep in a wall's first cell its face lies on average [cells]: a cell is occupied from its first echo on."""
THIN_DEPTH = 0.25
"""The same of walls of one or two cells, so that something is left of them."""

LEAST_LEFT_OUT = 1.0
"""Free space that a model leaves out is looked at again from this size on [m2]."""
WIDER_THAN_RAYS = 0.2
"""And if a disc of this radius fits into it: single rays are rightly left out [m]."""
DOUBT = 0.15
"""And if the model gives it this probability on average: what was seen through panes it gives less."""
OPEN_BORDER = 0.2
"""Or if no more of its border is unknown: what was seen through panes ends there, rooms end at walls."""
LOST = 0.5
"""A model that leaves out more of the wide free space has not understood the map: nothing was rightly left out."""


class FloorModel(Protocol):
    """Something that finds the floor of a map."""

    def probability(self, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
        """Of being floor, for each cell.

        Args:
            grid: The map.
            angle_deg: Direction of its main walls, counter-clockwise from the x axis.

        Returns:
            Shape (rows, cols), in [0, 1]; the faces of walls lie at 0.5.
        """
        ...


class CleanedFloor:
    """The floor by classical cleaning; needs no torch."""

    def probability(self, grid: OccupancyGrid, angle_deg: float) -> Float32Array:  # noqa: ARG002 - part of the protocol
        """Of being floor: a half on the faces of walls."""
        return faces_within_cells(clean_map(grid.cells, grid.frame.resolution))


class TranslatedFloor:
    """The floor by a trained translator."""

    def __init__(self, translator: "LearnedTranslator") -> None:
        self._translator = translator

    def probability(self, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
        """Of being floor, by the network."""
        return self._translator.translate(grid.cells, grid.frame.resolution, angle_deg=angle_deg)


class FilledFloor:
    """A model's floor, and the mean with the next model's where it leaves out what the robot saw free."""

    def __init__(self, models: Sequence[FloorModel]) -> None:
        self._models = tuple(models)

    def probability(self, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
        """Of being floor; models after the first are asked only where something is left out."""
        result = self._models[0].probability(grid, angle_deg)
        for model in self._models[1:]:
            region = left_out_regions(result, grid)
            if region.any():
                mean = (result + model.probability(grid, angle_deg)) / np.float32(2)
                result = np.where(region, mean, result)
        return result


def left_out_regions(probability: Float32Array, grid: OccupancyGrid) -> BoolArray:
    """Wide free space of a map that isn't floor by a model's picture and should be, with a cell around it.

    Args:
        probability: Of being floor, shape of the map.
        grid: The map.

    Returns:
        Shape of the map; parts of at least :data:`LEAST_LEFT_OUT`, wider than twice :data:`WIDER_THAN_RAYS`, that the
        model doubts or that end at walls and floor.
    """
    cell = grid.frame.resolution
    free = grid.cells == FREE
    missing = free & (probability < 0.5)
    reach = max(1, round(WIDER_THAN_RAYS / cell))
    wide = opened(missing, reach)
    parts = without_small(wide, LEAST_LEFT_OUT / cell**2)
    if np.count_nonzero(wide) <= LOST * np.count_nonzero(opened(free, reach)):
        parts = _doubted(parts, np.where(missing, probability, np.inf), grid.cells == UNKNOWN, reach)
    return cv2.dilate(parts.astype(np.uint8), disc(2 * reach + 3)) > 0


def _doubted(parts: BoolArray, left_out: Float32Array, unknown: BoolArray, reach: int) -> BoolArray:
    """Those parts that are probable by :data:`DOUBT`, or have little unknown border; ``left_out`` is inf elsewhere."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(parts.astype(np.uint8), connectivity=4)
    kept = np.zeros_like(parts)
    margin = reach + 3
    for label in range(1, count):
        left, top, width, height = stats[label, :4]
        box = np.s_[
            max(0, top - margin) : top + height + margin, max(0, left - margin) : left + width + margin
        ]
        part = labels[box] == label
        whole = (cv2.dilate(part.astype(np.uint8), disc(2 * reach + 3)) > 0) & np.isfinite(left_out[box])
        border = (cv2.dilate(whole.astype(np.uint8), disc(3)) > 0) & ~whole
        is_open = np.count_nonzero(border & unknown[box]) > OPEN_BORDER * np.count_nonzero(border)
        if not is_open or left_out[box][part].mean() >= DOUBT:
            kept[box] |= part
    return kept


def opened(mask: BoolArray, radius: int) -> BoolArray:
    """What discs of a radius [cells] that fit into a mask cover."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc(2 * radius + 1)) > 0


def load_floor_model(name: str) -> FloorModel:
    """A model by its name.

    Args:
        name: ``none``, pretrained weights, a .safetensors file, the folder of a run; several with ``+`` between them:
            what the first leaves out of the seen floor is left to the mean with the next.

    Raises:
        SlamgymError: If there is no such model.
    """
    if "+" in name and not Path(name).exists():
        return FilledFloor([load_floor_model(part) for part in name.split("+")])
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
