import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.planning import CostmapConfig, crop_known, free_body, make_costmap, mark_obstacles
from slamgym.planning.costmap import FREE_COST, INSCRIBED_COST, LETHAL_COST, NO_INFORMATION

RESOLUTION = 0.05


def grid_of(cells):
    cells = np.asarray(cells, dtype=np.uint8)
    return OccupancyGrid(cells, GridFrame(RESOLUTION, -1.0, -2.0, *cells.shape))


def random_cells(seed, shape=(40, 55)):
    rng = np.random.default_rng(seed)
    return rng.choice([FREE, UNKNOWN, OCCUPIED], size=shape, p=[0.7, 0.27, 0.03]).astype(np.uint8)


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_cost_falls_with_the_distance_to_the_nearest_obstacle(seed):
    cells = random_cells(seed)
    costmap = make_costmap(grid_of(cells))
    obstacles = np.argwhere(cells == OCCUPIED)
    free = np.argwhere(cells == FREE)
    distance = np.sqrt(((free[:, None] - obstacles[None]) ** 2).sum(-1)).min(1) * RESOLUTION
    costs = costmap.costs[free[:, 0], free[:, 1]].astype(int)
    by_distance = costs[np.argsort(distance, kind="stable")]
    assert (np.diff(by_distance) <= 0).all()
    assert ((costs == INSCRIBED_COST) == (distance <= 0.22 + 1e-9)).all()
    decayed = np.floor(252 * np.exp(-3.0 * (distance - 0.22)))
    band = (distance > 0.22 + 1e-9) & (distance <= 1.0 + 1e-9)
    np.testing.assert_array_equal(costs[band], decayed[band])


def test_occupied_is_lethal_and_unknown_stays_unknown():
    cells = random_cells(3)
    costs = make_costmap(grid_of(cells)).costs
    assert (costs[cells == OCCUPIED] == LETHAL_COST).all()
    assert (costs[cells == UNKNOWN] == NO_INFORMATION).all()


def test_a_map_without_obstacles_costs_nothing():
    costs = make_costmap(grid_of(np.full((10, 12), FREE))).costs
    assert (costs == FREE_COST).all()


def test_a_larger_radius_never_lowers_a_cost():
    grid = grid_of(random_cells(5))
    small = make_costmap(grid, CostmapConfig(inscribed_radius=0.15)).costs
    large = make_costmap(grid, CostmapConfig(inscribed_radius=0.25)).costs
    assert (large >= small).all()


def test_coastal_cost_holds_only_out_of_sight_of_walls():
    cells = np.full((80, 80), FREE)
    cells[0] = OCCUPIED
    config = CostmapConfig(inflation_radius=0.5, coastal_distance=2.0)
    costs = make_costmap(grid_of(cells), config).costs
    rows = np.arange(80)
    assert (costs[rows * RESOLUTION > 2.0 + 1e-9] == 252).all()
    between = (rows * RESOLUTION > 0.5 + 1e-9) & (rows * RESOLUTION < 2.0 - 1e-9)
    assert (costs[between] == FREE_COST).all()


def test_a_door_of_70_cm_is_passable_even_with_walls_one_cell_too_thick():
    cells = np.full((41, 60), FREE)
    cells[18:22] = OCCUPIED
    cells[18:22, 20:34] = FREE  # 14 cells = 0.7 m
    for thick in (0, 1):
        cells[18:22, 20 : 20 + thick] = OCCUPIED
        cells[18:22, 34 - thick : 34] = OCCUPIED
        assert (make_costmap(grid_of(cells)).costs[18:22] < INSCRIBED_COST).any(axis=1).all()


@settings(max_examples=20)
@given(
    top=st.integers(0, 60),
    left=st.integers(0, 60),
    height=st.integers(1, 30),
    width=st.integers(1, 30),
)
def test_crop_keeps_every_known_cell_where_it_was(top, left, height, width):
    cells = np.full((100, 100), UNKNOWN, dtype=np.uint8)
    cells[top : top + height, left : left + width] = random_cells(1, (height, width))
    grid = OccupancyGrid(cells, GridFrame(RESOLUTION, -2.5, -2.5, 100, 100))
    cropped = crop_known(grid, Pose2D(0.0, 0.0, 0.0))
    rows, cols = np.nonzero(cropped.cells != UNKNOWN)
    x, y = cropped.frame.to_point(rows, cols)
    row, col = grid.frame.to_cell(x, y)
    np.testing.assert_array_equal(cells[row, col], cropped.cells[rows, cols])
    assert len(rows) == (cells != UNKNOWN).sum()


def test_crop_of_an_unknown_map_is_the_robot_and_its_margin():
    grid = OccupancyGrid(
        np.full((200, 200), UNKNOWN, np.uint8), GridFrame(RESOLUTION, -5.0, -5.0, 200, 200)
    )
    cropped = crop_known(grid, Pose2D(1.0, -2.0, 0.0), margin=0.5)
    assert cropped.frame.shape == (21, 21)
    min_x, min_y, max_x, max_y = cropped.frame.bounds
    assert min_x < 1.0 < max_x
    assert min_y < -2.0 < max_y


def test_body_frees_unknown_cells_but_keeps_the_wall_it_touches():
    cells = np.full((40, 40), UNKNOWN)
    cells[:, 23] = OCCUPIED
    grid = OccupancyGrid(cells.astype(np.uint8), GridFrame(RESOLUTION, 0.0, 0.0, 40, 40))
    x, y = grid.frame.to_point(20, 19)
    freed = free_body(grid, Pose2D(float(x), float(y), 0.0), 0.22).cells
    assert freed[20, 19] == freed[20, 16] == FREE
    assert (freed[:, 23] == OCCUPIED).all()
    assert (grid.cells != FREE).all()  # the argument is left alone


def test_marked_obstacles_leave_known_walls_as_thin_as_they_are():
    cells = np.full((60, 60), FREE)
    cells[:, 30] = OCCUPIED
    grid = OccupancyGrid(cells.astype(np.uint8), GridFrame(RESOLUTION, 0.0, 0.0, 60, 60))
    beside_wall, in_the_open, outside = (1.6, 1.5), (0.5, 1.5), (99.0, 1.0)
    marked = mark_obstacles(grid, np.array([beside_wall, in_the_open, outside])).cells
    assert (marked == OCCUPIED).sum() == (cells == OCCUPIED).sum() + 1
    row, col = grid.frame.to_cell(*in_the_open)
    assert marked[row, col] == OCCUPIED


@pytest.mark.parametrize(
    "settings_", [{"inscribed_radius": 0.0}, {"inflation_radius": 0.1}, {"coastal_distance": -1.0}]
)
def test_senseless_settings_are_refused(settings_):
    with pytest.raises(ConfigError):
        CostmapConfig(**settings_)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    rows=st.integers(1, 40),
    cols=st.integers(1, 40),
    share=st.sampled_from([0.002, 0.03, 0.5]),
)
def test_distances_are_those_to_the_nearest_occupied_cell(seed, rows, cols, share):
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((rows, cols)) < share, OCCUPIED, FREE).astype(np.uint8)
    cells[rng.random((rows, cols)) < 0.2] = UNKNOWN
    obstacles = np.argwhere(cells == OCCUPIED)
    distance = make_costmap(grid_of(cells)).distance
    if len(obstacles) == 0:
        assert np.isinf(distance).all()
        return
    offsets = np.argwhere(np.full(cells.shape, True))[:, None] - obstacles[None]
    nearest = np.sqrt((offsets**2).sum(-1).min(1)).reshape(cells.shape)
    np.testing.assert_array_equal(distance, nearest.astype(np.float32))


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    edits=st.integers(0, 4),
    coastal=st.sampled_from([0.3, 1.5, np.inf]),
)
def test_a_costmap_made_of_an_older_one_is_that_of_the_map_alone(seed, edits, coastal):
    rng = np.random.default_rng(seed)
    config = CostmapConfig(inflation_radius=0.4, coastal_distance=coastal)
    world = random_cells(seed, (260, 300))
    world[rng.random(world.shape) < 0.9] = FREE

    def seen_through_a_window():
        (top, bottom), (left, right) = (
            np.sort(rng.choice(size, 2, replace=False)) for size in world.shape
        )
        part = world[top:bottom, left:right].copy()
        y = (world.shape[0] - bottom) * RESOLUTION - 3.0
        return OccupancyGrid(part, GridFrame(RESOLUTION, left * RESOLUTION + 7.0, y, *part.shape))

    older = make_costmap(seen_through_a_window(), config)
    for _ in range(edits):
        row, col = (int(rng.integers(0, size)) for size in world.shape)
        world[row : row + 9, col : col + 7] = random_cells(
            row, world[row : row + 9, col : col + 7].shape
        )
    newer = seen_through_a_window()
    expected, found = make_costmap(newer, config), make_costmap(newer, config, older)
    np.testing.assert_array_equal(found.costs, expected.costs)
    known = newer.cells != UNKNOWN
    np.testing.assert_array_equal(found.distance[known], expected.distance[known])


@pytest.mark.parametrize("gap", [40, 70, 110])
def test_distances_near_a_change_are_from_the_old_obstacles_beyond_it_too(gap):
    """In a hall: up to 3 m (60 cells) off a change distances change, and obstacles 3 m from there count."""
    cells = np.full((200, 400), FREE, np.uint8)
    cells[:, 100 + gap] = OCCUPIED
    older = make_costmap(grid_of(cells.copy()))
    cells[100, 100] = OCCUPIED
    grid = grid_of(cells)
    found, expected = make_costmap(grid, before=older), make_costmap(grid)
    np.testing.assert_array_equal(found.distance, expected.distance)
    np.testing.assert_array_equal(found.costs, expected.costs)
