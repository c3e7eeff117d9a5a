"""The whole comparison: registration, walls, extra walls, doors, rooms."""

from collections.abc import Iterator

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.types import FREE, FloatArray, OccupancyGrid
from slamgym.drawing.comparison.door_changes import door_changes
from slamgym.drawing.comparison.extra_walls import extra_structures
from slamgym.drawing.comparison.faces import MapEvidence, PlanFaces, map_evidence, plan_faces
from slamgym.drawing.comparison.records import Change, ChangeKind, FaceReport, Line, PlanComparison
from slamgym.drawing.comparison.registration import register
from slamgym.drawing.comparison.walls import Faces, judge_face, measure_faces, open_runs
from slamgym.drawing.settings import ComparisonConfig

AGREE = 0.15
"""The two faces of a wall have moved together if their offsets agree this well [m]."""
SEEN_FROM = 0.1
"""Of a room's floor, cells of this size are asked [m]."""
FURNITURE = (0.15, 0.8)
"""What stands so far before the place of a wall whose other side isn't seen may be furniture [m]."""
SHORTEST = 0.5
"""Changes of shorter faces and shorter gaps in a wall aren't reported [m]."""
EXPLORED = 0.3
"""A room of which the robot has seen less is not yet explored [share]."""


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
    faces = measured.plan
    reports = [judge_face(measured, face, config) for face in range(len(faces.lengths))]
    rooms = tuple(
        (room.category, _seen_share(room.polygon.intersection(plan.free_space), evidence))
        for room in plan.rooms
    )
    changes = [
        *_merged(_wall_changes(measured, reports, config)),
        *_new_openings(plan, measured, reports),
        *_extra_walls(plan, evidence, measured, reports),
        *door_changes(plan, measured, evidence),
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
        if i in done or faces.lengths[i] < SHORTEST:
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
    """What one or two faces of a wall say about it."""
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


def _merged(changes: Iterator[Change]) -> list[Change]:
    """Pieces of one wall that have changed alike become one row."""
    rows = list(changes)
    merged = True
    while merged:
        merged = False
        for a in range(len(rows)):
            for b in range(a + 1, len(rows)):
                together = _together(rows[a], rows[b])
                if together is not None:
                    rows[a] = together
                    del rows[b]
                    merged = True
                    break
            if merged:
                break
    return rows


def _together(first: Change, second: Change) -> Change | None:
    """Two changes as one, if they are of one kind and in line."""
    p, q = np.reshape(first.line, (2, 2)), np.reshape(second.line, (2, 2))
    unit = (p[1] - p[0]) / np.hypot(*(p[1] - p[0]))
    other = (q[1] - q[0]) / np.hypot(*(q[1] - q[0]))
    across, along = (q - p[0]) @ [-unit[1], unit[0]], np.sort((q - p[0]) @ unit)
    reach = float(np.hypot(*(p[1] - p[0])))
    if first.kind != second.kind or abs(unit @ other) < 0.996 or np.abs(across).max() > 0.15:
        return None
    if along[0] > reach + 0.15 or along[1] < -0.15:
        return None
    offset = second.offset
    if first.offset is not None and offset is not None:
        offset = offset if unit @ other > 0 else -offset
        if abs(first.offset - offset) > 0.06:
            return None
    low, high = min(0.0, float(along[0])), max(reach, float(along[1]))
    start, end = p[0] + low * unit, p[0] + high * unit
    length = high - low
    longer = first if first.length >= second.length else second
    sign = 1.0 if longer is first or unit @ other > 0 else -1.0
    return Change(
        first.kind,
        f"wall of {length:.1f} m",
        (float(start[0]), float(start[1]), float(end[0]), float(end[1])),
        length,
        None if longer.offset is None else sign * longer.offset,
        longer.error,
        None if longer.raw_offset is None else sign * longer.raw_offset,
        longer.note,
    )


def _new_openings(plan: FloorPlan, measured: Faces, reports: list[FaceReport]) -> Iterator[Change]:
    """Gaps in walls that are there otherwise, away from the plan's doors."""
    faces = measured.plan
    doors = shapely.MultiLineString([[door.start, door.end] for door in plan.doors]) if plan.doors else None
    found: list[shapely.LineString] = []
    for face in np.flatnonzero(faces.lengths >= SHORTEST):
        if reports[face].state in ("missing", "moved", "not_seen"):
            continue
        unit = (faces.segments[face, 2:] - faces.segments[face, :2]) / faces.lengths[face]
        for start, stop in open_runs(measured, int(face), SHORTEST):
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
    for structure in extra_structures(plan, evidence, np.vstack([here, jambs])):
        note = "seen from both sides" if structure.is_seen_from_both_sides else "long, seen from one side"
        yield Change(
            "wall_extra", f"wall of {structure.length:.1f} m", structure.line, structure.length, note=note
        )


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
