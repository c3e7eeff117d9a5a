import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.planning import (
    CostmapConfig,
    make_costmap,
    path_is_free,
    place_near,
    plan_path,
    reachable_space,
)
from slamgym.planning.costmap import INSCRIBED_COST
from slamgym.planning.grid_path import COST_FACTOR, straight_turns
from slamgym.planning.grid_path_kernels import line_cost, search_path, trace_path

RESOLUTION = 0.05


def grid_of(cells):
    cells = np.asarray(cells, dtype=np.uint8)
    return OccupancyGrid(cells, GridFrame(RESOLUTION, -1.0, -1.0, *cells.shape))


def point_at(grid, row, col):
    x, y = grid.frame.to_point(row, col)
    return float(x), float(y)


def pose_at(grid, row, col):
    return Pose2D(*point_at(grid, row, col), 0.0)


def cluttered(seed, shape=(80, 90)):
    rng = np.random.default_rng(seed)
    cells = np.full(shape, FREE)
    for _ in range(12):
        row, col = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        cells[row : row + rng.integers(1, 14), col : col + rng.integers(1, 14)] = OCCUPIED
    return grid_of(cells)


def cost_of(costmap, path):
    """Length of a path weighted by the costs along it [m]."""
    cells = np.column_stack(
        [
            costmap.frame.height_px - 0.5 - (path[:, 1] - costmap.frame.origin_y) / RESOLUTION,
            (path[:, 0] - costmap.frame.origin_x) / RESOLUTION - 0.5,
        ]
    )
    legs = itertools.pairwise(cells)
    return RESOLUTION * sum(line_cost(costmap.costs, *a, *b, 256, COST_FACTOR) for a, b in legs)


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), data=st.data())
def test_paths_keep_off_obstacles_and_cost_no_more_than_a_straight_line(seed, data):
    grid = cluttered(seed)
    costmap = make_costmap(grid, CostmapConfig(inscribed_radius=0.12))
    free = np.argwhere(costmap.costs < INSCRIBED_COST)
    assume(len(free) > 2)
    start = free[data.draw(st.integers(0, len(free) - 1))]
    goal = free[data.draw(st.integers(0, len(free) - 1))]
    path = plan_path(costmap, pose_at(grid, *start), point_at(grid, *goal), tolerance=0.0)
    reachable = reachable_space(costmap, pose_at(grid, *start))
    if path is None:
        assert (
            goal[0] * grid.cells.shape[1] + goal[1] not in reachable.order[: reachable.num_centre]
        )
        return
    assert path_is_free(costmap, path)
    np.testing.assert_allclose(
        path[[0, -1]], [point_at(grid, *start), point_at(grid, *goal)], atol=1e-9
    )
    assert np.hypot(*np.diff(path, axis=0).T).max() <= RESOLUTION + 1e-9
    straight = line_cost(
        costmap.costs, *map(float, start), *map(float, goal), INSCRIBED_COST, COST_FACTOR
    )
    # The grid's 8 directions make a path up to 8.2 % longer than the straight line before it is straightened.
    assert cost_of(costmap, path) <= 1.083 * straight * RESOLUTION + 0.2
    assert cost_of(costmap, path) >= math.dist(point_at(grid, *start), point_at(grid, *goal)) - 1e-9


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_straightening_never_makes_a_path_dearer_than_dijkstra_found_it(seed):
    grid = cluttered(seed)
    costmap = make_costmap(grid, CostmapConfig(inscribed_radius=0.12))
    start = pose_at(grid, 40, 45)
    reachable = reachable_space(costmap, start)
    assume(reachable is not None)
    distance, _ = search_path(
        costmap.costs,
        int(reachable.order[0]),
        -1,
        np.arange(costmap.costs.size),
        INSCRIBED_COST,
        COST_FACTOR,
    )
    costs = distance.reshape(costmap.costs.shape) * RESOLUTION
    last = divmod(int(reachable.order[reachable.num_centre - 1]), grid.cells.shape[1])
    path = plan_path(costmap, start, point_at(grid, *last), 0.0, reachable)
    # Lines are sampled twice per cell, steps counted once: the two sums differ by a few per cent.
    assert cost_of(costmap, path) <= 1.05 * costs[last] + 0.05


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 5))
def test_a_search_that_ends_early_finds_the_paths_of_the_whole_search(seed, count):
    grid = cluttered(seed)
    costmap = make_costmap(grid, CostmapConfig(inscribed_radius=0.12))
    reachable = reachable_space(costmap, pose_at(grid, 40, 45))
    assume(reachable is not None)
    start = int(reachable.order[0])
    rng = np.random.default_rng(seed)
    # Among the cells wanted are walls and places that no path leads to.
    wanted = rng.choice(np.append(reachable.order, rng.integers(0, grid.cells.size, 20)), count)
    whole, parents = search_path(
        costmap.costs, start, -1, np.arange(costmap.costs.size), INSCRIBED_COST, COST_FACTOR
    )
    part, their_parents = search_path(
        costmap.costs, start, -1, wanted.astype(np.int64), INSCRIBED_COST, COST_FACTOR
    )
    assert (part == whole[wanted]).all()
    for cell in wanted[np.isfinite(whole[wanted])]:
        assert (trace_path(parents, start, cell) == trace_path(their_parents, start, cell)).all()


@pytest.mark.parametrize("corner", [(0, 1), (1, 0)])
def test_no_step_cuts_the_corner_of_a_wall(corner):
    costs = np.zeros((3, 3), np.uint8)
    costs[corner] = INSCRIBED_COST
    for goal in (-1, 4):
        (length,), _ = search_path(costs, 0, goal, np.array([4]), INSCRIBED_COST, 0.0)
        assert length == 2.0  # round it, not across


@pytest.mark.parametrize("heading", [0.0, 0.5, 2.0, -3.0])
def test_a_robot_turns_by_the_angle_from_its_heading_to_a_place(heading):
    aside = np.array([0.0, 0.7, -0.7, 3.0, -3.0])
    towards = heading + aside
    places = np.column_stack([1.0 + 2.0 * np.cos(towards), -2.0 + 2.0 * np.sin(towards)])
    pose = Pose2D(1.0, -2.0, heading)
    np.testing.assert_allclose(straight_turns(pose, places), np.abs(aside), atol=1e-9)
    assert straight_turns(pose, np.array([[1.1, -2.1]])) == 0.0


def test_goal_in_unknown_space_is_replaced_by_the_nearest_place():
    cells = np.full((60, 60), FREE)
    cells[:20] = UNKNOWN
    grid = grid_of(cells)
    costmap = make_costmap(grid)
    path = plan_path(costmap, pose_at(grid, 50, 30), point_at(grid, 14, 30), tolerance=0.5)
    np.testing.assert_allclose(path[-1], point_at(grid, 20, 30), atol=1e-9)
    assert plan_path(costmap, pose_at(grid, 50, 30), point_at(grid, 2, 30), tolerance=0.5) is None


def test_the_place_near_a_goal_is_never_behind_a_wall():
    cells = np.full((60, 61), FREE)
    cells[:, 30] = OCCUPIED
    cells[50:, 30] = FREE  # the path round it
    cells[20:40, 31:37] = UNKNOWN
    grid = grid_of(cells)
    costmap = make_costmap(grid)
    reachable = reachable_space(costmap, pose_at(grid, 30, 10))
    # Straight across, the near side is nearer; but the goal is an unknown cell on the far side.
    _, col = place_near(costmap, point_at(grid, 30, 32), 1.0, reachable)
    assert col > 30


def test_no_path_through_a_door_that_is_too_narrow():
    for door, passable in ((8, False), (14, True)):
        cells = np.full((60, 61), FREE)
        cells[:, 29:32] = OCCUPIED
        cells[20 : 20 + door, 29:32] = FREE
        grid = grid_of(cells)
        path = plan_path(make_costmap(grid), pose_at(grid, 30, 10), point_at(grid, 30, 50))
        assert (path is not None) == passable


def test_a_path_leads_out_of_inflated_ground():
    cells = np.full((60, 60), FREE)
    cells[0] = OCCUPIED
    grid = grid_of(cells)
    costmap = make_costmap(grid)
    path = plan_path(costmap, pose_at(grid, 2, 10), point_at(grid, 40, 40))
    assert path is not None
    assert path_is_free(costmap, path)


def test_a_blocked_path_is_noticed():
    grid = grid_of(np.full((60, 60), FREE))
    path = plan_path(make_costmap(grid), pose_at(grid, 30, 5), point_at(grid, 30, 55))
    assert path_is_free(make_costmap(grid), path)
    blocked = grid.cells.copy()
    blocked[25:35, 30] = OCCUPIED
    assert not path_is_free(make_costmap(grid_of(blocked)), path)
