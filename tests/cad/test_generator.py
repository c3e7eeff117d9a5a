import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from slamgym.cad import PlanGeneratorConfig, generate_plan
from slamgym.cad.cells import Box, Space, shared_walls, subdivide
from slamgym.cad.doors import find_openings
from slamgym.core.errors import ConfigError

seeds = st.integers(0, 2**32)
kinds = st.sampled_from(["home", "office"])


@given(seeds, kinds)
@settings(max_examples=60)
def test_every_plan_is_sound(seed, kind):
    plan = generate_plan(seed, PlanGeneratorConfig(kind=kind))
    assert isinstance(plan.free_space, Polygon)
    assert plan.free_space.is_valid
    # One connected space for a robot of radius 0.22 m with a margin, and it gets into every room.
    robot = plan.free_space.buffer(-0.25)
    assert isinstance(robot, Polygon)
    assert all(room.polygon.intersects(robot) for room in plan.rooms)
    _doors_are_passages_of_their_width(plan)
    _rooms_lie_in_the_plan_and_apart(plan)
    # Corners lie on whole centimetres in the positive quadrant.
    points = 100 * plan.segments()
    np.testing.assert_allclose(points, np.round(points), atol=1e-6)
    assert plan.bounds[:2] == pytest.approx((0.1, 0.1))


def _doors_are_passages_of_their_width(plan):
    for door in plan.doors:
        assert 0.7 - 1e-9 <= door.width <= 2.4 + 1e-9
        line = shapely.LineString([door.start, door.end])
        assert plan.free_space.covers(line)
        # The jambs are solid: half a centimetre beyond either end there is wall.
        longer = shapely.affinity.scale(line, 1 + 0.01 / door.width, 1 + 0.01 / door.width)
        assert longer.difference(plan.free_space).length == pytest.approx(0.01, abs=1e-6)


def _rooms_lie_in_the_plan_and_apart(plan):
    rooms = shapely.union_all([room.polygon for room in plan.rooms])
    assert rooms.area == pytest.approx(sum(room.area for room in plan.rooms))
    # Outside the rooms the free space is doorways; inside them pillars, islands and chimneys are missing.
    assert plan.free_space.difference(rooms).area < 0.12 * plan.area
    assert rooms.difference(plan.free_space).area < 0.12 * plan.area


@given(seeds)
@settings(max_examples=10)
def test_the_same_seed_gives_the_same_plan(seed):
    first = generate_plan(seed)
    assert generate_plan(seed) == first
    assert (
        generate_plan(np.random.default_rng(seed), plan_id=first.id).free_space == first.free_space
    )
    assert generate_plan(seed + 1).free_space != first.free_space


def test_homes_resemble_houseexpo_and_unlike_it_have_ways_round():
    homes = [generate_plan(seed, PlanGeneratorConfig(kind="home")) for seed in range(100)]
    sides = np.array(
        [(plan.bounds[2] - plan.bounds[0], plan.bounds[3] - plan.bounds[1]) for plan in homes]
    )
    areas = np.array([plan.area for plan in homes])
    # HouseExpo's medians; the tolerances are some three standard errors of a median of 100 plans.
    assert np.median([len(plan.rooms) for plan in homes]) == pytest.approx(6.5, abs=1.5)
    assert np.median(areas) == pytest.approx(112, rel=0.2)
    assert np.median(sides.max(axis=1)) == pytest.approx(14.3, rel=0.15)
    assert np.median(sides.max(axis=1) / sides.min(axis=1)) == pytest.approx(1.37, abs=0.15)
    assert np.median(areas / sides.prod(axis=1)) == pytest.approx(0.84, abs=0.05)
    with_holes = np.mean([len(plan.free_space.simplify(0.03).interiors) > 0 for plan in homes])
    assert 0.2 < with_holes < 0.6


def test_mixed_plans_are_mostly_homes():
    names = [generate_plan(seed).id.split("_")[0] for seed in range(60)]
    # Binomial with p = 0.15: 9 expected, standard deviation 2.8.
    assert 1 <= names.count("office") <= 20
    assert set(names) == {"home", "office"}


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ConfigError, match="kind must be"):
        PlanGeneratorConfig(kind="castle")


@given(sizes=st.lists(st.floats(2, 30), min_size=1, max_size=12), seed=seeds)
def test_subdivision_tiles_the_box_in_proportion(sizes, seed):
    side = np.sqrt(sum(sizes))
    box = Box(0.0, 0.0, round(1.3 * side, 2), round(side / 1.3, 2))
    cells = subdivide(box, [Space("Room", size) for size in sizes], np.random.default_rng(seed))
    assert len(cells) == len(sizes)
    assert shapely.union_all([cell.polygon for cell in cells]).equals(box.polygon())
    # Cuts are rounded to a centimetre, so a room is wrong by at most 1 cm along its sides.
    for cell, size in zip(cells, sizes, strict=True):
        wanted = size / sum(sizes) * box.area
        assert cell.polygon.area == pytest.approx(wanted, abs=0.01 * cell.polygon.length + 0.01)


def test_shared_walls_are_found_once_and_longest_first():
    left = shapely.box(0, 0, 2, 5)
    right = shapely.box(2, 1, 4, 3)
    assert shared_walls(left, right) == [(2, 1, 2, 3)] or shared_walls(left, right) == [
        (2, 3, 2, 1)
    ]
    assert shared_walls(left, shapely.box(2, 5, 4, 6)) == []
    corner = shapely.box(0, 0, 6, 6).difference(shapely.box(3, 4, 6, 6))
    assert [wall.length for wall in shared_walls(corner, shapely.box(3, 4, 6, 6))] == [3, 2]


def test_openings_are_found_and_measured():
    # Two rooms; the wall between them has a door of 0.9 m at its end and one of 1.1 m in its middle.
    space = (
        shapely.box(0, 0, 8, 6)
        .difference(shapely.box(3.95, 0.9, 4.05, 3))
        .difference(shapely.box(3.95, 4.1, 4.05, 6))
    )
    assert sorted(door.width for door in find_openings(space)) == pytest.approx([0.9, 1.1])
    assert find_openings(shapely.box(0, 0, 3, 3)) == []
