"""Who joins late gets the last of what changes seldom, who asks for more than is offered nothing: docs/ros2.md."""

import json
import re

import pytest
import yaml

pytest.importorskip("rclpy")

from rclpy.qos import (
    QoSCompatibility,
    QoSDurabilityPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from source_tree import ROOT
from test_explore_node import begin as begin_explorer
from test_map_node import begin as begin_mapper

from slamgym.envs import ExploreConfig
from slamgym.ros2.node import LATCHED, RELIABLE, SENSOR
from slamgym.ros2.parameters import SimParameters
from slamgym.ros2.simulator import SimNode

PAGE = (ROOT / "docs/ros2.md").read_text()


class Still(SimNode):
    """Steps never."""

    def _run(self):
        pass


@pytest.fixture
def offered(desk):
    """How all nodes together offer their topics."""
    desk.make(Still, SimParameters(), ExploreConfig())
    begin_mapper(desk)
    begin_explorer(desk)
    return desk.qos


def is_served(offered, topic, subscriber):
    qos = offered[topic]
    publisher = QoSProfile(depth=qos) if isinstance(qos, int) else qos
    compatibility, _ = qos_check_compatible(publisher, subscriber)
    return compatibility != QoSCompatibility.ERROR


def test_a_reliable_subscriber_of_the_laser_gets_nothing_and_the_page_says_it(offered):
    assert is_served(offered, "/scan", SENSOR)
    assert not is_served(offered, "/scan", RELIABLE)
    assert re.search(r"`scan` is best effort.*\*reliable\* gets nothing", PAGE)
    for topic in ("/odom", "/map", "/pose", "/cmd_vel", "/explore/status"):
        assert is_served(offered, topic, RELIABLE), topic


def test_what_changes_seldom_is_kept_for_those_who_join_late_and_the_page_names_it(offered):
    kept = {
        topic
        for topic, qos in offered.items()
        if getattr(qos, "durability", None) == QoSDurabilityPolicy.TRANSIENT_LOCAL
    }
    named, _, _ = PAGE.partition(" are latched")
    assert kept - {"/tf_static"} == {f"/{name}" for name in re.findall(r"`([\w/]+)`", named)[-5:]}
    assert all(is_served(offered, topic, LATCHED) for topic in kept)
    assert is_served(offered, "/explore/status", LATCHED)


VIEWS = ROOT / "slamgym" / "ros2" / "views"
POLICIES = {
    "Reliable": ReliabilityPolicy.RELIABLE,
    "Best Effort": ReliabilityPolicy.BEST_EFFORT,
    "Transient Local": QoSDurabilityPolicy.TRANSIENT_LOCAL,
    "Volatile": QoSDurabilityPolicy.VOLATILE,
}


def test_rviz_asks_for_each_topic_as_it_is_offered(offered):
    shown = yaml.safe_load((VIEWS / "slamgym.rviz").read_text())["Visualization Manager"]
    assert shown["Global Options"]["Fixed Frame"] == "map"
    topics = [display["Topic"] for display in shown["Displays"] if "Topic" in display]
    assert len(topics) >= 5
    for topic in topics:
        asked = QoSProfile(
            depth=topic["Depth"],
            reliability=POLICIES[topic["Reliability Policy"]],
            durability=POLICIES[topic["Durability Policy"]],
        )
        assert is_served(offered, topic["Value"], asked), topic


def test_foxglove_shows_topics_and_services_that_are_there(offered, desk):
    panels = json.loads((VIEWS / "foxglove.json").read_text())["configById"]
    assert panels["3D!slamgym"]["topics"].keys() <= offered.keys()
    assert panels["RawMessages!status"]["topicPath"].removesuffix(".data") in offered
    services = {one.service_name for node in desk.nodes for one in node.services}
    asked = {panel["serviceName"] for panel in panels.values() if "serviceName" in panel}
    assert len(asked) == 2
    assert asked <= services


def test_there_is_a_status_within_a_second_of_the_start(desk):
    robot = begin_explorer(desk)
    desk.later += 1.1
    desk.tick(robot.node)
    assert robot.texts == ["waiting for a map"]
