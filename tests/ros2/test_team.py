"""Several robots over topics: maps merged as one node does it, and explorers that hear of each other."""

import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_stand_ins import Message, header, pose_on_map
from test_explore_node import begin, map_message
from test_gathered_maps import part

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OccupancyGrid, Pose2D
from slamgym.interop import read_ros_map
from slamgym.interop.ros_messages import grid_fields, pose_fields
from slamgym.ros2 import exploring
from slamgym.ros2.merging import MergeNode
from slamgym.ros2.parameters import ExploreParameters, MergeParameters
from slamgym.ros2.team import explorer_words

PAIR = {"robots": ("robot1", "robot2"), "starts": (0.0, 0.0, 0.0, 6.0, 1.0, 0.0)}


def published(robot, grid, stamp=9.0):
    return Message(**grid_fields(header(stamp, f"{robot}/map"), grid))


@pytest.fixture
def pair(desk, tmp_path):
    return desk.make(MergeNode, MergeParameters(**PAIR, out=tmp_path / "merged"))


def test_maps_come_out_as_one_and_to_each_robot_in_its_own_frame(desk, pair):
    desk.hand(pair, "/robot1/map", published("robot1", part(-1.0, 6.0)))
    desk.hand(pair, "/robot2/map", published("robot2", part(5.0, 15.0, Pose2D(6.0, 1.0, 0.0))))
    pair.merge()
    whole = desk.sent["/map"][-1]
    assert whole.header.frame_id == "map"
    assert whole.info.width * whole.info.resolution > 13.0
    to_second = desk.sent["/robot2/team_map"][-1]
    assert to_second.header.frame_id == "robot2/map"
    assert to_second.info.origin.position.x == pytest.approx(
        whole.info.origin.position.x - 6.0, abs=0.2
    )


def test_robots_hear_where_the_others_are(desk, pair):
    for robot in PAIR["robots"]:
        desk.hand(pair, f"/{robot}/map", published(robot, part(-1.0, 6.0)))
        desk.hand(pair, f"/{robot}/pose", pose_on_map(9.0, Pose2D(1.0, 0.0, 0.0), f"{robot}/map"))
    pair._send_places()
    (mate,) = desk.sent["/robot1/mates"][-1].poses
    assert (mate.position.x, mate.position.y) == pytest.approx((7.0, 1.0))


def test_a_robot_that_died_takes_nothing_along(desk, pair, tmp_path):
    desk.hand(pair, "/robot1/map", published("robot1", part(-1.0, 6.0)))
    desk.hand(pair, "/robot2/map", published("robot2", part(5.0, 15.0, Pose2D(6.0, 1.0, 0.0))))
    desk.hand(pair, "/robot2/pose", pose_on_map(9.0, Pose2D(1.0, 0.0, 0.0), "robot2/map"))
    pair._poses["robot2"] = (-math.inf, pair._poses["robot2"][1])
    pair._send_places()
    assert not desk.sent["/robot1/mates"], "it isn't reckoned with any more"
    pair.close()
    saved = read_ros_map(tmp_path / "merged" / "map.yaml")
    row, col = saved.frame.to_cell(13.0, 5.0)
    assert saved.cells[row, col] == FREE, "a room that only the dead one had seen"


def test_a_robot_may_join_late_and_one_frame_may_be_called_as_the_merged_one(desk, monkeypatch):
    node = desk.make(MergeNode, MergeParameters())
    topics = [
        ("/map", ["nav_msgs/msg/OccupancyGrid"]),
        ("/late/map", ["nav_msgs/msg/OccupancyGrid"]),
    ]
    monkeypatch.setattr(node, "get_topic_names_and_types", lambda: topics)
    node._discover()
    node._discover()
    desk.hand(node, "/late/map", map_message(part(-1.0, 6.0)))
    node.merge()
    assert desk.sent["/map"]
    assert desk.sent["/late/team_map"][-1].header.frame_id == "map"
    assert node._frame_below("late") == "late/map"


def test_broken_maps_are_left_out(desk, pair):
    broken = published("robot1", part(-1.0, 6.0))
    broken.info.width = 7
    desk.hand(pair, "/robot1/map", broken)
    pair.merge()
    assert not desk.sent["/map"]
    assert pair.save() == "there is no map yet"


@pytest.mark.parametrize(
    ("kind", "values", "sentence"),
    [
        (
            MergeParameters,
            {"robots": ("a", "a")},
            "two robots are called a; give each a name of its own",
        ),
        (MergeParameters, {"robots": ("a/b",)}, "can't be a namespace"),
        (
            MergeParameters,
            {"robots": ("a", "b"), "starts": (0.0,)},
            "x y theta of each of 2 robots",
        ),
        (ExploreParameters, {"robots": ()}, "a team of no robots"),
        (ExploreParameters, {"robots": ("a", "b", "a")}, "two robots are called a"),
    ],
)
def test_teams_without_sense_are_refused(kind, values, sentence):
    with pytest.raises(ConfigError, match=sentence):
        kind(**values)


def test_each_explorer_has_frames_and_folder_of_its_own(tmp_path):
    parameters = ExploreParameters(
        robots=("robot1", "robot2"), out=tmp_path, exit=True, robot_radius=0.15
    )
    words = explorer_words(parameters, "robot2")
    options = dict(zip(words[1::2], words[2::2], strict=False))
    assert words[0] == "explore"
    assert options["--map-frame"] == "robot2/map"
    assert options["--base-frame"] == "robot2/base_footprint"
    assert options["--out"] == str(tmp_path / "robot2")
    assert options["--robot-radius"] == "0.15"
    assert "--exit" in words
    assert "--robots" not in words


# --- the explorer ---


@pytest.fixture(autouse=True)
def drawn(monkeypatch):
    monkeypatch.setattr(exploring, "draw_saved_map", lambda _folder: None)


def mates(*poses):
    return Message(
        header=header(9.0, "map"), poses=[Message(**pose_fields(pose)) for pose in poses]
    )


def loop_of(robot):
    return robot.node._exploration._pilot.loop


def test_an_explorer_hears_others_and_is_alone_again_when_they_fall_silent(desk):
    robot = begin(desk).map()
    desk.hand(robot.node, "/mates", mates(Pose2D(1.0, -1.0, 0.5)))
    robot.sense(3)
    assert loop_of(robot).belief.mates == pytest.approx(np.array([[1.0, -1.0, 0.5]]))
    robot.node._team = robot.node._team._replace(heard_at=-math.inf)
    robot.sense(1)
    assert len(loop_of(robot).belief.mates) == 0


def test_what_the_team_has_mapped_is_no_frontier(desk):
    robot = begin(desk).map().sense(3)
    assert loop_of(robot).num_frontiers == 1
    known = part(-20.0, 20.0)
    everywhere = OccupancyGrid(np.full_like(known.cells, FREE), known.frame)
    desk.hand(robot.node, "/team_map", map_message(everywhere))
    robot.sense(40)
    grid = loop_of(robot).known_map()
    row, col = grid.frame.to_cell(5.0, 5.0)
    assert grid.cells[row, col] == FREE
