"""The simulated robot is the environment's, to the bit, and obeys as a TurtleBot3 does."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from rclpy.parameter import Parameter

from slamgym.core.errors import ConfigError
from slamgym.core.types import OCCUPIED
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.interop import read_ros_map
from slamgym.ros2.exploring import ExploreNode
from slamgym.ros2.mapping import MapNode
from slamgym.ros2.node import fill
from slamgym.ros2.parameters import ExploreParameters, MapParameters, SimParameters
from slamgym.ros2.sim_clock import BEGIN
from slamgym.ros2.simulator import SimNode
from slamgym.sim import LidarConfig, lidar_level, odometry_level

CONFIG = ExploreConfig(lidar=LidarConfig(sweep=0.0))
STEP = CONFIG.control_step
FAST = {"speed": 0.0}


class Still(SimNode):
    """Steps only when it is told to."""

    def _run(self):
        pass


def command(linear, angular=0.0):
    return fill(Twist(), {"linear": {"x": linear}, "angular": {"z": angular}})


def commands(count):
    rng = np.random.default_rng(3)
    return list(zip(rng.uniform(-0.05, 0.26, count), rng.uniform(-1.0, 1.0, count), strict=True))


def environment(seed, drive, **options):
    """Scans, true poses, odometry and coverage of an environment."""
    env = ExploreEnv(
        "bundled",
        localization="dead_reckoning",
        actions="physical",
        record=True,
        lidar=CONFIG.lidar,
    )
    _, info = env.reset(seed=seed, options=options or None)
    for action in drive:
        info = env.step(np.array(action))[4]
    return env.log, info


def drive_all(desk, node, drive):
    for linear, angular in drive:
        desk.hand(node, "/cmd_vel", command(linear, angular))
        node.step()


def check_same(desk, log, first=0):
    scans, odoms = desk.sent["/scan"][first:], desk.sent["/odom"][first:]
    assert len(scans) == len(log.stamps)
    for number, (scan, odom) in enumerate(zip(scans, odoms, strict=True)):
        np.testing.assert_array_equal(np.array(scan.ranges, np.float32), log.ranges[number])
        assert (odom.pose.pose.position.x, odom.pose.pose.position.y) == tuple(
            log.odometry[number, :2]
        )
        stamp = scan.header.stamp.sec + 1e-9 * scan.header.stamp.nanosec
        assert stamp == pytest.approx(BEGIN + log.stamps[number])
    assert scans[0].header.frame_id == "base_scan"
    return scans


def test_the_same_seed_and_commands_give_the_scans_of_the_environment(desk):
    drive = commands(40)
    node = desk.make(Still, SimParameters(seed=4, **FAST), CONFIG)
    node.publish()
    drive_all(desk, node, drive)
    log, info = environment(4, drive)
    scans = check_same(desk, log)
    assert np.isinf([scan.ranges for scan in scans]).any()  # REP 117: nothing came back
    start = node.robot.start
    for message, true in zip(desk.sent["/ground_truth/pose"], log.true_poses, strict=True):
        place = message.pose.position
        assert (place.x, place.y) == pytest.approx(
            (true[0] - start.x, true[1] - start.y), abs=1e-12
        )
    assert desk.sent["/ground_truth/coverage"][-1].data == pytest.approx(info["coverage"], abs=1e-6)


def test_a_reset_takes_plan_start_and_seed(desk):
    drive, plan = commands(10), "home_000007"
    node = desk.make(Still, SimParameters(seed=1, **FAST), CONFIG)
    node.publish()
    drive_all(desk, node, commands(3))
    start = (8.2, 0.9, 0.5)
    node.set_parameters(
        [
            Parameter("plan", value=plan),
            Parameter("seed", value=7),
            Parameter("start", value=list(start)),
        ]
    )
    first = len(desk.sent["/scan"])
    assert desk.call(node, "reset").success
    drive_all(desk, node, drive)
    check_same(desk, environment(7, drive, plan=plan, start=start)[0], first)


def test_a_reset_that_is_impossible_changes_nothing(desk):
    node = desk.make(Still, SimParameters(seed=1, **FAST), CONFIG)
    before = node.robot
    node.set_parameters([Parameter("plan", value="atlantis"), Parameter("seed", value=2)])
    response = desk.call(node, "reset")
    assert not response.success
    assert "atlantis" in response.message
    assert node.robot is before
    node.set_parameters([Parameter("plan", value="")])
    assert desk.call(node, "reset").success


@pytest.mark.parametrize("kind", [Node, SimNode, MapNode, ExploreNode])
def test_a_node_keeps_what_rclpy_gives_it(desk, kind):
    """rclpy's own attributes aren't private by name: `_parameters`, `_clock` and others must stay its."""
    made = {
        Node: lambda: Node("plain"),
        SimNode: lambda: desk.make(Still, SimParameters(**FAST), CONFIG),
        MapNode: lambda: desk.make(MapNode, MapParameters(), lambda config: config),
        ExploreNode: lambda: desk.make(ExploreNode, ExploreParameters()),
    }
    plain, node = made[Node](), made[kind]()
    for name, value in vars(plain).items():
        assert type(getattr(node, name)) is type(value), name


@pytest.mark.parametrize("wrong", [{"start": (1.0, 2.0)}, {"plan": "atlantis"}])
def test_wrong_parameters_are_refused_in_a_sentence(desk, wrong):
    with pytest.raises(ConfigError, match=r"start must be x, y, theta|atlantis"):
        SimNode(SimParameters(**wrong), CONFIG)


def test_it_stops_half_a_second_after_the_last_command(desk):
    node = desk.make(Still, SimParameters(seed=2, **FAST), CONFIG)
    desk.hand(node, "/cmd_vel", command(0.0, 1.0))
    headings = []
    for _ in range(12):
        node.step()
        headings.append(node.robot.true_pose.theta)
    turned = np.abs(np.unwrap(headings) - headings[0])
    assert turned[2] > 0.2
    assert turned[-1] == pytest.approx(turned[-3], abs=1e-9)
    assert turned[-1] < 1.0 * (0.5 + 3 * STEP)


def test_it_takes_both_types_of_command_and_none_that_is_broken(desk):
    node = desk.make(Still, SimParameters(seed=2, **FAST), CONFIG)
    kinds = {end.kind for end in desk.answers[node] if end.topic == "/cmd_vel"}
    assert kinds == {Twist}
    node.get_publishers_info_by_topic = lambda _topic: [
        type("End", (), {"topic_type": "geometry_msgs/msg/TwistStamped"})
    ]
    desk.tick(node)
    assert {end.kind for end in desk.answers[node] if end.topic == "/cmd_vel"} == {TwistStamped}
    desk.hand(node, "/cmd_vel", fill(TwistStamped(), {"twist": {"linear": {"x": 0.2}}}))
    desk.hand(node, "/cmd_vel", fill(TwistStamped(), {"twist": {"linear": {"x": float("nan")}}}))
    before = node.robot.path_length
    node.step()
    assert node.robot.path_length > before


def test_without_commands_it_stands_and_its_topics_go_on(desk):
    node = desk.make(Still, SimParameters(seed=2, **FAST), CONFIG)
    before = node.robot.true_pose
    for _ in range(5):
        node.step()
    assert node.robot.true_pose == before
    assert len(desk.sent["/scan"]) == len(desk.sent["/tf"]) == len(desk.sent["/clock"]) == 5


def test_transforms_say_the_same_as_the_odometry(desk):
    node = desk.make(Still, SimParameters(seed=2, **FAST), CONFIG)
    drive_all(desk, node, commands(5))
    for odom, transforms in zip(desk.sent["/odom"], desk.sent["/tf"], strict=True):
        (moved,) = transforms.transforms
        assert (moved.header.frame_id, moved.child_frame_id) == ("odom", "base_footprint")
        assert moved.header.stamp == odom.header.stamp
        assert moved.transform.translation.x == odom.pose.pose.position.x
        assert moved.transform.rotation.z == odom.pose.pose.orientation.z


def frames(message):
    return [(one.header.frame_id, one.child_frame_id) for one in message.transforms]


def test_one_message_says_all_fixed_frames_as_only_the_last_is_kept(desk):
    desk.make(Still, SimParameters(seed=2, **FAST), CONFIG)
    (fixed,) = desk.sent["/tf_static"]
    assert frames(fixed) == [("base_footprint", "base_link"), ("base_link", "base_scan")]
    assert fixed.transforms[1].transform.translation.x == CONFIG.lidar.mount[0]
    assert laser_height(fixed) == pytest.approx(0.132)  # a Waffle Pi's


def laser_height(fixed):
    """Of the laser over the floor [m]."""
    return sum(one.transform.translation.z for one in fixed.transforms)


def test_frames_are_parameters_and_a_robot_may_have_one_less(desk):
    names = {"odom_frame": "o", "base_frame": "b", "body_frame": "b", "laser_frame": "l"}
    node = desk.make(Still, SimParameters(seed=2, **names, **FAST), CONFIG)
    node.step()
    assert frames(desk.sent["/tf_static"][0]) == [("b", "l")]
    assert laser_height(desk.sent["/tf_static"][0]) == pytest.approx(0.132)
    assert frames(desk.sent["/tf"][0]) == [("o", "b")]
    odom = desk.sent["/odom"][0]
    assert (odom.header.frame_id, odom.child_frame_id) == ("o", "b")
    assert desk.sent["/scan"][0].header.frame_id == "l"


def test_in_real_time_odometry_comes_30_times_a_second_and_leads_from_scan_to_scan(desk):
    node = desk.make(Still, SimParameters(seed=2, **FAST), CONFIG)
    node.publish()
    due = 0.0
    for _ in range(3):
        desk.hand(node, "/cmd_vel", command(0.2))
        due = node._step_in_time(due, 0.0)
    stamps = np.array([seconds_of(odom) for odom in desk.sent["/odom"]])
    np.testing.assert_allclose(np.diff(stamps), STEP / 6, atol=1e-6)
    assert len(desk.sent["/tf"]) == len(stamps) == 19
    assert len(desk.sent["/scan"]) == 4
    places = [odom.pose.pose.position for odom in desk.sent["/odom"]]
    driven = np.hypot(*np.diff([(place.x, place.y) for place in places], axis=0).T)
    assert driven.sum() > 0.08
    # In the last step the robot has its speed: it goes on evenly, up to the scan.
    assert driven[12:] == pytest.approx(driven[12:].mean(), rel=1e-6)
    shown = [one.clock.sec + 1e-9 * one.clock.nanosec for one in desk.sent["/clock"]]
    assert (np.diff(shown) > 0.0).all()


def test_a_parameter_that_the_node_does_not_have_is_named(desk, capfd):
    rclpy.try_shutdown()
    rclpy.init(args=["--ros-args", "-p", "laser_fram:=l"])
    desk.make(Still, SimParameters(seed=2, **FAST), CONFIG)
    assert "no parameter 'laser_fram'; did you mean 'laser_frame'?" in capfd.readouterr().err


def seconds_of(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def test_a_laser_that_sweeps_is_mapped_as_one_that_measures_at_once(desk, tmp_path):
    turns = [(0.1, 1.5 * (-1) ** (step // 8)) for step in range(40)]
    walls = {}
    for sweep in (0.0, 0.1):
        exact = lidar_level("exact", LidarConfig(sweep=sweep, range_max=8.0))
        config = ExploreConfig(lidar=exact, odometry=odometry_level("ideal"))
        desk.sent.clear()
        node = desk.make(Still, SimParameters(seed=4, plan="home_000007", **FAST), config)
        node.publish()
        drive_all(desk, node, turns)
        folder = tmp_path / f"{sweep}"
        mapper = desk.make(MapNode, MapParameters(out=folder), lambda config: config)
        scans = list(desk.sent["/scan"])
        odoms = list(desk.sent["/odom"])
        desk.sent["/pose"].clear()
        for odom, scan in zip(odoms, scans, strict=True):
            desk.hand(mapper, "/odom", odom)
            desk.hand(mapper, "/scan", scan)
            assert seconds_of(odom) - seconds_of(scan) == pytest.approx(sweep)
            assert scan.time_increment * 179 == pytest.approx(sweep)
        # The odometry is ideal, but walls get thick if beams are misplaced.
        assert desk.call(mapper, "save").success
        walls[sweep] = (read_ros_map(folder / "map.yaml").cells == OCCUPIED).sum()
    assert walls[0.1] < 1.15 * walls[0.0]  # twice as many if the scans are taken as made at once
