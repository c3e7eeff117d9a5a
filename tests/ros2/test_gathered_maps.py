"""Maps of several mappers in one frame."""

import math

import numpy as np
import pytest
import shapely

from slamgym.cad import FloorPlan
from slamgym.core.geometry import compose, inverse, transform_points
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.ros2.gathered_maps import AT_ORIGIN, GatheredMaps, laid_under


def building():
    """Five rooms of different sides along a corridor: no place looks like another."""
    rooms = [
        shapely.box(0, 0, 14, 1.8),
        shapely.box(0, 2.0, 3.1, 6.2),
        shapely.box(3.3, 2.0, 7.9, 5.0),
        shapely.box(8.1, 2.0, 14, 7.3),
        shapely.box(1.0, -4.4, 5.6, -0.2),
        shapely.box(5.8, -2.9, 12.2, -0.2),
    ]
    doors = [(1.0, 1.7, 1.9, 2.1), (5.0, 1.7, 5.8, 2.1), (10.0, 1.7, 11.1, 2.1)]
    doors += [(2.2, -0.3, 3.1, 0.1), (8.8, -0.3, 9.7, 0.1)]
    return FloorPlan("five", shapely.union_all([*rooms, *(shapely.box(*door) for door in doors)]))


def part(low, high, pose=AT_ORIGIN):
    """What a robot has mapped of the building from x = low to high [m], its map frame at a pose in the building."""
    whole = building().raster(0.05)
    side = 400
    frame = GridFrame(0.05, -10.0, -10.0, side, side)
    rows, cols = np.indices((side, side))
    x, y = frame.to_point(rows, cols)
    places = transform_points(pose, np.stack([x, y], axis=-1))
    row, col = whole.frame.to_cell(places[..., 0], places[..., 1])
    height, width = whole.cells.shape
    inside = (row >= 0) & (row < height) & (col >= 0) & (col < width)
    inside &= (places[..., 0] > low) & (places[..., 0] < high)
    cells = np.full((side, side), UNKNOWN, np.uint8)
    cells[inside] = whole.cells[row[inside], col[inside]]
    return OccupancyGrid(cells, frame)


def test_a_second_map_is_used_once_it_is_sure_where_it_lies():
    turned = Pose2D(6.0, 1.0, 0.6)
    gathered = GatheredMaps({})
    gathered.take("robot1", part(-1.0, 10.0))
    gathered.take("robot2", part(3.5, 15.0, turned))
    assert list(gathered.places) == ["robot1"], "the first gives the frame"
    said = [gathered.improve() for _ in range(2)]
    assert any("robot2 is on the map" in sentence for sentence in said)
    x, y, theta = gathered.places["robot2"]
    assert math.dist((x, y), turned[:2]) < 0.1
    assert abs(theta - turned.theta) < math.radians(1.0)
    merged = gathered.merged()
    row, col = merged.frame.to_cell(13.0, 6.0)
    assert merged.cells[row, col] == FREE, "a room that only the second has seen"


def test_a_map_of_another_place_is_left_out():
    gathered = GatheredMaps({})
    gathered.take("robot1", part(-1.0, 6.0))
    hall = np.full((200, 200), FREE, np.uint8)
    hall[[0, -1]] = hall[:, [0, -1]] = OCCUPIED
    gathered.take("robot2", OccupancyGrid(hall, GridFrame(0.05, 0.0, 0.0, 200, 200)))
    assert gathered.improve() == ""
    assert list(gathered.places) == ["robot1"]


def test_known_starts_are_taken_and_aligned():
    true = Pose2D(6.0, 1.0, 0.0)
    said = Pose2D(6.15, 0.9, 0.04)
    gathered = GatheredMaps({"robot1": AT_ORIGIN, "robot2": said})
    gathered.take("robot2", part(3.5, 15.0, true))
    assert gathered.merged() is not None, "nothing has to be searched for"
    gathered.take("robot1", part(-1.0, 12.0))
    for _ in range(2):
        gathered.improve()
    between = compose(inverse(gathered.places["robot1"]), gathered.places["robot2"])
    assert math.dist(between[:2], true[:2]) < 0.06


def test_the_map_of_a_robot_that_has_died_stays():
    gathered = GatheredMaps({"robot1": AT_ORIGIN, "robot2": AT_ORIGIN})
    gathered.take("robot1", part(-1.0, 5.0))
    gathered.take("robot2", part(5.0, 15.0))
    before = gathered.merged()
    for x in (0.0, 5.0):  # only robot1 goes on
        gathered.take("robot1", part(-1.0, 5.0 + 0.0 * x))
    np.testing.assert_array_equal(gathered.merged().cells, before.cells)


def test_each_robot_gets_the_map_and_the_others_in_its_own_frame():
    there = Pose2D(6.0, 1.0, 0.5 * math.pi)
    gathered = GatheredMaps({"robot1": AT_ORIGIN, "robot2": there})
    gathered.take("robot1", part(-1.0, 15.0))
    merged = gathered.merged()
    own = gathered.seen_from("robot2", merged)
    # A place in a room, seen from both: robot2 looks up in the building.
    for grid, point in ((merged, (9.0, 6.0)), (own, (5.0, -3.0))):
        row, col = grid.frame.to_cell(*point)
        assert grid.cells[row, col] == FREE
    poses = {"robot1": Pose2D(6.0, 2.0, 0.0), "robot2": AT_ORIGIN, "robot3": AT_ORIGIN}
    (mate,) = gathered.mates("robot2", poses)
    assert mate == pytest.approx((1.0, 0.0, -0.5 * math.pi))
    assert gathered.mates("robot3", poses) == []
    assert gathered.seen_from("robot3", merged) is None


def test_an_own_map_wins_over_what_others_show():
    own = OccupancyGrid(np.array([[FREE, UNKNOWN]], np.uint8), GridFrame(0.05, 0.0, 0.0, 1, 2))
    others = OccupancyGrid(np.full((1, 3), OCCUPIED, np.uint8), GridFrame(0.05, 0.0, 0.0, 1, 3))
    laid = laid_under(own, others)
    assert laid.cells.tolist() == [[FREE, OCCUPIED, OCCUPIED]]
    assert not laid.cells.flags.writeable
    assert laid_under(own, None) is own
