import numpy as np
import pytest

from slamgym.planning.frontier_feature_kernels import (
    FREE_CLASS,
    UNKNOWN_REGION,
    classify_costs,
    explore_unknown_region,
    explore_unknown_regions,
    unknown_by_ray,
)

LETHAL, UNKNOWN = 254, 255
STEP = 2.0 * np.pi / 72


def some_costs(seed):
    """A costmap of 60 x 80 cells with walls and patches of the unknown."""
    rng = np.random.default_rng(seed)
    costs = np.zeros((60, 80), np.uint8)
    for value, count in ((UNKNOWN, 12), (LETHAL, 8)):
        for _ in range(count):
            row, col = rng.integers(60), rng.integers(80)
            costs[row : row + rng.integers(1, 12), col : col + rng.integers(1, 12)] = value
    costs[20:41, 30:51] = 0
    return costs


def by_hand(costs, row, col, max_range, i):
    """The sum over a ray, cell after cell."""
    area = 0.0
    for r in range(1, int(max_range) + 1):
        rr = int(np.floor(row + r * np.sin(i * STEP) + 0.5))
        cc = int(np.floor(col + r * np.cos(i * STEP) + 0.5))
        inside = 0 <= rr < costs.shape[0] and 0 <= cc < costs.shape[1]
        cost = costs[rr, cc] if inside else UNKNOWN
        if cost == LETHAL:
            break
        if cost == UNKNOWN:
            area += r * STEP
    return area


@pytest.mark.parametrize("seed", range(4))
def test_the_unknown_in_sight_is_that_along_each_ray(seed):
    costs = some_costs(seed)
    for row, col, max_range in ((30, 40, 45.7), (2, 3, 60.0), (30, 40, 1.0)):
        expected = [by_hand(costs, row, col, max_range, i) for i in range(72)]
        np.testing.assert_array_equal(unknown_by_ray(costs, row, col, max_range), expected)


def test_an_empty_disc_counts_with_its_area_and_a_wall_hides_its_sector():
    costs = np.full((101, 101), UNKNOWN, np.uint8)
    whole = unknown_by_ray(costs, 50, 50, 40.0)
    # Rings of radius 1 to 40 and width 1 reach from 0.5 to 40.5.
    assert whole.sum() == pytest.approx(np.pi * (40.5**2 - 0.5**2), rel=1e-9)
    costs[:, 60] = LETHAL  # 10 cells to the right
    hidden = unknown_by_ray(costs, 50, 50, 40.0)
    assert hidden[0] == pytest.approx(STEP * sum(range(1, 10)))
    assert hidden[36] == whole[36]


def test_a_flood_counts_cells_by_their_distance_and_each_other_frontier_once():
    """Eight unknown rows of ten cells between floor; a frontier along the upper one, another along the lower one."""
    classes = np.zeros((10, 10), np.uint8)
    classes[[0, -1]] = FREE_CLASS
    labels = np.full((10, 10), -1, np.int16)
    labels[1], labels[8] = 0, 1
    cells = np.column_stack([np.ones(10, np.int64), np.arange(10)])
    region = explore_unknown_region(classes, labels, 0, cells, (3, 20), 1, 2)
    # The first two rows are seeds; outside are its left and its right column.
    expected = {"near": 50, "far": 80, "outside": 0.2, "is_enclosed": 1, "free": 20}
    expected |= {"occupied": 0, "frontiers": 1}
    assert dict(zip(UNKNOWN_REGION, region, strict=True)) == pytest.approx(expected)
    part = explore_unknown_region(classes, labels, 0, cells, (3, 4), 1, 2)
    found = dict(zip(UNKNOWN_REGION, part, strict=True))
    assert (found["far"], found["is_enclosed"], found["frontiers"]) == (60, 0.0, 0)


@pytest.mark.parametrize("shape", [(60, 80), (59, 79)])
def test_regions_behind_several_frontiers_are_those_behind_each_on_a_coarse_map(shape):
    """Cells that share a coarse one count once; those beyond the coarse map, on its edge."""
    height, width = shape
    costs = some_costs(1)[:height, :width]
    rng = np.random.default_rng(0)
    runs = [rng.integers(0, shape, (count, 2)).astype(np.int32) for count in (1, 12, 40)]
    runs[1][0] = height - 1, width - 1
    starts = np.append(0, np.cumsum([len(cells) for cells in runs]))
    found = explore_unknown_regions(costs, np.concatenate(runs), starts, 2, (3, 9), 2)
    cut = costs[: height // 2 * 2, : width // 2 * 2].reshape(height // 2, 2, width // 2, 2)
    is_occupied = (cut == LETHAL).any(axis=(1, 3))
    classes = np.where(is_occupied, 2, (cut < LETHAL).any(axis=(1, 3))).astype(np.uint8)
    np.testing.assert_array_equal(classify_costs(costs, 2), classes)
    last = np.array(classes.shape) - 1
    coarse = [np.unique(np.minimum(cells // 2, last), axis=0).astype(np.int64) for cells in runs]
    labels = np.full(classes.shape, -1, np.int16)
    for label, cells in enumerate(coarse):
        labels[tuple(cells.T)] = label
    for label, cells in enumerate(coarse):
        one = explore_unknown_region(classes, labels, label, cells, (3, 9), 2, len(runs))
        assert found[label].tolist() == one.tolist()
