"""Translators that don't learn: the cleaning that a trained one has to beat, and an oracle that games the error."""

import cv2
import numpy as np

from slamgym.core.errors import ConfigError
from slamgym.core.types import BoolArray, ByteArray, Float32Array
from slamgym.metrics.cleaning import clean_map, odd


class ClassicalTranslator:
    """The cleaning as a :class:`slamgym.gan.translation.translate.Translator`."""

    def __init__(self, metres_per_px: float = 0.05) -> None:
        """Keep the scale.

        Args:
            metres_per_px: Scale of maps that come without one; 0.05 m is what most robots use.

        Raises:
            ConfigError: If the scale isn't positive.
        """
        if not metres_per_px > 0.0:
            raise ConfigError(f"metres_per_px must be a positive number, not {metres_per_px}")
        self.metres_per_px = metres_per_px

    def translate(self, slam: ByteArray, metres_per_px: float | None = None) -> Float32Array:
        """Clean a SLAM map; the values are 0 and 1."""
        return clean_map(slam, metres_per_px or self.metres_per_px).astype(np.float32)


def outline_only(cad: ByteArray, metres_per_px: float, thickest_wall: float = 0.5) -> BoolArray:
    """The CAD map with all its inner walls erased: an oracle that games the mean squared error.

    Args:
        cad: CAD map, shape (H, W): 0 walls and outside, 254 inside.
        metres_per_px: Scale [m].
        thickest_wall: Walls between rooms are at most so thick [m].

    Returns:
        Free cells, shape (H, W): everything inside of the building's outline.
    """
    radius = thickest_wall / metres_per_px
    border = int(np.ceil(radius)) + 2  # so that closing doesn't join the building to the image's border
    free = np.pad((cad > 127).astype(np.uint8), border)
    closed = cv2.morphologyEx(
        free, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_RECT, (odd(radius),) * 2)
    )
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = cv2.drawContours(np.zeros_like(free), contours, -1, 1, cv2.FILLED)
    return filled[border:-border, border:-border] > 0
