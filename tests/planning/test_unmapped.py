"""Directions in which a scan met nothing, and what an exploration makes of them."""

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
from slamgym.planning import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig
from slamgym.planning.unmapped import find_open_space, free_at, is_unmapped

FRAME = GridFrame(0.05, -6.0, -6.0, 240, 240)
LASER = LaserGeometry(180, -np.pi / 2, np.pi / 179, 0.12, 3.5)
NOTHING = np.full(180, 3.5, np.float32)
WALL = np.full(180, 2.0, np.float32)


def opened(first, width):
    """A scan of a wall with an opening, in beams."""
    scan = WALL.copy()
    scan[first : first + width] = 3.5
    return scan


def doorway():
    """A room of 4 m whose door in the east leads to what the map doesn't know."""
    cells = np.full(FRAME.shape, UNKNOWN, np.uint8)
    x, y = FRAME.to_point(*np.indices(FRAME.shape))
    far = np.maximum(np.abs(x), np.abs(y))
    cells[far < 2.0] = FREE
    cells[(far >= 2.0) & (far < 2.1)] = OCCUPIED
    cells[(x > 2.0) & (far < 2.1) & (np.abs(y) < 0.6)] = FREE
    return OccupancyGrid(cells, FRAME)


@pytest.mark.parametrize("first", [0, 40, 88])
def test_open_space_is_a_fan_a_metre_long_where_a_right_angle_is_empty(first):
    points = find_open_space(Pose2D(1.0, 2.0, np.pi / 2), opened(first, 92), LASER)
    assert points is not None
    east, north = points[:, 0] - 1.0, points[:, 1] - 2.0
    assert np.hypot(east, north).max() <= 1.0
    bearing = np.degrees(np.arctan2(-east, north))[np.hypot(east, north) > 0.1]
    assert bearing.min() >= first - 91.0
    assert bearing.max() <= first + 92 - 90.0
    assert np.ptp(bearing) > 80.0


@pytest.mark.parametrize("width", [0, 30, 80])
def test_windows_and_dark_walls_are_no_open_space(width):
    assert find_open_space(Pose2D(0.0, 0.0, 0.0), opened(20, width), LASER) is None


def test_a_few_strays_do_not_close_open_space_and_many_do():
    scan = NOTHING.copy()
    scan[::60] = 1.0
    assert find_open_space(Pose2D(0.0, 0.0, 0.0), scan, LASER) is not None
    scan[::10] = 1.0
    assert find_open_space(Pose2D(0.0, 0.0, 0.0), scan, LASER) is None


def test_only_unknown_cells_become_free():
    grid = doorway()
    points = find_open_space(Pose2D(1.8, 0.0, 0.0), NOTHING, LASER)
    before = grid.cells.copy()
    after = free_at(points, grid, UNKNOWN)
    np.testing.assert_array_equal(grid.cells, before)
    changed = after.cells != before
    assert changed.any()
    assert (before[changed] == UNKNOWN).all()
    assert (after.cells[changed] == FREE).all()
    beyond = points + np.array([0.6, 0.0])
    assert is_unmapped(beyond, grid)
    assert not is_unmapped(beyond, free_at(beyond, grid, UNKNOWN))


@pytest.mark.parametrize(("scan", "goes_out"), [(NOTHING, True), (WALL, False)])
def test_a_robot_in_a_doorway_to_a_hall_larger_than_its_range_goes_on(scan, goes_out):
    loop = ExplorationLoop(ExplorerContext(FRAME, LASER), ExplorationLoopConfig())
    grid, farthest = doorway(), 0.0
    for time in np.arange(0.0, 200.0, 2.0):
        loop.observe(
            {
                "map": grid.cells[np.newaxis].copy(),
                "scan": scan,
                "pose": np.array([1.9, 0.0, 0.0], np.float32),
                "time": np.array([time], np.float32),
            }
        )
        if loop.finished:
            break
        farthest = max([farthest, *(one.frontier.middle[0] for one in loop.candidates)])
        if loop.candidates:
            loop.choose(0)
        loop.command()
    assert loop.finished
    assert (farthest > 2.6) is goes_out
