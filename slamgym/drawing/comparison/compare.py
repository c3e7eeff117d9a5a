"""The whole comparison: registration, walls, extra walls, doors, rooms."""

from collections.abc import Iterator

import numpy as np
import shapely
from scipy.spatial import KDTree
from shapely.geometry.base import BaseGeometry

from slamgym.cad.floorplan import Door, FloorPlan
from slamgym.core.types import FREE, OCCUPIED, FloatArray, IntArray, OccupancyGrid
from slamgym.drawing.comparison.extra_walls import extra_structures
from slamgym.drawing.comparison.faces import MapEvidence, PlanFaces, map_evidence, plan_faces
from slamgym.drawing.comparison.records import Change, ChangeKind, FaceReport, Line, PlanComparison
from slamgym.drawing.comparison.registration import register
from slamgym.drawing.comparison.walls import Faces, judge_face, measure_faces, open_runs, runs_of
from slamgym.drawing.settings import ComparisonConfig

AGREE = 0.15
"""The two faces of a wall have moved together if their offsets agree this well [m]."""
SEEN_FROM = 0.1
"""Size of the cells at which a room's floor is sampled [m]."""
FURNITURE = (0.15, 0.8)
"""A face so far before the place of a wall whose other side isn't seen may be furniture [m]."""
SHORTEST_CHANGED = 0.5
"""Changes of shorter faces and shorter gaps in a wall aren't reported [m]."""
EXPLORED = 0.3
"""A room of which the robot has seen less is not yet explored [share]."""
BEYOND_JAMBS = 1.3
"""The wall is looked at this far beyond both jambs [m]."""
_STEP = 0.025
_DEPTH = 0.1
"""A door is open where the map is free this far to both sides of the wall's middle [m]."""
NARROWEST_DOOR = 0.45
"""A gap that is narrower is no door [m]."""
NEAREST_FACES = 40
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
    faces = plan_faces(plan)
    evidence = map_evidence(grid)
    found = register(plan, faces, evidence, config.scale)
    doubts = (*doubts, *found.doubts)
    if not found.is_same_building:
        return PlanComparison(plan.where, map_name, found, (), (), (), doubts)
    evidence = evidence.moved(found.plan_from_map, found.scale)
    measured = measure_faces(faces, evidence)
    reports = [judge_face(measured, face, config) for face in range(len(faces.lengths))]
    rooms = tuple(
        (room.category, _seen_share(room.polygon.intersection(plan.free_space), evidence))
        for room in plan.rooms
    )
    changes = [
        *_wall_changes(measured, reports, config),
        *_new_openings(plan, measured, reports),
        *_extra_walls(plan, evidence, measured, reports),
        *_door_changes(plan, measured, evidence),
        *_unexplored(plan, rooms),
    ]
    return PlanComparison(plan.where, map_name, found, tuple(changes), tuple(reports), rooms, doubts)


def _wall_changes(measured: Faces, reports: list[FaceReport], config: ComparisonConfig) -> Iterator[Change]:
    """Walls that have moved or are missing; the two faces of a wall are one row."""
    faces = measured.plan
    done: set[int] = set()
    for face in np.argsort(-faces.lengths):
        i, j = int(face), int(faces.opposite[face])
        first, second = reports[i], reports[j] if j >= 0 else None
        if i in done or faces.lengths[i] < SHORTEST_CHANGED:
            continue
        if j >= 0 and faces.opposite[j] == i:
            done.add(j)
        if second is not None and second.state in ("not_seen", "unclear"):
            second = None
        if first.state in ("not_seen", "unclear"):
            if second is None:
                continue
            i, first, second = j, second, None
        change = _wall_change(faces, i, first, second, config)
        if change is not None:
            yield change


def _wall_change(
    faces: PlanFaces, i: int, first: FaceReport, second: FaceReport | None, config: ComparisonConfig
) -> Change | None:
    """The change of a wall that the reports of one or two of its faces show, if any."""
    line: Line = _middle_line(faces, i)
    length = float(faces.lengths[i])
    states = {first.state} | ({second.state} if second is not None else set())
    if "missing" in states and not states & {"present", "moved"}:
        return Change("wall_missing", f"wall of {length:.1f} m", line, length)
    if first.offset is None or first.error is None or first.raw_offset is None:
        return None
    kind: ChangeKind = "wall_moved"
    offset, error, raw, note = first.offset, first.error, first.raw_offset, "measured on one face"
    if (
        second is not None
        and second.offset is not None
        and second.error is not None
        and second.raw_offset is not None
    ):
        if abs(first.offset + second.offset) > AGREE:
            return None  # one face is where it was: furniture before the other, or a thicker wall
        offset, raw = 0.5 * (first.offset - second.offset), 0.5 * (first.raw_offset - second.raw_offset)
        # The distortion is common to both, so two faces aren't twice as sure.
        error, note = 0.8 * min(first.error, second.error), "measured on both faces"
    elif FURNITURE[0] < offset < FURNITURE[1]:
        kind, note = "wall_covered", "seen from one side: furniture along the wall, or the wall has moved"
    if abs(offset) <= config.moved or abs(offset) <= config.sure * error:
        return None
    return Change(kind, f"wall of {length:.1f} m", line, length, offset, error, raw, note)


def _middle_line(faces: PlanFaces, i: int) -> Line:
    """Between a face and the one behind it, with the floor of the first on its left."""
    x0, y0, x1, y1 = faces.segments[i].tolist()
    j = int(faces.opposite[i])
    if j < 0:
        return x0, y0, x1, y1
    depth = float((faces.segments[j, :2] - faces.segments[i, :2]) @ -faces.normals[i])
    x, y = (-0.5 * depth * faces.normals[i]).tolist()
    return x0 + x, y0 + y, x1 + x, y1 + y


def _new_openings(plan: FloorPlan, measured: Faces, reports: list[FaceReport]) -> Iterator[Change]:
    """Gaps in walls that are there otherwise, away from the plan's doors."""
    faces = measured.plan
    doors = shapely.MultiLineString([[door.start, door.end] for door in plan.doors]) if plan.doors else None
    found: list[shapely.LineString] = []
    for face in np.flatnonzero(faces.lengths >= SHORTEST_CHANGED):
        if reports[face].state in ("missing", "moved", "not_seen"):
            continue
        unit = (faces.segments[face, 2:] - faces.segments[face, :2]) / faces.lengths[face]
        for start, stop in open_runs(measured, int(face), SHORTEST_CHANGED):
            middle = _middle_line(faces, int(face))
            base = np.array(middle[:2])
            line = shapely.LineString([base + start * unit, base + stop * unit])
            if doors is not None and line.distance(doors) < 1.5:
                continue  # that door has moved, or is wider
            if any(line.distance(other) < 0.3 for other in found):
                continue
            found.append(line)
            (xa, ya), (xb, yb) = line.coords
            yield Change(
                "opening_new", f"opening of {line.length:.1f} m", (xa, ya, xb, yb), float(line.length)
            )


def _extra_walls(
    plan: FloorPlan, evidence: MapEvidence, measured: Faces, reports: list[FaceReport]
) -> Iterator[Change]:
    """Straight structures that the plan doesn't have."""
    faces = measured.plan
    shift = np.array([report.offset or 0.0 for report in reports])[faces.face] + measured.expected
    places = faces.points + shift[:, None] * faces.point_normals
    # A wall that has moved is looked for where it is now, and the place that it left is no wall either.
    here = np.vstack([places, faces.points + measured.expected[:, None] * faces.point_normals])
    jambs = np.array([end for door in plan.doors for end in (door.start, door.end)]).reshape(-1, 2)
    for structure in extra_structures(plan.free_space, evidence, np.vstack([here, jambs])):
        note = "seen from both sides" if structure.is_seen_from_both_sides else "long, seen from one side"
        yield Change(
            "wall_extra", f"wall of {structure.length:.1f} m", structure.line, structure.length, note=note
        )


def _door_changes(plan: FloorPlan, faces: Faces, evidence: MapEvidence) -> Iterator[Change]:
    """The doors that are not as planned: moved along their wall, of another width, or blocked."""
    tree = KDTree(faces.plan.points)
    for number, door in enumerate(plan.doors, start=1):
        line: Line = (*door.start, *door.end)
        unit = np.array([line[2] - line[0], line[3] - line[1]]) / max(door.width, 1e-6)
        shift = _distortion_at(faces, tree, 0.5 * (np.array(line[:2]) + np.array(line[2:])))
        states = _states(door, unit, evidence, shift)
        along = -BEYOND_JAMBS + _STEP * (np.arange(len(states), dtype=np.float64) + 0.5)
        # Beyond the ends of the wall lie other rooms.
        places = np.array(door.start) + along[:, None] * unit
        is_floor = shapely.contains_xy(plan.free_space, places[:, 0], places[:, 1])
        states[is_floor & ((along < -_STEP) | (along > door.width + _STEP))] = 0
        inside = (along > 0.1) & (along < door.width - 0.1)
        if (states[inside] == 0).mean() > 0.5:
            continue
        gap = _best_gap(states, along, door.width)
        name = f"door {number}, {door.width:.2f} m"
        if gap is None:
            if (states[inside] < 0).mean() > 0.6:
                yield Change("door_blocked", name, line, door.width)
            continue
        if gap[0] <= along[0] or gap[1] >= along[-1]:
            continue  # the wall itself is gone there, which is another change
        offset = 0.5 * (gap[0] + gap[1]) - 0.5 * door.width
        if abs(offset) > MOVED and min(abs(gap[0]), abs(gap[1] - door.width)) > 0.5 * MOVED:
            yield Change("door_moved", name, line, door.width, offset, 2 * _STEP, offset)
        elif abs(gap[1] - gap[0] - door.width) > OTHER_WIDTH:
            wider = gap[1] - gap[0] - door.width
            yield Change("door_width", name, line, door.width, wider, 2 * _STEP, wider)


def _distortion_at(faces: Faces, tree: KDTree, place: FloatArray) -> FloatArray:
    """The map's shift at a place, from the distortions along the normals of the faces around, (2,) [m]."""
    _, index = tree.query(place, k=min(NEAREST_FACES, len(faces.plan.points)))
    normals = faces.plan.point_normals[index]
    # A little prior, where all faces look the same way.
    left = normals.T @ normals + 0.1 * np.eye(2)
    return np.linalg.solve(left, normals.T @ faces.expected[index])


def _states(door: Door, unit: FloatArray, evidence: MapEvidence, shift: FloatArray) -> IntArray:
    """Along the wall's middle line: 1 open, -1 closed, 0 unknown."""
    normal = np.array([-unit[1], unit[0]])
    along = np.arange(-BEYOND_JAMBS + 0.5 * _STEP, door.width + BEYOND_JAMBS, _STEP)
    depths = np.arange(-_DEPTH, _DEPTH + 1e-9, 0.025)
    places = np.array(door.start) + shift + along[:, None] * unit
    cells = evidence.values(places[:, None] + depths[:, None] * normal)
    occupied, free = (cells == OCCUPIED).any(axis=1), (cells == FREE).mean(axis=1)
    return np.where(occupied, -1, np.where(free > 0.8, 1, 0))


def _best_gap(states: IntArray, along: FloatArray, width: float) -> tuple[float, float] | None:
    """The gap that overlaps the door most, or else is nearest to it: its ends along the wall [m]."""
    ends = along[0] + _STEP * (runs_of(states == 1) - 0.5)
    runs = [(start, stop) for start, stop in ends.tolist() if stop - start >= NARROWEST_DOOR]
    return max(runs, key=lambda run: min(run[1], width) - max(run[0], 0.0), default=None)


def _seen_share(floor: BaseGeometry, evidence: MapEvidence) -> float:
    """The share of a floor that the map shows as free."""
    if floor.is_empty or floor.area < SEEN_FROM**2:
        return 1.0
    min_x, min_y, max_x, max_y = floor.bounds
    x, y = np.meshgrid(np.arange(min_x, max_x, SEEN_FROM), np.arange(min_y, max_y, SEEN_FROM))
    points: FloatArray = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5 * SEEN_FROM
    points = points[shapely.contains_xy(floor, points[:, 0], points[:, 1])]
    return float((evidence.values(points) == FREE).mean()) if len(points) else 1.0


def _unexplored(plan: FloorPlan, rooms: tuple[tuple[str, float], ...]) -> Iterator[Change]:
    for room, (name, seen) in zip(plan.rooms, rooms, strict=True):
        if seen < EXPLORED:
            x, y = room.polygon.representative_point().coords[0]
            yield Change("room_unexplored", name, (x, y, x, y), 0.0, note=f"{seen:.0%} of it seen")
