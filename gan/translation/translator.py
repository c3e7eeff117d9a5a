"""What every way from a SLAM map to a CAD map looks like to those who use it: the evaluation and the tools."""

from typing import Protocol, runtime_checkable

from slamgym.core.types import ByteArray, Float32Array


@runtime_checkable
class Translator(Protocol):
    """Something that turns a SLAM map into a map of where the floor is."""

    def translate(self, slam: ByteArray, metres_per_px: float | None = None) -> Float32Array:
        """Tell for each pixel how likely it is free space of the building.

        Args:
            slam: SLAM map, shape (H, W): 0 occupied, 205 unknown, 254 free, row 0 at the top. Any size.
            metres_per_px: Scale of the map [m], if it is known.

        Returns:
            Shape (H, W), values in [0, 1], in the frame and scale of ``slam``: 1 inside of rooms, 0 in walls
            and outside. A threshold of 0.5 gives the CAD map.
        """
        ...
