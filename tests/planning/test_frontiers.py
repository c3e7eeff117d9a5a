import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.planning import (
    CostmapConfig,
    expected_gain,
    find_frontiers,
    make_costmap,
    reachable_space,
)
from slamgym.planning.costmap import INSCRIBED_COST, LETHAL_COST, NO_INFORMATION
from slamgym.planning.frontier_kernels import nearest_open_cell

RESOLUTION = 0.05


def grid_of(cells):
    cells = np.asarray(cells, dtype=np.uint8)
    return OccupancyGrid(cells, GridFrame(RESOLUTION, 0.0, 0.0, *cells.shape))


def pose_at(grid, row, col):
    x, y = grid.frame.to_point(row, col)
    return Pose2D(float(x), float(y), 0.0)


def blobs(seed, shape=(70, 90)):
    """A map with patches of all three kinds, free about the middle."""
    rng = np.random.default_rng(seed)
    cells = np.full(shape, FREE, np.uint8)
    for value in (UNKNOWN, UNKNOWN, OCCUPIED, OCCUPIED):
        for _ in range(4):
            row, col = rng.integers(0, shape[0]), rng.integers(0, shape[1])
            cells[row : row + rng.integers(2, 20), col : col + rng.integers(2, 20)] = value
    cells[30:40, 40:50] = FREE
    return grid_of(cells)


def two_rooms(door_cells, far_known=30):
    """A room of 3 m and one behind a wall of 0.1 m with a door; the far room is known for some rows only."""
    cells = np.full((64 + far_known + 20, 62), UNKNOWN)
    cells[:64, :] = OCCUPIED
    cells[1:61, 1:61] = FREE
    first = 30 - door_cells // 2
    cells[61:64, first : first + door_cells] = FREE
    cells[64 : 64 + far_known, 1:61] = FREE
    cells[61:, 0] = cells[61:, 61] = OCCUPIED
    return grid_of(cells)


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000))
def test_frontiers_border_free_and_unknown_and_share_no_cell(seed):
    grid = blobs(seed)
    costmap = make_costmap(grid, CostmapConfig(inflation_radius=0.3))
    pose = pose_at(grid, 35, 45)
    frontiers = find_frontiers(costmap, pose, min_size=0.0)
    free = np.pad(costmap.costs < LETHAL_COST, 1)
    cells = [tuple(cell) for frontier in frontiers for cell in frontier.cells]
    assert len(cells) == len(set(cells))
    for row, col in cells:
        assert costmap.costs[row, col] == NO_INFORMATION
        assert (
            free[row, col + 1]
            or free[row + 2, col + 1]
            or free[row + 1, col]
            or free[row + 1, col + 2]
        )


def test_fields_of_a_straight_frontier():
    cells = np.full((60, 60), FREE)
    cells[:20] = UNKNOWN
    grid = grid_of(cells)
    pose = pose_at(grid, 40, 10)
    (frontier,) = find_frontiers(make_costmap(grid), pose)
    assert frontier.size == 60
    assert frontier.min_distance == pytest.approx(21 * RESOLUTION)
    centroid_x, centroid_y = grid.frame.to_point(19, 29.5)
    assert frontier.centroid == pytest.approx((float(centroid_x), float(centroid_y)))
    assert frontier.nearest == pytest.approx(pose_at(grid, 19, 10)[:2])
    assert frontier.middle[0] == pytest.approx(float(centroid_x), abs=RESOLUTION)


def test_centroid_counts_the_first_contact_cell():
    cells = np.full((40, 40), OCCUPIED)
    cells[10:30, 10:30] = FREE
    cells[9, 18:20] = UNKNOWN  # two cells: leaving one out would move the mean by half a cell
    grid = grid_of(cells)
    costmap = make_costmap(grid, CostmapConfig(inscribed_radius=0.05, inflation_radius=0.05))
    (frontier,) = find_frontiers(costmap, pose_at(grid, 20, 20), min_size=0.0)
    assert frontier.centroid == pytest.approx(tuple(float(v) for v in grid.frame.to_point(9, 18.5)))


def test_smaller_frontiers_are_dropped_and_those_of_exactly_the_size_kept():
    cells = np.full((60, 60), OCCUPIED)
    cells[1:59, 1:59] = FREE
    cells[0, 20:35] = UNKNOWN  # 15 cells = 0.75 m
    grid = grid_of(cells)
    pose = pose_at(grid, 30, 30)
    assert len(find_frontiers(make_costmap(grid), pose, min_size=0.75)) == 1
    assert find_frontiers(make_costmap(grid), pose, min_size=0.8) == []


def test_an_inflated_doorway_hides_no_frontier():
    grid = two_rooms(door_cells=16)
    (frontier,) = find_frontiers(make_costmap(grid), pose_at(grid, 30, 30))
    assert frontier.size >= 55


def test_a_gap_that_the_robot_cannot_pass_leads_to_no_frontier():
    grid = two_rooms(door_cells=7)
    assert find_frontiers(make_costmap(grid), pose_at(grid, 30, 30)) == []


def test_a_robot_on_inflated_or_unknown_ground_still_searches():
    grid = two_rooms(door_cells=16)
    costmap = make_costmap(grid)
    assert len(find_frontiers(costmap, pose_at(grid, 2, 30))) == 1
    assert find_frontiers(costmap, Pose2D(-50.0, 0.0, 0.0)) == []


def test_a_walled_in_robot_reaches_nothing():
    cells = np.full((40, 40), FREE)
    cells[15:25, 15:25] = OCCUPIED
    cells[19:21, 19:21] = FREE
    grid = grid_of(cells)
    assert reachable_space(make_costmap(grid), pose_at(grid, 20, 20)) is None


def test_expected_gain_stops_at_walls_and_is_a_disc_in_the_unknown():
    cells = np.full((200, 200), UNKNOWN)
    grid = grid_of(cells)
    x, y = grid.frame.to_point(100, 100)
    point = (float(x), float(y))
    everything = expected_gain(make_costmap(grid), point, 2.0)
    assert everything == pytest.approx(np.pi * 2.0**2, rel=0.05)  # a polar sum of 5 cm rings
    cells[:, 110] = OCCUPIED
    assert (
        0.5 * everything
        < expected_gain(make_costmap(grid_of(cells)), point, 2.0)
        < 0.8 * everything
    )


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), steps=st.integers(0, 15))
def test_the_nearest_open_cell_is_the_same_on_a_larger_map(seed, steps):
    costs = make_costmap(blobs(seed), CostmapConfig(inscribed_radius=0.12)).costs
    row, col = (int(value) for value in np.random.default_rng(seed).integers(0, costs.shape))
    anywhere = np.zeros(0, np.bool_)
    found = nearest_open_cell(costs, row, col, INSCRIBED_COST, anywhere, steps)
    around = np.pad(costs, 30, constant_values=LETHAL_COST)
    again = nearest_open_cell(around, row + 30, col + 30, INSCRIBED_COST, anywhere, steps)
    if found < 0:
        assert again < 0
    else:
        assert tuple(np.subtract(divmod(again, around.shape[1]), 30)) == divmod(
            found, costs.shape[1]
        )
        assert np.hypot(*np.subtract(divmod(found, costs.shape[1]), (row, col))) <= np.hypot(
            steps, steps
        )
