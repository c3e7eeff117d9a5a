"""A single odd stamp is left out; several that agree are another clock, and nothing of that is lost."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_stand_ins import LASER, odometry, scan
from test_map_node import Drive, begin, feed

from slamgym.interop.logs import open_log
from slamgym.ros2.run_files import LOG
from slamgym.ros2.stamps import AGREEING, LONGEST_GAP, StampGate


@pytest.fixture(scope="module")
def drive():
    return Drive(30)


def gate_with_warnings():
    warnings = []
    return StampGate("scan", lambda kind, text: warnings.append(text)), warnings


def passed(gate, stamps):
    return [one.stamp for stamp in stamps for one in gate.take(stamp, None)]


@pytest.mark.parametrize("apart", [3600.0, -3600.0, LONGEST_GAP + 0.3])
def test_single_odd_stamps_are_left_out(apart):
    gate, warnings = gate_with_warnings()
    usual = [0.2 * step for step in range(1, 60)]
    given = []
    for number, stamp in enumerate(usual):
        given += [stamp + apart, stamp] if number % 9 == 5 else [stamp]
    assert passed(gate, given) == usual
    assert "left out" in warnings[0]
    assert ("ahead of" if apart > 0.0 else "behind") in warnings[0]


@pytest.mark.parametrize("jump", [3600.0, -3600.0, 30.0])
def test_stamps_that_agree_are_another_clock_and_none_is_lost(jump):
    gate, warnings = gate_with_warnings()
    before = [4000.0 + 0.2 * step for step in range(10)]
    after = [before[-1] + jump + 0.2 * step for step in range(10)]
    assert passed(gate, before + after[: AGREEING - 1]) == before
    assert passed(gate, after[AGREEING - 1 :]) == after
    assert not warnings


def test_odd_stamps_that_contradict_each_other_are_no_clock():
    gate, _ = gate_with_warnings()
    usual = [0.2 * step for step in range(1, 4)]
    odd = [1000.0 * number for number in range(1, 12)]
    assert passed(gate, usual + odd + [1.0]) == [*usual, 1.0]
    assert passed(gate, [77.0] * 20 + [1.2]) == [1.2]  # a clock that stands is none


def test_disorder_is_no_jump():
    gate, warnings = gate_with_warnings()
    stamps = [1.0, 1.4, 1.2, 1.6, 1.0, 1.8]
    assert passed(gate, stamps) == stamps
    assert not warnings


@pytest.mark.parametrize("odometry_by", ["tf", "laser"])
@pytest.mark.parametrize("ahead", [3600.0, -3600.0])
def test_a_mapper_goes_on_with_its_map(desk, drive, capfd, odometry_by, ahead):
    """The scan, the odometry, or both may have the odd stamp."""
    node = begin(desk, odometry=odometry_by)
    since = 5000.0
    for number, (odom, seen) in enumerate(drive.messages(since)):
        stamp = drive.stamps[number] + since + ahead
        if number % 6 in {2, 4}:
            desk.hand(node, "/odom", odometry(stamp, drive.odometry[number]))
        if number % 6 in {3, 4}:
            desk.hand(node, "/scan", scan(stamp, drive.ranges[number], LASER))
        desk.hand(node, "/odom", odom)
        desk.hand(node, "/scan", seen)
    shown = capfd.readouterr().err
    assert "clock jumped" not in shown
    assert shown.count("scan is stamped 3600") == 1
    sent = [one.header.stamp.sec for one in desk.sent["/pose"]]
    assert len(sent) == len(drive.stamps)
    assert list(sent) == sorted(sent)
    node.close()
    assert len(open_log(f"mapped/{LOG}").records) == len(drive.stamps)


def test_a_run_that_begins_again_is_mapped_from_its_first_scan(desk, drive, capfd):
    node = begin(desk)
    feed(desk, node, drive, since=500.0)
    feed(desk, node, drive)
    assert capfd.readouterr().err.count("clock jumped back") == 1
    poses = np.array([one.pose.pose.position.x for one in desk.sent["/pose"]])
    count = len(drive.stamps)
    np.testing.assert_array_equal(poses[:count], poses[count:])
