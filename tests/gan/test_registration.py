"""Pairs are laid over each other before anything is learnt."""

import cv2
import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.gan import registration
from slamgym.gan.data import PairSet
from slamgym.gan.registration import moved, nearest_motion, registered
from slamgym.metrics.alignment import IDENTITY, Similarity

SIDE = 64


def drawn_pair():
    cad = np.zeros((SIDE, SIDE), np.uint8)
    cad[12:50, 10:34] = FREE
    cad[12:30, 34:54] = FREE
    slam = np.where(cad == FREE, FREE, UNKNOWN).astype(np.uint8)
    faces = cv2.dilate((cad == FREE).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    slam[faces & (cad != FREE)] = OCCUPIED
    return cad, slam


def pairs_off_by(similarity, count=2):
    cad, slam = drawn_pair()
    off = moved(slam, similarity)
    names = tuple(str(i) for i in range(count))
    return PairSet(
        np.stack([cad] * count), np.stack([off] * count), names, names, np.full(count, 0.1)
    )


def error(pairs):
    return np.mean((pairs.slam == FREE) != (pairs.cad == FREE))


def test_what_drift_did_to_the_whole_map_is_undone():
    pairs = pairs_off_by(Similarity(0.05, -0.03, 0.06, 0.0))
    better = registered(pairs)
    # Nearest cells, moved twice: borders are off by a cell at most.
    assert error(better) < 0.02 < 0.25 * error(pairs)
    assert np.array_equal(better.cad, pairs.cad)
    assert set(np.unique(better.slam)) == {OCCUPIED, UNKNOWN, FREE}
    assert (better.slam == OCCUPIED).sum() > 0.7 * (pairs.slam == OCCUPIED).sum()


def test_a_pair_that_lies_right_is_left_as_it_is():
    cad, slam = drawn_pair()
    assert nearest_motion(slam, cad) == IDENTITY
    assert moved(slam, IDENTITY) is slam


def test_the_motion_is_rigid():
    """Rooms that are a cell narrower than true ones stay so: that is for the network to learn."""
    cad, slam = drawn_pair()
    narrow = cv2.erode((slam == FREE).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    slam[(slam == FREE) & ~narrow] = OCCUPIED
    assert nearest_motion(slam, cad).log_scale == 0.0
    slam[30:] = UNKNOWN
    assert nearest_motion(slam, cad).log_scale == 0.0


@pytest.mark.parametrize("value", [UNKNOWN, OCCUPIED, FREE])
def test_maps_without_a_border_are_left_as_they_are(value):
    cad, _ = drawn_pair()
    pairs = PairSet(
        cad[None], np.full((1, SIDE, SIDE), value, np.uint8), ("a",), ("a",), np.array([0.1])
    )
    result = registered(pairs).slam
    assert set(np.unique(result)) <= {value, UNKNOWN}


def test_similarities_are_kept_and_those_of_other_pairs_are_not_used(tmp_path, monkeypatch):
    file = tmp_path / "run" / "registration.safetensors"
    pairs = pairs_off_by(Similarity(0.05, -0.03, 0.06, 0.0))
    first = registered(pairs, file, "one")
    search = registration.nearest_motion
    monkeypatch.setattr(registration, "nearest_motion", lambda *_: pytest.fail("searched again"))
    assert np.array_equal(registered(pairs, file, "one").slam, first.slam)
    monkeypatch.setattr(registration, "nearest_motion", search)
    others = pairs_off_by(Similarity(-0.04, 0.02, 0.0, 0.0), count=3)
    assert error(registered(others, file, "two")) < 0.01
    file.write_bytes(b"damaged")
    assert np.array_equal(registered(pairs, file, "one").slam, first.slam)
