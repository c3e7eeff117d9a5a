import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D, Twist2D
from slamgym.sim import Lidar, LidarConfig, lidar_level

ROOM = np.array(
    [(-2.0, -2.0, 2.0, -2.0), (2.0, -2.0, 2.0, 2.0), (2.0, 2.0, -2.0, 2.0), (-2.0, 2.0, -2.0, -2.0)]
)
ORIGIN = Pose2D(0.0, 0.0, 0.0)


def many_scans(config, number=400, segments=ROOM):
    lidar, rng = Lidar(config), np.random.default_rng(0)
    scans = np.array([lidar.scan(ORIGIN, segments, rng, 0.0).ranges for _ in range(number)])
    return scans.astype(np.float64), lidar.true_ranges(ORIGIN, segments)


class TestGeometry:
    def test_the_default_is_half_a_turn_ahead_with_a_beam_at_either_end(self):
        geometry = LidarConfig().geometry
        assert geometry.angles[[0, -1]] == pytest.approx([-math.pi / 2, math.pi / 2])
        assert (geometry.num_beams, geometry.range_min, geometry.range_max) == (180, 0.12, 3.5)

    def test_a_full_turn_has_no_beam_twice(self):
        angles = LidarConfig(num_beams=360, field_of_view_deg=360.0).geometry.angles
        assert np.diff(angles) == pytest.approx(math.radians(1))
        assert angles[-1] == pytest.approx(math.pi - math.radians(1))

    def test_the_sensor_is_behind_the_axle(self):
        config = lidar_level("exact", LidarConfig(num_beams=181))
        lidar = Lidar(config)
        assert lidar.true_ranges(ORIGIN, ROOM)[90] == pytest.approx(2.064)
        # Facing +y, the mount points to -y.
        assert lidar.true_ranges(Pose2D(0.5, 0.0, math.pi / 2), ROOM)[90] == pytest.approx(2.064)

    @given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-4, 4))
    def test_every_end_point_lies_on_a_wall(self, x, y, theta):
        lidar = Lidar(lidar_level("exact", LidarConfig(mount=(-0.064, 0.02, 0.3), range_max=10.0)))
        ranges = lidar.true_ranges(Pose2D(x, y, theta), ROOM)
        angles = theta + 0.3 + lidar.geometry.angles
        ends_x = x - 0.064 * math.cos(theta) - 0.02 * math.sin(theta) + ranges * np.cos(angles)
        ends_y = y - 0.064 * math.sin(theta) + 0.02 * math.cos(theta) + ranges * np.sin(angles)
        assert np.maximum(abs(ends_x), abs(ends_y)) == pytest.approx(2.0, abs=1e-9)


class TestSweep:
    """A scan that takes 0.2 s, of a full turn from behind over the right to behind again."""

    SWEEP = lidar_level(
        "exact",
        LidarConfig(num_beams=360, field_of_view_deg=360.0, mount=(0.0, 0.0, 0.0), sweep=0.2),
    )

    def test_a_robot_that_stands_has_the_snapshot(self):
        moved, still = Lidar(self.SWEEP), Lidar(replace(self.SWEEP, sweep=0.0))
        ranges = moved.look(ORIGIN, ROOM, Twist2D(0.0, 0.0)).ranges
        assert np.array_equal(ranges, still.look(ORIGIN, ROOM, Twist2D(0.2, 1.8)).ranges)

    @pytest.mark.parametrize("rate", [1.8, -1.8])
    def test_turning_skews_the_scan_by_what_was_turned_since_each_beam(self, rate):
        lidar = Lidar(self.SWEEP)
        ranges = lidar.look(ORIGIN, ROOM, Twist2D(0.0, rate)).ranges
        age = 0.2 * (1.0 - np.arange(360) / 359)
        angles = lidar.geometry.angles - rate * age
        expected = 2.0 / np.maximum(abs(np.cos(angles)), abs(np.sin(angles)))
        # What is seen follows from a pose for each part of the sweep, which matters within a degree of the corners.
        errors = abs(ranges - expected)
        corners = abs(np.sin(2.0 * angles)) > math.cos(math.radians(2.0))
        assert errors[~corners].max() < 1e-3
        assert errors.max() < 0.1
        snapshot = 2.0 / np.maximum(
            abs(np.cos(lidar.geometry.angles)), abs(np.sin(lidar.geometry.angles))
        )
        assert abs(ranges - snapshot)[:90].max() > 0.4

    def test_driving_moves_the_first_beams_back(self):
        lidar = Lidar(self.SWEEP)
        ranges = lidar.look(ORIGIN, ROOM, Twist2D(0.25, 0.0)).ranges
        # The first beam looks back 0.2 s ago, 0.05 m nearer to the wall behind; beam 180 ahead, half of that.
        assert ranges[[0, 180]] == pytest.approx([2.0 - 0.05, 2.0 + 0.025], abs=0.001)

    def test_it_fits_between_two_scans(self):
        with pytest.raises(
            ConfigError, match=r"lidar\.sweep must not exceed the time between scans"
        ):
            LidarConfig(sweep=0.3)

    @pytest.mark.parametrize(
        ("view", "rate", "seconds"), [(180.0, 5.0, 0.1), (360.0, 5.0, 0.2), (180.0, 20.0, 0.025)]
    )
    def test_by_default_it_is_the_mirrors_turn(self, view, rate, seconds):
        laser = LidarConfig(num_beams=720, field_of_view_deg=view, rate=rate)
        assert laser.geometry.scan_time == pytest.approx(seconds, rel=0.002)

    def test_the_levels_of_simulators_measure_at_once_unless_told_otherwise(self):
        told = LidarConfig(sweep=0.05)
        for level, seconds in {"exact": 0.0, "gazebo": 0.0, "lds01": 0.1, "real": 0.1}.items():
            assert lidar_level(level).scan_time == pytest.approx(seconds)
            assert lidar_level(level, told).scan_time == 0.05


class TestErrors:
    def test_without_noise_ranges_are_exact(self):
        scans, true = many_scans(lidar_level("exact"), 3)
        assert np.array_equal(scans, np.tile(true.astype(np.float32), (3, 1)))

    def test_noise_lies_along_the_beam_with_the_sigma_that_was_asked_for(self):
        scans, true = many_scans(lidar_level("gazebo"))
        errors = scans - true
        # 72,000 draws: the mean within 5 sigma / sqrt(n), sigma within 5 / sqrt(2 n) of itself.
        assert abs(errors.mean()) < 5 * 0.01 / math.sqrt(errors.size)
        assert errors.std() == pytest.approx(0.01, rel=5 / math.sqrt(2 * errors.size))
        # Beams don't share their noise.
        correlation = np.corrcoef(errors[:, 0], errors[:, 1])[0, 1]
        assert abs(correlation) < 5 / math.sqrt(len(errors))

    def test_the_data_sheet_noise_grows_with_the_range(self):
        near = np.array([(0.2 - 0.064, -9.0, 0.2 - 0.064, 9.0)])
        far = near + np.array([2.8, 0.0, 2.8, 0.0])
        for walls, sigma in ((near, 0.0033), (far, 0.035)):
            scans, true = many_scans(lidar_level("lds01"), 4000, walls)
            assert true[90] == pytest.approx(walls[0, 0] + 0.064, rel=1e-3)
            # 4,000 draws: 5 standard errors of a standard deviation are 5.6 %.
            assert scans[:, 90].std() == pytest.approx(sigma, rel=0.06)

    def test_the_constant_part_of_the_error_belongs_to_the_place(self):
        wall = np.array([(2.0, -9.0, 2.0, 9.0)])
        scans, true = many_scans(lidar_level("lds01"), 2000, wall)
        constant = scans.mean(axis=0)[60:120] - true[60:120]
        sigma = 0.035 / 3 * true[60:120]
        # Far more than the mean of 2,000 draws leaves, no more than 2.6 times the noise, and alike for neighbours.
        assert constant.std() > 5 * sigma.max() / math.sqrt(2000)
        assert (np.abs(constant) < 2.7 * sigma + 0.005).all()
        assert np.abs(np.diff(constant)).max() < 0.5 * sigma.max()

    def test_beams_fail_by_themselves_in_their_shares(self):
        config = replace(lidar_level("exact"), lost=0.15, stray=0.05)
        scans, true = many_scans(config, 200)
        number = scans.size
        for mask, share in (
            (np.isinf(scans), 0.15),
            (np.isfinite(scans) & (scans < true - 1e-6), 0.05),
        ):
            assert mask.mean() == pytest.approx(
                share, abs=0.003 + 5 * math.sqrt(share * (1 - share) / number)
            )

    def test_a_burst_is_short_and_in_one_piece(self):
        scans, true = many_scans(replace(lidar_level("exact"), bursts=1.0), 100)
        short = scans < true - 1e-6
        lengths = short.sum(axis=1)
        assert lengths.max() <= 12
        assert (lengths > 0).mean() > 0.3  # many are beyond the wall and go unnoticed
        first, last = short.argmax(axis=1), 179 - short[:, ::-1].argmax(axis=1)
        assert (last - first < 12)[lengths > 0].all()

    def test_without_errors_no_range_exceeds_the_nearest_wall(self):
        rng = np.random.default_rng(0)
        more = np.vstack([ROOM, rng.uniform(-2, 2, (5, 4))])
        lidar = Lidar(lidar_level("exact"))
        fewer_walls = lidar.scan(ORIGIN, ROOM, rng, 0.0).ranges
        assert (lidar.scan(ORIGIN, more, rng, 0.0).ranges <= fewer_walls).all()

    def test_out_of_range_readings_follow_rep_117(self):
        lidar = Lidar(lidar_level("exact", LidarConfig(num_beams=181)))
        assert (
            lidar.scan(Pose2D(1.96 + 0.064, 0.0, 0.0), ROOM, np.random.default_rng(0), 0.0).ranges[
                90
            ]
            == -np.inf
        )
        far = ROOM * 2.0
        assert lidar.scan(ORIGIN, far, np.random.default_rng(0), 0.0).ranges[90] == np.inf

    def test_the_same_generator_gives_the_same_scan(self):
        lidar = Lidar(lidar_level("real"))
        one, other = (lidar.scan(ORIGIN, ROOM, np.random.default_rng(7), 1.5) for _ in range(2))
        assert one.ranges.dtype == np.float32
        assert one.stamp == 1.5
        assert one.ranges.tobytes() == other.ranges.tobytes()


def test_levels_keep_the_geometry_and_differ_in_their_errors():
    wide = LidarConfig(num_beams=360, field_of_view_deg=360.0)
    levels = [lidar_level(name, wide) for name in ("exact", "gazebo", "lds01", "real")]
    assert all(level.geometry.taking(0.0) == wide.geometry.taking(0.0) for level in levels)
    assert len(set(levels)) == 4


def test_an_unknown_level_suggests_the_nearest():
    with pytest.raises(ConfigError, match="did you mean 'gazebo'"):
        lidar_level("gazeboo")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("num_beams", {"num_beams": 1}),
        ("field_of_view", {"field_of_view_deg": 400.0}),
        ("range_min", {"range_min": 4.0}),
        ("rate", {"rate": 0.0}),
        ("sigma", {"sigma": -1.0}),
        ("lost", {"lost": 0.7, "stray": 0.6}),
        ("attenuation", {"attenuation": -1.0}),
    ],
)
def test_senseless_settings_are_refused_by_name(name, values):
    with pytest.raises(ConfigError, match=name):
        LidarConfig(**values)
