"""The whole comparison: registration, walls, extra walls, doors, rooms."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.types import FREE, FloatArray, IntArray, OccupancyGrid
from slamgym.drawing.comparison.extra_walls import extra_walls
from slamgym.drawing.comparison.faces import MapEvidence, map_evidence
from slamgym.drawing.comparison.plan_walls import plan_walls
from slamgym.drawing.comparison.records import Change, ChangeKind, Line, PlanComparison, WallReport
from slamgym.drawing.comparison.registration import register
from slamgym.drawing.comparison.walls import Survey, judge_wall, measure_walls, open_runs, runs_of
from slamgym.drawing.evidence import filled
from slamgym.drawing.settings import ComparisonConfig

CHANGED: dict[str, ChangeKind] = {
    "moved": "wall_moved",
    "covered": "wall_covered",
    "missing": "wall_missing",
}
"""States of walls that are changes."""
SHORTEST_CHANGED = 0.5
"""Changes of shorter walls and shorter gaps in a wall aren't reported [m]."""
EXPLORED = 0.3
"""A room of which the robot has seen less is not yet explored [share]."""
BEYOND_JAMBS = 1.3
"""The wall is looked at this far beyond both jambs [m]."""
_STEP = 0.025
NARROWEST_DOOR = 0.45
"""A gap that is narrower is no door [m]."""
MOVED, OTHER_WIDTH = 0.2, 0.15
"""A door has moved, or is wider or narrower, if it differs by more [m]."""


def compare_with_plan(
    plan: FloorPlan,
    grid: OccupancyGrid,
    config: ComparisonConfig | None = None,
    map_name: str = "",
    doubts: tuple[str, ...] = (),
) -> PlanComparison:
    """Compare a robot's map with a floor plan.

    Args:
        plan: As planned.
        grid: As built. Where it lies is not known; its scale is, unless ``config.scale``.
        config: The settings.
        map_name: For the report.
        doubts: What is already doubtful about plan and map, for the report.

    Returns:
        The changes; none where plan and map are of different buildings.
    """
    config = config or ComparisonConfig()
    walls = plan_walls(plan)
    evidence = map_evidence(grid)
    found = register(plan, walls, evidence, config.scale)
    doubts = (*doubts, *found.doubts)
    if not found.is_same_building:
        return PlanComparison(plan.where, map_name, found, (), (), (), doubts)
    evidence = evidence.moved(found.plan_from_map, found.scale)
    measured = measure_walls(walls, evidence)
    reports = [judge_wall(measured, wall, config) for wall in range(len(walls.lengths))]
    rooms = tuple(
        (room.category, _seen_share(room.polygon.intersection(plan.free_space), evidence))
        for room in plan.rooms
    )
    changes = [
        *_wall_changes(reports),
        *_new_openings(plan, measured, reports),
        *_extra_walls(plan, evidence, measured, reports),
        *_door_changes(plan, measured, evidence),
        *_unexplored(plan, rooms),
    ]
    return PlanComparison(plan.where, map_name, found, tuple(changes), tuple(reports), rooms, doubts)


def _wall_changes(reports: Sequence[WallReport]) -> Iterator[Change]:
    """Walls that have moved, are missing or covered, the longest first."""
    for wall in sorted(reports, key=lambda report: -report.length):
        if wall.state in CHANGED and wall.length >= SHORTEST_CHANGED:
            moved = wall.offset, wall.error, wall.raw_offset
            kind, what = CHANGED[wall.state], f"wall of {wall.length:.1f} m"
            yield Change(kind, what, wall.line, wall.length, *moved, wall.note)


def _new_openings(plan: FloorPlan, measured: Survey, reports: Sequence[WallReport]) -> Iterator[Change]:
    """Gaps in walls that are there otherwise, away from the plan's doors."""
    doors = shapely.MultiLineString([[door.start, door.end] for door in plan.doors])
    for number, wall in enumerate(reports):
        if wall.length < SHORTEST_CHANGED or wall.state not in ("present", "covered", "unclear"):
            continue
        for ends in open_runs(measured, number, SHORTEST_CHANGED):
            line = shapely.LineString(_along(wall.line, np.array(ends)))
            if not line.distance(doors) < 1.5:  # else that door has moved, or is wider; nan without any
                (xa, ya), (xb, yb) = line.coords
                yield Change("opening_new", f"opening of {line.length:.1f} m", (xa, ya, xb, yb), line.length)


def _along(line: Line, places: FloatArray) -> FloatArray:
    """Points (N, 2) at places (N,) along a line from its first end [m]."""
    start, end = np.array(line[:2]), np.array(line[2:])
    return start + places[:, None] * (end - start) / max(float(np.hypot(*(end - start))), 1e-6)


def _extra_walls(
    plan: FloorPlan, evidence: MapEvidence, measured: Survey, reports: Sequence[WallReport]
) -> Iterator[Change]:
    """Straight structures that the plan doesn't have."""
    walls = measured.plan
    # A wall that has moved is looked for where it is now, and the place that it left is no wall either.
    jambs = np.array([end for door in plan.doors for end in (door.start, door.end)]).reshape(-1, 2)
    shifts = measured.drift, measured.drift + [report.offset or 0.0 for report in reports]
    places = [walls.points + (shift[:, None] * walls.normals)[walls.wall] for shift in shifts]
    for line in extra_walls(plan.free_space, evidence, np.vstack([*places, jambs])):
        (xa, ya), (xb, yb) = line.coords
        yield Change("wall_extra", f"wall of {line.length:.1f} m", (xa, ya, xb, yb), line.length)


def _door_changes(plan: FloorPlan, measured: Survey, evidence: MapEvidence) -> Iterator[Change]:
    """The doors that are not as planned: moved along their wall, of another width, or blocked."""
    for number, door in enumerate(plan.doors, start=1):
        line: Line = (*door.start, *door.end)
        along = np.arange(-BEYOND_JAMBS + 0.5 * _STEP, door.width + BEYOND_JAMBS, _STEP)
        places = _along(line, along)
        normal = np.array([line[1] - line[3], line[2] - line[0]]) / max(door.width, 1e-6)
        shift = measured.drift_at(0.5 * np.add(door.start, door.end))
        states = evidence.across(places + shift, normal)
        # Beyond the ends of the wall lie other rooms.
        is_floor = shapely.contains_xy(plan.free_space, places)
        states[is_floor & ((along < -_STEP) | (along > door.width + _STEP))] = 0
        inside = states[(along > 0.1) & (along < door.width - 0.1)]
        if (inside == 0).mean() > 0.5:
            continue
        gap = _best_gap(states, along, door.width)
        name = f"door {number}, {door.width:.2f} m"
        if gap is None:
            if (inside < 0).mean() > 0.6:
                yield Change("door_blocked", name, line, door.width)
            continue
        if gap[0] <= along[0] or gap[1] >= along[-1]:
            continue  # the wall itself is gone there, which is another change
        offset, wider = 0.5 * (gap[0] + gap[1] - door.width), gap[1] - gap[0] - door.width
        if abs(offset) > MOVED and min(abs(gap[0]), abs(gap[1] - door.width)) > 0.5 * MOVED:
            yield Change("door_moved", name, line, door.width, offset, 2 * _STEP, offset)
        elif abs(wider) > OTHER_WIDTH:
            yield Change("door_width", name, line, door.width, wider, 2 * _STEP, wider)


def _best_gap(states: IntArray, along: FloatArray, width: float) -> tuple[float, float] | None:
    """The gap that overlaps the door most, or else is nearest to it: its ends along the wall [m]."""
    ends = along[0] + _STEP * (runs_of(states == 1) - 0.5)
    runs = [(start, stop) for start, stop in ends.tolist() if stop - start >= NARROWEST_DOOR]
    return max(runs, key=lambda run: min(run[1], width) - max(run[0], 0.0), default=None)


def _seen_share(floor: BaseGeometry, evidence: MapEvidence) -> float:
    """The share of a floor that the map shows as free."""
    frame = evidence.grid.frame
    shape = shapely.transform(floor, evidence.on_map)
    if shape.area < frame.resolution**2:
        return 1.0
    free = (evidence.grid.cells == FREE) & filled(shape, frame)
    return min(float(free.sum() * frame.resolution**2 / shape.area), 1.0)


def _unexplored(plan: FloorPlan, rooms: tuple[tuple[str, float], ...]) -> Iterator[Change]:
    for room, (name, seen) in zip(plan.rooms, rooms, strict=True):
        if seen < EXPLORED:
            x, y = room.polygon.representative_point().coords[0]
            yield Change("room_unexplored", name, (x, y, x, y), 0.0, note=f"{seen:.0%} of it seen")
