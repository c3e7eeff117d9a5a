"""Who joins late gets the last of what changes seldom, who asks for more than is offered nothing: docs/ros2.md."""

import re

import pytest

pytest.importorskip("rclpy")

from rclpy.qos import QoSCompatibility, QoSDurabilityPolicy, QoSProfile, qos_check_compatible
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


def test_there_is_a_status_within_a_second_of_the_start(desk):
    robot = begin_explorer(desk)
    desk.later += 1.1
    desk.tick(robot.node)
    assert robot.texts == ["waiting for a map"]
