"""Plans that look alike are found however they lie, and others are kept apart."""

import numpy as np
import pytest
from shapely import Polygon, box
from shapely.affinity import affine_transform, rotate, scale, translate

from slamgym.cad import FloorPlan, open_plans
from slamgym.cad.image_plan import trace_plan
from slamgym.core.types import GridFrame
from slamgym.dataset.curate.near_duplicates import (
    RADIUS,
    _candidates,
    distances,
    near_duplicates,
    plan_print,
)

SYMMETRIES = [
    [1, 0, 0, 1], [-1, 0, 0, 1], [1, 0, 0, -1], [-1, 0, 0, -1],
    [0, 1, 1, 0], [0, -1, 1, 0], [0, 1, -1, 0], [0, -1, -1, 0],
]  # fmt: skip


@pytest.fixture(scope="module")
def plans():
    source = open_plans("bundled")
    return [source.load(plan_id) for plan_id in source.ids]


def grouped(plans):
    return near_duplicates(np.stack([plan_print(plan) for plan in plans]))


def turned(plan, matrix, x=0.0, y=0.0):
    return FloorPlan(plan.id, affine_transform(plan.free_space, [*matrix, x, y]))


@pytest.mark.parametrize("matrix", SYMMETRIES)
def test_a_copy_is_found_however_it_is_turned_flipped_and_moved(plans, matrix):
    copies = [turned(plan, matrix, 17.3, -4.1) for plan in plans]
    groups = grouped([*plans, *copies])
    assert list(groups) == [*range(len(plans)), *range(len(plans))]


def test_a_moved_door_leaves_a_plan_alike_and_another_plan_is_different(plans):
    plan = plans[0]
    min_x, min_y, _, _ = plan.bounds
    chimney = box(0, 0, 0.4, 0.4)
    changed = FloorPlan("changed", plan.free_space.difference(translate(chimney, min_x, min_y)))
    assert list(grouped([plan, changed, plans[1]])) == [0, 0, 2]


@pytest.mark.parametrize("factor", [0.5, 0.8, 0.95, 1.2, 3.0])
def test_a_plan_of_another_size_looks_alike(plans, factor):
    resized = [FloorPlan("resized", scale(plan.free_space, factor, factor)) for plan in plans]
    assert list(grouped([*plans, *resized])) == [*range(len(plans)), *range(len(plans))]


@pytest.mark.parametrize("angle", [-3.0, -1.0, 0.5, 2.0, 3.0, 44.9, 46.0])
def test_a_plan_that_lies_askew_looks_alike(plans, angle):
    askew = [FloorPlan("askew", rotate(plan.free_space, angle)) for plan in plans]
    assert list(grouped([*plans, *askew])) == [*range(len(plans)), *range(len(plans))]


def test_prints_are_the_same_however_a_plan_is_turned_flipped_resized_and_moved(plans):
    rng = np.random.default_rng(0)
    for plan in [*plans, *plans]:
        factor = rng.uniform(0.3, 3.0)
        x, y = rng.uniform(-100.0, 100.0, 2)
        flipped = turned(plan, factor * np.array(SYMMETRIES[rng.integers(8)]), x, y)
        other = FloorPlan("other", rotate(flipped.free_space, rng.uniform(-180.0, 180.0)))
        first = plan_print(plan)
        second = plan_print(other)
        assert distances(first[None], second[None])[0] < 0.5 * RADIUS


def test_staircases_of_a_slanted_plan_count_as_slanted_walls():
    """As plans that were drawn on a grid of 1 cm have them."""
    hall = box(0, 0, 12, 7).difference(box(4, 2, 4.2, 7))
    frame = GridFrame(0.02, -2.0, -2.0, 600, 800)
    cells = FloorPlan("hall", rotate(hall, 3.0)).raster(0.02, frame).cells > 0
    drawn = trace_plan(cells, frame, "drawn", "drawn", smoothing=0.0)
    assert list(grouped([FloorPlan("hall", hall), drawn])) == [0, 0]


def test_thin_inner_walls_tell_plans_of_one_outline_apart():
    """An empty hall, one that is divided along, and one that is divided across: most of the floor is the same."""
    hall = box(0, 0, 15, 10)
    along = box(0, 4.9, 13, 5)
    across = box(7, 0, 7.1, 9)
    plans = [FloorPlan(str(walls), hall.difference(walls)) for walls in (Polygon(), along, across)]
    assert list(grouped(plans)) == [0, 1, 2]


def test_a_wall_that_is_moved_a_little_leaves_a_plan_alike(plans):
    hall = box(0, 0, 15, 10)
    moved = [FloorPlan(str(x), hall.difference(box(x, 0, x + 0.15, 8.5))) for x in (6.0, 6.3, 9.0)]
    assert list(grouped(moved))[1] == 0


def test_the_hash_proposes_every_pair_that_comparing_all_would_find():
    """The k-d tree only saves work: on 150 generated plans, some changed a little, it misses none."""
    source = open_plans("procedural:3")
    rng = np.random.default_rng(0)
    prints = [plan_print(source.load(plan_id)) for plan_id in source.ids[:50]]
    for picture in list(prints):
        for spread in (0.02, 0.1):
            other = (
                np.rot90(picture, rng.integers(4)) + rng.normal(0, 1, picture.shape) * spread / 32
            )
            prints.append((other / np.linalg.norm(other)).astype(np.float32))
    pictures = np.stack(prints)
    first, second = np.triu_indices(len(prints), k=1)
    alike = distances(pictures[first], pictures[second]) <= RADIUS
    expected = set(zip(first[alike].tolist(), second[alike].tolist(), strict=True))
    proposed = {tuple(sorted(pair)) for pair in _candidates(pictures, RADIUS).tolist()}
    assert len(expected) >= 50
    assert expected <= proposed


def test_few_plans_are_no_special_case(plans):
    assert list(grouped(plans[:1])) == [0]
    assert len(near_duplicates(np.empty((0, 32, 32), np.float32))) == 0
