"""Probabilistic roadmaps: paths keep clear of walls and reach what can be reached."""

import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.errors import SlamgymError
from slamgym.planning.prm import build_roadmap, random_path, shorten, spread_stops, tour

CLEARANCE = 0.25


@pytest.fixture(scope="module")
def grid():
    free = shapely.box(0.0, 0.0, 8.0, 5.0).difference(shapely.box(3.9, 0.0, 4.0, 3.8))
    return FloorPlan("two rooms", free).raster(0.05)


@pytest.fixture(scope="module")
def roadmap(grid):
    return build_roadmap(grid, CLEARANCE, np.random.default_rng(0))


def clearance_along(path: np.ndarray) -> float:
    walls = shapely.union_all([shapely.box(3.9, 0.0, 4.0, 3.8), shapely.box(0, 0, 8, 5).exterior])
    return float(shapely.LineString(path).distance(walls))


@pytest.mark.parametrize("seed", range(5))
def test_paths_keep_the_clearance(roadmap, seed) -> None:
    path = random_path(roadmap, np.random.default_rng(seed))
    assert len(path) >= 2
    # The distance transform counts from cell centres: one cell diagonal and its own approximation.
    assert clearance_along(path) > CLEARANCE - 0.08


def test_the_way_round_a_wall_is_found_and_nearly_shortest(roadmap) -> None:
    start, goal = roadmap.nearest([2.0, 0.6]), roadmap.nearest([6.0, 0.6])
    path = roadmap.path(start, goal)
    np.testing.assert_allclose(path[[0, -1]], roadmap.nodes[[start, goal]])
    length = np.hypot(*np.diff(path, axis=0).T).sum()
    corner = np.array([3.95, 3.8 + CLEARANCE])
    shortest = np.hypot(*(corner - path[0])) + np.hypot(*(corner - path[-1]))
    assert shortest * 0.97 < length < 1.25 * shortest


def test_a_tour_passes_every_stop(roadmap) -> None:
    stops = np.array([[1.0, 1.0], [1.0, 4.0], [7.0, 1.0], [7.0, 4.0]])
    path = tour(roadmap, stops, np.random.default_rng(0))
    for stop in stops:
        node = roadmap.nodes[roadmap.nearest(stop)]
        assert np.hypot(*(path - node).T).min() < 1e-9
    assert clearance_along(path) > CLEARANCE - 0.08


def test_spread_stops_leave_no_place_far_away(roadmap) -> None:
    stops = spread_stops(roadmap, 2.5, np.random.default_rng(0))
    gap = np.hypot(*(roadmap.nodes[:, None] - stops[None]).transpose(2, 0, 1)).min(axis=1)
    assert gap.max() <= 2.5


def test_shortening_leaves_out_needless_points(roadmap) -> None:
    straight = np.column_stack([np.linspace(0.5, 3.4, 9), np.full(9, 2.0)])
    short = shorten(straight, roadmap.clearance_map, roadmap.grid, CLEARANCE)
    np.testing.assert_allclose(short, straight[[0, -1]])


def test_the_same_seed_gives_the_same_roadmap(grid, roadmap) -> None:
    again = build_roadmap(grid, CLEARANCE, np.random.default_rng(0))
    np.testing.assert_array_equal(again.nodes, roadmap.nodes)


def test_a_plan_too_narrow_for_the_robot_is_refused() -> None:
    grid = FloorPlan("gap", shapely.box(0.0, 0.0, 8.0, 0.3)).raster(0.05)
    with pytest.raises(SlamgymError, match="too narrow"):
        build_roadmap(grid, CLEARANCE, np.random.default_rng(0))
