"""Buildings that differ from their plans by known changes, for the benchmark of ``slamgym cad compare``.

Walls between two rooms are shifted by a given distance, removed, added, and doors are closed or moved. The plan stays
as it was drawn; the changed building is what the robot explores.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad import FloorPlan, check_plan
from slamgym.core.errors import PlanError
from slamgym.core.types import FloatArray

SHIFTS = (0.1, 0.2, 0.3, 0.5)
"""Distances by which walls are moved [m]."""
THICKNESS = (0.04, 0.4)
"""Least and largest thickness of walls between two rooms [m]."""
APART = 1.0
"""Changes are no nearer to each other than this [m]."""


@dataclass(frozen=True)
class Change:
    """A true change: a wall's or door's middle line in the plan, and by how much it was moved."""

    kind: str  # wall_moved, wall_missing, wall_extra, door_blocked, door_moved
    line: tuple[float, float, float, float]  # [m]
    offset: float  # [m]; along the line's normal (to its left) for walls, along the line for doors
    touched: Polygon  # where the building differs


@dataclass(frozen=True)
class Slab:
    """A straight piece of wall between two faces."""

    line: FloatArray  # (4,) middle line
    normal: FloatArray
    body: Polygon


def inner_slabs(plan: FloorPlan, shortest: float) -> list[Slab]:
    """The straight pieces of walls with floor on both sides."""
    segments = plan.segments()
    start, end = segments[:, :2], segments[:, 2:]
    length = np.hypot(*(end - start).T)
    unit = (end - start) / length[:, None]
    found = []
    for i in np.flatnonzero(length >= shortest):
        normal = np.array([-unit[i, 1], unit[i, 0]])
        for j in np.flatnonzero(length >= shortest):
            if j <= i or abs(float(unit[i] @ unit[j])) < 0.999:
                continue
            across = float((start[j] - start[i]) @ normal)
            along = sorted(float((point - start[i]) @ unit[i]) for point in (start[j], end[j]))
            low, high = max(0.0, along[0]), min(float(length[i]), along[1])
            if not THICKNESS[0] <= abs(across) <= THICKNESS[1] or high - low < shortest:
                continue
            corners = [
                start[i] + low * unit[i],
                start[i] + high * unit[i],
                start[i] + high * unit[i] + across * normal,
                start[i] + low * unit[i] + across * normal,
            ]
            body = Polygon(corners)
            # Wall between the faces, not floor.
            if plan.free_space.intersection(body).area < 0.02 * body.area:
                middle = 0.5 * across * normal
                line = np.concatenate([corners[0] + middle, corners[1] + middle])
                found.append(Slab(line, normal, body))
    return found


def _with_floor(plan: FloorPlan, floor: shapely.Geometry) -> FloorPlan | None:
    """The plan with another floor, if a robot can still explore nearly all of it."""
    parts = [
        part for part in shapely.get_parts(floor) if isinstance(part, Polygon) and part.area > 0.05
    ]
    largest = max(parts, key=lambda part: float(part.area))
    if largest.area < 0.85 * plan.area:
        return None
    simple = largest.simplify(0.001)
    assert isinstance(simple, Polygon)
    changed = replace(plan, free_space=simple, rooms=(), doors=())
    try:
        check_plan(changed, max_extent=60.0)
    except PlanError:
        return None
    return changed


def _moved(body: Polygon, by: FloatArray) -> Polygon:
    return shapely.transform(body, lambda points: points + by)


def _swept(body: Polygon, by: FloatArray) -> Polygon:
    return shapely.union_all([body, _moved(body, by)]).convex_hull.buffer(0.05)


def shift_wall(plan: FloorPlan, slab: Slab, by: float) -> tuple[FloorPlan, Change] | None:
    """Move a piece of wall sideways."""
    offset = by * slab.normal
    floor = plan.free_space.union(slab.body.buffer(0.001, join_style="mitre")).difference(
        _moved(slab.body, offset)
    )
    changed = _with_floor(plan, floor)
    line = tuple(slab.line.tolist())
    return (
        None
        if changed is None
        else (changed, Change("wall_moved", line, by, _swept(slab.body, offset)))
    )


def remove_wall(plan: FloorPlan, slab: Slab) -> tuple[FloorPlan, Change] | None:
    """Take a piece of wall away."""
    changed = _with_floor(plan, plan.free_space.union(slab.body.buffer(0.001, join_style="mitre")))
    line = tuple(slab.line.tolist())
    return (
        None
        if changed is None
        else (changed, Change("wall_missing", line, 0.0, slab.body.buffer(0.05)))
    )


def add_wall(plan: FloorPlan, rng: np.random.Generator) -> tuple[FloorPlan, Change] | None:
    """Build a straight wall of 1.2 to 2.5 m from some wall into a room."""
    segments = plan.segments()
    length = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    index = rng.choice(len(segments), p=length / length.sum())
    if length[index] < 1.0:
        return None
    start, end = segments[index, :2], segments[index, 2:]
    unit = (end - start) / length[index]
    normal = np.array([-unit[1], unit[0]])
    at = start + rng.uniform(0.4, length[index] - 0.4) * unit
    if not plan.free_space.contains(shapely.Point(at + 0.2 * normal)):
        normal = -normal
    tip = at + rng.uniform(1.2, 2.5) * normal
    body = shapely.LineString([at - 0.03 * normal, tip]).buffer(0.05, cap_style="flat")
    inside = plan.free_space.buffer(0.04)
    if not inside.contains(body) or plan.free_space.exterior.distance(shapely.Point(tip)) < 0.7:
        return None
    changed = _with_floor(plan, plan.free_space.difference(body))
    line = (*at.tolist(), *tip.tolist())
    return (
        None if changed is None else (changed, Change("wall_extra", line, 0.0, body.buffer(0.05)))
    )


def _door_slab(line: FloatArray, thickness: float) -> Polygon:
    return shapely.LineString(line.reshape(2, 2)).buffer(0.5 * thickness, cap_style="flat")


def _wall_thickness(plan: FloorPlan, line: FloatArray) -> float | None:
    """Thickness of the wall next to a door, measured behind its jamb."""
    unit = (line[2:] - line[:2]) / np.hypot(*(line[2:] - line[:2]))
    normal = np.array([-unit[1], unit[0]])
    for beside in (line[:2] - 0.03 * unit, line[2:] + 0.03 * unit):
        ray = shapely.LineString([beside - 0.4 * normal, beside + 0.4 * normal])
        solid = ray.difference(plan.free_space)
        if 0.05 < solid.length < 0.4:
            return float(solid.length)
    return None


def _draw_door(plan: FloorPlan, rng: np.random.Generator) -> tuple[FloatArray, float] | None:
    """One of the doors from jamb to jamb, and how thick its wall is."""
    if not plan.doors:
        return None
    door = plan.doors[rng.integers(len(plan.doors))]
    line = np.array([*door.start, *door.end])
    thickness = _wall_thickness(plan, line)
    return None if thickness is None else (line, thickness)


def close_door(plan: FloorPlan, rng: np.random.Generator) -> tuple[FloorPlan, Change] | None:
    """Wall a door up."""
    drawn = _draw_door(plan, rng)
    if drawn is None:
        return None
    line, thickness = drawn
    slab = _door_slab(line, thickness).buffer(0.002, join_style="mitre")
    changed = _with_floor(plan, plan.free_space.difference(slab))
    return (
        None
        if changed is None
        else (changed, Change("door_blocked", tuple(line.tolist()), 0.0, slab.buffer(0.1)))
    )


def move_door(plan: FloorPlan, rng: np.random.Generator) -> tuple[FloorPlan, Change] | None:
    """Move a door along its wall by 0.4 to 1.2 m."""
    drawn = _draw_door(plan, rng)
    if drawn is None:
        return None
    line, thickness = drawn
    by = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.2))
    unit = (line[2:] - line[:2]) / np.hypot(*(line[2:] - line[:2]))
    there = line + np.tile(by * unit, 2)
    old = _door_slab(line, thickness).buffer(0.002, join_style="mitre")
    new = _door_slab(there, thickness + 0.02)
    walls_beside = new.difference(old).difference(plan.free_space)
    # What is opened must be wall, and floor must lie on both sides of it.
    whole = shapely.LineString(there.reshape(2, 2)).buffer(0.5 * thickness + 0.3, cap_style="flat")
    if walls_beside.area < 0.75 * (new.area - new.intersection(old).area) or (
        whole.difference(new).intersection(plan.free_space).area < 0.85 * whole.difference(new).area
    ):
        return None
    changed = _with_floor(plan, plan.free_space.difference(old).union(new))
    if changed is None:
        return None
    touched = shapely.union_all([old, new]).convex_hull.buffer(0.1)
    return changed, Change("door_moved", tuple(line.tolist()), by, touched)


def change_building(plan: FloorPlan, rng: np.random.Generator) -> tuple[FloorPlan, list[Change]]:
    """Shift a wall by each distance, remove one, add two, close a door and move one, as far as there is room."""
    built = plan
    changes: list[Change] = []

    def accept(result: tuple[FloorPlan, Change] | None) -> bool:
        nonlocal built
        if result is None or any(
            other.touched.distance(result[1].touched) < APART for other in changes
        ):
            return False
        built = replace(result[0], rooms=(), doors=plan.doors)
        changes.append(result[1])
        return True

    def attempt(make: Callable[[], tuple[FloorPlan, Change] | None], tries: int = 30) -> None:
        for _ in range(tries):
            if accept(make()):
                return

    for shift in rng.permutation(SHIFTS):
        slabs = inner_slabs(built, 1.2)
        if slabs:
            attempt(lambda: shift_wall(
                built, slabs[rng.integers(len(slabs))], float(shift) * rng.choice([-1.0, 1.0])  # noqa: B023 - called at once
            ))  # fmt: skip
    slabs = inner_slabs(built, 1.0)
    if slabs:
        attempt(lambda: remove_wall(built, slabs[rng.integers(len(slabs))]))
    for _ in range(2):
        attempt(lambda: add_wall(built, rng), 100)
    attempt(lambda: move_door(built, rng))
    attempt(lambda: close_door(built, rng))
    return replace(built, doors=()), changes
