"""Maps of other mappers as ours: the values of a ``nav_msgs/OccupancyGrid`` on one lattice that never moves.

Other mappers publish cells of 0.02 to 0.1 m whose origin moves as the map grows. Here every map comes on cells of
0.05 m that are multiples of that size from the map frame's origin, so that places on it, and what was computed for
its cells, stay valid from map to map.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamgym.core.errors import InputFileError
from slamgym.core.limits import shown
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    GridFrame,
    OccupancyGrid,
    Pose2D,
)
from slamgym.interop.ros_map import MAX_ORIGIN
from slamgym.interop.ros_messages import pose_of

LATTICE_CELL = 0.05
"""Side of the cells that foreign maps are brought to [m]."""
MOST_CELLS = 25_000_000
"""A map has so many cells at most, as it is published and on our lattice: 250 m x 250 m."""
COARSEST_USABLE_CELL = 1.0
"""Larger cells [m] show no door."""
_BLOCK = 8
"""Maps begin and end at multiples of so many cells: how places are rounded doesn't change as a map grows."""
_MARGIN = 10
"""So many unknown cells are left around a map: what ends at its border is a frontier, too."""
_UNDECIDED = 5
"""Probabilities nearer to 50 % than this are unknown: one hit in Cartographer is 55 %, one miss 49 %."""
_LETHAL = 100
"""Value of walls in a published costmap (nav2_costmap_2d)."""
_INSCRIBED = 99
"""Value there of cells in which the robot's centre would make it touch a wall."""
_VALUES = np.array([UNKNOWN, FREE, OCCUPIED], np.uint8)
"""Our values, each winning over those before."""


class ForeignMap:
    """The map of another mapper, as it was last published.

    Args:
        name: What errors call it, such as its topic.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._values: NDArray[np.int8] | None = None  # (H, W), row 0 at the bottom
        self._resolution = LATTICE_CELL  # [m]
        self._origin = Pose2D(0.0, 0.0, 0.0)

    def take_message(self, message: Any) -> OccupancyGrid:
        """Take over a ``nav_msgs/OccupancyGrid``; see :meth:`take`."""
        info = message.info
        origin = pose_of(info.origin, "map")
        return self.take(message.data, info.width, info.height, info.resolution, origin)

    def take(
        self, data: Any, width: int, height: int, resolution: float, origin: Pose2D
    ) -> OccupancyGrid:
        """Take over a whole map.

        Args:
            data: Values, -1 unknown or 0 to 100, ``height * width`` of them, the bottom row first.
            width: [cells].
            height: [cells].
            resolution: Side of a cell [m].
            origin: Outer corner of the first cell in the map frame.

        Returns:
            It on our lattice, read-only, with a margin of unknown cells.

        Raises:
            InputFileError: If it is broken, turned, or too large.
        """
        placed = all(abs(value) <= MAX_ORIGIN for value in origin)
        if not (placed and 0.0 < resolution < math.inf):
            raise self._error(
                f"has cells of {shown(resolution)} m from {shown(tuple(origin))} on; a map needs a size of cells "
                f"above 0 and an origin within {MAX_ORIGIN:g} m"
            )
        if origin.theta != 0.0:
            raise self._error(
                f"is turned by {origin.theta:g} rad; let the mapper publish it with yaw 0"
            )
        resolution = round(resolution, 7)  # the message has it in single precision
        if resolution > COARSEST_USABLE_CELL:
            raise self._error(
                f"has cells of {resolution:g} m, and a robot needs {COARSEST_USABLE_CELL:g} m at most; let the mapper "
                "publish finer ones (0.05 m is usual)"
            )
        growth = max(1.0, resolution / LATTICE_CELL)
        if width * height * growth**2 > MOST_CELLS:
            raise self._error(
                f"is {width * resolution:.0f} m x {height * resolution:.0f} m of {resolution:g} m a cell, more than "
                f"{MOST_CELLS // 10**6} million cells of {min(resolution, LATTICE_CELL):g} m; let the mapper crop it "
                "to the building"
            )
        values = self._checked(data, width, height)
        self._values = values.copy()
        self._resolution = resolution
        self._origin = origin
        return self._on_lattice(self._values)

    def patch(self, data: Any, x: int, y: int, width: int, height: int) -> OccupancyGrid | None:
        """Take over a part of the map (``map_msgs/OccupancyGridUpdate``); None as long as there is no map.

        Args:
            data: As for :meth:`take`.
            x: First column of the part.
            y: First row of the part, counted from the bottom.
            width: [cells].
            height: [cells].

        Raises:
            InputFileError: If it is broken, or doesn't lie on the map.
        """
        if self._values is None:
            return None
        values = self._checked(data, width, height)
        rows, cols = self._values.shape
        if not (0 <= x <= cols - width and 0 <= y <= rows - height):
            raise self._error(
                f"is {cols} x {rows} cells, but its update is of {width} x {height} from ({x}, {y}) on; "
                "let both come from one mapper"
            )
        self._values[y : y + height, x : x + width] = values
        return self._on_lattice(self._values)

    def _checked(self, data: Any, width: int, height: int) -> NDArray[np.int8]:
        """The values as an array, shape (height, width)."""
        if width < 1 or height < 1:
            raise self._error(f"has no cells ({width} x {height}); wait for the mapper to begin")
        values = np.asarray(data).astype(np.int8, copy=False).reshape(-1)
        if len(values) != width * height:
            raise self._error(
                f"has {len(values)} values where {width} x {height} cells need {width * height}"
            )
        return values.reshape(height, width)

    def _error(self, reason: str) -> InputFileError:
        return InputFileError(self.name, reason)

    def _on_lattice(self, values: NDArray[np.int8]) -> OccupancyGrid:
        """The map on our lattice: occupied wins over free, and that over unknown."""
        size = self._resolution / LATTICE_CELL
        ranks = classify_values(values)
        ranks, left = _onto_lattice(ranks, self._origin.x / LATTICE_CELL, size, axis=1)
        ranks, bottom = _onto_lattice(ranks, self._origin.y / LATTICE_CELL, size, axis=0)
        before, behind = _margins(left, ranks.shape[1])
        below, above = _margins(bottom, ranks.shape[0])
        ranks = np.pad(ranks, ((below, above), (before, behind)))
        cells = np.ascontiguousarray(_VALUES[ranks[::-1]])
        cells.flags.writeable = False
        height, width = cells.shape
        x = (left - before) * LATTICE_CELL
        y = (bottom - below) * LATTICE_CELL
        return OccupancyGrid(cells, GridFrame(LATTICE_CELL, x, y, height, width))


def _margins(first: int, count: int) -> tuple[int, int]:
    """Unknown cells to add before and behind cells of these numbers, so that the map ends at blocks."""
    low = (first - _MARGIN) // _BLOCK * _BLOCK
    high = -((first + count + _MARGIN) // -_BLOCK) * _BLOCK
    return first - low, high - first - count


def classify_values(values: NDArray[np.int8]) -> ByteArray:
    """Ranks 0 unknown, 1 free, 2 occupied of the values of a published map, shape (H, W).

    What the values mean is told by themselves. In a costmap the robot's body makes a seam of 99 round each wall of
    100, so only 100 is a wall; the seam lies on the unknown behind it, too, and is known where it is nearer to free
    space than to the unknown. Otherwise they are probabilities, with nothing but 0 and 100 in trinary maps.
    """
    known = (values >= 0) & (values <= _LETHAL)
    if _is_costmap(values):
        to_open = _distance_to(known & (values < _INSCRIBED))
        to_unknown = _distance_to(~known)
        occupied = values == _LETHAL
        free = known & (to_open <= to_unknown)
    else:
        occupied = known & (values > 50 + _UNDECIDED)
        free = known & (values < 50 - _UNDECIDED)
    return np.where(occupied, 2, free).astype(np.uint8)


def _distance_to(mask: BoolArray) -> Float32Array:
    """From each cell to the nearest cell of a mask [cells]."""
    import cv2

    elsewhere = (~mask).view(np.uint8)
    distance = cv2.distanceTransform(elsewhere, cv2.DIST_L2, cv2.DIST_MASK_3)
    return np.asarray(distance, dtype=np.float32)


def _is_costmap(values: NDArray[np.int8]) -> bool:
    """True if nothing but the seam, or the unknown, lies next to walls."""
    import cv2

    wall = (values == _LETHAL).view(np.uint8)
    neighbours = np.ones((3, 3), np.uint8)
    around = values[cv2.dilate(wall, neighbours) > wall]
    seam = around == _INSCRIBED
    unknown = around < 0
    return bool(seam.any()) and float(np.mean(seam | unknown)) > 0.95


def _onto_lattice(ranks: ByteArray, start: float, size: float, axis: int) -> tuple[ByteArray, int]:
    """Bring one axis of a map to cells of size 1; returns it and the number of its first cell there.

    Each fine cell goes where its centre lies, and the highest rank wins; of coarse cells each new one takes what its
    own centre shows. So the centre of no cell moves by more than half a cell, and no wall gets a hole.

    Args:
        ranks: Shape (H, W).
        start: Where the first cell begins.
        size: Of the cells.
        axis: The one to bring there.
    """
    count = ranks.shape[axis]
    fuzz = 1e-6  # a centre on a border of two cells belongs to the same one every time
    if size < 1.0 - fuzz:
        centres = start + size * (np.arange(count) + 0.5)
        cells = np.floor(centres + fuzz).astype(np.int64)
        begins = np.flatnonzero(np.diff(cells, prepend=cells[0] - 1))
        return np.maximum.reduceat(ranks, begins, axis=axis), int(cells[0])
    first = math.floor(start + 0.5 + fuzz)
    end = math.floor(start + size * count + 0.5 + fuzz)
    centres = np.arange(first, end) + 0.5
    shown_there = np.floor((centres - start) / size + fuzz).astype(np.int64)
    taken = np.clip(shown_there, 0, count - 1)
    return np.take(ranks, taken, axis=axis), first
