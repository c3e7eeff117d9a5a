"""The whole comparison: registration, walls, extra walls, doors, rooms."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely

from slamgym.cad.floorplan import Door, FloorPlan, Room
from slamgym.core.geometry import runs_of
from slamgym.core.types import FREE, FloatArray, IntArray, OccupancyGrid
from slamgym.drawing.comparison.extra_walls import extra_walls
from slamgym.drawing.comparison.faces import MapEvidence, map_evidence, plan_walls
from slamgym.drawing.comparison.records import FindingKind, Line, PlanComparison, PlanFinding
from slamgym.drawing.comparison.registration import MISSED, register
from slamgym.drawing.comparison.walls import (
    LEAST_SEEN,
    Survey,
    judge_wall,
    measure_walls,
    open_runs,
)
from slamgym.drawing.evidence import filled
from slamgym.drawing.settings import DRAWN_DOORS, MARGIN, USUAL_CELL, ComparisonConfig

CHANGED = ("wall_moved", "wall_missing", "room_unexplored")
"""What of the findings about walls and rooms is a change."""
SHORTEST_CHANGED = 0.5
"""Changes of shorter walls and shorter gaps in a wall aren't reported [m]."""
DOOR_CHANGED = 0.2
"""A door has moved if its middle is farther from its place, and is of another width if that differs by more [m]: either
jamb may be drawn two cells off."""


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
        grid: As built. Where it lies is not known; its scale is.
        config: The settings.
        map_name: For the report.
        doubts: What is already doubtful about plan and map, for the report.

    Returns:
        The changes, the largest first; none where plan and map are of different buildings.
    """
    config = config or ComparisonConfig()
    walls = plan_walls(plan)
    evidence = map_evidence(grid)
    found = register(plan, walls, evidence)
    doubts = (*doubts, *found.doubts)
    if not found.is_same_building:
        return PlanComparison(plan.where, map_name, found, (), (), (), doubts)
    evidence = evidence.moved(found.plan_from_map)
    measured = measure_walls(walls, evidence)
    judged = [judge_wall(measured, wall, config) for wall in range(len(walls.lengths))]
    rooms = [_judge_room(room, plan, evidence) for room in plan.rooms]
    long_walls = [wall for wall in judged if wall.length >= SHORTEST_CHANGED]
    changed_walls = [wall for wall in long_walls if wall.kind in CHANGED]
    changes = [
        *changed_walls,
        *_new_openings(plan, measured, judged),
        *_extra_walls(plan, evidence, measured, judged),
        *_door_changes(plan, measured, evidence),
        *(room for room in rooms if room.kind in CHANGED),
    ]
    changes.sort(key=_size, reverse=True)
    return PlanComparison(
        plan.where, map_name, found, tuple(changes), tuple(judged), tuple(rooms), doubts
    )


def _size(change: PlanFinding) -> float:
    """The area between what was planned and what was built [m2]; rooms that are unexplored have none."""
    away = MISSED if change.offset is None else abs(change.offset)
    return change.length * away


def _straight(kind: FindingKind, noun: str, line: shapely.LineString) -> PlanFinding:
    """A finding about a straight line."""
    (xa, ya), (xb, yb) = line.coords
    return PlanFinding(kind, f"{noun} of {line.length:.1f} m", (xa, ya, xb, yb))


def _new_openings(
    plan: FloorPlan, measured: Survey, judged: Sequence[PlanFinding]
) -> Iterator[PlanFinding]:
    """Gaps in walls that are there otherwise, away from the plan's doors."""
    doors = shapely.MultiLineString([[door.start, door.end] for door in plan.doors])
    for number, wall in enumerate(judged):
        if wall.length < SHORTEST_CHANGED or wall.kind not in ("wall_present", "wall_unclear"):
            continue
        for ends in open_runs(measured, number, SHORTEST_CHANGED):
            line = shapely.LineString(_along(wall.line, np.array(ends)))
            is_of_door = line.distance(doors) < 1.5  # it has moved, or is wider; nan without any
            if not is_of_door:
                yield _straight("opening_new", "opening", line)


def _along(line: Line, places: FloatArray) -> FloatArray:
    """Points (N, 2) at places (N,) along a line from its first end [m]."""
    start = np.array(line[:2])
    along = np.array(line[2:]) - start
    length = max(float(np.hypot(*along)), 1e-6)
    return start + places[:, None] * along / length


def _extra_walls(
    plan: FloorPlan, evidence: MapEvidence, measured: Survey, judged: Sequence[PlanFinding]
) -> Iterator[PlanFinding]:
    """Straight structures that the plan doesn't have."""
    walls = measured.plan
    # A wall that has moved is looked for where it is now, and the place that it left is no wall either.
    moved_by = measured.drift + [wall.offset or 0.0 for wall in judged]
    drift = measured.drift[:, None] * walls.normals
    shift = moved_by[:, None] * walls.normals
    left = walls.points + drift[walls.wall]
    now = walls.points + shift[walls.wall]
    jambs = [(door.start, door.end) for door in plan.doors]
    explained_by = np.vstack([left, now, np.array(jambs).reshape(-1, 2)])
    for line in extra_walls(plan.free_space, evidence, explained_by):
        yield _straight("wall_extra", "wall", line)


def _door_changes(
    plan: FloorPlan, measured: Survey, evidence: MapEvidence
) -> Iterator[PlanFinding]:
    """The doors that are not as planned: moved along their wall, of another width, or blocked."""
    for number, door in enumerate(plan.doors, start=1):
        along = np.arange(-MARGIN + 0.5 * USUAL_CELL, door.width + MARGIN, USUAL_CELL)
        states = _states_along(door, along, plan, measured, evidence)
        inside = states[(along > 0.1) & (along < door.width - 0.1)]
        if (inside == 0).mean() > 0.5:
            continue
        line: Line = (*door.start, *door.end)
        name = f"door {number}, {door.width:.2f} m"
        gap = _best_gap(states, along, door.width)
        if gap is not None:
            yield from _changed_gap(name, line, door.width, gap, along)
        elif (inside < 0).mean() > 0.6:
            yield PlanFinding("door_blocked", name, line)


def _states_along(
    door: Door, along: FloatArray, plan: FloorPlan, measured: Survey, evidence: MapEvidence
) -> IntArray:
    """At places along a door's wall (N,) [m]: 1 open, -1 closed, 0 unknown, or beyond the ends of the wall."""
    x0, y0 = door.start
    x1, y1 = door.end
    places = _along((x0, y0, x1, y1), along)
    normal = np.array([y0 - y1, x1 - x0]) / max(door.width, 1e-6)
    shift = measured.drift_at(0.5 * np.add(door.start, door.end))
    states = evidence.across(places + shift, normal)
    # Beyond the ends of the wall lie other rooms.
    is_floor = shapely.contains_xy(plan.free_space, places)
    is_beside = (along < -USUAL_CELL) | (along > door.width + USUAL_CELL)
    states[is_floor & is_beside] = 0
    return states


def _changed_gap(
    name: str, line: Line, width: float, gap: tuple[float, float], along: FloatArray
) -> Iterator[PlanFinding]:
    """What is not as planned about the gap of a door."""
    low, high = gap
    if low <= along[0] or high >= along[-1]:
        return  # the wall itself is gone there, which is another change
    offset = 0.5 * (low + high - width)
    wider = high - low - width
    nearer_jamb = min(abs(low), abs(high - width))
    if abs(offset) > DOOR_CHANGED and nearer_jamb > 0.5 * DOOR_CHANGED:
        yield PlanFinding("door_moved", name, line, offset, 2 * USUAL_CELL, offset)
    elif abs(wider) > DOOR_CHANGED:
        yield PlanFinding("door_width", name, line, wider, 2 * USUAL_CELL, wider)


def _best_gap(states: IntArray, along: FloatArray, width: float) -> tuple[float, float] | None:
    """The gap that overlaps the door most, or else is nearest to it: its ends along the wall [m]."""
    is_open = states == 1
    ends = along[0] + USUAL_CELL * (runs_of(is_open) - 0.5)
    runs = [(start, stop) for start, stop in ends.tolist() if stop - start >= DRAWN_DOORS[0]]

    def overlap(run: tuple[float, float]) -> float:
        start, stop = run
        return min(stop, width) - max(start, 0.0)

    return max(runs, key=overlap, default=None)


def _judge_room(room: Room, plan: FloorPlan, evidence: MapEvidence) -> PlanFinding:
    """Whether the map shows enough of a room as free."""
    frame = evidence.grid.frame
    shape = shapely.transform(room.polygon.intersection(plan.free_space), evidence.on_map)
    free = (evidence.grid.cells == FREE) & filled(shape, frame)
    cell = frame.resolution**2
    seen = 1.0
    if shape.area > cell:
        seen = min(float(free.sum() * cell / shape.area), 1.0)
    x, y = room.polygon.representative_point().coords[0]
    kind: FindingKind = "room_unexplored" if seen < LEAST_SEEN else "room_explored"
    return PlanFinding(kind, room.category, (x, y, x, y), seen=seen)
