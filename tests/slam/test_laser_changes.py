"""A laser whose readings are scaled or mirrored from one scan to the next is found, however the robot moves."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from room_drive import GEOMETRY, good_drive, scan_at

from slamgym.core.geometry import between
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.interop import Log, LogRecord
from slamgym.slam.laser_changes import change_between, noting_changes, seen_after

FROM = Pose2D(2.0, 4.0, 0.4)
TO = Pose2D(2.7, 3.7, 0.0)
"""Two places in the room, 0.8 m and 0.4 rad apart: nothing of the readings themselves is alike."""


def record(pose, stamp, change=lambda ranges: ranges):
    scan = scan_at(pose, stamp, np.random.default_rng(0))
    return LogRecord(stamp, pose, dataclasses.replace(scan, ranges=change(scan.ranges)))


@pytest.fixture(scope="module")
def drive():
    return good_drive()


@given(st.floats(1.5, 4.5), st.floats(3.6, 4.4), st.floats(-3.0, 3.0))
def test_the_room_is_expected_where_it_is_then_seen(x, y, theta):
    there = Pose2D(x, y, theta)
    expected = seen_after(record(FROM, 0.0).scan, between(FROM, there))
    seen = record(there, 1.0).scan.ranges
    both = np.isfinite(expected)
    assert np.count_nonzero(both) > 60
    # Noise of 1 cm, and beams 2 degrees apart on slanting walls.
    assert np.median(np.abs(expected - seen)[both]) < 0.06


def test_what_nothing_was_seen_of_is_not_expected():
    nothing = np.full(GEOMETRY.num_beams, np.nan, np.float32)
    assert np.isinf(seen_after(LaserScan(0.0, nothing, GEOMETRY), TO)).all()


@pytest.mark.parametrize("factor", [0.3048, 0.5, 1.4, 10.0])
def test_another_unit_is_named_with_its_factor(factor):
    change = change_between(record(FROM, 0.0), record(TO, 1.0, lambda r: np.float32(factor) * r))
    assert change == f"all readings become {factor:.1f} times as long"


def test_exchanged_sides_are_named():
    change = change_between(record(FROM, 0.0), record(TO, 1.0, lambda r: r[::-1].copy()))
    assert change == "left and right change places"


def test_exchanged_sides_are_named_where_little_is_seen():
    """Of 180 beams 30 to one side have a return, as with a laser of 4 m in a hall."""
    ranges = np.full(GEOMETRY.num_beams, np.nan, np.float32)
    ranges[20:50] = 3.0 + 0.02 * np.arange(30)
    before = LogRecord(0.0, FROM, LaserScan(0.0, ranges, GEOMETRY))
    after = LogRecord(0.2, FROM, LaserScan(0.2, ranges[::-1].copy(), GEOMETRY))
    assert change_between(before, after) == "left and right change places"
    assert change_between(before, before) == ""


def test_neither_a_good_drive_nor_wrong_odometry_is_a_changed_laser(drive):
    for forward, turn in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (1.5, 1.0), (0.0, 0.0), (1.0, 3.0)):
        records = []
        for one in drive.records[:200]:
            x, y, theta = one.odometry
            pose = Pose2D(forward * x, forward * y, turn * theta)
            records.append(one._replace(odometry=pose))
        assert not noting_changes(dataclasses.replace(drive, records=records)).findings


@pytest.mark.parametrize(("begin", "end"), [(100, 200), (100, 400), (350, 500)])
def test_what_lasts_shorter_is_in_doubt(drive, begin, end):
    records = [
        one._replace(scan=dataclasses.replace(one.scan, ranges=one.scan.ranges[::-1].copy()))
        if begin <= index < end
        else one
        for index, one in enumerate(drive.records)
    ]
    checked = noting_changes(dataclasses.replace(drive, records=records))
    inside = [any(a <= one.stamp < b for a, b in checked.doubted) for one in checked]
    whole = np.arange(len(drive))
    wrong = (whole >= begin) & (whole < end)
    expected = wrong if wrong.mean() < 0.5 else ~wrong
    np.testing.assert_array_equal(inside[:-1], expected[:-1])


@pytest.mark.parametrize(("moved", "kinds"), [(0.1, ["laser changed"]), (1.0, [])])
def test_readings_that_become_longer_by_little_more_than_the_robot_moves_are_no_fault(moved, kinds):
    geometry = LaserGeometry(180, -np.pi, np.pi / 90, 0.1, 8.0)
    records = []
    for number in range(6):
        ranges = np.full(180, 5.0 if number < 3 else 6.5, np.float32)
        pose = Pose2D(0.1 * number + (moved - 0.1 if number >= 3 else 0.0), 0.0, 0.0)
        records.append(LogRecord(0.2 * number, pose, LaserScan(0.2 * number, ranges, geometry)))
    findings = noting_changes(Log("hall", records, geometry)).findings
    assert [finding.kind for finding in findings] == kinds
