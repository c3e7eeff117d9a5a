"""Changes to pairs, and the direction of walls."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.gan.training import augmentation
from slamgym.gan.training.augmentation import augment
from slamgym.metrics.wall_direction import (
    NO_DIRECTION,
    find_wall_direction,
    flipped,
    padded_for_turning,
    turned,
)


def test_the_eight_flips_differ():
    image = np.arange(9).reshape(3, 3)
    assert len({flipped(image, symmetry).tobytes() for symmetry in range(8)}) == 8


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40)
def test_damaged_maps_keep_their_three_values_and_targets_are_not_damaged(seed):
    cad = np.full((48, 48), OCCUPIED, np.uint8)
    cad[8:40, 8:40] = FREE
    slam = np.where(cad == FREE, FREE, UNKNOWN).astype(np.uint8)
    slam[7, 8:40] = OCCUPIED
    before = slam.copy()
    new_cad, new_slam = augment(cad, slam, 48, np.random.default_rng(seed))
    assert np.array_equal(slam, before)
    assert set(np.unique(new_slam)) <= {OCCUPIED, UNKNOWN, FREE}
    assert new_cad.shape == new_slam.shape == (48, 48)
    # Motion alone changes the floor's area: by the square of at most 1.2.
    assert 0.65 * (cad == FREE).sum() < (new_cad > 127).sum() < 1.5 * (cad == FREE).sum()


@pytest.fixture
def undamaged(monkeypatch):
    monkeypatch.setattr(augmentation, "DAMAGE_PROBABILITY", 0.0)
    monkeypatch.setattr(augmentation, "TURN_DEG", 0.0)


def test_without_damage_the_slam_map_moves_as_the_cad_map_does(undamaged):
    image = np.full((32, 32), UNKNOWN, np.uint8)
    image[5:20, 8:27] = FREE
    for seed in range(10):
        cad, slam = augment(image, image, 32, np.random.default_rng(seed))
        # Interpolated against nearest cell, and filled unlike each other beyond: borders only.
        assert np.mean((cad > 230) != (slam > 230)) < 0.08


def test_half_of_the_samples_stay_on_their_grid(undamaged):
    image = np.full((48, 48), UNKNOWN, np.uint8)
    image[8:40, 8:40] = FREE
    image[20, 8:30] = OCCUPIED  # a wall of one pixel
    as_they_were = [
        np.array_equal(augment(image, image, 48, np.random.default_rng(seed))[1], image)
        for seed in range(40)
    ]
    assert 10 < sum(as_they_were) < 30


DAMAGES = ("_doubled", "_with_gaps", "_forgotten", "_cut_off", "_speckled", "_coarsened")


@pytest.mark.parametrize("damage", DAMAGES)
def test_each_kind_of_damage_does_something(damage):
    slam = np.full((64, 64), FREE, np.uint8)
    slam[::4, ::9] = OCCUPIED
    slam[40:, 40:] = UNKNOWN
    before = slam.copy()
    damaged = [
        getattr(augmentation, damage)(slam, np.random.default_rng(seed)) for seed in range(20)
    ]
    assert sum(not np.array_equal(each, slam) for each in damaged) > 10
    assert all(
        set(np.unique(each)) <= {OCCUPIED, UNKNOWN, FREE} and each.dtype == np.uint8
        for each in damaged
    )
    assert np.array_equal(slam, before)


def test_salt_noise_has_the_amount_that_training_was_tuned_with():
    floor = np.full((96, 96), FREE, np.uint8)
    changed = [
        np.mean(augmentation._speckled(floor, np.random.default_rng(seed)) != floor)
        for seed in range(400)
    ]
    # A share of the pixels, up to 0.4 %, is drawn anew, and every fourth of them gets the value that it had.
    assert max(changed) <= 0.004
    # The share is uniform: the mean of 400 has a standard deviation of 3 %.
    assert np.mean(changed) == pytest.approx(0.75 * 0.002, rel=0.12)


def turned_building(angle_deg, noise=0.0):
    """A building of two rooms, 200 px, turned counter-clockwise."""
    image = np.full((256, 256), UNKNOWN, np.uint8)
    for x0, y0, x1, y1 in ((70, 80, 150, 170), (158, 80, 190, 140)):
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], np.float64) - 127.5
        angle = np.radians(angle_deg)
        # Rows grow downwards, so counter-clockwise on the screen is this:
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        outline = np.rint(corners @ turn.T + 127.5).astype(np.int32)
        cv2.fillPoly(image, [outline], FREE)
        cv2.polylines(image, [outline], True, OCCUPIED, 2)
    image[np.random.default_rng(0).random(image.shape) < noise] = OCCUPIED
    return image


@pytest.mark.parametrize("angle", [-40.0, -13.0, -2.5, 0.0, 1.5, 7.0, 30.0, 44.0])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_the_direction_of_walls_is_found(angle, noise):
    # Corners are rounded to whole pixels: at most atan(1 / 80) = 0.7 degrees along the shorter walls.
    assert find_wall_direction(turned_building(angle, noise)).angle_deg == pytest.approx(
        angle, abs=0.8
    )


def test_a_map_without_walls_has_no_direction():
    assert find_wall_direction(np.full((32, 32), UNKNOWN, np.uint8)) == NO_DIRECTION


def test_turning_back_straightens_the_walls():
    straight = turned(turned_building(20.0), -find_wall_direction(turned_building(20.0)).angle_deg)
    assert find_wall_direction(straight).angle_deg == pytest.approx(0.0, abs=0.8)


@pytest.mark.parametrize("angle", [10.0, 45.0, 90.0])
def test_padding_keeps_all_corners(angle):
    image = np.full((20, 50), FREE, np.uint8)
    padded = padded_for_turning(image, angle)
    kept = (turned(padded, angle) == FREE).sum()
    assert kept == pytest.approx(image.size, rel=0.03)  # nearest cells along the borders


class TestWindows:
    def pair(self, side=300):
        slam = np.full((side, side), UNKNOWN, np.uint8)
        slam[180:260, 40:140] = FREE
        return np.where(slam == FREE, FREE, OCCUPIED).astype(np.uint8), slam

    @pytest.mark.parametrize("rotated", [0.0, 1.0])
    def test_a_window_keeps_its_scale_and_shows_some_of_the_map(
        self, monkeypatch, undamaged, rotated
    ):
        monkeypatch.setattr(augmentation, "ROTATED", rotated)
        for seed in range(10):
            cad, slam = augment(*self.pair(), 128, np.random.default_rng(seed))
            assert cad.shape == slam.shape == (128, 128)
            assert (slam == FREE).sum() > 400
            # Turned or not, what is floor in one is floor in the other, but for the cells at its borders.
            assert np.mean((slam == FREE) != (cad > 127)) < 0.02

    def test_a_turned_sample_is_turned(self, monkeypatch, undamaged):
        monkeypatch.setattr(augmentation, "ROTATED", 1.0)
        monkeypatch.setattr(augmentation, "RESAMPLED", 1.0)
        turned_share = [
            len(np.unique(augment(*self.pair(), 256, np.random.default_rng(seed))[0])) > 2
            for seed in range(5)
        ]
        assert all(turned_share)  # greys along oblique borders
