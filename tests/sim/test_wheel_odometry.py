import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D, Twist2D
from slamgym.sim import (
    Motion,
    OdometryConfig,
    OdometryLevel,
    RobotConfig,
    WheelOdometry,
    World,
    name_of_odometry,
    odometry_level,
)

ROBOT = RobotConfig()
ORIGIN = Pose2D(0.0, 0.0, 0.0)
FLAWLESS = OdometryConfig(
    ticks_per_revolution=0,
    diameter_ratio_std=0.0,
    wheelbase_ratio_std=0.0,
    scale_std=0.0,
    slip_distance=0.0,
    slip_drift=0.0,
    slip_turn=0.0,
)


def rolled(left, right):
    """A motion of which only the wheels matter."""
    return Motion(ORIGIN, ORIGIN, (left, right), False, 0.0)


def straight(way):
    return rolled(way, way)


def turn(angle):
    half = 0.5 * ROBOT.wheel_separation * angle
    return rolled(-half, half)


class Flaws:
    """Draws the systematic errors of one robot, as they are given."""

    def __init__(self, diameter_ratio=1.0, wheelbase_ratio=1.0, scale=1.0):
        self._errors = np.array([diameter_ratio, wheelbase_ratio, scale]) - 1.0

    def standard_normal(self, count):
        assert count == 3
        return self._errors


def follow_with(flaws, motions):
    """Where a robot with these systematic errors, and no others, believes to be."""
    config = replace(FLAWLESS, diameter_ratio_std=1.0, wheelbase_ratio_std=1.0, scale_std=1.0)
    odometry = WheelOdometry(config, ROBOT, flaws)
    for motion in motions:
        odometry.update(motion, np.random.default_rng(0))
    return odometry.pose


def follow(config, motions, seed=0):
    rng = np.random.default_rng(seed)
    odometry = WheelOdometry(config, ROBOT, rng)
    for motion in motions:
        odometry.update(motion, rng)
    return odometry.pose


def square(side=4.0, direction=1.0):
    return [
        step
        for _ in range(4)
        for step in ([straight(0.05)] * round(side / 0.05) + [turn(direction * math.pi / 2)])
    ]


class TestSystematicErrors:
    def test_a_flawless_robot_returns_from_a_square(self):
        assert follow(FLAWLESS, square()) == pytest.approx(ORIGIN, abs=1e-9)

    def test_encoder_ticks_cost_less_than_a_millimetre_over_a_square(self):
        pose = follow(replace(FLAWLESS, ticks_per_revolution=4096), square())
        # A tick is 0.05 mm, and its heading error 0.05 / 287 rad acts over at most 16 m.
        assert math.hypot(pose.x, pose.y) < 16.0 * 4 * 0.0000506 / 0.287
        assert pose != ORIGIN

    @given(st.floats(0.97, 1.03), st.floats(-6, 6))
    def test_turning_on_the_spot_does_not_depend_on_unequal_wheels(self, ratio, angle):
        pose = follow_with(Flaws(diameter_ratio=ratio), [turn(angle)])
        # The mean of (E + 1) / 2 and (1 / E + 1) / 2 differs from 1 in second order only.
        error = abs(math.remainder(pose.theta - angle, 2 * math.pi))
        assert error <= 0.26 * (ratio - 1) ** 2 * abs(angle) + 1e-9

    @given(st.floats(0.95, 1.05), st.floats(-3, 3))
    def test_driving_straight_does_not_depend_on_the_wheel_base(self, ratio, way):
        assert follow_with(Flaws(wheelbase_ratio=ratio), [straight(way)]) == pytest.approx(
            (way, 0, 0)
        )

    def test_a_longer_wheel_base_than_believed_makes_turns_look_larger(self):
        # E_b = actual / nominal; the odometry divides by the nominal base.
        pose = follow_with(Flaws(wheelbase_ratio=1.02), [turn(1.0)])
        assert pose.theta == pytest.approx(1.02)

    def test_a_larger_right_wheel_makes_a_straight_way_look_like_a_right_bend(self):
        # It turns less often for the same distance, so odometry believes that the right side went less far.
        pose = follow_with(Flaws(diameter_ratio=1.01), [straight(0.01)] * 100)
        assert pose.theta == pytest.approx(
            -0.01 / 0.287, rel=0.01
        )  # (E_d - 1) / b per metre, to first order

    def test_the_two_directions_separate_the_errors(self):
        # UMBmark: E_b shows as a heading error of opposite sign in the two directions, E_d of the same sign.
        by_base = [
            follow_with(Flaws(wheelbase_ratio=1.005), square(direction=d)).theta for d in (1, -1)
        ]
        by_wheels = [
            follow_with(Flaws(diameter_ratio=1.0005), square(direction=d)).theta for d in (1, -1)
        ]
        assert by_base[0] == pytest.approx(-by_base[1])
        assert by_base[0] == pytest.approx(0.005 * 2 * math.pi)
        assert by_wheels[0] == pytest.approx(by_wheels[1], rel=0.01)

    def test_scale_stretches_the_distance(self):
        assert follow_with(Flaws(scale=1.03), [straight(2.0)]).x == pytest.approx(2.06)

    def test_each_robot_draws_its_own_errors_with_the_configured_spread(self):
        config = OdometryConfig(diameter_ratio_std=0.002, wheelbase_ratio_std=0.02, scale_std=0.01)
        rng = np.random.default_rng(0)
        robots = [WheelOdometry(config, ROBOT, rng) for _ in range(2000)]
        drawn = np.array([(r.diameter_ratio, r.wheelbase_ratio, r.scale) for r in robots])
        # 2,000 draws: five standard errors of a standard deviation are 8 %.
        assert drawn.std(axis=0) == pytest.approx([0.002, 0.02, 0.01], rel=0.08)
        assert drawn.mean(axis=0) == pytest.approx(1.0, abs=5 * 0.02 / math.sqrt(2000))


class TestRandomSlip:
    def test_it_grows_with_the_root_of_way_and_turn_whatever_the_step(self):
        config = replace(FLAWLESS, slip_distance=0.02, slip_turn=0.03)
        for steps in (1, 20):
            ways = [follow(config, [straight(4.0 / steps)] * steps, seed).x for seed in range(1500)]
            turns = [
                follow(config, [turn(2.0 / steps)] * steps, seed).theta for seed in range(1500)
            ]
            # 1,500 draws: five standard errors of a standard deviation are 9 %.
            assert np.std(ways) == pytest.approx(0.02 * math.sqrt(4.0), rel=0.09)
            assert np.std(turns) == pytest.approx(0.03 * math.sqrt(2.0), rel=0.09)

    def test_a_straight_way_bends_at_random(self):
        config = replace(FLAWLESS, slip_drift=0.01)
        headings = [follow(config, [straight(0.5)] * 8, seed).theta for seed in range(1500)]
        assert np.std(headings) == pytest.approx(0.01 * math.sqrt(4.0), rel=0.09)
        assert abs(np.mean(headings)) < 5 * 0.02 / math.sqrt(1500)

    def test_a_standing_robot_stays_where_it_is(self):
        assert follow(odometry_level("high"), [straight(0.0)] * 100) == ORIGIN


class TestLevels:
    def test_ideal_follows_the_body_through_contact(self):
        world, ideal, wheel = _press_on_a_wall()
        assert ideal == pytest.approx(world.pose, abs=1e-9)
        # Real wheels spun on for most of the distance.
        assert wheel.x > world.pose.x + 0.5

    def test_medium_lies_between_low_and_high_in_every_error(self):
        low, medium, high = (odometry_level(name) for name in ("low", "medium", "high"))
        for name in (
            "diameter_ratio_std",
            "wheelbase_ratio_std",
            "scale_std",
            "slip_distance",
            "slip_drift",
            "slip_turn",
        ):
            assert getattr(low, name) < getattr(medium, name) < getattr(high, name)
        assert medium == OdometryConfig()

    @pytest.mark.parametrize(
        ("level", "way", "heading_deg", "turned"),
        [
            # Low: OptiOdom, alpha_Eb 0.98 deg rms over a turn of 90 deg, drift 0.23 deg/m rms.
            ("low", (0.001, 0.004), (0.2, 0.6), (0.005, 0.02)),
            # High: six public logs, distance 2.6-5.4 %, heading 0.5-1.8 deg/m, turns 3.5-13 %.
            ("high", (0.026, 0.054), (0.5, 1.8), (0.035, 0.13)),
        ],
    )
    def test_errors_have_the_measured_size(self, level, way, heading_deg, turned):
        config = odometry_level(level)
        metres = np.array([follow(config, [straight(0.05)] * 20, seed) for seed in range(800)])
        turns = np.array([follow(config, [turn(0.05)] * 20, seed).theta for seed in range(800)])
        assert way[0] < np.std(metres[:, 0]) < way[1]
        assert heading_deg[0] < np.degrees(np.std(metres[:, 2])) < heading_deg[1]
        assert turned[0] < np.std(turns) < turned[1]

    def test_an_unknown_level_suggests_the_nearest(self):
        with pytest.raises(ConfigError, match="did you mean 'medium'"):
            odometry_level("medum")


def test_it_integrates_what_the_wheels_rolled_along_any_path():
    world = World(FloorPlan("hall", shapely.box(0, 0, 20, 20)), ROBOT)
    world.reset(Pose2D(10.0, 10.0, 0.4))
    rng = np.random.default_rng(0)
    odometry = WheelOdometry(FLAWLESS, ROBOT, rng)
    odometry.reset(world.pose)
    for _ in range(100):
        odometry.update(world.step(Twist2D(*rng.uniform(-1, 1, 2)), 0.2), rng)
    # One arc a step stands for a step whose velocity may ramp: at most a millimetre each.
    assert math.dist(odometry.pose[:2], world.pose[:2]) < 0.1
    assert math.remainder(odometry.pose.theta - world.pose.theta, 2 * math.pi) == pytest.approx(
        0.0, abs=1e-9
    )


def test_a_reset_keeps_the_robot_and_restarts_the_path():
    odometry = WheelOdometry(OdometryConfig(), ROBOT, np.random.default_rng(0))
    before = odometry.wheelbase_ratio
    odometry.update(straight(1.0), np.random.default_rng(0))
    odometry.reset(Pose2D(1.0, 2.0, 3.0))
    assert odometry.pose == Pose2D(1.0, 2.0, 3.0)
    assert odometry.wheelbase_ratio == before


@pytest.mark.parametrize(
    "values",
    [{"model": "visual"}, {"ticks_per_revolution": -1}, {"scale_std": -1.0}, {"slip_turn": -0.1}],
)
def test_senseless_settings_are_refused_by_name(values):
    with pytest.raises(ConfigError, match=next(iter(values))):
        OdometryConfig(**values)


def _press_on_a_wall():
    world = World(FloorPlan("hall", shapely.box(0, 0, 8, 6)), ROBOT)
    world.reset(Pose2D(7.0, 3.0, 0.3))
    rng = np.random.default_rng(0)
    readers = [WheelOdometry(config, ROBOT, rng) for config in (odometry_level("ideal"), FLAWLESS)]
    for reader in readers:
        reader.reset(world.pose)
    for _ in range(50):
        motion = world.step(Twist2D(0.26, 0.0), 0.2)
        for reader in readers:
            reader.update(motion, rng)
    return world, readers[0].pose, readers[1].pose


def test_settings_bear_the_name_of_their_level():
    for name in get_args(OdometryLevel):
        assert name_of_odometry(odometry_level(name)) == name
    assert name_of_odometry(OdometryConfig(scale_std=0.5)) == "custom"
