"""Motion by the laser alone: where it binds something, and where it binds nothing, which is said."""

import dataclasses
import math

import numpy as np
import pytest
from room_drive import GEOMETRY, PERIOD, TIMES, good_drive, true_poses

from slamgym.core.geometry import compose
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.interop import Log, LogRecord
from slamgym.interop.odometry import without_odometry
from slamgym.metrics.trajectory import relative_poses
from slamgym.sim.raycast import cast_rays
from slamgym.slam.graph.relative import moved_by
from slamgym.slam.laser_odometry import motion_between, with_laser_odometry
from slamgym.slam.steady_motion import SteadyMotion

EXACT = np.eye(3) * 1e8
SPEED = np.array([0.3, 0.0, 0.4])


def moving_steadily(steps):
    """A filter that was told the poses of a robot of steady speed, and the last of these."""
    motion = SteadyMotion()
    pose = np.zeros(3)
    for _ in range(steps):
        pose = moved_by(pose, PERIOD * SPEED)
        motion.predict(PERIOD)
        motion.correct(pose, EXACT)
    return motion, pose


def test_a_steady_speed_is_learned_and_leads_on():
    motion, pose = moving_steadily(20)
    assert motion.speed == pytest.approx(SPEED, abs=0.01)
    for _ in range(5):
        pose = moved_by(pose, PERIOD * SPEED)
        motion.predict(PERIOD)
    assert motion.pose == pytest.approx(pose, abs=0.01)


def test_what_is_not_seen_is_less_and_less_known():
    motion, _ = moving_steadily(20)
    before = motion.pose_covariance
    for _ in range(10):
        motion.predict(PERIOD)
        motion.correct(motion.pose + 1.0, np.zeros((3, 3)))  # no information, whatever it says
        now = motion.pose_covariance
        assert (np.linalg.eigvalsh(now - before) > 0.0).all()
        before = now
    assert motion.speed == pytest.approx(SPEED, abs=0.01)


def test_the_covariance_stays_one_however_information_varies():
    rng = np.random.default_rng(0)
    motion = SteadyMotion()
    for _ in range(2000):
        motion.predict(PERIOD)
        root = rng.standard_normal((3, 3)) * 10.0 ** rng.uniform(-1.0, 3.0, 3)
        motion.correct(motion.pose + 0.01 * rng.standard_normal(3), root @ root.T)
        assert np.array_equal(motion.covariance, motion.covariance.T)
        assert (np.linalg.eigvalsh(motion.covariance) > 0.0).all()


def test_in_a_room_nothing_is_in_doubt():
    found = with_laser_odometry(without_odometry(good_drive()))
    assert found.doubted == ()
    poses = np.array([record.odometry for record in found])
    steps = relative_poses(poses[:-1], poses[1:])
    truth = relative_poses(true_poses(TIMES[:-1]), true_poses(TIMES[1:]))
    assert np.abs(steps - truth).max() < 0.05


def test_a_robot_that_sees_nothing_for_a_while_goes_on_and_is_in_doubt():
    records = list(without_odometry(good_drive()).records[:200])
    nothing = np.full(GEOMETRY.num_beams, np.nan, np.float32)
    for index in range(100, 115):
        scan = LaserScan(records[index].stamp, nothing, GEOMETRY)
        records[index] = records[index]._replace(scan=scan)
    log = dataclasses.replace(good_drive(), records=records, has_odometry=False)
    found = with_laser_odometry(log)
    ((begin, end),) = found.doubted
    assert TIMES[100] <= begin < end <= TIMES[116]
    poses = np.array([record.odometry for record in found])
    moved = relative_poses(poses[95:96], poses[120:121])
    truth = relative_poses(true_poses(TIMES[95:96]), true_poses(TIMES[120:121]))
    assert moved == pytest.approx(truth, abs=0.1)  # it sees again what it saw before


CORRIDOR = np.array([(-2.0, -1.0, 60.0, -1.0), (-2.0, 1.0, 60.0, 1.0), (-2.0, -1.0, -2.0, 1.0)])


@pytest.mark.parametrize("seed", range(3))
def test_scans_of_few_beams_in_a_bare_corridor_do_not_say_that_the_robot_stands(seed):
    """The second scan fits the first best where that was taken, beam on beam; nothing was seen through elsewhere."""
    count = 90
    step = math.pi / count
    at_rest = Pose2D(0.0, 0.0, 0.0)
    geometry = LaserGeometry(count, 0.5 * (step - math.pi), step, 0.1, 50.0, at_rest)
    walls = np.array([(-200.0, side, 200.0, side) for side in (-1.0, 1.0)])
    rng = np.random.default_rng(seed)

    def scan(x: float) -> LaserScan:
        ranges = np.empty(count)
        cast_rays(x, 0.05, 0.02, geometry.angle_min, step, walls, 50.0, ranges)
        ranges += 0.01 * rng.standard_normal(count)
        return LaserScan(x, ranges.astype(np.float32), geometry)

    driven = motion_between(scan(0.0), scan(1.0), np.array([1.0, 0.0, 0.0])).pose
    assert driven[0] > 0.7  # along the walls little binds


def corridor_log(seconds):
    """A drive at 0.3 m/s from a corridor's end, out of whose sight it soon is; the laser reaches 3.5 m."""
    rng = np.random.default_rng(2)
    geometry = GEOMETRY._replace(range_max=3.5)
    records = []
    for stamp in PERIOD * np.arange(round(seconds / PERIOD)):
        sensor = compose(Pose2D(0.3 * stamp, 0.0, 0.0), geometry.mount)
        ranges = np.empty(geometry.num_beams)
        cast_rays(
            *sensor,
            geometry.angle_min,
            geometry.angle_increment,
            CORRIDOR,
            geometry.range_max,
            ranges,
        )
        noisy = ranges + 0.01 * rng.standard_normal(len(ranges))
        scan = LaserScan(float(stamp), noisy.astype(np.float32), geometry)
        records.append(LogRecord(float(stamp), Pose2D(0.0, 0.0, 0.0), scan))
    return Log("corridor", records, geometry, has_odometry=False)


def test_along_a_bare_corridor_the_speed_leads_on_and_the_way_is_in_doubt():
    log = corridor_log(20.0)
    found = with_laser_odometry(log)
    poses = np.array([record.odometry for record in found])
    assert np.abs(poses[:, 1]).max() < 0.1  # the walls bind this
    assert np.abs(poses[:, 2]).max() < 0.03
    assert poses[-1, 0] == pytest.approx(0.3 * 19.8, rel=0.15)  # it was within 4 %
    assert found.doubted
    assert found.doubted[0][0] > 4.0  # it has seen the end until then
    assert found.doubted[-1][1] == log.records[-1].stamp
