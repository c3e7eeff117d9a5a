"""Whatever comes, each node says it once, names what it waits for, goes on, and the robot stands."""

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from rclpy.parameter import Parameter
from ros_stand_ins import LASER, Message, Transforms, header, odometry, pose_on_map, scan, transform

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.envs import ExploreConfig
from slamgym.interop.ros_messages import grid_fields
from slamgym.ros2.exploring import ExploreNode
from slamgym.ros2.mapping import MapNode
from slamgym.ros2.node import PATIENCE, run_node
from slamgym.ros2.parameters import DemoParameters, ExploreParameters, MapParameters, SimParameters
from slamgym.ros2.simulator import SimNode

HOME = Pose2D(0.0, 0.0, 0.0)
RANGES = np.linspace(1.0, 3.0, LASER.num_beams)


def grid_message(frame="map", **info):
    cells = np.full((80, 80), UNKNOWN, np.uint8)
    cells[20:60, 20:60] = FREE
    fields = grid_fields(
        header(9.0, frame), OccupancyGrid(cells, GridFrame(0.05, -2.0, -2.0, 80, 80))
    )
    return Message(**{**fields, "info": {**fields["info"], **info}})


def make_map(desk):
    return desk.make(MapNode, MapParameters(), lambda config: config)


def make_explore(desk):
    return desk.make(ExploreNode, ExploreParameters(explorer="nearest"))


NODES = pytest.mark.parametrize("make", [make_map, make_explore])


def feed(desk, node, count, since=10.0, grid=True):
    """A usual robot, so many scans of it."""
    if grid:
        desk.hand(node, "/map", grid_message())
    for step in range(count):
        stamp = since + 0.2 * step
        desk.hand(node, "/odom", odometry(stamp, HOME))
        desk.hand(node, "/scan", scan(stamp, RANGES))
        desk.hand(node, "/pose", pose_on_map(stamp, HOME))


def watched(desk, node, seconds=PATIENCE + 1.0):
    """Let time pass, and the node look."""
    desk.later += seconds
    return desk.tick(node)


def warnings(capfd, part=""):
    shown = capfd.readouterr().err.splitlines()
    assert not any("Traceback" in line for line in shown)
    return [
        line for line in shown if "[WARN]" in line and part in line and "laser_mount" not in line
    ]


def check_works(desk, node):
    """The node takes what is right afterwards."""
    assert not node.worker.is_over
    assert node.worker.error is None
    feed(desk, node, 6, since=500.0)
    sent = desk.sent["/pose" if isinstance(node, MapNode) else "/cmd_vel"]
    if isinstance(node, MapNode):
        assert sent[-1].header.stamp.sec >= 500
    else:
        assert any(command.linear.x or command.angular.z for command in sent[-3:])


def stands(desk):
    """True if the robot was never told to move."""
    return all(not (one.linear.x or one.angular.z) for one in desk.sent.get("/cmd_vel", []))


@pytest.mark.parametrize(
    ("make", "missing"),
    [(make_map, "odom, scan"), (make_explore, "map, odom, scan")],
    ids=["map", "explore"],
)
def test_nothing_comes(desk, capfd, make, missing):
    node = make(desk)
    desk.tick(node)
    assert not warnings(capfd)  # not yet
    for _ in range(5):
        watched(desk, node)
    assert len(warnings(capfd, f"waiting for {missing}")) == 1
    assert stands(desk)
    check_works(desk, node)


@NODES
def test_no_odometry(desk, capfd, make):
    node = make(desk)
    for step in range(30):
        desk.hand(node, "/map", grid_message())
        desk.hand(node, "/scan", scan(10.0 + 0.2 * step, RANGES))
    for _ in range(3):
        desk.later += PATIENCE + 1.0
        desk.hand(node, "/scan", scan(20.0, RANGES))
        desk.tick(node)
    assert [line.rpartition("waiting for ")[2] for line in warnings(capfd)] == ["odom"]
    assert stands(desk)
    check_works(desk, node)


@NODES
def test_what_stops_coming_is_said_and_so_is_its_return(desk, capfd, make):
    node = make(desk)
    feed(desk, node, 5)
    watched(desk, node)
    watched(desk, node)
    feed(desk, node, 5, since=20.0)
    desk.tick(node)
    shown = capfd.readouterr().err
    assert shown.count("waiting for odom, scan") == 1
    assert shown.count("received odom, scan") == 1


def test_a_map_that_does_not_change_is_not_waited_for(desk, capfd):
    node = make_explore(desk)
    feed(desk, node, 3)
    for number in range(3):
        desk.later += PATIENCE + 1.0
        feed(desk, node, 3, since=20.0 + number, grid=False)
        desk.tick(node)
    assert not warnings(capfd)


@NODES
@pytest.mark.parametrize("jump", [-300.0, 300.0])
def test_the_clock_jumps(desk, capfd, make, jump):
    node = make(desk)
    feed(desk, node, 10, since=400.0)
    feed(desk, node, 10, since=400.0 + jump)
    found = warnings(capfd)
    assert len(found) == (isinstance(node, MapNode) and jump < 0.0)
    assert all("jumped back" in line for line in found)
    desk.sent.get("/cmd_vel", []).clear()
    feed(desk, node, 10, since=405.0 + jump)
    assert not node.worker.is_over
    if isinstance(node, ExploreNode):
        assert not stands(desk)


@NODES
def test_scans_and_odometry_by_two_clocks(desk, capfd, make):
    node = make(desk)
    desk.hand(node, "/map", grid_message())
    for step in range(40):
        desk.hand(node, "/odom", odometry(1.7e9 + 0.2 * step, HOME))
        desk.hand(node, "/scan", scan(10.0 + 0.2 * step, RANGES))
    assert len(warnings(capfd, "one clock")) == 1
    assert stands(desk)


@NODES
def test_scans_without_a_stamp(desk, capfd, make):
    node = make(desk)
    desk.hand(node, "/map", grid_message())
    for step in range(20):
        desk.hand(node, "/odom", odometry(10.0 + 0.2 * step, HOME))
        desk.hand(node, "/scan", scan(0.0, RANGES))
    assert len(warnings(capfd, "without a stamp")) == 1
    assert stands(desk)
    check_works(desk, node)


@NODES
def test_two_scans_of_one_moment(desk, capfd, make):
    node = make(desk)
    desk.hand(node, "/map", grid_message())
    for step in range(12):
        stamp = 10.0 + 0.2 * (step // 2)
        desk.hand(node, "/odom", odometry(stamp, HOME))
        desk.hand(node, "/scan", scan(stamp, RANGES))
        desk.hand(node, "/pose", pose_on_map(stamp, HOME))
    assert len(warnings(capfd)) == isinstance(node, MapNode)
    check_works(desk, node)


@NODES
def test_another_number_of_beams(desk, capfd, make):
    node = make(desk)
    feed(desk, node, 5)
    for step in range(10):
        stamp, beams = 11.0 + 0.2 * step, 30 + step
        desk.hand(node, "/odom", odometry(stamp, HOME))
        desk.hand(node, "/scan", scan(stamp, np.full(beams, 2.0)))
        desk.hand(node, "/pose", pose_on_map(stamp, HOME))
    assert len(warnings(capfd, "beams where the first had 90")) == 1
    check_works(desk, node)


@NODES
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.0, -1.0, 1e30])
def test_scans_of_nothing(desk, capfd, make, value):
    node = make(desk)
    desk.hand(node, "/map", grid_message())
    for step in range(10):
        stamp = 10.0 + 0.2 * step
        desk.hand(node, "/odom", odometry(stamp, HOME))
        desk.hand(node, "/scan", scan(stamp, np.full(90, value)))
        desk.hand(node, "/pose", pose_on_map(stamp, HOME))
    assert not node.worker.is_over
    check_works(desk, node)
    assert len(warnings(capfd)) <= 1


@NODES
@pytest.mark.parametrize(
    "fault",
    [{"ranges": []}, {"angle_increment": 0.0}, {"angle_min": math.nan}, {"range_min": math.nan}],
    ids=str,
)
def test_scans_that_no_laser_sends(desk, capfd, make, fault):
    node = make(desk)
    desk.hand(node, "/map", grid_message())
    for step in range(10):
        stamp = 10.0 + 0.2 * step
        desk.hand(node, "/odom", odometry(stamp, HOME))
        desk.hand(node, "/scan", scan(stamp, **{"ranges": RANGES, **fault}))
    assert len(warnings(capfd, "scan left out")) == 1
    assert stands(desk)
    check_works(desk, node)


@NODES
def test_odometry_with_broken_numbers(desk, capfd, make):
    node = make(desk)
    desk.hand(node, "/map", grid_message())
    for step in range(10):
        stamp = 10.0 + 0.2 * step
        broken = odometry(stamp, HOME._replace(x=math.nan))
        if step % 2:
            broken = odometry(stamp, HOME)
            broken.pose.pose.orientation.w = 0.0
        desk.hand(node, "/odom", broken)
        desk.hand(node, "/scan", scan(stamp, RANGES))
    found = warnings(capfd, "a message on odom is left out")
    assert len(found) == 2  # one for each kind
    assert stands(desk)
    check_works(desk, node)


def test_a_map_of_another_frame(desk, capfd):
    node = make_explore(desk)
    for _ in range(4):
        desk.hand(node, "/map", grid_message(frame="map_of_robot2"))
        feed(desk, node, 1, grid=False)
    (line,) = warnings(capfd)
    assert "'map_of_robot2'" in line
    assert "map_frame" in line
    assert stands(desk)
    assert "waiting for a map" in desk.sent["/explore/status"][-1].data
    check_works(desk, node)


@pytest.mark.parametrize(
    "info",
    [
        {"width": 81},
        {"width": 0, "height": 0},
        {"resolution": 0.0},
        {"resolution": math.nan},
        {"width": 100_000, "height": 100_000},
        {"origin": {"position": {"x": math.inf, "y": 0.0}, "orientation": {"w": 1.0}}},
        {"origin": {"position": {"x": 0.0, "y": 0.0}, "orientation": {"z": 0.5, "w": 0.9}}},
        {"origin": {"position": {"x": 0.0, "y": 0.0}, "orientation": {"w": 0.0}}},
    ],
    ids=lambda info: ",".join(info),
)
def test_maps_that_no_mapper_sends(desk, capfd, info):
    node = make_explore(desk)
    for number in range(4):
        desk.hand(node, "/map", grid_message(**info))
        feed(desk, node, 1, since=10.0 + number, grid=False)
    assert len(warnings(capfd, "a map is left out")) == 1
    assert stands(desk)
    check_works(desk, node)


def test_a_pose_of_another_frame(desk, capfd):
    node = make_explore(desk)
    desk.hand(node, "/map", grid_message())
    for step in range(10):
        stamp = 10.0 + 0.2 * step
        desk.hand(node, "/odom", odometry(stamp, HOME))
        desk.hand(node, "/scan", scan(stamp, RANGES))
        desk.hand(node, "/pose", pose_on_map(stamp, HOME, frame="world"))
    assert len(warnings(capfd, "'world'")) == 1
    assert "waiting for the robot's pose" in desk.sent["/explore/status"][-1].data
    assert stands(desk)
    check_works(desk, node)


@NODES
def test_transforms_stop_and_the_odometry_with_them(desk, capfd, make):
    node = make(desk)
    desk.hand(node, "/map", grid_message())
    for step in range(10):
        stamp = 10.0 + 0.2 * step
        both = [
            transform(stamp, "map", "odom", HOME),
            transform(stamp, "odom", "base_footprint", HOME),
        ]
        desk.hand(node, "/tf", Transforms(both[: 2 if step < 5 else 1]))
        desk.hand(node, "/scan", scan(stamp, RANGES))
    desk.later += PATIENCE + 1.0
    desk.hand(node, "/tf", Transforms([transform(20.0, "map", "odom", HOME)]))
    desk.hand(node, "/scan", scan(20.0, RANGES))
    desk.tick(node)
    assert [line.rpartition("waiting for ")[2] for line in warnings(capfd)] == ["odom"]


@NODES
def test_two_publishers_of_one_topic(desk, capfd, make):
    node = make(desk)
    node.count_publishers = lambda topic: 2 if topic == "/scan" else 1
    for _ in range(4):
        watched(desk, node)
    assert len(warnings(capfd, "scan has several publishers")) == 1


def test_only_what_a_node_uses_may_have_no_second_publisher(desk, capfd):
    """Where another navigation drives, cmd_vel has its own publishers."""
    node = desk.make(ExploreNode, ExploreParameters(drive="goals"))
    node.count_publishers = lambda topic: 2 if topic == "/cmd_vel" else 1
    watched(desk, node)
    assert not warnings(capfd, "several publishers")
    node = make_explore(desk)
    node.count_publishers = lambda topic: 2 if topic == "/cmd_vel" else 1
    watched(desk, node)
    assert len(warnings(capfd, "cmd_vel has several publishers")) == 1


@pytest.mark.parametrize(
    "words",
    [["-p", "area:=[0, 0.5]"], ["--foo"], ["-r", "scan"], ["--params-file", "nowhere.yaml"]],
    ids=str,
)
def test_arguments_that_ros_refuses(ros_domain, words):
    with pytest.raises(ConfigError, match=r"what follows --ros-args: .*(foo|scan|area|nowhere)"):
        run_node(lambda: pytest.fail("made"), ["--ros-args", *words])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_commands_with_broken_numbers(desk, value):
    class Still(SimNode):
        def _run(self):
            pass

    node = desk.make(Still, SimParameters(speed=0.0), ExploreConfig())
    twist = {"linear": {"x": value}, "angular": {"z": 1.0}}
    desk.hand(node, "/cmd_vel", Message(**twist))
    node.step()
    assert node.robot.path_length == 0.0


def test_a_worker_that_is_behind_drops_the_oldest_and_counts_it(desk, capfd):
    node = make_map(desk)
    topics = {end.topic: end.callback for end in desk.answers[node]}
    with node.worker.lock:
        for step in range(40):
            stamp = 10.0 + 0.2 * step
            topics["/odom"](odometry(stamp, HOME))
            topics["/scan"](scan(stamp, RANGES))
    desk.settle(node)
    sent = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in desk.sent["/pose"]]
    assert len(sent) + node.worker.dropped in range(40, 43)  # what waits for the scans counts, too
    assert sent[-1] == pytest.approx(10.0 + 0.2 * 39)
    desk.tick(node)
    values = {one.key: one.value for one in desk.sent["/diagnostics"][-1].status[0].values}
    assert int(values["dropped"]) == node.worker.dropped > 20


# --- parameters and names ---


def with_ros_arguments(monkeypatch, arguments):
    import rclpy

    rclpy.try_shutdown()
    rclpy.init(args=["--ros-args", *arguments])


def test_parameters_may_be_whole_numbers_and_text(desk, monkeypatch):
    words = ["area:=[0.0, 0.0, 5.0, 0.0, 5.0, 5.0]", "robot_radius:=1", "out:=there", "wait:=true"]
    with_ros_arguments(monkeypatch, [word for one in words for word in ("-p", one)])
    read = make_explore(desk).read_parameters(ExploreParameters())
    assert read.area == (0.0, 0.0, 5.0, 0.0, 5.0, 5.0)
    assert read.robot_radius == 1.0
    assert read.out == Path("there")
    assert read.wait is True


def test_a_list_of_whole_numbers_and_a_name_of_digits(desk, monkeypatch):
    words = ["area:=[0, 0, 5, 0, 5, 5]", "map_frame:=7", "explorer:=tour"]
    with_ros_arguments(monkeypatch, [word for one in words for word in ("-p", one)])
    read = make_explore(desk).read_parameters(ExploreParameters())
    assert read.area == (0.0, 0.0, 5.0, 0.0, 5.0, 5.0)
    assert read.map_frame == "7"


@pytest.mark.parametrize(
    "word", ["robot_radius:=-1.0", "robot_radius:=wide", "wait:=maybe", "area:=here", "drive:=legs"]
)
def test_parameters_that_make_no_sense_are_refused_in_a_sentence(desk, monkeypatch, word):
    with_ros_arguments(monkeypatch, ["-p", word])
    with pytest.raises(ConfigError, match=word.partition(":")[0].replace("_", "[-_]")):
        make_explore(desk)


def test_own_code_is_named_on_the_command_line_alone(desk, monkeypatch, tmp_path):
    """A file of parameters, which may be anybody's, runs no module of the folder in which the node is started."""
    (tmp_path / "evilmod.py").write_text("from pathlib import Path\nPath('run').touch()\n")
    monkeypatch.syspath_prepend(tmp_path)
    parameters = "slamgym_explore:\n  ros__parameters:\n    explorer: 'evilmod:f'\n"
    (tmp_path / "p.yaml").write_text(parameters)
    import rclpy

    rclpy.try_shutdown()
    rclpy.init(args=["--ros-args", "--params-file", str(tmp_path / "p.yaml")])
    with pytest.raises(ConfigError, match="name it on the command line"):
        make_explore(desk)
    assert not (tmp_path / "run").exists()
    with pytest.raises(ConfigError, match="evilmod"):  # there it is what the user wants
        desk.make(ExploreNode, ExploreParameters(explorer="evilmod:f"))
    assert (tmp_path / "run").exists()


@pytest.mark.parametrize("kind", [SimParameters, DemoParameters])
def test_a_seed_below_zero_is_refused_on_the_command_line(kind):
    with pytest.raises(ConfigError, match="--seed must be at least 0, not -5"):
        kind(seed=-5)


def test_a_seed_below_zero_is_refused_as_a_parameter_and_the_node_goes_on(desk, monkeypatch):
    class Still(SimNode):
        def _run(self):
            pass

    node = desk.make(Still, SimParameters(speed=0.0), ExploreConfig())
    node.set_parameters([Parameter("seed", value=-5)])
    response = desk.call(node, "reset")
    assert not response.success
    assert "--seed must be at least 0, not -5" in response.message
    assert not node.worker.is_over
    node.set_parameters([Parameter("seed", value=5)])
    assert desk.call(node, "reset").success
    with_ros_arguments(monkeypatch, ["-p", "seed:=-5"])
    with pytest.raises(ConfigError, match="--seed must be at least 0"):
        desk.make(Still, SimParameters(speed=0.0), ExploreConfig())


@NODES
def test_a_laser_that_repeats_one_reading_is_noticed_and_the_robot_stands(desk, capfd, make):
    node = make(desk)
    feed(desk, node, 6)
    for step in range(20):
        stamp, pose = 11.2 + 0.2 * step, HOME._replace(x=0.05 * step)
        desk.hand(node, "/odom", odometry(stamp, pose))
        desk.hand(node, "/scan", scan(stamp, RANGES))
        desk.hand(node, "/pose", pose_on_map(stamp, pose))
    assert len(warnings(capfd, "the laser repeats one reading while the robot moves")) == 1
    if isinstance(node, MapNode):
        assert desk.sent["/pose"][-1].header.stamp.sec < 13
        return
    desk.later += 1.1
    desk.tick(node)
    assert not desk.sent["/cmd_vel"][-1].linear.x
    assert not desk.sent["/cmd_vel"][-1].angular.z
    check_works(desk, node)


def test_topics_follow_the_namespace_and_what_belongs_to_all_does_not(desk, monkeypatch):
    with_ros_arguments(
        monkeypatch, ["-r", "__ns:=/tb3", "-r", "scan:=lidar/front", "-r", "__node:=mine"]
    )
    node = make_map(desk)
    heard = {end.topic for end in desk.answers[node]}
    assert {"/tb3/lidar/front", "/tb3/odom", "/tf", "/tf_static"} <= heard
    assert {"/tb3/map", "/tb3/pose", "/diagnostics", "/tf"} <= set(desk.sent)
    assert "/tb3/scan" not in heard
    desk.make(ExploreNode, ExploreParameters())
    assert {"/tb3/cmd_vel", "/tb3/explore/status"} <= set(desk.sent)
