"""The layers that a translator learns: shares that add up, ending where the map is no evidence; doors."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.gan.data import PairSet
from slamgym.gan.presets import find_preset
from slamgym.gan.training.sampler import BatchSampler
from slamgym.metrics.layers import (
    EXPLORED_MARGIN,
    WALL_DEPTH,
    door_cells,
    explored_floor,
    layer_shares,
)

SCALE = 0.1
NO_DOOR = np.zeros((1, 1), np.bool_)


def half_explored():
    """A hall of 8 m by 4 m whose left half was seen, but for a bed of 1.5 m in it."""
    cad = np.zeros((60, 100), np.uint8)
    cad[10:50, 10:90] = FREE
    slam = np.full(cad.shape, UNKNOWN, np.uint8)
    slam[10:50, 10:50] = FREE
    slam[25:40, 20:35] = UNKNOWN
    return cad, slam


def test_gaps_are_closed_and_frontiers_are_passed_by_the_margin_alone():
    cad, slam = half_explored()
    floor, wall, door, unseen = layer_shares(cad, NO_DOOR, slam, SCALE)
    assert (floor[10:50, 10:50] == FREE).all()  # with the bed
    assert (floor[10:50, 50:54] == FREE).all()
    assert (unseen[:, 57:] == FREE).all()
    assert not floor[:10].any()  # no floor that the CAD map hasn't
    assert not door.any()
    depth = int(WALL_DEPTH / SCALE)
    assert (wall[10 - depth : 10, 12:48] == FREE).all()
    assert not wall[: 9 - depth].any()


def test_a_floor_of_255_is_no_wall():
    cad, slam = half_explored()
    expected = layer_shares(cad, NO_DOOR, slam, SCALE)
    white = np.where(cad == FREE, 255, cad).astype(np.uint8)
    assert np.array_equal(layer_shares(white, NO_DOOR, slam, SCALE), expected)


@given(seed=st.integers(0, 1000), scale=st.sampled_from([0.03, 0.05, 0.1]))
@settings(max_examples=20, deadline=None)
def test_shares_add_up_to_the_whole(seed, scale):
    rng = np.random.default_rng(seed)
    cad = rng.integers(0, 255, (50, 40)).astype(np.uint8)
    slam = rng.choice([OCCUPIED, UNKNOWN, FREE, FREE, FREE], (50, 40)).astype(np.uint8)
    assert (layer_shares(cad, rng.random(cad.shape) < 0.1, slam, scale).sum(axis=0) == FREE).all()


def test_a_door_is_the_floor_between_its_jambs():
    floor = np.zeros((80, 120), np.bool_)
    floor[10:70, 10:58] = floor[10:70, 62:110] = True
    floor[30:46, 58:62] = True  # an opening of 0.8 m in a wall of 0.2 m
    doors = door_cells(floor, 0.05)
    rows, cols = np.nonzero(doors)
    # Two cells to every side of the line on which the rooms meet, which lies in the opening.
    assert 28 <= rows.min() <= 30
    assert 45 <= rows.max() <= 47
    assert 56 <= cols.min() <= cols.max() <= 63
    assert doors[30:46].any(axis=1).all()
    assert not door_cells(floor[:, :58], 0.05).any()


def test_sizes_are_in_metres():
    _, slam = half_explored()
    large = slam.repeat(2, axis=0).repeat(2, axis=1)
    fine = explored_floor(large, SCALE / 2, 0.5)[::2, ::2]
    assert np.mean(fine == explored_floor(slam, SCALE, 0.5)) > 0.99


@given(seed=st.integers(0, 1000), margin=st.floats(0.0, 1.0))
@settings(max_examples=20, deadline=None)
def test_what_was_seen_is_explored_and_a_longer_margin_explores_more(seed, margin):
    rng = np.random.default_rng(seed)
    slam = np.full((40, 40), UNKNOWN, np.uint8)
    row, col = rng.integers(0, 25, 2)
    slam[row : row + 14, col : col + 12] = FREE
    slam[row : row + 14, col + 12 : col + 13] = OCCUPIED
    near, far = explored_floor(slam, SCALE, margin), explored_floor(slam, SCALE, margin + 0.3)
    assert near[slam == FREE].all()
    assert far[near].all()
    assert far.sum() > near.sum() or near.all()


def test_a_ray_is_explored_but_nothing_follows_from_it():
    _, slam = half_explored()
    before = explored_floor(slam, SCALE / 2, 0.5)
    slam[30, 50:85] = FREE  # 5 cm wide: a beam that left by a window
    after = explored_floor(slam, SCALE / 2, 0.5)
    assert after[30, 50:85].all()
    assert not before[30, 62:85].any()
    off_the_ray = np.arange(60) != 30
    np.testing.assert_array_equal(after[off_the_ray], before[off_the_ray])


@pytest.mark.parametrize("value", [UNKNOWN, OCCUPIED])
def test_without_free_space_or_with_single_cells_nothing_is_explored(value):
    slam = np.full((30, 40), value, np.uint8)
    assert not explored_floor(slam, SCALE, 0.5).any()
    slam[5, 7] = FREE
    assert not explored_floor(slam, SCALE, 0.5).any()
    assert explored_floor(np.full((30, 40), FREE, np.uint8), SCALE, 0.5).all()


def test_training_targets_end_where_the_map_does(monkeypatch):
    monkeypatch.setattr("slamgym.gan.training.sampler.flipped", lambda image, symmetry: image)
    cad, slam = (np.stack([image[:60, :60]]) for image in half_explored())
    slam[0, 30:] = UNKNOWN
    pairs = PairSet(cad, slam, ("a",), ("a",), np.array([SCALE]))
    config = dataclasses.replace(find_preset("slam2cad"), augment=False)
    batch = BatchSampler(pairs, config, np.random.default_rng(0)).draw(1)
    assert np.array_equal(batch.cad[0], layer_shares(cad[0], NO_DOOR, slam[0], SCALE))
    assert batch.other_cad is None
    assert not batch.cad[0, 0, round(30 + EXPLORED_MARGIN / SCALE) + 1 :].any()


@pytest.mark.parametrize("scale", [0.05, float("nan")])
def test_doors_are_learned_where_the_whole_map_has_them(monkeypatch, scale):
    """Also where the robot saw one of the two rooms alone."""
    monkeypatch.setattr("slamgym.gan.training.sampler.flipped", lambda image, symmetry: image)
    cad = np.zeros((120, 120), np.uint8)
    cad[10:70, 10:58] = cad[10:70, 62:110] = cad[30:46, 58:62] = FREE
    slam = np.full_like(cad, UNKNOWN)
    slam[10:70, 10:58] = FREE
    pairs = PairSet(cad[None], slam[None], ("a",), ("a",), np.array([scale]))
    config = dataclasses.replace(find_preset("slam2cad"), augment=False)
    door = BatchSampler(pairs, config, np.random.default_rng(0)).draw(1).cad[0, 2]
    assert (door[30:46] == FREE).any(axis=1).all()
    assert not door[:, :54].any()
    assert not door[:, 66:].any()
