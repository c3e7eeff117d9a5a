"""Where the floor is, as a picture of probabilities: by a trained translator, or by cleaning alone."""

from typing import Protocol

import cv2
import numpy as np

from slamgym.core.types import BoolArray, Float32Array, OccupancyGrid
from slamgym.gan.translation.classical import clean_map

NO_MODEL = "none"
"""Name of the cleaning without a network."""
FACE_DEPTH = 0.5
"""How deep in a wall's first cell its face lies on average [cells]: a cell is occupied from its first echo on."""
THIN_DEPTH = 0.25
"""The same of walls of one or two cells, so that something is left of them."""


class FloorModel(Protocol):
    """Something that finds the floor: a :class:`slamgym.gan.translation.translate.Translator`."""

    def translate(self, slam: np.ndarray, metres_per_px: float | None = None) -> Float32Array:
        """Probability of being floor, shape (H, W)."""
        ...


class CleanedFloor:
    """The floor by classical cleaning, borders where the walls' faces are: needs no torch."""

    def translate(self, slam: np.ndarray, metres_per_px: float | None = None) -> Float32Array:
        """Probability of being floor, shape (H, W): a half on the faces of walls."""
        if metres_per_px is None:
            raise ValueError("cleaning needs the scale of the map")
        return faces_within_cells(clean_map(slam, metres_per_px))


def load_floor_model(name: str) -> FloorModel:
    """A model by its name: ``none``, pretrained weights, a .safetensors file or the folder of a run.

    Raises:
        SlamgymError: If there is no such model.
    """
    if name == NO_MODEL:
        return CleanedFloor()
    from slamgym.gan.translation.translate import load_translator

    return load_translator(name, "slam2cad")


def floor_probability(grid: OccupancyGrid, model: FloorModel) -> Float32Array:
    """Probability of being floor for each cell of a map, shape (rows, cols)."""
    return model.translate(grid.cells, grid.frame.resolution)


def faces_within_cells(free: BoolArray) -> Float32Array:
    """A picture whose level 0.5 runs through the first cells of walls, where their faces lie.

    Args:
        free: Free cells of a map, shape (rows, cols).
    """
    walls = np.pad((~free).astype(np.uint8), 2, constant_values=1)
    thick = cv2.morphologyEx(walls, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))[2:-2, 2:-2] > 0
    depth = np.where(thick, FACE_DEPTH, THIN_DEPTH)
    inside, outside = (_distance_to(mask) - 0.5 for mask in (~free, free))
    signed = np.where(free, inside, depth - outside)
    return (0.5 + 0.5 * np.clip(signed, -1.0, 1.0)).astype(np.float32)


def _distance_to(mask: BoolArray) -> Float32Array:
    """Distance of each cell to the nearest one of the mask [cells]."""
    distance = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(distance, dtype=np.float32)
