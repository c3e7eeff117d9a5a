"""A laser that repeats one reading while the robot moves is noticed, and the map isn't called sure there."""

import dataclasses

import numpy as np
import pytest
from room_drive import TIMES, good_drive, scan_at

from slamgym.core.types import LaserScan, Pose2D
from slamgym.slam import SlamConfig
from slamgym.slam.laser_check import FEWEST_READINGS, Repetition, blind_scans, without_repeats
from slamgym.slam.odometry_check import check_odometry
from slamgym.slam.replay import replay


@pytest.fixture(scope="module")
def drive():
    return good_drive()


def frozen(log, first, end):
    """The log whose laser repeats one reading from one scan to before another."""
    records = list(log.records)
    ranges = records[first].scan.ranges
    for index in range(first, end):
        record = records[index]
        scan = LaserScan(record.stamp, ranges.copy(), record.scan.geometry)
        records[index] = record._replace(scan=scan)
    return dataclasses.replace(log, records=records)


@pytest.mark.parametrize(("first", "end"), [(250, 500), (100, 150), (0, 60)])
def test_the_stretch_is_named_and_its_readings_are_left_out(drive, first, end):
    checked = check_odometry(frozen(drive, first, end), estimate_scan_time=False)
    (finding,) = checked.findings
    assert finding.kind == "stuck laser"
    assert f"in {end - first - 1} of 500 scans" in finding.sentence
    assert f"first {0.2 * (first + 1):.0f} s" in finding.sentence
    assert checked.has_odometry
    assert not checked.distrusted
    left_out = [np.isnan(record.scan.ranges).all() for record in checked]
    assert np.flatnonzero(left_out).tolist() == list(range(first + 1, end))
    for record, given in zip(checked, drive, strict=True):
        assert record.stamp == given.stamp
        assert record.odometry == given.odometry


def test_the_map_is_in_doubt_there_and_the_path_is_whole(drive):
    broken = check_odometry(frozen(drive, 250, 500), estimate_scan_time=False)
    config = SlamConfig.for_log(drive.geometry.range_max, drive.geometry.num_beams)
    result = replay(broken, config, np.random.default_rng(0))
    assert len(result.trajectory.stamps) == len(drive)
    assert result.doubtful[251:].all()
    assert result.doubtful[:245].mean() < 0.1
    (span,) = [one for one in result.stats.spans() if one.end > TIMES[260]]
    assert span.begin == pytest.approx(TIMES[251], abs=1.5)
    assert span.end == pytest.approx(TIMES[-1], abs=1.5)


def test_a_robot_at_rest_before_a_laser_without_noise_is_no_fault():
    pose = Pose2D(1.0, 1.0, 0.0)
    ranges = scan_at(pose, 0.0, np.random.default_rng(0)).ranges
    repetition = Repetition()
    assert not any(repetition.is_stuck(0.2 * step, ranges, pose) for step in range(500))
    assert repetition.count == 499


@pytest.mark.parametrize(
    ("seen", "step", "wait"),
    [
        (FEWEST_READINGS - 1, 0.1, 0.2),  # an open hall
        (180, 0.02, 0.01),  # published ten times as fast as the laser turns
        (180, 0.0001, 0.2),  # no motion to speak of
    ],
)
def test_what_may_well_be_the_same_again_is_no_fault(seen, step, wait):
    ranges = np.full(180, np.inf, np.float32)
    ranges[:seen] = 2.0
    repetition = Repetition()
    for number in range(50):
        now = ranges + np.float32(0.01 * (number // 10))
        assert not repetition.is_stuck(wait * number, now, Pose2D(step * number, 0.0, 0.0))


def test_each_scan_twice_is_no_fault(drive):
    records = []
    for record in drive.records[:100]:
        later = LaserScan(record.stamp + 0.1, record.scan.ranges, record.scan.geometry)
        records += [record, record._replace(stamp=record.stamp + 0.1, scan=later)]
    log = dataclasses.replace(drive, records=records)
    assert without_repeats(log) is log


def test_single_scans_without_a_reading_are_not_in_doubt(drive):
    records = list(drive.records[:100])
    nothing = np.full(drive.geometry.num_beams, np.nan, np.float32)
    for index in (10, 50, *range(70, 80)):
        scan = LaserScan(records[index].stamp, nothing, drive.geometry)
        records[index] = records[index]._replace(scan=scan)
    log = dataclasses.replace(drive, records=records)
    assert np.flatnonzero(blind_scans(log)).tolist() == list(range(70, 80))
    at_rest = [record._replace(odometry=Pose2D(0.0, 0.0, 0.0)) for record in records]
    assert not blind_scans(dataclasses.replace(log, records=at_rest)).any()
    no_odometry = dataclasses.replace(log, records=at_rest, has_odometry=False)
    assert np.flatnonzero(blind_scans(no_odometry)).tolist() == list(range(70, 80))
