"""A lifecycle manager configures, activates and deactivates mapper and explorer; without one they begin at once."""

import pytest

pytest.importorskip("rclpy")

from test_explore_node import begin as begin_explorer
from test_map_node import Drive, feed
from test_map_node import begin as begin_mapper

from slamgym.interop import read_ros_map


@pytest.fixture(scope="module")
def drive():
    return Drive(30)


def state_of(node):
    return node._state_machine.current_state[1]


def test_nodes_are_active_from_the_start_by_default(desk):
    assert state_of(begin_mapper(desk)) == "active"
    assert state_of(begin_explorer(desk).node) == "active"


def test_a_mapper_maps_while_it_is_active_and_goes_on_with_its_map(desk, drive):
    node = begin_mapper(desk, autostart=False)
    assert state_of(node) == "unconfigured"
    feed(desk, node, drive, steps=5)
    node.trigger_configure()
    feed(desk, node, drive, since=10.0, steps=5)
    assert not desk.sent["/pose"]
    node.trigger_activate()
    feed(desk, node, drive, since=20.0, steps=5)
    assert len(desk.sent["/pose"]) == 5
    desk.tick(node)
    transforms = len(desk.sent["/tf"])
    assert transforms > 0
    node.trigger_deactivate()
    feed(desk, node, drive, since=30.0, steps=5)
    desk.tick(node)
    assert len(desk.sent["/pose"]) == 5
    assert len(desk.sent["/tf"]) == transforms
    mapper = node._run.mapper
    node.trigger_activate()
    feed(desk, node, drive, since=40.0, steps=5)
    assert node._run.mapper is mapper
    assert len(desk.sent["/pose"]) == 10


def test_cleaning_up_puts_the_map_aside(desk, drive):
    node = begin_mapper(desk)
    feed(desk, node, drive, steps=10)
    node.trigger_deactivate()
    node.trigger_cleanup()
    desk.settle(node)
    assert state_of(node) == "unconfigured"
    assert read_ros_map("mapped/run1/map.yaml").cells.size
    assert node._run.mapper is None


def test_a_robot_stands_until_the_explorer_is_active_and_as_soon_as_it_is_not(desk):
    robot = begin_explorer(desk, autostart=False)
    node = robot.node
    robot.map().sense(10)
    assert not any(one.linear.x or one.angular.z for one in robot.commands)
    node.trigger_configure()
    node.trigger_activate()
    robot.sense(10)
    assert any(one.linear.x or one.angular.z for one in robot.commands)
    node.trigger_deactivate()
    count = len(robot.commands) - 1
    robot.sense(10)
    assert not any(one.linear.x or one.angular.z for one in robot.commands[count:])


def test_shutting_down_ends_the_node(desk):
    node = begin_mapper(desk)
    node.trigger_shutdown()
    assert node.worker.is_over
