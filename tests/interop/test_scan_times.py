"""Times of scans and of their beams in logs: kept by every format, chosen by the user, and refused if they can't be."""

import math

import numpy as np
import pytest

from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError
from slamgym.core.geometry import part_of
from slamgym.core.types import LaserScan, Pose2D
from slamgym.interop import BagChoices, LogRecord, open_log, write_carmen, write_rosbag2
from slamgym.interop.scan_times import (
    ASSUMED_RATE,
    believed_scan_time,
    rate_without_clock,
    stamped_earlier,
)

MOTION = Pose2D(0.05, 0.002, 0.15)
"""Of the robot between two scans."""


def swept(records, geometry, seconds):
    """The laser and the scans with times of their beams."""
    laser = geometry.taking(seconds)
    motion = part_of(MOTION, seconds / 0.2)
    return laser, [
        record._replace(scan=LaserScan(record.stamp, record.scan.ranges, laser, motion))
        for record in records
    ]


def write(path, records, laser):
    if path.suffix == ".log":
        write_carmen(path, records, laser)
    else:
        pytest.importorskip("rosbags")
        write_rosbag2(path, records, laser)


@pytest.mark.parametrize("name", ["a.log", "bag"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_times_of_beams_survive_with_the_motion_between_them(
    tmp_path, records, geometry, name, sign
):
    laser, timed = swept(records, geometry._replace(time_increment=sign * 0.0), 0.13)
    assert math.copysign(1.0, laser.time_increment) == sign
    write(tmp_path / name, timed, laser)
    log = open_log(tmp_path / name)
    assert not log.warnings.sentences()
    assert not log.findings
    assert log.geometry.time_increment == pytest.approx(laser.time_increment)
    assert log.geometry.angles == pytest.approx(laser.angles, abs=1e-6)
    for ours, theirs in zip(timed, log, strict=True):
        assert theirs.odometry == pytest.approx(ours.odometry, abs=1e-6)
        assert theirs.scan.motion == pytest.approx(ours.scan.motion, abs=3e-6)
        seen = np.isfinite(ours.scan.ranges)
        assert theirs.scan.ranges[seen] == pytest.approx(ours.scan.ranges[seen], abs=6e-4)


def test_scans_made_at_once_are_written_as_ever(tmp_path, records, geometry):
    write_carmen(tmp_path / "a.log", records, geometry)
    text = (tmp_path / "a.log").read_text()
    assert "beam every" not in text
    assert text.count("ODOM") == len(records)
    assert open_log(tmp_path / "a.log").geometry.scan_time == 0.0


def test_the_user_says_how_long_a_scan_takes(tmp_path, records, geometry):
    laser, timed = swept(records, geometry, 0.13)
    write_carmen(tmp_path / "a.log", timed, laser)
    off = open_log(tmp_path / "a.log", BagChoices(scan_time=0.0))
    assert off.geometry.scan_time == 0.0
    assert all(record.scan.motion == (0.0, 0.0, 0.0) for record in off)
    write_carmen(tmp_path / "b.log", records, geometry)
    on = open_log(tmp_path / "b.log", BagChoices(scan_time=0.1))
    assert on.geometry.scan_time == pytest.approx(0.1)
    # By the odometry of the scans alone: half of the motion to the next.
    first, second = records[4].odometry, records[5].odometry
    assert on.records[4].scan.motion.theta == pytest.approx(0.5 * (second.theta - first.theta))


@pytest.mark.parametrize(
    ("increment", "said"),
    [("nan", "aren't numbers"), ("inf", "aren't numbers"), ("0.02", "longer than until the next")],
)
def test_times_of_beams_that_cannot_be_are_said_and_left_out(
    tmp_path, records, geometry, increment, said
):
    write_carmen(tmp_path / "a.log", records, geometry)
    text = (tmp_path / "a.log").read_text()
    (tmp_path / "a.log").write_text(f"# a beam every {increment} s\n{text}")
    log = open_log(tmp_path / "a.log")
    (finding,) = log.findings
    assert finding.kind == "beam times"
    assert said in finding.sentence
    assert "--scan-time" in finding.sentence
    assert log.geometry.scan_time == 0.0
    chosen = open_log(tmp_path / "a.log", BagChoices(scan_time=0.1))
    assert not chosen.findings


@pytest.mark.parametrize("scan_time", [math.nan, 0.3])
def test_the_same_of_a_bag(tmp_path, records, geometry, scan_time):
    pytest.importorskip("rosbags")
    laser = geometry._replace(time_increment=scan_time / 18)
    write_rosbag2(tmp_path / "bag", records, laser)
    log = open_log(tmp_path / "bag")
    assert [finding.kind for finding in log.findings] == ["beam times"]
    assert log.geometry.scan_time == 0.0
    assert len(log) == len(records)


def test_what_lasers_tell():
    def told(*increments, gap=0.2):
        seconds, findings = believed_scan_time(increments, 101, gap)
        return seconds, "".join(finding.sentence for finding in findings)

    assert told(0.001) == (pytest.approx(0.1), "")
    assert told(0.001, math.nan, 0.001) == (pytest.approx(0.1), "")  # one broken message
    assert told(0.002) == (pytest.approx(0.2), "")  # the next scan follows at once
    assert told(0.001, gap=math.nan) == (pytest.approx(0.1), "")
    assert "backwards" in told(-0.001)[1]
    assert "longer" in told(153333.0, gap=math.nan)[1]  # a driver that writes nanoseconds
    assert told(-0.001)[0] == told(math.nan)[0] == 0.0


def test_scans_that_are_stamped_late_are_set_back_and_take_the_odometry_of_then(
    tmp_path, records, geometry
):
    write_carmen(tmp_path / "a.log", records, geometry)
    log = open_log(tmp_path / "a.log")
    earlier = stamped_earlier(log, 0.1)
    assert [record.stamp for record in earlier] == pytest.approx(
        [record.stamp - 0.1 for record in records]
    )
    between = 0.5 * (records[3].odometry.theta + records[4].odometry.theta)
    assert earlier.records[4].odometry.theta == pytest.approx(between)
    assert all(record.scan.stamp == record.stamp for record in earlier)


# --- a clock that stands still ---


def standing_log(folder, records, geometry):
    """A log whose stamps are all equal, with fast motions, and odometry between the scans."""
    fast = []
    for k, record in enumerate(records):
        pose = Pose2D(0.9 * k, 0.0, 0.2 * k)
        fast.append(LogRecord(record.stamp, pose, record.scan))
    write_carmen(folder / "right.log", fast, geometry)
    lines = []
    x = 0.0
    for line in (folder / "right.log").read_text().splitlines():
        words = line.split()
        if words[0] in {"ODOM", "ROBOTLASER1"}:
            words[-1] = words[-3] = "4294970000.000000"
        lines.append(" ".join(words))
        if words[0] == "ROBOTLASER1":
            lines.append(f"ODOM {x + 0.45} 0 0 0 0 0 4294970000.0 host 4294970000.0")
            x += 0.9
    (folder / "a.log").write_text("\n".join(lines))
    return folder / "a.log"


def test_a_clock_that_stands_still_is_named_and_the_order_of_the_file_counts(
    tmp_path, records, geometry
):
    path = standing_log(tmp_path, records, geometry)
    log = open_log(path)
    (finding,) = log.findings
    assert finding.kind == "clock"
    assert "stands still: 10 of 10" in finding.sentence
    assert "--scan-rate" in finding.sentence
    assert len(log) == len(records)
    assert np.diff([record.stamp for record in log]) == pytest.approx(1.0 / ASSUMED_RATE)
    assert [record.odometry.x for record in log] == pytest.approx(0.9 * np.arange(10))


def test_a_scan_rate_gives_times_to_the_scans_and_to_the_odometry_between(
    tmp_path, records, geometry
):
    path = standing_log(tmp_path, records, geometry)
    log = open_log(path, BagChoices(scan_rate=5.0))
    assert not log.findings
    assert [record.stamp for record in log] == pytest.approx(0.2 * np.arange(10))
    stamps, poses, scans = log.track
    halfway = scans[3] + 1
    assert 0.6 < stamps[halfway] < 0.8
    assert poses[halfway, 0] == pytest.approx(0.9 * 3.5)
    assert (np.diff(stamps) >= 0.0).all()


def test_a_bag_takes_a_scan_rate_too(tmp_path, records, geometry):
    pytest.importorskip("rosbags")
    write_rosbag2(tmp_path / "bag", records, geometry)
    log = open_log(tmp_path / "bag", BagChoices(scan_rate=2.0))
    assert [record.stamp for record in log] == pytest.approx(0.5 * np.arange(10))
    assert [record.odometry.x for record in log] == pytest.approx(
        [record.odometry.x for record in records], abs=0.05
    )


def test_stamps_that_repeat_now_and_then_are_no_clock_that_stands_still():
    assert rate_without_clock([0.0, 0.1, 0.1, 0.2, 0.3, 0.3], None) == (None, ())
    assert rate_without_clock([], None) == (None, ())
    assert rate_without_clock([1.0], None) == (None, ())
    assert rate_without_clock([1.0, 1.0, 1.0], 8.0) == (8.0, ())


@pytest.mark.parametrize("option", ["--scan-rate=0", "--scan-rate=-5", "--scan-time=-0.1"])
@pytest.mark.parametrize("command", ["slam", "doctor"])
def test_a_rate_or_a_time_that_makes_no_sense_is_refused(
    tmp_path, records, geometry, command, option
):
    write_carmen(tmp_path / "a.log", records, geometry)
    words = [command, str(tmp_path / "a.log"), option]
    if command == "slam":
        words += ["-o", str(tmp_path / "out")]
    with pytest.raises(ConfigError, match=rf"{option.partition('=')[0]} must be"):
        TABLE.run("slamgym", words)
