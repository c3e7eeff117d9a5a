"""Waypoints to poses over time; and the paths that make no sense."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import Trajectory
from slamgym.parametric.config import MotionConfig
from slamgym.parametric.paths import Waypoints, check_recorded, drive, pick_scans, sampled
from slamgym.sim.robot import RobotConfig

CONFIG = MotionConfig()
ROBOT = RobotConfig()
SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [0.0, 0.0]])


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=2, max_size=6, unique=True))
def test_turn_and_go_passes_all_waypoints_within_the_robots_limits(points) -> None:
    points = np.round(np.array(points), 2)
    if len(np.unique(points, axis=0)) < 2:
        return
    driven = drive(Waypoints(points))
    for point in points:
        assert np.hypot(*(driven.poses[:, :2] - point).T).min() < 1e-9
    dt = np.diff(driven.stamps)
    assert (dt > 0.0).all()
    way = np.hypot(*np.diff(driven.poses[:, :2], axis=0).T)
    turn = np.abs(wrap_angle(np.diff(driven.poses[:, 2])))
    assert (way / dt).max() <= ROBOT.max_linear + 1e-6
    assert (turn / dt).max() <= ROBOT.max_angular + 1e-6
    # It turns or drives, never both.
    assert not ((way > 1e-9) & (turn > 1e-9)).any()


def test_a_slower_robot_takes_longer_for_the_same_way() -> None:
    fast, slow = (drive(Waypoints(SQUARE), robot=RobotConfig(max_linear=v)) for v in (0.2, 0.1))
    assert fast.length == pytest.approx(8.0)
    assert slow.length == pytest.approx(8.0)
    assert np.ptp(slow.stamps) > 1.3 * np.ptp(fast.stamps)


def test_samples_lie_on_the_path_at_equal_intervals() -> None:
    driven = drive(Waypoints(SQUARE))
    samples = sampled(driven, 0.2)
    np.testing.assert_allclose(np.diff(samples.stamps), 0.2)
    np.testing.assert_allclose(samples.poses[0], driven.poses[0])
    assert samples.length == pytest.approx(8.0, abs=0.1)
    # From -170 to 170 degrees the short way.
    turning = Trajectory(np.array([0.0, 1.0]), np.array([[0.0, 0.0, -2.97], [0.0, 0.0, 2.97]]))
    assert np.abs(sampled(turning, 0.5).poses[1, 2]) == pytest.approx(math.pi)


def test_times_of_arrival_are_kept() -> None:
    times = np.array([0.0, 12.0, 30.0, 42.0, 60.0])
    driven = drive(Waypoints(SQUARE, times))
    for point, time in zip(SQUARE, times, strict=True):
        at = np.argmin(np.abs(driven.stamps - time))
        assert driven.stamps[at] == pytest.approx(time)
        np.testing.assert_allclose(driven.poses[at, :2], point, atol=1e-9)


def test_scans_are_picked_by_way_and_angle() -> None:
    driven = drive(Waypoints(SQUARE))
    scans = pick_scans(driven, CONFIG)
    step = np.hypot(*np.diff(scans.poses[:, :2], axis=0).T)
    turn = np.abs(wrap_angle(np.diff(scans.poses[:, 2])))
    # One fine sample may overshoot: 0.05 s at the largest speeds.
    assert step.max() <= CONFIG.scan_spacing + 0.05 * ROBOT.max_linear + 1e-9
    assert turn.max() <= CONFIG.scan_angle + 0.05 * ROBOT.max_angular + 1e-9
    np.testing.assert_allclose(scans.poses[[0, -1]], driven.poses[[0, -1]])


@pytest.mark.parametrize(
    ("points", "times", "message"),
    [
        ([[0.0, 0.0]], None, "has 1 waypoint"),
        ([[0.0, 0.0], [float("nan"), 1.0]], None, "waypoint 2 is not a pair of finite numbers"),
        ([[0.0, 0.0], [float("inf"), 1.0]], None, "waypoint 2"),
        ([[1.0, 1.0], [1.0, 1.0]], None, "all waypoints lie in one place"),
        ([[0.0, 0.0], [1.0, 0.0]], [5.0, 3.0], "times of arrival must increase"),
        ([[0.0, 0.0], [1.0, 0.0]], [0.0, float("nan")], "finite time of arrival"),
        ([[0.0, 0.0], [1.0, 0.0]], [0.0, 0.5], "can't be reached in 0.50 s"),
    ],
)
def test_paths_that_make_no_sense_are_refused_by_name(points, times, message) -> None:
    waypoints = Waypoints(np.array(points), None if times is None else np.array(times))
    with pytest.raises(ConfigError, match=message) as error:
        drive(waypoints, "tour.csv")
    assert str(error.value).startswith("tour.csv")


@pytest.mark.parametrize(
    ("stamps", "poses", "message"),
    [
        ([0.0], [[0, 0, 0]], "has 1 pose"),
        ([0.0, 0.0], [[0, 0, 0], [1, 0, 0]], "time doesn't grow at pose 2"),
        ([0.0, 1.0], [[0, 0, 0], [float("nan"), 0, 0]], "not finite"),
    ],
)
def test_recorded_paths_that_make_no_sense_are_refused(stamps, poses, message) -> None:
    with pytest.raises(ConfigError, match=message):
        check_recorded(Trajectory(np.array(stamps), np.array(poses, dtype=float)))
