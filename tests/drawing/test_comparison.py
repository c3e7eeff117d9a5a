"""Drawn plans and maps with known changes: registration, walls, doors, furniture, drift, rooms."""

import dataclasses
import math

import cv2
import numpy as np
import pytest
import shapely

from slamgym.cad import Door, FloorPlan, Room
from slamgym.core.geometry import inverse, transform_points
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.drawing.comparison import compare_with_plan, draw_comparison
from slamgym.drawing.comparison.distortion import Drift
from slamgym.drawing.comparison.faces import map_evidence, plan_walls
from slamgym.drawing.comparison.report import verdict

T = 0.12
OUTSIDE = shapely.box(0, 0, 10, 7)
WALLS = {
    "middle": (4.0, 0.0, 4.0 + T, 7.0),
    "left": (0.0, 3.5, 4.0, 3.5 + T),
    "right": (4.0 + T, 4.5, 10.0, 4.5 + T),
    "stub": (7.0, 4.5 + T, 7.0 + T, 7.0),
}
DOORS = {
    "a": (4.0, 1.0, 4.0 + T, 1.9),
    "b": (1.5, 3.5, 2.4, 3.5 + T),
    "c": (5.0, 4.5, 5.9, 4.5 + T),
    "d": (8.5, 4.5, 9.4, 4.5 + T),
}
ROOMS = {
    "Living": (0, 0, 4, 3.5),
    "Bedroom": (0, 3.62, 4, 7),
    "Hall": (4.12, 0, 10, 4.5),
    "Bath": (4.12, 4.62, 7, 7),
    "Office": (7.12, 4.62, 10, 7),
}


def building(walls=None, doors=None, more=()):
    floor = OUTSIDE.difference(
        shapely.union_all([shapely.box(*box) for box in (walls or WALLS).values()])
    )
    floor = floor.union(shapely.union_all([shapely.box(*box) for box in (doors or DOORS).values()]))
    floor = floor.difference(shapely.union_all([shapely.box(*box) for box in more]))
    return max(shapely.get_parts(floor), key=lambda part: part.area)


def middle(box):
    x0, y0, x1, y1 = box
    if x1 - x0 > y1 - y0:
        return Door((x0, 0.5 * (y0 + y1)), (x1, 0.5 * (y0 + y1)))
    return Door((0.5 * (x0 + x1), y0), (0.5 * (x0 + x1), y1))


PLAN = FloorPlan(
    "flat",
    building(),
    tuple(Room(name, shapely.box(*box)) for name, box in ROOMS.items()),
    tuple(middle(box) for box in DOORS.values()),
)


def robot_map(floor, pose=Pose2D(1.3, -0.7, 0.4), seen=None, bend=None, seed=0):
    """A map of a floor: walls of one cell with noise, in a frame of its own; ``bend`` moves true points (drift)."""
    rng = np.random.default_rng(seed)
    resolution = 0.05
    corners = transform_points(inverse(pose), shapely.get_coordinates(OUTSIDE))
    low, high = corners.min(axis=0), corners.max(axis=0)
    frame = GridFrame.covering((*low, *high), resolution, margin=0.5)
    rows, cols = np.indices(frame.shape)
    x, y = frame.to_point(rows.ravel(), cols.ravel())
    there = transform_points(pose, np.stack([x, y], axis=1))
    if bend is not None:
        there = there - bend(there)
    free = shapely.contains_xy(floor, *there.T)
    if seen is not None:
        free &= shapely.contains_xy(seen, *there.T)
    free = free.reshape(frame.shape)
    cells = np.where(free, FREE, UNKNOWN).astype(np.uint8)
    around = cv2.dilate(free.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    wall = around & ~free & ~shapely.contains_xy(floor, *there.T).reshape(frame.shape)
    cells[wall] = OCCUPIED
    salt = free & (rng.random(frame.shape) < 0.001)
    cells[salt] = OCCUPIED
    return OccupancyGrid(cells, frame)


def of_kind(found, kind):
    return [change for change in found.changes if change.kind == kind]


def moved_walls(**offsets):
    walls = dict(WALLS)
    for name, (dx, dy) in offsets.items():
        x0, y0, x1, y1 = walls[name]
        walls[name] = (x0 + dx, y0 + dy, x1 + dx, y1 + dy)
    return walls


@pytest.fixture(scope="module")
def unchanged():
    return compare_with_plan(PLAN, robot_map(building()))


def test_a_map_as_planned_has_no_changes(unchanged):
    assert unchanged.is_confident
    assert unchanged.changes == ()
    assert unchanged.doubts == ()
    assert unchanged.registration.explained > 0.95
    assert {wall.kind for wall in unchanged.walls} <= {
        "wall_present",
        "wall_not_seen",
        "wall_unclear",
    }


@pytest.mark.parametrize(
    "pose", [Pose2D(0, 0, 0), Pose2D(5, 5, 3.0), Pose2D(-40, 12, -1.3), Pose2D(2, 1, math.pi / 2)]
)
def test_the_map_is_found_wherever_it_lies(pose):
    found = compare_with_plan(PLAN, robot_map(building(), pose)).registration.plan_from_map
    assert (found.x, found.y) == pytest.approx((pose.x, pose.y), abs=0.04)
    assert math.cos(found.theta - pose.theta) > math.cos(math.radians(0.5))


@pytest.mark.parametrize("shift", [0.1, -0.2, 0.3, -0.5])
def test_a_moved_wall_is_measured(shift):
    walls = moved_walls(left=(0.0, shift))
    doors = {**DOORS, "b": (1.5, 3.5 + shift, 2.4, 3.5 + shift + T)}
    found = compare_with_plan(PLAN, robot_map(building(walls, doors)))
    moved = of_kind(found, "wall_moved")
    assert moved, found.changes
    for change in moved:
        along = change.line[2] - change.line[0]
        offset = change.offset if along > 0 else -change.offset
        assert offset == pytest.approx(shift, abs=0.04)
        assert change.line[1] == pytest.approx(3.5 + T / 2, abs=0.01)
        assert change.error < 0.05
    assert sum(change.length for change in moved) == pytest.approx(4.0 - 0.9, abs=0.4)
    assert not of_kind(found, "wall_extra")


def test_a_missing_wall_and_an_extra_one():
    walls = {name: box for name, box in WALLS.items() if name != "stub"}
    found = compare_with_plan(PLAN, robot_map(building(walls, more=[(1.5, 0.0, 1.6, 2.0)])))
    (missing,) = of_kind(found, "wall_missing")
    assert missing.line[0] == pytest.approx(7.0 + T / 2, abs=0.01)
    assert missing.length == pytest.approx(7.0 - 4.62, abs=0.15)
    (extra,) = of_kind(found, "wall_extra")
    assert extra.length == pytest.approx(2.0, abs=0.35)
    assert 0.5 * (extra.line[0] + extra.line[2]) == pytest.approx(1.55, abs=0.06)
    assert not of_kind(found, "wall_moved")
    assert found.changes == (missing, extra)  # the larger first


def test_large_changes_come_before_small_ones():
    walls = moved_walls(left=(0.0, 0.12), stub=(0.4, 0.0))
    doors = {**DOORS, "b": (1.5, 3.62, 2.4, 3.62 + T)}
    found = compare_with_plan(
        PLAN, robot_map(building(walls, doors), seen=shapely.box(0, 0, 10, 7))
    )
    moved = [change.length * abs(change.offset) for change in of_kind(found, "wall_moved")]
    assert len(moved) > 1
    assert moved == sorted(moved, reverse=True)


def test_furniture_is_no_wall():
    furniture = [
        (0.0, 1.0, 0.6, 3.2),
        (5.0, 1.5, 6.8, 2.4),
        (8.0, 0.0, 9.8, 0.45),
        (0.3, 6.0, 2.1, 7.0),
        (9.4, 1.0, 10.0, 3.0),
    ]
    found = compare_with_plan(PLAN, robot_map(building(more=furniture)))
    assert found.changes == ()


def test_doors_blocked_moved_and_of_another_width():
    doors = {
        "a": DOORS["a"],
        "b": (2.3, 3.5, 3.2, 3.5 + T),
        "d": (8.5, 4.5, 9.05, 4.5 + T),
        "e": (8.5, 4.5, 9.05, 4.5 + T),
    }
    found = compare_with_plan(
        PLAN, robot_map(building(doors={**doors, "stub": (7.0, 5.5, 7.0 + T, 6.4)}))
    )
    (moved,) = of_kind(found, "door_moved")
    assert moved.offset == pytest.approx(0.8, abs=0.06)
    (narrower,) = of_kind(found, "door_width")
    assert narrower.offset == pytest.approx(0.55 - 0.9, abs=0.08)
    (blocked,) = of_kind(found, "door_blocked")
    assert blocked.what.startswith("door 3")
    (opening,) = of_kind(found, "opening_new")
    assert opening.length == pytest.approx(0.9, abs=0.15)
    assert not of_kind(found, "wall_moved")


def test_rooms_that_were_not_entered_are_named_and_their_walls_not_judged():
    seen = shapely.box(0, 0, 10, 4.55)
    found = compare_with_plan(PLAN, robot_map(building(moved_walls(stub=(0.3, 0.0))), seen=seen))
    assert [change.what for change in of_kind(found, "room_unexplored")] == [
        "Bedroom",
        "Bath",
        "Office",
    ]
    assert len(found.changes) == 3
    assert sum(wall.kind == "wall_not_seen" for wall in found.walls) >= 5


def test_drift_is_no_moved_wall_but_a_wall_that_moves_beside_it_is():
    def bend(points):
        return np.stack([0.06 * np.sin(points[:, 1] / 4.0), 0.02 * (points[:, 0] - 5.0)], axis=1)

    assert compare_with_plan(PLAN, robot_map(building(), bend=bend)).changes == ()
    found = compare_with_plan(PLAN, robot_map(building(moved_walls(stub=(0.3, 0.0))), bend=bend))
    (moved,) = found.changes
    assert moved.kind == "wall_moved"
    assert abs(moved.offset) == pytest.approx(0.3, abs=0.05)
    assert abs(moved.raw_offset - moved.offset) > 0.005


def test_another_building_is_said_and_not_compared():
    rooms = [
        (0, 0, 5, 5),
        (5.1, 0, 8, 2),
        (5.1, 2.1, 8, 5),
        (0, 5.1, 3, 12),
        (4.8, 1, 5.2, 1.8),
        (4.8, 3, 5.2, 4),
        (1, 4.9, 2, 5.2),
    ]
    other = shapely.union_all([shapely.box(*box) for box in rooms])
    found = compare_with_plan(FloorPlan("other", other), robot_map(building()))
    assert not found.is_confident
    assert found.changes == ()
    assert "different buildings" in found.doubts[0]
    assert "NOT THE SAME" in verdict(found)


def test_a_symmetric_building_is_doubted():
    floor = shapely.union_all(
        [shapely.box(0, 0, 4, 3), shapely.box(4.1, 0, 8.1, 3), shapely.box(3.9, 1, 4.2, 2)]
    )
    found = compare_with_plan(FloorPlan("twins", floor), robot_map(floor))
    assert found.is_confident
    assert "another place" in found.doubts[0]


@pytest.mark.parametrize("scale", [0.96, 1.0, 1.06])
def test_another_scale_is_doubted(scale):
    grid = robot_map(building())
    other = dataclasses.replace(grid, frame=grid.frame._replace(resolution=0.05 / scale))
    found = compare_with_plan(PLAN, other)
    assert found.registration.scale == pytest.approx(scale, abs=0.007)
    assert any("scale doubtful" in doubt for doubt in found.doubts) == (scale != 1.0)


def test_the_picture_shows_what_has_changed(unchanged):
    grid = robot_map(building(moved_walls(left=(0.0, 0.3))))
    found = compare_with_plan(PLAN, grid)
    picture = draw_comparison(found, PLAN, grid)
    orange = (picture == (240, 140, 0)).all(axis=2).sum()
    assert orange > 1000
    assert (draw_comparison(unchanged, PLAN, robot_map(building())) == (240, 140, 0)).all(
        axis=2
    ).sum() == 0


def test_walls_have_two_faces_where_floor_lies_on_both_sides():
    walls = plan_walls(PLAN)
    away = ((walls.points - walls.lines[walls.wall, :2]) * walls.normals[walls.wall]).sum(axis=1)
    inner = [
        wall for wall in range(len(walls.lengths)) if len(set(walls.side[walls.wall == wall])) == 2
    ]
    assert len(inner) >= 5
    for wall in range(len(walls.lengths)):
        own = walls.wall == wall
        assert away[own] == pytest.approx(walls.side[own] * (T / 2 if wall in inner else 0.0))
    before = walls.points + 0.02 * walls.point_normals
    assert shapely.contains_xy(PLAN.free_space, before).mean() > 0.95


def test_normals_point_to_the_free_side():
    evidence = map_evidence(robot_map(building(), Pose2D(0, 0, 0)))
    free = evidence.values(evidence.points + 0.08 * evidence.normals) == FREE
    assert free.mean() > 0.97


def test_drift_is_predicted_from_other_walls():
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 12, (80, 2))
    angles = rng.choice([0, 0.5 * np.pi], 80)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    field = np.stack([0.1 * np.sin(places[:, 1] / 4), 0.05 * np.cos(places[:, 0] / 5)], axis=1)
    values = (field * normals).sum(axis=1) + rng.normal(0, 0.01, 80)
    values[7] += 0.4
    drift = Drift(places, normals, values, np.full(80, 0.015))
    error = drift.expected - (field * normals).sum(axis=1)
    assert np.sqrt((error**2).mean()) < 0.025
    assert np.abs(error / drift.deviation).mean() < 1.3
    assert abs(error[7]) < 0.05
