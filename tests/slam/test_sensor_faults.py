"""Sensor faults in logs, one table: what `doctor` and `slam` say of each names the right part and the stretch."""

import dataclasses
import gzip
from pathlib import Path

import numpy as np
import pytest
from room_drive import good_drive
from sensor_faults import (
    COLUMNS,
    LEFT_OUT,
    READERS,
    SENSOR_FAULTS,
    late,
    mirrored,
    rows_of,
    scaled,
    stretch,
)

from slamgym.interop.carmen import read_carmen
from slamgym.interop.carmen_writer import carmen_lines
from slamgym.interop.logs import open_log
from slamgym.slam import SlamConfig
from slamgym.slam.laser_changes import noting_changes
from slamgym.slam.laser_check import noting_gaps, without_repeats
from slamgym.slam.log_watch import WINDOW, LogWatch
from slamgym.slam.odometry_check import check_odometry
from slamgym.slam.replay import replay

LOGS = Path(__file__).parents[3] / "shared/data/logs"
REAL = ("urg4m_lab", "csail", "aces", "freiburg-079", "intel", "fhw")
UNNAMED = {("urg4m_lab", "scaled")}
"""Logs in which a fault isn't seen: a laser that sees 4 m shows too little before and after."""


LASER_FAULTS = {
    "frozen": "the laser repeats one reading",
    "scaled": "all readings become 1.4 times as long",
    "mirrored": "left and right change places",
    "gap": "the laser sends no scan for",
}
"""Words in what is said of each fault that lasts for a stretch."""


def put_in(name, log):
    return SENSOR_FAULTS[name].put_in(log, *stretch(log))


def seconds(log, index):
    return f"{log.records[index].stamp - log.records[0].stamp:.0f} s"


@pytest.fixture(scope="module")
def drive():
    return good_drive()


def the_finding(name, findings):
    (finding,) = [one for one in findings if one.kind in SENSOR_FAULTS[name].kinds]
    return finding


@pytest.mark.parametrize("name", LASER_FAULTS)
def test_doctor_names_the_laser_and_the_stretch(drive, name):
    begin, end = stretch(drive)
    checked = check_odometry(put_in(name, drive), estimate_scan_time=False)
    finding = the_finding(name, checked.findings)
    assert LASER_FAULTS[name] in finding.sentence
    first = {"frozen": begin + 1, "gap": begin - 1}.get(name, begin)
    assert seconds(drive, first) in finding.sentence
    if finding.kind == "laser changed":
        assert "in 2 places" in finding.sentence
        assert seconds(drive, end) in finding.sentence
    # The odometry is right, and isn't blamed.
    assert [one.kind for one in checked.findings] == [finding.kind]


def test_doctor_names_late_odometry_and_a_laser_that_is_mirrored_or_scaled_throughout(drive):
    count = len(drive)
    for fault, kind, words in (
        (late, "clock", "the odometry is 0.3"),
        (mirrored, "odometry", "one upside down needs its mount"),
        (scaled, "scale", "of the laser's distances"),
    ):
        (finding,) = check_odometry(fault(drive, 0, count), estimate_scan_time=False).findings
        assert finding.kind == kind
        assert words in finding.sentence


def test_doctor_names_nothing_of_a_good_log(drive):
    checked = check_odometry(drive)
    assert not checked.findings
    assert not checked.doubted


@pytest.mark.parametrize("ahead", [3600.0, -3600.0])
def test_a_single_odd_stamp_costs_one_scan_and_is_said(drive, tmp_path, ahead):
    records = list(drive.records[:50])
    odd = records[20]
    scan = dataclasses.replace(odd.scan, stamp=odd.stamp + ahead)
    records[20] = odd._replace(stamp=odd.stamp + ahead, scan=scan)
    records = [
        one._replace(
            stamp=one.stamp + 5000.0, scan=dataclasses.replace(one.scan, stamp=one.stamp + 5000.0)
        )
        for one in records
    ]
    path = tmp_path / "odd.log.gz"
    with gzip.open(path, "wt") as file:
        file.writelines(carmen_lines(records, drive.geometry))
    log = read_carmen(path)
    assert len(log) == 49
    assert log.warnings.counts[LEFT_OUT] == 1


@pytest.mark.parametrize("name", LASER_FAULTS)
def test_slam_doubts_the_path_where_the_laser_was_wrong_and_not_before(drive, name):
    begin, end = stretch(drive)
    broken = check_odometry(put_in(name, drive), estimate_scan_time=False)
    config = SlamConfig.for_log(drive.geometry.range_max, drive.geometry.num_beams)
    config = dataclasses.replace(config, mode="dead_reckoning")  # the log's checks alone
    result = replay(broken, config, np.random.default_rng(0))
    expected = np.zeros(len(broken), dtype=bool)
    if name == "gap":
        expected[[begin - 1, begin]] = True  # the scans before and after it
    else:
        expected[begin + (name == "frozen") : end] = True
    wrong = np.flatnonzero(result.doubtful != expected)
    assert len(wrong) <= 4  # a scan in doubt is in doubt until the next that is processed
    assert set(wrong) <= {*range(end, end + 4), begin + 1, begin + 2, begin + 3}
    (span,) = result.stats.spans()
    stamps = [one.stamp for one in drive]
    assert span.begin == pytest.approx(stamps[begin], abs=1.0)
    assert span.end == pytest.approx(stamps[end], abs=1.0)


@pytest.mark.parametrize("name", SENSOR_FAULTS)
def test_the_watch_of_a_node_says_the_same(drive, name):
    if name == "jumped stamp":
        return  # is left out before: see tests/ros2/test_stamps.py
    if name == "frozen":
        return  # too: see tests/ros2/test_laser.py
    begin, end = stretch(drive)
    watch = LogWatch(drive.geometry, drive.records[0].stamp)
    assert not [finding for one in drive for finding in watch.take(one)]
    assert watch.doubt(drive.records[-1].stamp) == ""
    watch = LogWatch(drive.geometry, drive.records[0].stamp)
    said = [(one.stamp, finding) for one in put_in(name, drive) for finding in watch.take(one)]
    finding = the_finding(name, [finding for _, finding in said])
    assert finding.kind in watch.doubt(said[0][0] + 1.0)
    if name in LASER_FAULTS:
        assert LASER_FAULTS[name] in finding.fault
        assert said[0][0] == drive.records[end if name == "gap" else begin].stamp
    else:
        assert said[0][0] <= drive.records[0].stamp + WINDOW + 1.0


def test_a_watch_compares_nothing_across_scans_that_were_left_out(drive):
    begin, _ = stretch(drive)
    watch = LogWatch(drive.geometry, drive.records[0].stamp)
    for index, one in enumerate(put_in("mirrored", drive)):
        if index == begin:
            watch.leave_out()
        if index < begin + 50:
            assert not watch.take(one)


@pytest.mark.parametrize("name", REAL)
def test_on_real_logs_faults_of_the_laser_are_named_and_nothing_else(name):
    path = LOGS / f"{name}.log.gz"
    if not path.exists():
        pytest.skip("the public logs aren't here")
    log = open_log(path)
    log = dataclasses.replace(log, records=log.records[:800], recorded_track=None, findings=())

    def kinds(broken):
        checked = noting_changes(noting_gaps(without_repeats(broken)))
        return {finding.kind for finding in checked.findings}

    assert not kinds(log)
    for fault in LASER_FAULTS:
        if (name, fault) not in UNNAMED:
            assert SENSOR_FAULTS[fault].kinds & kinds(put_in(fault, log)), fault


def test_the_table_of_faults_has_a_value_in_each_column(drive, monkeypatch):
    monkeypatch.setattr("sensor_faults.READERS", {"doctor": READERS["doctor"]})
    monkeypatch.setattr("sensor_faults.SENSOR_FAULTS", {"gap": SENSOR_FAULTS["gap"]})
    rows = list(rows_of({"a home": drive}))
    assert [row["fault"] for row in rows] == ["unbroken", "gap"]
    assert all(row.keys() == set(COLUMNS) for row in rows)
    assert rows[1]["named"] == 1
