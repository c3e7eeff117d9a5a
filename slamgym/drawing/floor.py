"""Where the floor is, as a picture of probabilities: by a trained translator, or by cleaning alone."""

from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np

from slamgym.core.types import BoolArray, Float32Array, OccupancyGrid
from slamgym.metrics.cleaning import clean_map
from slamgym.metrics.maps import distance_to

if TYPE_CHECKING:
    from slamgym.gan.translation.translate import LearnedTranslator

NO_MODEL = "none"
"""Name of the cleaning without a network."""
FACE_DEPTH = 0.5
"""Mean depth of a wall's face in the wall's first cell [cells]: a cell is occupied from its first echo on."""
THIN_DEPTH = 0.25
"""The same for walls of one or two cells, so that they don't vanish."""


class FloorModel(Protocol):
    """Something that finds the floor of a map."""

    def probability(self, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
        """Probability of being floor, for each cell.

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
        """Probability of being floor: a half on the faces of walls."""
        return faces_within_cells(clean_map(grid.cells, grid.frame.resolution))


class TranslatedFloor:
    """The floor by a trained translator."""

    def __init__(self, translator: "LearnedTranslator") -> None:
        self._translator = translator

    def probability(self, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
        """Probability of being floor, by the network."""
        return self._translator.translate(grid.cells, grid.frame.resolution, angle_deg=angle_deg)


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
