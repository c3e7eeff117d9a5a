"""Plans that look alike are found however they lie, and others are kept apart."""

import numpy as np
import pytest
from shapely import box
from shapely.affinity import affine_transform, scale, translate

from slamgym.cad import FloorPlan, open_plans
from slamgym.dataset.curate.near_duplicates import RADIUS, _candidates, distances, near_duplicates, plan_print

SYMMETRIES = [
    [1, 0, 0, 1], [-1, 0, 0, 1], [1, 0, 0, -1], [-1, 0, 0, -1],
    [0, 1, 1, 0], [0, -1, 1, 0], [0, 1, -1, 0], [0, -1, -1, 0],
]  # fmt: skip


@pytest.fixture(scope="module")
def plans():
    source = open_plans("bundled")
    return [source.load(plan_id) for plan_id in source.ids]


def side(plan):
    min_x, min_y, max_x, max_y = plan.bounds
    return max(max_x - min_x, max_y - min_y)


def grouped(plans):
    return near_duplicates(np.stack([plan_print(plan) for plan in plans]), np.array([side(p) for p in plans]))


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


def test_plans_of_another_size_are_different(plans):
    larger = FloorPlan("larger", scale(plans[0].free_space, 1.1, 1.1))
    slightly = FloorPlan("slightly", scale(plans[0].free_space, 1.01, 1.01))
    assert list(grouped([plans[0], larger, slightly])) == [0, 1, 0]


def test_the_hash_proposes_every_pair_that_comparing_all_would_find():
    """The k-d tree only saves work: on 150 generated plans, some changed a little, it misses none."""
    source = open_plans("procedural:3")
    rng = np.random.default_rng(0)
    prints = [plan_print(source.load(plan_id)) for plan_id in source.ids[:50]]
    for picture in list(prints):
        for spread in (0.01, 0.1):
            other = np.rot90(picture, rng.integers(4)) + rng.normal(0, 1, picture.shape) * spread / 32
            prints.append((other / np.linalg.norm(other)).astype(np.float32))
    pictures, sizes = np.stack(prints), np.zeros(len(prints))
    first, second = np.triu_indices(len(prints), k=1)
    alike = distances(pictures[first], pictures[second]) <= RADIUS
    expected = set(zip(first[alike].tolist(), second[alike].tolist(), strict=True))
    proposed = {tuple(sorted(pair)) for pair in _candidates(pictures, sizes, RADIUS).tolist()}
    assert len(expected) >= 50
    assert expected <= proposed


def test_few_plans_are_no_special_case(plans):
    assert list(grouped(plans[:1])) == [0]
    assert len(near_duplicates(np.empty((0, 32, 32), np.float32), np.empty(0))) == 0
