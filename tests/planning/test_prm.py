"""Probabilistic roadmaps: paths keep clear of walls and reach what can be reached."""

import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.errors import SlamgymError
from slamgym.core.types import FREE
from slamgym.planning.prm import (
    build_roadmap,
    drivable_area,
    random_path,
    shorten,
    spread_stops,
    tour,
)

CLEARANCE = 0.25


WALL = shapely.box(3.9, 0.0, 4.0, 3.8)


def area_of(free: shapely.Polygon):
    grid = FloorPlan("some rooms", free).raster(0.05)
    x, y = grid.frame.to_point(*np.indices(grid.frame.shape))
    away = shapely.distance(free.boundary, shapely.points(x, y))
    return drivable_area(np.where(grid.cells == FREE, away, 0.0), grid.frame, CLEARANCE)


@pytest.fixture(scope="module")
def area():
    return area_of(shapely.box(0.0, 0.0, 8.0, 5.0).difference(WALL))


@pytest.fixture(scope="module")
def roadmap(area):
    return build_roadmap(area, np.random.default_rng(0))


def clearance_along(path: np.ndarray) -> float:
    walls = shapely.union_all([WALL, shapely.box(0, 0, 8, 5).exterior])
    return float(shapely.LineString(path).distance(walls))


@pytest.mark.parametrize("seed", range(5))
def test_paths_keep_the_clearance(roadmap, seed) -> None:
    path = random_path(roadmap, np.random.default_rng(seed))
    assert len(path) >= 2
    # Interpolation between cells is off by millimetres at a corner.
    assert clearance_along(path) > CLEARANCE - 0.01


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
    assert clearance_along(path) > CLEARANCE - 0.01


def test_spread_stops_leave_no_place_far_away(roadmap) -> None:
    stops = spread_stops(roadmap, 2.5, np.random.default_rng(0))
    gap = np.hypot(*(roadmap.nodes[:, None] - stops[None]).transpose(2, 0, 1)).min(axis=1)
    assert gap.max() <= 2.5


def test_shortening_leaves_out_needless_points(roadmap) -> None:
    straight = np.column_stack([np.linspace(0.5, 3.4, 9), np.full(9, 2.0)])
    short = shorten(straight, roadmap.area)
    np.testing.assert_allclose(short, straight[[0, -1]])


def test_the_same_seed_gives_the_same_roadmap(area, roadmap) -> None:
    again = build_roadmap(area, np.random.default_rng(0))
    np.testing.assert_array_equal(again.nodes, roadmap.nodes)


@pytest.mark.parametrize("seed", range(5))
def test_a_doorway_that_the_robot_just_fits_through_is_driven_through(seed) -> None:
    # 60 cm wide and half a metre deep: few pairs of random points see through it.
    wall = shapely.box(3.7, 0.0, 4.2, 5.0).difference(shapely.box(3.7, 2.0, 4.2, 2.6))
    free = shapely.box(0.0, 0.0, 8.0, 5.0).difference(wall)
    corner = np.array([[0.325, 0.325]])
    roadmap = build_roadmap(area_of(free), np.random.default_rng(seed), corner)
    nearest = roadmap.nodes[roadmap.nearest(corner[0])]
    np.testing.assert_allclose(nearest, corner[0], atol=0.026)
    path = roadmap.path(roadmap.nearest([0.3, 0.3]), roadmap.nearest([7.5, 4.5]))
    assert shapely.LineString(path).distance(free.boundary) > CLEARANCE - 0.01


def test_what_cannot_be_reached_is_left_out() -> None:
    free = shapely.box(0.0, 0.0, 8.0, 5.0).difference(shapely.box(5.0, 0.0, 5.1, 4.6))
    area = area_of(free)
    roadmap = build_roadmap(area, np.random.default_rng(0))
    assert roadmap.nodes[:, 0].max() < 5.0
    assert area.points[:, 0].max() < 5.0


def test_a_plan_too_narrow_for_the_robot_is_refused() -> None:
    with pytest.raises(SlamgymError, match="too narrow"):
        area_of(shapely.box(0.0, 0.0, 8.0, 0.3))
