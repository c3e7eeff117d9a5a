"""The explore node drives, or sends goals, on a map from anywhere; and stands still when it should."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.qos import DurabilityPolicy
from ros_stand_ins import LASER, Message, Transforms, header, odometry, pose_on_map, scan, transform

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import compose
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.interop import read_ros_map
from slamgym.interop.ros_messages import grid_fields
from slamgym.ros2 import exploring, goals
from slamgym.ros2.exploring import ExploreNode
from slamgym.ros2.parameters import ExploreParameters

HOME = Pose2D(0.0, 0.0, 0.0)
HALF = 1.9
"""Of the room's side [m]."""


def seen_from(pose):
    """Ranges to the walls of the room."""
    x, y, theta = compose(pose, LASER.mount)
    cos, sin = np.cos(theta + LASER.angles), np.sin(theta + LASER.angles)
    return np.minimum((1.9 * np.sign(cos) - x) / cos, (1.9 * np.sign(sin) - y) / sin)


def room(gap):
    """A room of 4 m with walls, of which one may have a gap to what is unknown."""
    cells = np.full((120, 120), UNKNOWN, np.uint8)
    cells[20:100, 20:100] = OCCUPIED
    cells[22:98, 22:98] = FREE
    if gap:
        cells[45:75, 98:104] = FREE
    return OccupancyGrid(cells, GridFrame(0.05, -3.0, -3.0, 120, 120))


def look(pose, gap):
    """What the laser sees from a place in the room."""
    angles = pose.theta + LASER.angles
    ahead = np.column_stack([np.cos(angles), np.sin(angles)])
    steps = (np.copysign(HALF, ahead) - np.array(pose[:2])) / ahead
    ranges = steps.min(axis=1)
    leaves = (
        (steps[:, 0] <= steps[:, 1])
        & (ahead[:, 0] > 0.0)
        & (abs(pose.y + ranges * ahead[:, 1]) < 0.75)
    )
    return np.where((leaves & gap) | (ranges > LASER.range_max), np.inf, ranges)


def map_message(grid, stamp=9.0, frame="map"):
    return Message(**grid_fields(header(stamp, frame), grid))


class Robot:
    """Feeds an explore node as a robot that stands, or obeys, would."""

    def __init__(self, desk, node, pose=HOME):
        self.desk, self.node, self.pose, self.stamp, self.gap = desk, node, pose, 10.0, True

    def map(self, gap=True, **others):
        self.gap = gap
        self.desk.hand(self.node, "/map", map_message(room(gap), **others))
        return self

    def sense(self, count=1, *, placed=True, step=0.2, obeys=False):
        """So many scans; the mapper places each if there is one. A robot that obeys goes where its commands lead."""
        for _ in range(count):
            self.stamp += step
            if obeys and self.commands:
                twist = self.commands[-1]
                moved = Pose2D(step * twist.linear.x, 0.0, step * twist.angular.z)
                self.pose = compose(self.pose, moved)
            self.desk.hand(self.node, "/odom", odometry(self.stamp, self.pose))
            self.desk.hand(self.node, "/scan", scan(self.stamp, look(self.pose, self.gap)))
            if placed:
                self.desk.hand(self.node, "/pose", pose_on_map(self.stamp, self.pose))
        return self

    def finish(self):
        """Go on until it is done."""
        for _ in range(40):
            self.sense(50, obeys=True)
            if self.texts[-1].startswith("done"):
                return self
        raise AssertionError(self.texts)

    @property
    def commands(self):
        return self.desk.sent["/cmd_vel"]

    @property
    def texts(self):
        return [message.data for message in self.desk.sent["/explore/status"]]


@pytest.fixture(autouse=True)
def drawn(monkeypatch):
    """Folders whose drawing was asked for; drawing itself takes a process."""
    folders = []
    monkeypatch.setattr(exploring, "draw_saved_map", lambda folder: folders.append(str(folder)))
    return folders


def begin(desk, **parameters):
    return Robot(
        desk, desk.make(ExploreNode, ExploreParameters(**{"explorer": "nearest", **parameters}))
    )


def is_zero(twist):
    return twist.linear.x == 0.0 and twist.angular.z == 0.0


# --- driving ---


def test_it_drives_once_map_scan_and_pose_are_there(desk):
    robot = begin(desk)
    robot.sense()
    assert is_zero(robot.commands[-1])
    robot.map().sense(5)
    assert not is_zero(robot.commands[-1])
    assert any("exploring" in text for text in robot.texts)
    assert desk.sent["/explore/frontiers"][-1].markers
    assert desk.sent["/explore/path"][-1].header.frame_id == "map"


def test_it_waits_for_the_pose_at_a_scan_but_not_for_long(desk):
    robot = begin(desk).map().sense(3)
    count = len(robot.commands)
    robot.sense(placed=False)
    assert len(robot.commands) == count
    desk.later += 0.35
    desk.tick(robot.node)
    assert len(robot.commands) == count + 1
    assert not is_zero(robot.commands[-1])


def test_without_poses_transforms_place_the_robot(desk):
    robot = begin(desk).map()
    place = Pose2D(0.5, 0.2, 1.0)
    for step in range(15):
        stamp = 10.0 + 0.2 * step
        moved = [
            transform(stamp, "odom", "base_footprint", HOME),
            transform(stamp, "map", "odom", place),
        ]
        desk.hand(robot.node, "/tf", Transforms(moved))
        desk.hand(robot.node, "/scan", scan(stamp, look(HOME, gap=True)))
    assert not is_zero(robot.commands[-1])


def test_a_robot_without_scans_is_stopped(desk):
    robot = begin(desk).map().sense(5)
    assert not is_zero(robot.commands[-1])
    desk.later += 1.1
    desk.tick(robot.node)
    assert is_zero(robot.commands[-1])
    desk.hand(robot.node, "/odom", odometry(robot.stamp + 1.0, HOME))
    desk.later += 1.1
    desk.tick(robot.node)
    assert "waiting for a scan" in robot.texts[-1]
    assert is_zero(robot.commands[-1])
    robot.stamp += 2.0
    robot.sense(2)
    assert not is_zero(robot.commands[-1])


def test_a_mapper_that_has_ended_stops_the_robot_until_another_comes(desk):
    robot = begin(desk).map().sense(5)
    robot.sense(40, placed=False)
    assert is_zero(robot.commands[-1])
    assert "waiting for the robot's pose" in robot.texts[-1]
    robot.sense(5)
    assert not is_zero(robot.commands[-1])


def test_a_fixed_place_of_the_odometry_is_never_out_of_date(desk):
    robot = begin(desk).map()
    desk.hand(robot.node, "/tf_static", Transforms([transform(0.0, "map", "odom", HOME)]))
    robot.sense(40, placed=False)
    assert not is_zero(robot.commands[-1])


def test_it_sends_the_type_that_the_robot_takes(desk):
    robot = begin(desk).map().sense(2)
    assert isinstance(robot.commands[-1], Twist)
    robot.node.get_subscriptions_info_by_topic = lambda _topic: [
        SimpleNamespace(topic_type="geometry_msgs/msg/TwistStamped")
    ]
    desk.tick(robot.node)
    robot.sense(3)
    assert isinstance(robot.commands[-1], TwistStamped)
    assert robot.commands[-1].header.frame_id == "base_footprint"
    assert not is_zero(robot.commands[-1].twist)


def test_it_ends_with_the_robot_stopped(desk):
    robot = begin(desk).map().sense(5)
    robot.node.close()
    assert is_zero(robot.commands[-1])


# --- maps ---


@pytest.mark.parametrize(
    "durability", [DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL]
)
def test_maps_are_heard_whether_or_not_their_publisher_keeps_them(desk, durability):
    robot = begin(desk)
    robot.node.get_publishers_info_by_topic = lambda _topic: [
        SimpleNamespace(topic_type="", qos_profile=SimpleNamespace(durability=durability))
    ]
    desk.tick(robot.node)
    (end,) = [end for end in desk.answers[robot.node] if end.topic == "/map"]
    assert end.qos.durability == durability
    robot.map().sense(3)
    assert not is_zero(robot.commands[-1])


def test_updates_of_the_map_are_put_into_it(desk, monkeypatch):
    monkeypatch.setattr(exploring, "OccupancyGridUpdate", Message)
    robot = begin(desk).map(gap=False).sense(10)
    known = robot.node._exploration.view().known_area
    part = np.zeros((30, 6), np.int8)
    wrong, right = (
        Message(header=header(9.5, "map"), x=x, y=45, width=6, height=30, data=part.ravel())
        for x in (118, 98)
    )
    desk.hand(robot.node, "/map_updates", wrong)
    desk.hand(robot.node, "/map_updates", right)
    robot.sense(30)
    assert robot.node._exploration.view().known_area > known


def test_a_map_from_before_a_jump_of_the_clock_is_of_another_run(desk):
    robot = begin(desk)
    robot.stamp = 400.0
    robot.map(gap=False, stamp=400.0)
    robot.finish()
    robot.stamp = 10.0
    robot.sense(5)
    assert robot.texts[-1].startswith("waiting for a map")
    robot.map(gap=True, stamp=robot.stamp)
    robot.sense(5)
    assert robot.texts[-1].startswith("exploring")
    assert not is_zero(robot.commands[-1])


# --- goals ---


class Navigation:
    """A stand-in of Nav2's action: what becomes of its goals is told beforehand."""

    def __init__(self, outcome):
        self.outcome, self.goals, self.cancelled, self.pending = outcome, [], 0, []

    def __call__(self, _node, _kind, _name):
        return self

    def server_is_ready(self):
        return self.outcome != "absent"

    def send_goal_async(self, goal):
        self.goals.append(goal.pose)
        accepted = self.outcome != "reject"
        handle = SimpleNamespace(
            accepted=accepted,
            get_result_async=lambda: Later(
                SimpleNamespace(status=6), self.outcome == "hang", self.pending
            ),
            cancel_goal_async=self.cancel,
        )
        return Later(handle, self.outcome == "late", self.pending)

    def cancel(self):
        self.cancelled += 1


class Later:
    """A future."""

    def __init__(self, value, is_late, pending):
        self.value, self.is_late, self.pending = value, is_late, pending

    def result(self):
        return self.value

    def add_done_callback(self, callback):
        if self.is_late:
            self.pending.append(lambda: callback(self))
        else:
            callback(self)


def with_navigation(desk, monkeypatch, outcome):
    navigation = Navigation(outcome)
    monkeypatch.setattr(
        goals, "NavigateToPose", SimpleNamespace(Goal=lambda pose: SimpleNamespace(pose=pose))
    )
    monkeypatch.setattr(goals, "ActionClient", navigation)
    return begin(desk, drive="goals"), navigation


def test_goals_go_to_a_topic_where_nav2_is_not_installed(desk):
    robot = begin(desk, drive="goals").map().sense(5)
    goal = desk.sent["/goal_pose"][-1]
    assert goal.header.frame_id == "map"
    assert goal.pose.position.x > 1.0  # towards the gap
    assert "/cmd_vel" not in desk.sent
    assert len(desk.sent["/goal_pose"]) == 1  # as long as it stays the same
    desk.call(robot.node, "stop")
    robot.sense()
    assert math.hypot(desk.sent["/goal_pose"][-1].pose.position.x) < 0.01  # the robot's own place


@pytest.mark.parametrize("outcome", ["abort", "reject", "absent"])
def test_a_navigation_that_gets_nowhere_blocks_the_robot_and_nothing_more(
    desk, monkeypatch, outcome, capfd
):
    robot, navigation = with_navigation(desk, monkeypatch, outcome)
    robot.map().sense(300, step=0.5)
    assert not robot.node.worker.is_over
    assert any(text.startswith("blocked") for text in robot.texts)
    assert not any(text.startswith("done") for text in robot.texts)
    if outcome == "absent":
        assert capfd.readouterr().err.count("is Nav2 running?") == 1
    else:
        assert 3 <= len(navigation.goals) <= 100


def test_a_goal_that_is_not_wanted_any_more_is_cancelled(desk, monkeypatch):
    robot, navigation = with_navigation(desk, monkeypatch, "hang")
    robot.map().sense(3)
    assert len(navigation.goals) == 1
    desk.call(robot.node, "stop")
    robot.sense(2)
    assert navigation.cancelled == 1
    desk.call(robot.node, "start")
    robot.sense(2)
    assert len(navigation.goals) == 2
    robot.node.close()
    assert navigation.cancelled == 2


def test_a_goal_that_is_accepted_too_late_is_cancelled_then(desk, monkeypatch):
    robot, navigation = with_navigation(desk, monkeypatch, "late")
    robot.map().sense(3)
    desk.call(robot.node, "stop")
    robot.sense(2)
    assert navigation.cancelled == 0
    while navigation.pending:
        navigation.pending.pop()()
    assert navigation.cancelled == 1


def test_where_another_navigation_drives_no_scan_is_needed(desk, monkeypatch):
    robot, navigation = with_navigation(desk, monkeypatch, "hang")
    robot.map()
    for step in range(3):
        desk.hand(robot.node, "/odom", odometry(10.0 + step, HOME))
        desk.hand(robot.node, "/pose", pose_on_map(10.0 + step, HOME))
        desk.later += 1.1
        desk.tick(robot.node)
    assert len(navigation.goals) == 1


# --- services ---


def test_it_starts_stops_and_lets_others_drive_meanwhile(desk):
    robot = begin(desk, wait=True).map().sense(3)
    assert all(is_zero(command) for command in robot.commands)
    count = len(robot.commands)
    robot.sense(5)
    assert len(robot.commands) == count  # a person may drive it by hand
    assert robot.texts[-1] == "paused"
    assert desk.call(robot.node, "start").success
    robot.sense(3)
    assert not is_zero(robot.commands[-1])
    desk.call(robot.node, "stop")
    robot.sense()
    assert is_zero(robot.commands[-1])
    desk.hand(robot.node, "/explore/resume", Message(data=True))
    robot.sense(3)
    assert not is_zero(robot.commands[-1])
    desk.hand(robot.node, "/explore/resume", Message(data=False))
    robot.sense()
    assert is_zero(robot.commands[-1])


def test_it_returns_to_the_start(desk):
    robot = begin(desk).map().sense(3)
    robot.pose = Pose2D(1.0, 0.5, 0.0)
    robot.sense()
    assert desk.call(robot.node, "return_to_start").success
    robot.sense(3)
    assert "returning to the start" in robot.texts
    assert not is_zero(robot.commands[-1])
    robot.sense(100, obeys=True)
    assert math.hypot(*robot.pose[:2]) < 0.3
    assert "at the start" in robot.texts[-1]
    assert is_zero(robot.commands[-1])


def test_when_it_is_done_map_and_drawing_are_made_once(desk, drawn):
    robot = begin(desk, exit=True).map(gap=False).finish()
    for _ in range(50):
        if robot.node.worker.is_over:
            break
        desk.settle(robot.node)
    assert robot.node.worker.is_over
    assert robot.node.worker.error is None
    assert drawn == ["explored"]
    assert (read_ros_map("explored/map.yaml").cells == FREE).sum() > 5000


def test_after_the_end_it_can_explore_again_and_saves_again(desk, drawn):
    robot = begin(desk).map(gap=False).finish()
    Path("explored/map.yaml").unlink()
    assert is_zero(robot.commands[-1])
    desk.call(robot.node, "start")
    robot.finish()
    assert Path("explored/map.yaml").exists()
    assert len(drawn) == 2


@pytest.mark.parametrize(
    "wrong", [{"explorer": "magellan"}, {"area": (0.0, 0.0, 1.0, 1.0)}, {"area": (0.0,) * 7}]
)
def test_what_makes_no_sense_is_refused(desk, wrong):
    with pytest.raises(ConfigError, match=r"magellan|area"):
        begin(desk, **wrong)
