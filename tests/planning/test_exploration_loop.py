"""Candidates for a choice, and the loop that offers them and drives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.errors import ConfigError
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
    CostmapConfig,
    ExplorerContext,
    GoalStatus,
    find_frontiers,
    make_costmap,
    reachable_space,
)
from slamgym.planning.blacklist import Blacklist
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig
from slamgym.planning.frontier_candidates import (
    coarsen_costmap,
    frontiers_in_reach,
    make_candidates,
    split_frontier,
)

FRAME = GridFrame(0.05, -4.0, -4.0, 160, 160)
HERE = Pose2D(0.0, 0.0, 0.0)


def room(half=2.0, openings=()):
    """A square room about the origin, walls drawn but for openings (x0, y0, x1, y1) into the unknown."""
    cells = np.full(FRAME.shape, UNKNOWN, np.uint8)
    x, y = FRAME.to_point(*np.indices(FRAME.shape))
    far = np.maximum(np.abs(x), np.abs(y))
    cells[far < half] = FREE
    cells[(far >= half) & (far < half + 0.1)] = OCCUPIED
    for x0, y0, x1, y1 in openings:
        inside = (x > x0) & (x < x1) & (y > y0) & (y < y1)
        cells[inside & (cells == OCCUPIED)] = UNKNOWN
    return OccupancyGrid(cells, FRAME)


EAST, NORTH = (1.9, -0.6, 2.2, 0.6), (-1.0, 1.9, 1.0, 2.2)


def planned(grid):
    costmap = make_costmap(grid, CostmapConfig())
    return costmap, reachable_space(costmap, HERE)


def candidates_of(grid, **changes):
    costmap, space = planned(grid)
    found = frontiers_in_reach(costmap, space, HERE, min_size=0.3, split_extent=3.0)
    return make_candidates(costmap, space, found, **{"most": 16} | changes)


def test_candidates_are_the_openings_with_paths_to_them():
    first, second = candidates_of(room(openings=[EAST, NORTH]))
    assert first.path_cost <= second.path_cost
    east = min((first, second), key=lambda one: abs(one.frontier.middle[1]))
    assert east.frontier.middle == pytest.approx((2.05, 0.0), abs=0.15)
    assert east.path_length == pytest.approx(1.8, abs=0.3)  # to where the robot's centre can stand
    np.testing.assert_allclose(east.path[0], [0.0, 0.0], atol=0.1)


def test_few_candidates_are_the_first_of_many():
    grid = room(openings=[EAST, NORTH, (-2.2, -1.0, -1.9, 0.0), (0.0, -2.2, 1.0, -1.9)])
    everything = candidates_of(grid)
    assert len(everything) == 4
    for most in range(1, 5):
        few = candidates_of(grid, most=most)
        assert [one.path_cost for one in few] == [one.path_cost for one in everything[:most]]
        for one, other in zip(few, everything[:most], strict=True):
            np.testing.assert_array_equal(one.path, other.path)


def test_what_lies_behind_a_wall_is_no_candidate():
    grid = room(openings=[])
    grid.cells[:20] = FREE  # known, but nowhere to get to
    assert candidates_of(grid) == []


def test_the_place_the_robot_goes_to_is_kept():
    grid = room(openings=[EAST])
    (fresh,) = candidates_of(grid)
    wanted = (2.03, 0.3)
    (kept,) = candidates_of(grid, keep=wanted)
    assert kept.target == wanted
    assert fresh.target != wanted


@settings(max_examples=30)
@given(extent=st.floats(0.2, 4.0))
def test_parts_of_a_frontier_make_up_the_whole_and_extend_no_farther(extent):
    grid = room(openings=[EAST, NORTH, (-2.2, -2.2, 2.2, -1.9)])
    costmap, _ = planned(grid)
    for frontier in find_frontiers(costmap, HERE, 0.3):
        parts = split_frontier(frontier, FRAME, HERE, extent)
        cells = np.vstack([part.cells for part in parts])
        assert len(cells) == frontier.size
        assert set(map(tuple, cells)) == set(map(tuple, frontier.cells))
        for part in parts:
            assert np.ptp(part.cells, axis=0).max() * FRAME.resolution <= extent
            assert part.size == len(part.cells)


@pytest.mark.parametrize(("seen", "stays"), [(0.0, True), (0.4, True), (0.6, False), (0.9, False)])
def test_a_frontier_is_still_there_while_half_of_it_is_unknown(seen, stays):
    grid = room(openings=[EAST])
    (candidate,) = candidates_of(grid)
    x, y = candidate.points[: round(seen * len(candidate.points))].T
    rows, cols = FRAME.to_cell(x, y)
    cells = grid.cells.copy()
    cells[rows, cols] = FREE
    assert candidate.is_still_there(make_costmap(OccupancyGrid(cells, FRAME))) is stays


def test_what_was_not_reached_is_forgiven_and_what_was_reached_is_not():
    reached, missed = candidates_of(room(openings=[EAST, NORTH]))
    blacklist = Blacklist(0.0)
    blacklist.add(reached, True)
    blacklist.add(missed, False)
    assert not blacklist.without_given_up([reached, missed])
    blacklist.forgive()
    assert blacklist.without_given_up([reached, missed]) == [missed]


def test_what_was_passed_over_stays_so_until_the_map_changes_around_it():
    grid = room(openings=[EAST, NORTH])
    candidates = candidates_of(grid)
    passed, other = candidates
    blacklist = Blacklist(0.0)
    blacklist.pass_over(passed, make_costmap(grid))
    blacklist.clear()  # strikes out what was given up alone
    assert blacklist.without_passed_over(candidates, make_costmap(grid)) == [other]
    for one, left in ((other, [other]), (passed, candidates)):
        cells = grid.cells.copy()
        row, col = FRAME.to_cell(*one.frontier.middle)
        cells[max(0, row - 20) : row + 21, col - 20 : col + 21] = FREE
        seen = make_costmap(OccupancyGrid(cells, FRAME))
        assert blacklist.without_passed_over(candidates, seen) == left


def test_coarse_cells_take_the_lowest_cost_and_stay_in_place():
    rng = np.random.default_rng(0)
    costs = rng.integers(0, 256, (7, 9)).astype(np.uint8)
    frame = GridFrame(0.05, 1.0, 2.0, 7, 9)
    coarse, coarse_frame = coarsen_costmap(costs, frame)
    assert coarse.shape == (3, 4)
    for row in range(3):
        for col in range(4):
            assert coarse[row, col] == costs[2 * row : 2 * row + 2, 2 * col : 2 * col + 2].min()
    x, y = coarse_frame.to_point(0, 0)
    left, top = frame.to_point(0, 0)
    assert (x, y) == pytest.approx((left + 0.025, top - 0.025))


@pytest.fixture
def loop():
    geometry = LaserGeometry(180, -np.pi / 2, np.pi / 179, 0.12, 3.5)
    return ExplorationLoop(ExplorerContext(FRAME, geometry), ExplorationLoopConfig())


def see(loop, grid, time, pose=HERE):
    cells = grid.cells[np.newaxis].copy()
    cells.flags.writeable = False
    return loop.observe(
        {
            "map": cells,
            "scan": np.full(180, 3.5, np.float32),
            "pose": np.array(pose, np.float32),
            "time": np.array([time], np.float32),
        }
    )


def test_a_choice_is_due_once_then_kept_until_the_horizon(loop):
    grid = room(openings=[EAST, NORTH])
    assert see(loop, grid, 0.0)
    assert loop.choose(0)
    assert loop.command().linear >= 0.0
    assert not see(loop, grid, 2.0)
    assert not see(loop, grid, 4.0)
    assert see(loop, grid, 6.0)


@pytest.mark.parametrize("walls_seen", [False, True])
def test_the_middle_of_a_hall_is_offered_as_soon_as_its_walls_are_seen(walls_seen):
    half, frame = 6.0, GridFrame(0.05, -7.0, -7.0, 280, 280)
    x, y = frame.to_point(*np.indices(frame.shape))
    far = np.maximum(np.abs(x), np.abs(y))
    cells = np.where(far < half, FREE, UNKNOWN).astype(np.uint8)
    cells[(far >= half) & (far < half + 0.1) & ~((x > 0.0) & (np.abs(y) < 0.6))] = OCCUPIED
    cells[far < 0.6] = UNKNOWN  # nearer to the robot than the door to the east
    if not walls_seen:
        cells[(np.abs(x) < 0.6) & (y < 0.0) & (far < half)] = (
            UNKNOWN  # as far as the wall to the south
        )
    loop = ExplorationLoop(
        ExplorerContext(frame, LaserGeometry(180, -np.pi / 2, np.pi / 179, 0.12, 3.5))
    )
    assert see(loop, OccupancyGrid(cells, frame), 0.0, Pose2D(0.0, 2.0, 0.0))
    assert any(np.hypot(*one.target) < 1.0 for one in loop.candidates) == walls_seen
    assert max(one.target[0] for one in loop.candidates) == pytest.approx(half, abs=0.2)
    assert any(one.target[1] < -3.5 for one in loop.candidates) != walls_seen


def test_a_choice_is_due_as_soon_as_the_frontier_is_gone(loop):
    see(loop, room(openings=[EAST, NORTH]), 0.0)
    east = min(range(2), key=lambda i: abs(loop.candidates[i].frontier.middle[1]))
    loop.choose(east)
    assert see(loop, room(openings=[NORTH]), 2.0)
    assert len(loop.candidates) == 1


def test_on_a_corrected_map_nothing_is_remembered_by_its_place_and_the_next_map_is_awaited(loop):
    grid = room(openings=[EAST, NORTH])
    see(loop, grid, 0.0)
    loop.choose(0)
    loop.navigator.status = GoalStatus.ABORTED
    see(loop, grid, 0.2)
    loop.choose(0)
    assert len(loop.candidates) == 1  # the other is blacklisted
    # Half a metre within a fifth of a second: the map is still the old one.
    cells = loop.known_map().cells[np.newaxis].copy()
    at = np.array((0.0, -0.5, 0.0), np.float32)
    scan = np.full(180, 3.5, np.float32)
    assert not loop.observe(
        {"map": cells, "scan": scan, "pose": at, "time": np.array([0.4], np.float32)}
    )
    assert loop.target is None
    assert loop.command() == (0.0, 0.0)
    assert see(loop, grid, 2.0, Pose2D(0.0, -0.5, 0.0))
    assert len(loop.candidates) == 2


def test_a_stalled_exploration_keeps_its_choice(loop):
    grid = room(openings=[EAST, NORTH])
    see(loop, grid, 0.0)
    due = [see(loop, grid, time) and loop.choose(0) for time in np.arange(0.0, 80.0, 2.0)]
    # The robot doesn't move: from 30 s without progress the goal is given up, but not reconsidered at 46, 52 s ...
    assert sum(due[1:20]) >= 5
    assert sum(due[24:]) <= 4


def test_with_nothing_left_the_robot_looks_around_and_is_done(loop):
    closed = room()
    assert not see(loop, closed, 0.0)
    turned = []
    for step in range(200):
        turned.append(loop.command())
        heading = 0.3 * step
        see(
            loop,
            closed,
            2.0 * step,
            Pose2D(0.0, 0.0, float(np.arctan2(np.sin(heading), np.cos(heading)))),
        )
        if loop.finished:
            break
    assert loop.finished
    assert turned[0].angular > 0.0
    assert loop.command() == (0.0, 0.0)


@pytest.mark.parametrize(
    "changes", [{"max_candidates": 0}, {"horizon": 0.0}, {"split_extent": -1.0}]
)
def test_senseless_settings_are_refused(changes):
    with pytest.raises(ConfigError):
        ExplorationLoopConfig(**changes)
