"""The share of a building that has truly been seen.

The floor that counts is what a robot could be expected to see: the part of the free space that the robot's
centre can reach from its start (the connected component of the free space, eroded by the robot's radius,
that holds the start), dilated back by the radius and by what a disc can't fill of a square corner,
(sqrt(2) - 1) radius, and cut to the free space. A cell of that floor is seen once a beam without noise, cast
from the true pose and followed to the usable range, has passed through it. Coverage is the share of the
floor's cells that were seen.

It is computed from the truth: it may measure an exploration, but no observation shows it.
"""

import math
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from slamgym.cad.floorplan import FloorPlan, fill_segments, ring_segments
from slamgym.cad.polygons import polygon_parts
from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, FloatArray, GridFrame
from slamgym.sim.passages import Passages
from slamgym.sim.start import fitting_area

CELL = 0.1
"""Cell size of the floor [m]: the beams of one scan are at most 5 cm apart within the usable range."""

CORNER = math.sqrt(2.0) - 1.0
"""Part of a square corner that a disc can't fill, along its diagonal, in radii."""


_FRACTION = 32
"""Binary digits of a beam's position within a cell."""
_HALF = 1 << (_FRACTION - 1)
"""Half a cell."""


class ReachableFloor:
    """The parts of a building's floor that a robot can reach, each as a mask of cells.

    Args:
        plan: The building.
        robot_radius: [m].
        passages: Passages that remain between furniture, where there is some.
    """

    def __init__(
        self, plan: FloorPlan, robot_radius: float, passages: Passages | None = None
    ) -> None:
        self._dilation = robot_radius * (1.0 + CORNER)
        self._free: BaseGeometry = plan.free_space
        self._passages = passages
        self._labels = passages.parts(robot_radius)[1] if passages else None
        area = shapely.Polygon() if passages else fitting_area(plan, robot_radius)
        self._parts = [part for part in shapely.get_parts(area) if not part.is_empty]
        self._masks: dict[int, BoolArray] = {}
        # The margin keeps beams that end on the outline inside the grid.
        self.frame = GridFrame.covering(plan.bounds, CELL, margin=2.0 * CELL)

    def mask(self, x: float, y: float) -> BoolArray:
        """The floor that is reachable from a point.

        Convention: row 0 at the *bottom*, as :class:`Coverage` has it.

        Args:
            x: The start, world frame [m].
            y: The start, world frame [m].

        Returns:
            Shape ``frame.shape``, read-only; without any cell if the robot can't be anywhere.
        """
        index = self._part_at(x, y)
        if index not in self._masks:
            cells = self._mask_of(index)
            cells.flags.writeable = False
            self._masks[index] = cells
        return self._masks[index]

    def _mask_of(self, index: int) -> BoolArray:
        """Cells of a part; none for -1."""
        if index < 0:
            return np.zeros(self.frame.shape, dtype=np.bool_)
        if self._passages is not None and self._labels is not None:
            part = self._labels == index
            return self._passages.floor_about(part, self._dilation, self.frame)
        around = self._parts[index].buffer(self._dilation, quad_segs=8)
        floor = around.intersection(self._free)
        cells = fill_segments(_outlines(floor), self.frame)
        return np.ascontiguousarray(cells[::-1])

    def _part_at(self, x: float, y: float) -> int:
        """Index of the part that holds a point, or is nearest to it; -1 if there is none."""
        if self._passages is not None and self._labels is not None:
            here = int(self._labels[self._passages.cell(x, y)])
            if here > 0:
                return here
            inside = self._labels > 0
            if not inside.any():
                return -1
            distance = np.where(inside, self._passages.distance_from(x, y), np.inf)
            return int(self._labels.flat[int(np.argmin(distance))])
        if len(self._parts) < 2:
            return len(self._parts) - 1
        point = shapely.Point(x, y)
        return int(np.argmin([part.distance(point) for part in self._parts]))


class Coverage(NamedTuple):
    """Floor that one exploration has seen so far.

    Convention: the masks have row 0 at the *bottom*, as the kernel :func:`sweep` wants them.
    """

    floor: BoolArray  # cells that count, shape ``frame.shape``
    unseen: BoolArray  # those still to be seen
    frame: GridFrame

    @property
    def floor_area(self) -> float:
        """The floor that counts [m2]."""
        return int(np.count_nonzero(self.floor)) * CELL**2

    @property
    def share(self) -> float:
        """Share of the floor's cells that were seen, in [0, 1]; 1 where there is no floor."""
        total = int(np.count_nonzero(self.floor))
        return (total - int(np.count_nonzero(self.unseen))) / total if total else 1.0

    @property
    def seen(self) -> BoolArray:
        """Cells of the floor that were seen, shape ``frame.shape``, row 0 at the top."""
        seen: BoolArray = self.floor & ~self.unseen
        return seen[::-1]


def _outlines(area: BaseGeometry) -> FloatArray:
    """All edges of an area's polygons, shape (S, 4) [m]."""
    rings = []
    for part in polygon_parts(area):
        rings += [part.exterior, *part.interiors]
    return ring_segments(rings)


@kernel
def sweep(
    unseen: BoolArray,
    origin_x: float,
    origin_y: float,
    resolution: float,
    x: float,
    y: float,
    theta: float,
    directions: FloatArray,
    ranges: FloatArray,
    usable: float,
) -> int:
    """Mark the cells along each beam as seen.

    Convention: ``unseen`` has row 0 at the *bottom*, so that row and y grow together; ``x, y, theta`` is the
    pose of the sensor in the frame of the grid.

    Args:
        unseen: Cells still to be seen, shape (H, W); changed in place.
        origin_x: Lower left corner of the grid [m].
        origin_y: Lower left corner of the grid [m].
        resolution: Cell size [m].
        x: Sensor position [m].
        y: Sensor position [m].
        theta: Sensor heading [rad].
        directions: Unit vectors of the beams in the sensor frame, shape (num_beams, 2).
        ranges: True ranges, shape (num_beams,) [m]; inf where nothing was met.
        usable: Beams are followed no further than this [m].

    Returns:
        How many cells were seen for the first time.
    """
    height, width = unseen.shape
    flat = unseen.reshape(-1)
    cos = math.cos(theta)
    sin = math.sin(theta)
    scale = 1.0 / resolution
    start_col = math.floor((x - origin_x) * scale)
    start_row = math.floor((y - origin_y) * scale)
    if not (0 <= start_row < height and 0 <= start_col < width):
        return 0
    start = start_row * width + start_col
    fresh = 0
    last_row = 0
    last_col = 0
    for i in range(len(ranges)):
        length = min(ranges[i], usable)
        end_x = x + length * (cos * directions[i, 0] - sin * directions[i, 1])
        end_y = y + length * (sin * directions[i, 0] + cos * directions[i, 1])
        # Beams end at a wall or at the usable range; rounding may put the end a cell outside the grid.
        d_col = min(max(math.floor((end_x - origin_x) * scale), 0), width - 1) - start_col
        d_row = min(max(math.floor((end_y - origin_y) * scale), 0), height - 1) - start_row
        if i > 0 and d_row == last_row and d_col == last_col:
            continue  # the same cells as the last beam's
        last_row = d_row
        last_col = d_col
        major_stride = 1 if d_col >= 0 else -1
        minor_stride = width if d_row >= 0 else -width
        major = abs(d_col)
        minor = abs(d_row)
        if minor > major:
            major, minor = minor, major
            major_stride, minor_stride = minor_stride, major_stride
        slope = (minor << _FRACTION) // max(major, 1)
        offset = _HALF
        along = start
        for _ in range(major + 1):
            # An unsigned index isn't asked whether it counts from the end.
            cell = np.uint64(along + (offset >> _FRACTION) * minor_stride)
            if flat[cell]:
                flat[cell] = False
                fresh += 1
            along += major_stride
            offset += slope
    return fresh
