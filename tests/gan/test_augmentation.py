"""Changes to pairs, and the direction of walls."""

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.gan.config import AugmentConfig
from slamgym.gan.training import sampler
from slamgym.gan.training.sampler import augment
from slamgym.metrics.wall_direction import (
    NO_DIRECTION,
    find_wall_direction,
    flipped,
    padded_for_turning,
    turned,
    unflipped,
)

EVERYTHING = AugmentConfig(real_maps=True)


@pytest.fixture
def unflipped_samples(monkeypatch):
    monkeypatch.setattr(sampler, "flipped", lambda image, symmetry: image)


@pytest.fixture
def never_resampled(monkeypatch):
    monkeypatch.setattr(sampler, "RESAMPLED", 0.0)


@pytest.mark.parametrize("symmetry", range(8))
def test_flips_are_undone(symmetry):
    image = np.arange(12).reshape(3, 4)
    assert np.array_equal(unflipped(flipped(image, symmetry), symmetry), image)


def test_the_eight_flips_differ():
    image = np.arange(9).reshape(3, 3)
    assert len({flipped(image, symmetry).tobytes() for symmetry in range(8)}) == 8


def test_flips_are_the_same_for_both_images():
    image = np.arange(256, dtype=np.uint8).reshape(16, 16)
    for seed in range(20):
        cad, slam = augment(image, image, AugmentConfig(), np.random.default_rng(seed))
        assert np.array_equal(cad, slam)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40)
def test_damaged_maps_keep_their_three_values_and_targets_are_not_damaged(seed):
    cad = np.full((48, 48), OCCUPIED, np.uint8)
    cad[8:40, 8:40] = FREE
    slam = np.where(cad == FREE, FREE, UNKNOWN).astype(np.uint8)
    slam[7, 8:40] = OCCUPIED
    before = slam.copy()
    new_cad, new_slam = augment(cad, slam, EVERYTHING, np.random.default_rng(seed))
    assert np.array_equal(slam, before)
    assert set(np.unique(new_slam)) <= {OCCUPIED, UNKNOWN, FREE}
    assert new_cad.shape == new_slam.shape == (48, 48)
    # Motion alone changes the floor's area: by the square of at most 1.2, less what is shifted out.
    assert 0.55 * (cad == FREE).sum() < (new_cad > 127).sum() < 1.5 * (cad == FREE).sum()


def test_without_damage_the_slam_map_moves_as_the_cad_map_does():
    image = np.full((32, 32), UNKNOWN, np.uint8)
    image[5:20, 8:27] = FREE
    for seed in range(10):
        rng = np.random.default_rng(seed)
        cad, slam = augment(image, image, EVERYTHING, rng, damage=False)
        assert np.mean((cad > 230) != (slam > 230)) < 0.08  # interpolated against nearest cell: borders only


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_not_resampled_moves_by_whole_pixels(unflipped_samples, never_resampled, seed):
    cad = np.full((48, 48), OCCUPIED, np.uint8)
    cad[8:40, 8:40] = FREE
    cad[20, 8:30] = OCCUPIED  # a wall of one pixel
    new_cad, new_slam = augment(cad, cad, EVERYTHING, np.random.default_rng(seed), damage=False)
    assert np.array_equal(new_cad[5:-5, 5:-5], new_slam[5:-5, 5:-5])  # filled unlike each other beyond
    shifts = [np.roll(cad, (r, c), (0, 1)) for r in range(-5, 6) for c in range(-5, 6)]
    assert any(np.array_equal(new_cad, shifted) for shifted in shifts)


AMOUNTS = ("TURN_DEG", "WOBBLE_PX", "WALL_DROPOUT", "UNKNOWN_BLOBS", "SALT_NOISE", "OCCLUSION")


@pytest.mark.parametrize("kind", AMOUNTS)
def test_each_kind_of_damage_does_something(unflipped_samples, monkeypatch, kind):
    for other in {*AMOUNTS, "ZOOM", "SHIFT"} - {kind}:
        monkeypatch.setattr(sampler, other, 0.0)
    slam = np.full((64, 64), FREE, np.uint8)
    slam[::4, ::9] = OCCUPIED
    changed = [
        not np.array_equal(augment(slam, slam, EVERYTHING, np.random.default_rng(s))[1], slam)
        for s in range(60)
    ]
    assert any(changed)
    monkeypatch.setattr(sampler, kind, 0.0)
    _, same = augment(slam, slam, EVERYTHING, np.random.default_rng(0))
    assert np.array_equal(same, slam)


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
    assert find_wall_direction(turned_building(angle, noise)).angle_deg == pytest.approx(angle, abs=0.8)


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
    def test_a_window_keeps_its_scale_and_shows_some_of_the_map(self, monkeypatch, rotated):
        monkeypatch.setattr(sampler, "ROTATED", rotated)
        config = AugmentConfig(windows=True)
        for seed in range(10):
            cad, slam = augment(*self.pair(), config, np.random.default_rng(seed), side=128)
            assert cad.shape == slam.shape == (128, 128)
            assert (slam == FREE).sum() > 500
            # Turned or not, what is floor in one is floor in the other, but for the cells at its borders.
            assert np.mean((slam == FREE) != (cad > 127)) < 0.02

    def test_a_turned_sample_is_turned(self, monkeypatch):
        monkeypatch.setattr(sampler, "ROTATED", 1.0)
        config = AugmentConfig(windows=True)
        turned_share = [
            len(np.unique(augment(*self.pair(), config, np.random.default_rng(seed), side=256)[0])) > 2
            for seed in range(5)
        ]
        assert all(turned_share)  # greys along oblique borders
