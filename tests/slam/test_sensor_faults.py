"""Sensor faults in logs, one table: what `doctor` and `slam` say of each names the right part and the stretch."""

import dataclasses
import gzip
from pathlib import Path

import numpy as np
import pytest
from room_drive import good_drive

from slamgym.core.types import LaserScan
from slamgym.interop.carmen import read_carmen
from slamgym.interop.carmen_writer import carmen_lines
from slamgym.interop.logs import open_log
from slamgym.interop.odometry import retimed
from slamgym.slam import SlamConfig
from slamgym.slam.laser_check import noting_changes, noting_gaps, without_repeats
from slamgym.slam.odometry_check import check_odometry
from slamgym.slam.replay import replay

LOGS = Path(__file__).parents[3] / "shared/data/logs"
REAL = ("urg4m_lab", "csail", "aces", "freiburg-079", "intel", "fhw")


def rescanned(log, begin, end, change):
    """The log with other ranges in some of its scans."""
    records = list(log.records)
    for index in range(begin, end):
        record = records[index]
        scan = LaserScan(record.stamp, change(record.scan.ranges), record.scan.geometry)
        records[index] = record._replace(scan=scan)
    return dataclasses.replace(log, records=records)


def frozen(log, begin, end):
    ranges = log.records[begin].scan.ranges
    return rescanned(log, begin, end, lambda _: ranges.copy())


def mirrored(log, begin, end):
    return rescanned(log, begin, end, lambda ranges: ranges[::-1].copy())


def scaled(log, begin, end):
    return rescanned(log, begin, end, lambda ranges: np.float32(1.4) * ranges)


def gap(log, begin, end):
    return dataclasses.replace(
        log, records=[*log.records[:begin], *log.records[end:]], recorded_track=None
    )


def late(log, _begin, _end):
    return retimed(log, -0.3)


THINNED = ("csail", "aces", "intel", "fhw")
LASER_FAULTS = {
    frozen: ("stuck laser", "the laser repeats one reading"),
    scaled: ("laser changed", "all readings become 1.4 times as long"),
    mirrored: ("laser changed", "left and right change places"),
    gap: ("gap", "the laser sends no scan for"),
}
"""Each fault of a stretch: the kind of its finding, and words in it."""


def stretch(log):
    return int(0.4 * len(log)), int(0.6 * len(log))


def seconds(log, index):
    return f"{log.records[index].stamp - log.records[0].stamp:.0f} s"


@pytest.fixture(scope="module")
def drive():
    return good_drive()


@pytest.mark.parametrize("fault", LASER_FAULTS, ids=lambda fault: fault.__name__)
def test_doctor_names_the_laser_and_the_stretch(drive, fault):
    begin, end = stretch(drive)
    kind, words = LASER_FAULTS[fault]
    (finding,) = [
        one for one in check_odometry(fault(drive, begin, end)).findings if one[0] == kind
    ]
    assert words in finding.sentence
    first = {frozen: begin + 1, gap: begin - 1}.get(fault, begin)
    assert seconds(drive, first) in finding.sentence
    if kind == "laser changed":
        assert "in 2 places" in finding.sentence
        assert seconds(drive, end) in finding.sentence


def test_doctor_names_late_odometry_and_a_laser_that_is_mirrored_or_scaled_throughout(drive):
    count = len(drive)
    for fault, kind, words in (
        (late, "clock", "the odometry is 0.3"),
        (mirrored, "odometry", "one upside down needs its mount"),
        (scaled, "scale", "of the laser's distances"),
    ):
        (finding,) = check_odometry(fault(drive, 0, count)).findings
        assert finding.kind == kind
        assert words in finding.sentence


def test_doctor_names_nothing_of_a_good_log(drive):
    assert not check_odometry(drive).findings


@pytest.mark.parametrize("ahead", [3600.0, -3600.0])
def test_a_single_odd_stamp_costs_one_scan_and_is_said(drive, tmp_path, ahead):
    records = list(drive.records[:50])
    odd = records[20]
    scan = LaserScan(odd.stamp + ahead, odd.scan.ranges, odd.scan.geometry)
    records[20] = odd._replace(stamp=odd.stamp + ahead, scan=scan)
    records = [
        one._replace(
            stamp=one.stamp + 5000.0,
            scan=LaserScan(one.stamp + 5000.0, one.scan.ranges, one.scan.geometry),
        )
        for one in records
    ]
    path = tmp_path / "odd.log.gz"
    with gzip.open(path, "wt") as file:
        file.writelines(carmen_lines(records, drive.geometry))
    log = read_carmen(path)
    assert len(log) == 49
    assert log.warnings.counts["scan left out because time goes backwards"] == 1


def test_slam_doubts_the_path_where_the_laser_was_stuck_and_only_there(drive):
    begin, end = stretch(drive)
    broken = check_odometry(frozen(drive, begin, end))
    config = SlamConfig.for_log(drive.geometry.range_max, drive.geometry.num_beams)
    result = replay(broken, config, np.random.default_rng(0))
    assert result.doubtful[begin + 1 : end].all()
    assert not result.doubtful[: begin - 5].any()
    assert not result.doubtful[end + 10 :].any()


@pytest.mark.parametrize("name", REAL)
def test_on_real_logs_faults_of_the_laser_are_named_and_nothing_else(name):
    path = LOGS / f"{name}.log.gz"
    if not path.exists():
        pytest.skip("the public logs aren't here")
    log = open_log(path)
    log = dataclasses.replace(log, records=log.records[:800], recorded_track=None, findings=())
    begin, end = stretch(log)

    def kinds(broken):
        checked = noting_changes(noting_gaps(without_repeats(broken)))
        return [finding.kind for finding in checked.findings]

    assert kinds(log) == []
    # Of thinned logs the robot drives a metre from scan to scan: nothing says what changed.
    faults = (frozen, gap) if name in THINNED else (frozen, gap, scaled)
    for fault in faults:
        assert LASER_FAULTS[fault][0] in kinds(fault(log, begin, end)), fault.__name__
