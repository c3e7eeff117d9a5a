import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D
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
        config = replace(lidar_level("lds01"), z_hit=1.0, z_short=0.0, z_max=0.0, z_rand=0.0)
        near = np.array([(0.4 - 0.064, -9.0, 0.4 - 0.064, 9.0)])
        far = near + np.array([2.6, 0.0, 2.6, 0.0])
        for walls, sigma in ((near, 0.005), (far, 0.035)):
            scans, true = many_scans(config, 4000, walls)
            assert true[90] == pytest.approx(walls[0, 0] + 0.064, rel=1e-3)
            # 4,000 draws: 5 standard errors of a standard deviation are 5.6 %.
            assert (scans[:, 90] - true[90]).std() == pytest.approx(sigma, rel=0.06)

    def test_beams_fail_in_their_shares(self):
        config = LidarConfig(sigma=0.0, z_hit=0.6, z_short=0.2, z_max=0.15, z_rand=0.05, range_min=0.0)
        scans, true = many_scans(config)
        exact = np.isclose(scans, true, atol=1e-6)
        number = scans.size

        def share(mask, expected):
            assert mask.mean() == pytest.approx(
                expected, abs=5 * math.sqrt(expected * (1 - expected) / number)
            )

        share(exact, 0.6)
        share(np.isinf(scans), 0.15)
        further = ~exact & np.isfinite(scans) & (scans > true)
        share(further, 0.05 * float(np.mean(1.0 - true / 3.5)))
        share(~exact & (scans < true), 0.2 + 0.05 * float(np.mean(true / 3.5)))

    def test_short_readings_are_exponential_up_to_the_wall(self):
        config = LidarConfig(
            sigma=0.0, z_hit=0.0, z_short=1.0, z_max=0.0, z_rand=0.0, range_min=0.0, lambda_short=2.0
        )
        scans, true = many_scans(config)
        assert (scans <= true + 1e-6).all()
        # Mean of an exponential cut off at z: 1/l - z e^(-l z) / (1 - e^(-l z)).
        expected = 0.5 - true * np.exp(-2 * true) / (1 - np.exp(-2 * true))
        assert scans.mean() == pytest.approx(expected.mean(), abs=5 * 0.5 / math.sqrt(scans.size))

    def test_without_errors_no_range_exceeds_the_nearest_wall(self):
        rng = np.random.default_rng(0)
        more = np.vstack([ROOM, rng.uniform(-2, 2, (5, 4))])
        lidar = Lidar(lidar_level("exact"))
        fewer_walls = lidar.scan(ORIGIN, ROOM, rng, 0.0).ranges
        assert (lidar.scan(ORIGIN, more, rng, 0.0).ranges <= fewer_walls).all()

    def test_out_of_range_readings_follow_rep_117(self):
        lidar = Lidar(lidar_level("exact", LidarConfig(num_beams=181)))
        assert (
            lidar.scan(Pose2D(1.96 + 0.064, 0.0, 0.0), ROOM, np.random.default_rng(0), 0.0).ranges[90]
            == -np.inf
        )
        far = ROOM * 2.0
        assert lidar.scan(ORIGIN, far, np.random.default_rng(0), 0.0).ranges[90] == np.inf

    def test_the_same_generator_gives_the_same_scan(self):
        lidar = Lidar(lidar_level("lds01"))
        one, other = (lidar.scan(ORIGIN, ROOM, np.random.default_rng(7), 1.5) for _ in range(2))
        assert one.ranges.dtype == np.float32
        assert one.stamp == 1.5
        assert one.ranges.tobytes() == other.ranges.tobytes()


def test_levels_keep_the_geometry_and_differ_in_their_errors():
    wide = LidarConfig(num_beams=360, field_of_view_deg=360.0)
    levels = [lidar_level(name, wide) for name in ("exact", "gazebo", "lds01")]
    assert all(level.geometry == wide.geometry for level in levels)
    assert len(set(levels)) == 3


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
        ("z_hit", {"z_hit": 0.5}),
    ],
)
def test_senseless_settings_are_refused_by_name(name, values):
    with pytest.raises(ConfigError, match=name):
        LidarConfig(**values)
