"""Floor plans as geometry: the free space of a building, its rooms and its doors.

Convention: everything is in the plan's frame (``world``): metres, x right, y up.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad.polygons import largest_part, polygon_parts, refuse_crowded
from slamgym.core.errors import PlanError
from slamgym.core.thin_walls import SHARE_STEPS, close_thin_walls
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    IntArray,
    OccupancyGrid,
)

MIN_REACHED_SHARE = 0.8
"""The robot must be able to drive over this share of the floor, its own width counted."""
MIN_ROOM_SHARE = 0.25
"""A room of which the robot can drive over less than this share counts as one that it can't enter.

Half would be too strict: the rooms of HouseExpo are overlapping boxes, often larger than the room itself.
"""
MIN_ROOM_AREA = 1.0
"""Wardrobes and shafts smaller than this [m2] may stay closed to the robot."""


@dataclass(frozen=True)
class Room:
    """A room by its use and its extent, which may overlap other rooms and walls (HouseExpo gives boxes)."""

    category: str  # as HouseExpo names them: "Bedroom", "Living_Room", ...
    polygon: Polygon  # [m]

    @property
    def area(self) -> float:
        """Area of the declared extent [m2]."""
        return float(self.polygon.area)


@dataclass(frozen=True)
class Door:
    """An opening in a wall: the segment across its middle, from jamb to jamb."""

    start: tuple[float, float]  # [m]
    end: tuple[float, float]  # [m]

    @property
    def width(self) -> float:
        """Clear width [m]."""
        return math.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])


@dataclass(frozen=True)
class FloorPlan:
    """A building floor: where a robot may be, what the rooms are called, where the doors are.

    Attributes:
        id: Name of the plan, unique within its source.
        free_space: The floor between the walls; its holes are pillars, islands and cores.
        rooms: Rooms where known.
        doors: Doors and wider openings where known.
        source: The file it came from, or the generator with its seed; errors name it.
        doubts: Sentences about what a drawing left open, its unit above all.
    """

    id: str
    free_space: Polygon
    rooms: tuple[Room, ...] = ()
    doors: tuple[Door, ...] = ()
    source: str = ""
    doubts: tuple[str, ...] = ()

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(min x, min y, max x, max y) of the free space [m]."""
        min_x, min_y, max_x, max_y = self.free_space.bounds
        return min_x, min_y, max_x, max_y

    @property
    def extent(self) -> float:
        """Longer side of the bounding box [m]."""
        min_x, min_y, max_x, max_y = self.bounds
        return max(max_x - min_x, max_y - min_y)

    @property
    def area(self) -> float:
        """Area of the free space [m2]."""
        return float(self.free_space.area)

    @property
    def num_vertices(self) -> int:
        """Corners of the outline and of the holes."""
        return len(self.segments())

    @property
    def where(self) -> str:
        """The name of this plan in errors: its file, else its id."""
        return self.source or self.id

    @cached_property
    def _segments(self) -> FloatArray:
        segments = ring_segments([self.free_space.exterior, *self.free_space.interiors])
        segments.flags.writeable = False
        return segments

    def segments(self) -> FloatArray:
        """The faces of all walls, outline first, then the holes.

        Returns:
            Shape (S, 4): x0, y0, x1, y1 [m]; read-only, the same array at every call.
        """
        return self._segments

    def turned(self, degrees: float) -> "FloorPlan":
        """The same floor, turned counter-clockwise about the frame's origin."""
        if degrees == 0.0:
            return self
        radians = math.radians(degrees)
        cos = math.cos(radians)
        sin = math.sin(radians)
        matrix = np.array([[cos, -sin], [sin, cos]])

        def turn(shape: Polygon) -> Polygon:
            return shapely.transform(shape, lambda points: points @ matrix.T)

        def turn_point(point: tuple[float, float]) -> tuple[float, float]:
            x, y = (matrix @ point).tolist()
            return x, y

        return replace(
            self,
            free_space=turn(self.free_space),
            rooms=tuple(replace(room, polygon=turn(room.polygon)) for room in self.rooms),
            doors=tuple(Door(turn_point(door.start), turn_point(door.end)) for door in self.doors),
        )

    def raster(
        self,
        resolution: float,
        frame: GridFrame | None = None,
        offset: tuple[float, float] = (0.0, 0.0),
        *,
        outside: int = OCCUPIED,
        wall_thickness: float = 0.2,
    ) -> OccupancyGrid:
        """Draw the plan as an occupancy grid: the CAD map.

        A cell is free (254) if its centre lies in the free space. All else is a wall (0) or, farther than
        ``wall_thickness`` from any free cell, ``outside``: 0 gives the solid walls of a CAD image, 205 marks
        what no robot can ever see as unknown.

        Convention: ``offset`` is subtracted from world coordinates before drawing, so the start position as
        offset gives a grid in the map frame. ``frame`` is the frame of the result; by default the smallest
        one that covers the plan with a margin of ``wall_thickness``.

        Args:
            resolution: Cell size [m]; must agree with ``frame``.
            frame: Where the cells lie.
            offset: (x, y) [m] of the result's origin in the world.
            outside: Value of cells far from the free space.
            wall_thickness: How far outside the free space a cell still counts as wall [m].
        """
        if not resolution > 0.0:
            raise ValueError(f"resolution must be above 0 m per cell, not {resolution}")
        segments = self.segments() - np.array([*offset, *offset])
        if frame is None:
            min_x, min_y, max_x, max_y = self.bounds
            moved = (min_x - offset[0], min_y - offset[1], max_x - offset[0], max_y - offset[1])
            frame = GridFrame.covering(moved, resolution, margin=wall_thickness)
        elif not math.isclose(frame.resolution, resolution):
            raise ValueError(f"resolution is {resolution} but the frame's is {frame.resolution}")
        inside = fill_segments(segments, frame)
        return OccupancyGrid(map_values(inside, resolution, outside, wall_thickness), frame)


def ring_segments(rings: Iterable[BaseGeometry]) -> FloatArray:
    """The edges of closed rings, shape (S, 4) x0, y0, x1, y1 [m], without those of no length."""
    edges = []
    for ring in rings:
        points = shapely.get_coordinates(ring)
        edges.append(np.hstack([points[:-1], points[1:]]))
    segments = np.ascontiguousarray(np.vstack(edges)) if edges else np.empty((0, 4))
    long_enough = (segments[:, :2] != segments[:, 2:]).any(axis=1)
    return np.ascontiguousarray(segments[long_enough], dtype=np.float64)


def polygon_edges(geometry: BaseGeometry) -> FloatArray:
    """The edges of all polygons in a geometry, shape (S, 2, 2): start and end, x and y [m]."""
    return ring_segments(shapely.get_rings(polygon_parts(geometry))).reshape(-1, 2, 2)


def robot_space(plan: FloorPlan, robot_radius: float) -> Polygon:
    """Where the centre of a round robot can be: the largest part of the free space shrunk by its radius.

    Args:
        plan: The plan.
        robot_radius: [m].

    Returns:
        A polygon in the world frame, empty if the robot fits nowhere.
    """
    # 1 cm staircases, of which curved walls of HouseExpo consist, cost time and change nothing at this scale.
    outline = plan.free_space.simplify(0.005) if plan.num_vertices > 200 else plan.free_space
    shrunk = outline.buffer(-robot_radius, quad_segs=4)
    return largest_part(shrunk)


def check_plan(plan: FloorPlan, robot_radius: float = 0.22, max_extent: float = math.inf) -> None:
    """Refuse a plan that can't be explored.

    Args:
        plan: The plan.
        robot_radius: Radius of the robot's circular hull [m]; 0.22 m holds a TurtleBot3 Waffle Pi.
        max_extent: Longest side that the map has room for [m].

    Raises:
        PlanError: Naming the plan and the first fault found: coordinates that aren't numbers, an outline that
            crosses itself, no area, disjoint parts, too large for the map, rooms that the robot can't enter.
    """
    _check_geometry(plan)
    if plan.extent > max_extent:
        raise PlanError(
            plan.where,
            f"the plan is {plan.extent:.1f} m long but the map holds {max_extent:.1f} m; use coarser cells "
            "(observation.map_resolution), or set SLAMGYM_MAX_MAP_CELLS higher",
        )
    # Shrinking by the robot's radius makes every wall meet those nearer than its diameter.
    refuse_crowded(plan.segments(), 2.0 * robot_radius, plan.where)
    _check_reachable(plan, robot_radius)


def _check_geometry(plan: FloorPlan) -> None:
    """Refuse free space that isn't one valid polygon with an area."""
    space: BaseGeometry = plan.free_space  # which the type promises, but a caller may break it
    if isinstance(space, shapely.MultiPolygon):
        raise PlanError(
            plan.where, f"the free space falls into {len(space.geoms)} disjoint parts; connect them"
        )
    if not isinstance(space, Polygon):
        raise PlanError(plan.where, f"the free space is a {space.geom_type}, not a polygon")
    if not np.isfinite(shapely.get_coordinates(space)).all():
        raise PlanError(plan.where, "a coordinate is NaN or infinite; give numbers in metres")
    if space.is_empty or space.area <= 0.0:
        raise PlanError(
            plan.where, "the free space has no area; give an outline that encloses some"
        )
    if not space.is_valid:
        reason = shapely.is_valid_reason(space)
        raise PlanError(plan.where, f"the outline is invalid ({reason}); make it a simple polygon")


def _check_reachable(plan: FloorPlan, robot_radius: float) -> None:
    """Refuse a plan whose floor, or whose declared rooms, the robot can't enter."""
    robot = f"a robot of radius {robot_radius:.2f} m"
    centre_space = robot_space(plan, robot_radius)
    if centre_space.is_empty:
        raise PlanError(
            plan.where,
            f"no place is wide enough for {robot}; check its unit, or use a smaller robot",
        )
    # The floor that the robot's body can cover; corners it can't reach are a matter of centimetres.
    reached = centre_space.buffer(robot_radius, quad_segs=4)
    share = reached.area / plan.area
    if share < MIN_REACHED_SHARE:
        raise PlanError(
            plan.where, f"{robot} can enter only {share:.0%} of the floor; widen the doors"
        )
    closed = []
    for room in plan.rooms:
        floor = room.polygon.intersection(plan.free_space)
        reached_area = reached.intersection(floor).area
        if floor.area >= MIN_ROOM_AREA and reached_area < MIN_ROOM_SHARE * floor.area:
            closed.append(room.category)
    if closed:
        names = ", ".join(sorted(set(closed)))
        raise PlanError(
            plan.where, f"{robot} can't enter {len(closed)} room(s), {names}; widen the doors"
        )


def fill_segments(segments: FloatArray, frame: GridFrame) -> BoolArray:
    """The cells whose centres lie inside closed rings, by the even-odd rule.

    ``cv2.fillPoly`` would also paint every cell that the boundary touches, which makes walls thinner by half a
    cell on either side; here a scanline per row of cell centres collects the crossings of all edges at once.

    Convention: segments are given in the frame's coordinates; the result is ``[row, col]``, row 0 at the top.

    Args:
        segments: All edges of all rings (outlines and holes) in any order, shape (S, 4) x0, y0, x1, y1 [m].
        frame: The grid.

    Returns:
        Shape (height_px, width_px), true inside.
    """
    height, width = frame.shape
    row, col = _crossings(segments, frame)
    inside = np.zeros((height, width), np.bool_)
    if len(row):
        top = height - 1 - row.max()
        bottom = height - row.min()
        shape = (bottom - top, width + 1)
        places = (height - 1 - row - top) * (width + 1) + col
        crossings = np.bincount(places, minlength=shape[0] * shape[1]).reshape(shape)
        parity = (crossings & 1).astype(np.uint8)
        inside[top:bottom] = np.bitwise_xor.accumulate(parity, axis=1)[:, :width]
    return inside


def _crossings(segments: FloatArray, frame: GridFrame) -> tuple[IntArray, IntArray]:
    """Where edges cross the rows of cell centres: rows counted from the bottom, and the first columns behind."""
    height, width = frame.shape
    # In units of cells, with the centres of the cells at whole numbers and rows counted from the bottom.
    x0 = (segments[:, 0] - frame.origin_x) / frame.resolution - 0.5
    x1 = (segments[:, 2] - frame.origin_x) / frame.resolution - 0.5
    y0 = (segments[:, 1] - frame.origin_y) / frame.resolution - 0.5
    y1 = (segments[:, 3] - frame.origin_y) / frame.resolution - 0.5
    # An edge owns the rows in [lower end, upper end): a vertex on a row counts once, a horizontal edge never.
    first = np.clip(np.ceil(np.minimum(y0, y1)), 0, height).astype(np.int64)
    stop = np.clip(np.ceil(np.maximum(y0, y1)), 0, height).astype(np.int64)
    count = stop - first
    edge = np.repeat(np.arange(len(segments)), count)
    before = np.cumsum(count) - count
    row = np.arange(len(edge)) - before[edge] + first[edge]
    slope = (x1 - x0)[edge] / (y1 - y0)[edge]
    crossing = x0[edge] + (row - y0[edge]) * slope
    return row, np.clip(np.ceil(crossing), 0, width).astype(np.int64)


def floor_share(segments: FloatArray, frame: GridFrame) -> Float32Array:
    """Share of each cell that is floor; walls thinner than a cell stay closed.

    Where a straight face passes through a cell, the share says where; see :mod:`slamgym.core.thin_walls`.

    Convention: as of :func:`fill_segments`.

    Args:
        segments: All edges of all rings, shape (S, 4) [m].
        frame: The grid.

    Returns:
        Shape (height_px, width_px), in [0, 1].
    """
    height, width = frame.shape
    n = SHARE_STEPS
    fine_frame = GridFrame(
        frame.resolution / n, frame.origin_x, frame.origin_y, height * n, width * n
    )
    fine = fill_segments(segments, fine_frame)
    share = fine.reshape(height, n, width, n).mean(axis=(1, 3), dtype=np.float32)
    middle = n // 2
    # The transposed arrays are views: both directions change the same shares.
    close_thin_walls(share, fine[middle::n, middle:-middle])
    close_thin_walls(share.T, fine.T[middle::n, middle:-middle])
    return np.asarray(share, dtype=np.float32)


def map_values(
    inside: BoolArray, resolution: float, outside: int, wall_thickness: float
) -> ByteArray:
    """Give free cells 254, cells within ``wall_thickness`` [m] of them 0, and all others ``outside``."""
    import cv2

    cells: ByteArray = np.where(inside, FREE, OCCUPIED).astype(np.uint8)
    if outside != OCCUPIED:
        if inside.any():
            # From centre to centre; half a cell less is the distance to the free cell's border.
            outer = (~inside).astype(np.uint8)
            distance = cv2.distanceTransform(outer, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            far = distance * resolution > wall_thickness + 0.5 * resolution
        else:
            far = np.ones_like(inside)
        cells[far] = outside
    return cells
