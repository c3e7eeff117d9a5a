"""How long scans took, found by the log itself: a drive whose laser sweeps, and drives whose laser doesn't."""

import dataclasses
import functools

import numpy as np
import pytest
from room_drive import GEOMETRY, PERIOD, TIMES, WALLS, good_drive, true_poses

from slamgym.core.geometry import between, compose
from slamgym.core.types import LaserScan, Pose2D
from slamgym.interop.odometry import retimed
from slamgym.interop.scan_times import with_scan_time
from slamgym.metrics.trajectory import relative_poses
from slamgym.sim.raycast import cast_rays
from slamgym.slam.laser_odometry import LaserTracker, with_laser_odometry
from slamgym.slam.odometry_check import check_odometry
from slamgym.slam.scan_time_check import with_estimated_scan_time

SWEEP = 0.18  # [s], of 0.2 from a scan to the next


def swept_scan(stamp, begin, rng, seconds=SWEEP):
    """A scan that is swept from a moment on [s]."""
    angles = GEOMETRY.angles
    shares = np.linspace(0.0, 1.0, len(angles))
    ranges = np.empty(len(angles))
    for beam, pose in enumerate(true_poses(begin + seconds * shares)):
        sensor = compose(Pose2D(*pose), GEOMETRY.mount)
        cast_rays(*sensor, angles[beam], 1.0, WALLS, GEOMETRY.range_max, ranges[beam : beam + 1])
    noisy = ranges + 0.01 * rng.standard_normal(len(ranges))
    return LaserScan(stamp, noisy.astype(np.float32), GEOMETRY)


@functools.cache
def swept_drive(is_last):
    """The good drive with a laser that sweeps; the stamps are those of its first beams, or of its last."""
    rng = np.random.default_rng(1)
    records = []
    for record in good_drive():
        begin = record.stamp - (SWEEP if is_last else 0.0)
        records.append(record._replace(scan=swept_scan(record.stamp, begin, rng)))
    return dataclasses.replace(good_drive(), records=records)


def beam_times(log):
    return [finding.sentence for finding in log.findings if finding.kind == "beam times"]


def test_the_time_is_found_and_said():
    found = with_estimated_scan_time(swept_drive(False))
    (sentence,) = beam_times(found)
    assert found.geometry.scan_time == pytest.approx(SWEEP, abs=0.03)
    assert "--scan-time 0" in sentence
    assert "stamp of its last" not in sentence
    assert [record.stamp for record in found] == TIMES.tolist()
    assert all(record.scan.geometry is found.geometry for record in found)
    motions = np.array([record.scan.motion for record in found])[5:-5]
    steps = relative_poses(true_poses(TIMES[5:-5]), true_poses(TIMES[5:-5] + SWEEP))
    assert np.abs(motions - steps)[:, 2].mean() < 0.03 * np.abs(steps[:, 2]).max()


def test_stamps_of_the_last_beams_are_set_back_and_no_clock_is_blamed():
    found = check_odometry(swept_drive(True))
    (sentence,) = beam_times(found)
    assert "stamp of its last" in sentence
    assert [finding.kind for finding in found.findings] == ["beam times"]
    set_back = TIMES - [record.stamp for record in found]
    assert set_back == pytest.approx(SWEEP, abs=0.03)


@pytest.mark.parametrize("late", [0.2, -0.2])
def test_a_clock_that_is_wrong_is_not_taken_for_a_laser_that_sweeps(late):
    assert not beam_times(check_odometry(retimed(good_drive(), -late)))


FRONT = slice(45, 135)
"""The beams of half a turn."""


def seen_in_front(log):
    """The log of a laser that sees half a turn."""
    step = GEOMETRY.angle_increment
    geometry = GEOMETRY._replace(num_beams=90, angle_min=GEOMETRY.angle_min + FRONT.start * step)
    records = [
        record._replace(scan=LaserScan(record.stamp, record.scan.ranges[FRONT], geometry))
        for record in log
    ]
    return dataclasses.replace(log, records=records, geometry=geometry)


def swept_steadily():
    """The log of a laser that turns once a scan and sees half a turn."""
    rng = np.random.default_rng(3)
    records = [
        record._replace(scan=swept_scan(record.stamp, record.stamp - PERIOD / 4, rng, PERIOD))
        for record in good_drive()
    ]
    return seen_in_front(dataclasses.replace(good_drive(), records=records))


@pytest.mark.parametrize("late", [0.0, -0.16])
def test_a_laser_that_turns_steadily_is_told_by_turns_though_its_scans_are_hardly_skewed(late):
    found = check_odometry(retimed(swept_steadily(), late))
    assert "beam times" in {finding.kind for finding in found.findings}
    assert found.geometry.scan_time == pytest.approx(PERIOD / 2, abs=0.01)


def test_a_laser_that_sees_half_a_turn_at_once_is_not_taken_for_one_that_turns():
    found = check_odometry(retimed(seen_in_front(good_drive()), -0.16))
    assert {finding.kind for finding in found.findings} == {"clock"}


def test_what_the_user_or_the_log_says_is_not_estimated():
    swept = swept_drive(False)
    assert not beam_times(check_odometry(swept, estimate_scan_time=False))
    told = with_scan_time(swept, SWEEP)
    assert with_estimated_scan_time(told) is told


def test_by_the_right_time_the_walls_are_no_longer_skewed():
    """The laser's own odometry of a pair of scans, against the truth."""
    errors = {}
    for seconds in (0.0, SWEEP):
        log = with_laser_odometry(
            dataclasses.replace(with_scan_time(swept_drive(False), seconds), has_odometry=False)
        )
        poses = np.array([record.odometry for record in log])
        moved = relative_poses(poses[:-10], poses[10:])
        truth = relative_poses(true_poses(TIMES[:-10]), true_poses(TIMES[10:]))
        turned = np.abs(truth[:, 2]) > 0.5
        errors[seconds] = np.abs(moved - truth)[turned].mean(axis=0)
    assert (errors[SWEEP] < 0.5 * errors[0.0]).all()


def test_a_tracker_knows_the_speed_at_its_first_scan_from_the_second():
    """Two scans of a robot that turned before the first: the same motion as with the odometry's."""
    told = with_scan_time(swept_drive(False), SWEEP)
    speeds = np.abs(np.diff(np.unwrap(true_poses(TIMES)[:, 2])))
    fast = int(np.argmax(speeds[:-2]))
    first, second = told.records[fast], told.records[fast + 1]
    truth = between(Pose2D(*true_poses(TIMES)[fast]), Pose2D(*true_poses(TIMES)[fast + 1]))
    assert abs(truth.theta) > 0.7 * PERIOD  # it turns by 0.7 rad/s at least
    alone = LaserTracker(first.scan).move(second.scan)
    assert alone == pytest.approx(truth, abs=0.015)
