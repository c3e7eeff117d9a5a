import math

import numpy as np
import pytest

from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    GridFrame,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning import (
    ExplorerContext,
    expected_gain,
    grid_path,
    make_costmap,
    reachable_space,
)
from slamgym.planning.frontiers import view_gain
from slamgym.planning.grid_path import SHRINK, CoarsePaths, PathLengths
from slamgym.planning.view_history import ViewHistory

RESOLUTION = 0.05
HALF_TURN = LaserGeometry(180, -math.pi / 2, math.pi / 179, 0.12, 3.5)
FULL_TURN = LaserGeometry(360, -math.pi, 2 * math.pi / 359, 0.12, 3.5)


def grid_of(cells):
    cells = np.asarray(cells, dtype=np.uint8)
    return OccupancyGrid(cells, GridFrame(RESOLUTION, 0.0, 0.0, *cells.shape))


def point(grid, row, col):
    x, y = grid.frame.to_point(row, col)
    return float(x), float(y)


def walled(rows, cols):
    cells = np.full((rows, cols), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return cells


def two_rooms(door):
    """Two rooms of 3 m side by side, with a door of some cells in the middle of the wall."""
    cells = walled(62, 124)
    cells[:, 61:63] = OCCUPIED
    cells[31 - door // 2 : 31 - door // 2 + door, 61:63] = FREE
    return grid_of(cells)


# Views


@pytest.mark.parametrize("side", ["right", "up", "left"])
def test_the_unknown_counts_on_whichever_side_it_lies(side):
    cells = np.full((200, 200), FREE)
    unknown = {"right": np.s_[:, 111:], "up": np.s_[:90], "left": np.s_[:, :90]}[side]
    cells[unknown] = UNKNOWN
    grid = grid_of(cells)
    gain = view_gain(make_costmap(grid), point(grid, 100, 100), 3.0, HALF_TURN)
    assert gain == pytest.approx(
        view_gain(make_costmap(grid), point(grid, 100, 100), 3.0, FULL_TURN), rel=0.02
    )


def test_the_gain_of_a_half_plane_is_the_segment_of_the_disc_behind_it():
    cells = np.full((200, 200), FREE)
    cells[:, 121:] = UNKNOWN  # 1 m to the right of the view
    grid = grid_of(cells)
    gain = view_gain(make_costmap(grid), point(grid, 100, 100), 3.0, HALF_TURN)
    angle = 2.0 * math.acos(1.0 / 3.0)
    segment = 0.5 * 9.0 * (angle - math.sin(angle))
    assert gain == pytest.approx(segment, rel=0.05)  # cells of 5 cm and 72 rays


def test_walls_hide_the_unknown_and_a_half_turn_sees_half_of_what_is_all_round():
    cells = np.full((200, 200), UNKNOWN)
    cells[80:121, 80:121] = FREE
    grid = grid_of(cells)
    costmap, middle = make_costmap(grid), point(grid, 100, 100)
    all_round, half = (
        view_gain(costmap, middle, 3.0, FULL_TURN),
        view_gain(costmap, middle, 3.0, HALF_TURN),
    )
    assert half == pytest.approx(0.5 * all_round, rel=0.05)
    assert all_round == pytest.approx(expected_gain(costmap, middle, 3.0), rel=0.03)
    cells[:, 121] = OCCUPIED
    walled_off = view_gain(make_costmap(grid_of(cells)), middle, 3.0, FULL_TURN)
    assert walled_off < 0.85 * all_round


@pytest.mark.parametrize(
    ("pose", "kept"),
    [
        ((1.0, 2.0, 0.6), False),
        ((1.1, 2.1, 0.5), False),
        ((1.15, 2.15, 0.5), True),
        ((1.0, 2.0, 0.85), True),
        ((1.0, 2.0, 0.15), True),
        ((1.0, 2.0, 0.5 - 2.0 * math.pi), False),
    ],
)
def test_a_scan_is_kept_if_the_robot_has_moved_or_turned_either_way(pose, kept):
    frame = GridFrame(RESOLUTION, 0.0, 0.0, 100, 100)
    views, scan = ViewHistory(ExplorerContext(frame, HALF_TURN)), np.ones(180, np.float32)
    assert views.note(Pose2D(1.0, 2.0, 0.5), scan)
    assert views.note(Pose2D(*pose), scan) is kept


# Coarse paths


def test_coarse_lengths_agree_with_straight_lines_and_the_path_through_a_door():
    grid = two_rooms(door=16)
    costmap = make_costmap(grid)
    start = point(grid, 10, 10)
    paths = CoarsePaths(costmap, reachable_space(costmap, Pose2D(*start, 0.0)))
    places = np.array([point(grid, 10, 40), point(grid, 50, 110)])
    lengths = PathLengths().matrix(paths, Pose2D(*start, 0.0), places, 0.0)
    assert lengths[0, 1] == pytest.approx(1.5, abs=0.2)
    # Round the door's post: two straight stretches, at most 8 % longer on an 8-connected grid.
    door = np.array(point(grid, 31, 62))
    around = np.hypot(*(door - start)) + np.hypot(*(places[1] - door))
    assert 0.95 * around <= lengths[0, 2] <= 1.12 * around
    np.testing.assert_allclose(lengths, lengths.T)
    assert np.all(np.diag(lengths) == 0.0)


@pytest.mark.parametrize("near", [0, 1])
def test_lengths_that_are_kept_are_those_of_new_searches_once_the_robot_has_found_a_shorter_way(
    monkeypatch, near
):
    known, places = PathLengths(), [(8, 30), (55, 100), (55, 140), (30, 220)]
    cells = walled(62, 244)
    cells[20:, 121:123] = OCCUPIED
    for robot, door, least, most in (((31, 40), 0, 4.5, 5.5), ((47, 122), 16, 2.0, 2.8)):
        cells[40 : 40 + door, 121:123] = FREE
        grid = grid_of(cells)
        costmap, pose = make_costmap(grid), Pose2D(*point(grid, *robot), 0.0)
        paths = CoarsePaths(costmap, reachable_space(costmap, pose))
        at = np.array([point(grid, row, col) for row, col in places])
        anew = PathLengths().matrix(paths, pose, at, 0.0)
        with monkeypatch.context() as patched:
            patched.setattr(
                grid_path, "NEAR_PLACES", near
            )  # else all of these would be searched anew
            lengths = known.matrix(paths, pose, at, 0.0)
        # Places that lie within a cell are one: both ends of a path may be off by so much.
        np.testing.assert_allclose(lengths, anew, atol=2.0 * paths.cell)
        assert least < lengths[2, 3] < most
        places = [(row + 1, col) for row, col in places]


def test_coarse_cells_lose_no_doorway_and_open_no_wall():
    for door, joined in ((11, True), (16, True), (6, False), (0, False)):
        grid = two_rooms(door)
        costmap = make_costmap(grid)
        pose = Pose2D(*point(grid, 31, 30), 0.0)
        space = reachable_space(costmap, pose)
        paths = CoarsePaths(costmap, space)
        row, col = (int(cell) // SHRINK for cell in costmap.frame.to_cell(*point(grid, 31, 95)))
        wanted = np.array([row * -(-costmap.frame.width_px // SHRINK) + col])
        assert np.isfinite(paths.lengths_from(paths.place(pose[:2]), wanted)) == joined, door
        assert np.isinf(paths.lengths_from(paths.place((-5.0, 0.0)), wanted))  # off the map


def test_a_path_leads_from_start_to_goal_in_small_steps():
    grid = two_rooms(door=16)
    costmap = make_costmap(grid)
    start, goal = point(grid, 10, 10), point(grid, 50, 110)
    paths = CoarsePaths(costmap, reachable_space(costmap, Pose2D(*start, 0.0)))
    path = paths.path(start, goal)
    assert np.hypot(*(path[0] - start)) < 0.2
    assert np.hypot(*(path[-1] - goal)) < 0.2
    steps = np.hypot(*np.diff(path, axis=0).T)
    assert steps.max() <= math.sqrt(2.0) * paths.cell + 1e-9
    assert len(paths.path((-9.0, 0.0), goal)) == 0
