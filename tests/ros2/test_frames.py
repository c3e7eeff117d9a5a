"""The robot's place by messages as they come: in any order, late, broken, from two sources, after a clock's jump."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ros_stand_ins import Transforms, odometry, pose_on_map, scan, transform

from slamgym.core.geometry import compose, inverse
from slamgym.core.types import Pose2D
from slamgym.interop.records import BrokenMessageError
from slamgym.ros2.frames import KEPT, MOST_WAITING, MOUNT_WAIT, PoseHistory, RobotFrames, ScanSync
from slamgym.ros2.parameters import FrameNames
from slamgym.ros2.stamps import AGREEING

RANGES = np.ones(90)
OFFSET = Pose2D(1.0, -2.0, 0.7)


def on_arc(time):
    """A robot that drives circles: a chord of 25 ms is within 1e-5 m of them."""
    return Pose2D(
        0.5 * math.sin(0.4 * time),
        0.5 - 0.5 * math.cos(0.4 * time),
        math.remainder(0.4 * time, math.tau),
    )


def assert_same_pose(one, other, within=1e-9):
    assert math.dist(one[:2], other[:2]) <= within
    assert abs(math.remainder(one.theta - other.theta, math.tau)) <= within


def make_frames(warnings=None):
    return RobotFrames(
        FrameNames(), lambda kind, text: None if warnings is None else warnings.append((kind, text))
    )


class Receiver:
    """Takes what is delivered, and warnings."""

    def __init__(self):
        self.got, self.warnings = [], []
        self.frames = make_frames(self.warnings)
        self.sync = ScanSync(
            self.frames,
            lambda _message, stamp, pose: self.got.append((stamp, pose)),
            lambda kind, text: self.warnings.append((kind, text)),
        )

    def odometry(self, stamp, pose=None):
        self.frames.take_odometry(odometry(stamp, pose or on_arc(stamp)))
        self.sync.flush()

    def scan(self, stamp):
        self.sync.take(scan(stamp, RANGES))


# --- the history ---


def test_between_two_poses_it_is_interpolated_along_the_arc():
    history = PoseHistory()
    history.add(1.0, Pose2D(0.0, 0.0, 3.1))
    history.add(2.0, Pose2D(1.0, 0.0, -3.1))
    middle = history.at(1.5)
    assert abs(middle.theta) == pytest.approx(math.pi)  # the short way round
    assert middle.x == pytest.approx(0.5, abs=0.05)
    assert_same_pose(history.at(1.0), Pose2D(0.0, 0.0, 3.1))
    assert_same_pose(history.at(2.0), Pose2D(1.0, 0.0, -3.1))
    assert history.at(0.9) is None
    assert history.at(2.1) is None


def test_a_gap_is_not_bridged():
    history = PoseHistory()
    history.add(1.0, OFFSET)
    history.add(3.0, OFFSET)
    assert history.at(2.0) is None


def test_what_is_out_of_order_is_left_out_and_a_jump_back_begins_again():
    history = PoseHistory()
    for stamp in (10.0, 10.2, 10.1, 10.2):
        assert not history.add(stamp, Pose2D(stamp, 0.0, 0.0))
    assert list(history.stamps) == [10.0, 10.2]
    assert history.add(2.0, OFFSET)
    assert list(history.stamps) == [2.0]
    assert history.newest == 2.0


def test_it_keeps_no_more_than_it_needs():
    history = PoseHistory()
    for step in range(3 * KEPT):
        history.add(0.01 * step, OFFSET)
    assert len(history.stamps) == len(history.poses) == KEPT


# --- scans and odometry ---


@settings(max_examples=25)
@given(
    st.lists(st.floats(0.0, 1.5), min_size=12, max_size=12),
    st.floats(0.0, 0.199),
    st.floats(0.0, 0.02499),
)
def test_in_whatever_order_they_arrive_no_scan_is_lost(delays, scans_begin, odometry_begins):
    """5 Hz against 40 Hz; each topic keeps its order, but either may be late."""
    events, last = [], 0.0
    for step, delay in zip(
        range(5, 17), delays, strict=True
    ):  # scans, each later than the one before
        stamp = scans_begin + 0.2 * step
        last = max(last, stamp + delay)
        events.append((last, "scan", stamp))
    events += [(stamp, "odom", stamp) for stamp in odometry_begins + 0.025 * np.arange(150)]
    for late in (0.0, 1.4):
        receiver = Receiver()
        shifted = [
            (at + (late if kind == "odom" else 0.0), kind, stamp) for at, kind, stamp in events
        ]
        for _, kind, stamp in sorted(shifted):
            (receiver.scan if kind == "scan" else receiver.odometry)(stamp)
        assert [stamp for stamp, _ in receiver.got] == pytest.approx(
            [s for _, k, s in events if k == "scan"]
        )
        for stamp, pose in receiver.got:
            assert_same_pose(pose, on_arc(stamp), within=1e-5)
        assert receiver.sync.dropped == 0
        assert not receiver.warnings


def test_a_scan_of_the_same_moment_has_that_very_pose():
    receiver = Receiver()
    receiver.scan(1.0)
    receiver.odometry(1.0)
    assert_same_pose(receiver.got[0][1], on_arc(1.0))


def test_scans_before_the_first_odometry_are_left_out_without_a_word():
    receiver = Receiver()
    for stamp in (0.2, 0.4, 0.6):
        receiver.scan(stamp)
    receiver.odometry(0.5)
    receiver.odometry(0.7)
    assert [stamp for stamp, _ in receiver.got] == [pytest.approx(0.6)]
    assert receiver.sync.dropped == 2
    assert not receiver.warnings


@pytest.mark.parametrize("lag", [1.7e9, -1.7e9])
def test_two_clocks_are_noticed(lag):
    receiver = Receiver()
    for step in range(3 * MOST_WAITING):
        receiver.odometry(1.7e9 + 0.2 * step)
        receiver.scan(1.7e9 + 0.2 * step + lag)
    assert not receiver.got
    assert {kind for kind, _ in receiver.warnings} == {"stamps"}
    assert "one clock" in receiver.warnings[0][1]


def test_after_a_jump_back_scans_go_on_at_once():
    receiver = Receiver()
    receiver.odometry(100.0)
    receiver.scan(100.1)  # waits for odometry that never comes
    for step in range(AGREEING):
        receiver.odometry(5.0 + 0.01 * step)
    receiver.scan(5.1)
    receiver.odometry(5.2)
    assert [stamp for stamp, _ in receiver.got] == [pytest.approx(5.1)]


def test_the_place_on_the_map_is_forgotten_when_the_clock_jumps_back():
    frames = make_frames()
    frames.take_odometry(odometry(50.0, OFFSET))
    frames.take_pose(pose_on_map(50.0, Pose2D(0.0, 0.0, 0.0)))
    assert_same_pose(frames.on_map(OFFSET), Pose2D(0.0, 0.0, 0.0))
    for step in range(AGREEING):
        assert frames.on_map(OFFSET) is not None
        frames.take_odometry(odometry(1.0 + 0.02 * step, OFFSET))
    assert len(frames.odometry.stamps) == AGREEING
    assert frames.on_map(OFFSET) is None
    assert frames.pose_stamp == frames.map_stamp == -math.inf


def test_where_there_are_transforms_that_of_the_laser_is_waited_for_but_not_for_ever():
    """A scan may overtake /tf_static; and some robots have no transform of their laser."""
    fixed = Transforms([transform(0.0, "base_footprint", "base_scan", OFFSET)])
    for comes_at, first in ((1.0, 1.0), (None, MOUNT_WAIT)):
        receiver = Receiver()
        for step in range(20):
            moved = [transform(10.0 + 0.2 * step, "odom", "base_footprint", on_arc(step))]
            receiver.frames.take_transforms(Transforms(moved), static=False)
            if comes_at is not None and 0.2 * step >= comes_at:
                receiver.frames.take_transforms(fixed, static=True)
            receiver.scan(10.0 + 0.2 * step)
        assert receiver.got[0][0] == pytest.approx(10.0 + first)
        assert not receiver.warnings


# --- transforms ---


def test_transforms_are_preferred_to_odometry():
    frames = make_frames()
    frames.take_odometry(odometry(1.0, Pose2D(9.0, 9.0, 0.0)))
    assert frames.take_transforms(
        Transforms([transform(1.0, "odom", "base_footprint", OFFSET)]), static=False
    )
    frames.take_odometry(odometry(1.1, Pose2D(9.0, 9.0, 0.0)))
    assert list(frames.odometry.stamps) == [1.0]
    assert_same_pose(frames.odometry.at(1.0), OFFSET)


def test_the_map_is_placed_by_a_transform_or_by_a_pose():
    by_pose, by_transform = make_frames(), make_frames()
    here, believed = OFFSET, Pose2D(3.0, 1.0, -2.0)
    place = compose(believed, inverse(here))
    for frames in (by_pose, by_transform):
        assert frames.on_map(here) is None
        frames.take_transforms(
            Transforms([transform(11.0, "/odom", "base_footprint", here)]), static=False
        )
    by_pose.take_pose(pose_on_map(11.0, believed))
    assert not by_transform.take_transforms(
        Transforms([transform(11.3, "map", "odom", place)]), static=False
    )
    for frames in (by_pose, by_transform):
        assert_same_pose(frames.on_map(here), believed)
        assert frames.map_stamp == 11.0  # by the odometry's clock
    by_transform.take_transforms(Transforms([transform(0.0, "map", "odom", OFFSET)]), static=True)
    for step in range(AGREEING):
        moved = transform(0.5 + 0.02 * step, "odom", "base_footprint", here)
        by_transform.take_transforms(Transforms([moved]), static=False)
    assert by_transform.odometry.newest < 1.0
    assert by_transform.map_stamp == math.inf  # a fixed one is never out of date
    assert_same_pose(by_transform.on_map(here), compose(OFFSET, here))


def test_a_pose_of_an_unknown_moment_is_no_use():
    frames = make_frames()
    frames.take_odometry(odometry(1.0, OFFSET))
    frames.take_pose(pose_on_map(2.0, OFFSET))
    assert frames.on_map(OFFSET) is None


def test_the_mount_is_found_over_a_chain_of_frames():
    frames = make_frames()
    assert frames.mount("base_scan") is None
    links = [("base_footprint", "base_link"), ("base_link", "mast"), ("mast", "base_scan")]
    poses = [Pose2D(0.1, 0.0, 0.0), Pose2D(0.0, 0.2, math.pi / 2), Pose2D(0.3, 0.0, 0.0)]
    for (parent, child), pose in zip(reversed(links), reversed(poses), strict=True):
        assert frames.mount("base_scan") is None
        frames.take_transforms(
            Transforms([transform(0.0, parent, child, pose, z=0.1)]), static=True
        )
    mount, flipped = frames.mount("base_scan")
    assert_same_pose(mount, Pose2D(0.1, 0.5, math.pi / 2))
    assert not flipped


def test_the_base_may_hang_beside_the_laser():
    """Nav2's robots have base_footprint below base_link."""
    frames = make_frames()
    frames.take_transforms(
        Transforms(
            [
                transform(0.0, "base_link", "base_footprint", Pose2D(0.0, 0.0, 0.0), z=-0.05),
                transform(0.0, "base_link", "laser", Pose2D(0.2, 0.1, 0.5), flipped=True),
            ]
        ),
        static=True,
    )
    mount, flipped = frames.mount("laser")
    assert_same_pose(mount, Pose2D(0.2, 0.1, 0.5))
    assert flipped


def test_broken_transforms_are_left_out_one_by_one():
    frames = make_frames()
    zero = transform(1.0, "odom", "base_footprint", OFFSET)
    zero.transform.rotation.z = zero.transform.rotation.w = 0.0
    nan = transform(1.1, "odom", "base_footprint", OFFSET._replace(x=math.nan))
    good = transform(1.2, "odom", "base_footprint", OFFSET)
    assert frames.take_transforms(Transforms([zero, nan, good]), static=False)
    assert list(frames.odometry.stamps) == pytest.approx([1.2])
    assert not frames.take_transforms(Transforms([zero]), static=False)


def test_broken_odometry_is_refused():
    frames = make_frames()
    zero = odometry(1.0, OFFSET)
    zero.pose.pose.orientation.z = zero.pose.pose.orientation.w = 0.0
    with pytest.raises(BrokenMessageError, match="quaternion of zeros"):
        frames.take_odometry(zero)
    with pytest.raises(ValueError, match="broken numbers"):
        frames.take_odometry(odometry(1.0, OFFSET._replace(y=math.inf)))
    assert not frames.odometry.stamps


def test_two_turns_apart_nothing_is_wound_up():
    """Headings over many turns stay small, and the way between two of them short."""
    receiver = Receiver()
    for step in range(400):
        receiver.odometry(0.1 * step)
        receiver.scan(0.1 * step - 0.05)
    headings = [pose.theta for _, pose in receiver.got]
    assert all(abs(math.remainder(b - a, math.tau)) < 0.05 for a, b in pairwise(headings))
