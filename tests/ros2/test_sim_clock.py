"""Simulators in namespaces share one clock: the first has it, the others go by it."""

import itertools
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from rclpy.node import Node
from ros_stand_ins import Message

from slamgym.envs import ExploreConfig
from slamgym.interop.ros_messages import time_fields
from slamgym.ros2.parameters import SimParameters
from slamgym.ros2.sim_clock import BEGIN
from slamgym.ros2.simulator import SimNode
from slamgym.sim import LidarConfig

CONFIG = ExploreConfig(lidar=LidarConfig(sweep=0.0))
"""So a scan is stamped when its step ends."""
STEP = CONFIG.control_step


class Still(SimNode):
    """Steps only when it is told to."""

    def _run(self):
        pass


def make(desk, monkeypatch, *others):
    """A simulator, and simulators of other names whose clocks are on the topic."""
    monkeypatch.setattr("slamgym.ros2.sim_clock.LISTENING_TIME", 0.01)
    monkeypatch.setattr("slamgym.ros2.sim_clock.STILL_TIME", 0.01)
    node = desk.make(Still, SimParameters(seed=2, speed=0.0), CONFIG)
    have_clocks(node, itertools.repeat(others))
    return node


def have_clocks(node, names):
    """Let nodes of such names publish the clock whenever one asks, each time the next ones."""

    def ends(topic):
        shown = next(names) if topic == "/clock" else ()
        return [SimpleNamespace(node_namespace="/", node_name=name) for name in shown]

    node.get_publishers_info_by_topic = ends


def stamps(desk, topic="/scan"):
    return [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in desk.sent[topic]]


@pytest.mark.parametrize("others", [(), ("slamgym_sim",), ("slamgym_sim", "z")])
def test_alone_or_first_by_name_it_publishes_the_clock(desk, monkeypatch, others):
    node = make(desk, monkeypatch, *others)
    node._time.find_leader()
    node.publish()
    node.step()
    shown = [one.clock.sec + 1e-9 * one.clock.nanosec for one in desk.sent["/clock"]]
    assert shown == pytest.approx([BEGIN, BEGIN + STEP]) == stamps(desk)
    assert not [end for end in desk.answers[node] if end.topic == "/clock"]


def test_where_another_is_first_by_name_it_publishes_none(desk, monkeypatch, capfd):
    node = make(desk, monkeypatch, "slamgym_sim", "a_sim")
    node._time.find_leader()
    node.publish()
    assert not desk.sent["/clock"]
    assert "another simulator publishes /clock" in capfd.readouterr().err


def test_it_steps_when_the_other_s_clock_says_so(desk, monkeypatch, capfd):
    node = make(desk, monkeypatch, "a_sim")
    node._time._ticked.set()  # the other's clock is heard while it is listened for
    node._time._heard = 77.0
    node._time.find_leader()
    node.publish()
    assert stamps(desk) == [77.0]
    assert not node._wait_for_leader()  # it stands
    listening = node._time._take
    listening(Message(clock=time_fields(round((77.0 + 0.9 * STEP) * 1e9))))
    assert not node._wait_for_leader()
    listening(Message(clock=time_fields(round((77.0 + 2.0 * STEP) * 1e9))))
    for _ in range(2):
        assert node._wait_for_leader()
        node.step()
    assert not node._wait_for_leader()
    assert stamps(desk) == pytest.approx([77.0, 77.0 + STEP, 77.0 + 2.0 * STEP])
    assert not desk.sent["/clock"]


def test_after_resets_of_either_no_stamp_is_ahead_of_the_clock(desk, monkeypatch):
    node = make(desk, monkeypatch, "a_sim")
    node._time._ticked.set()
    node._time._heard = 77.0
    node._time.find_leader()
    node.publish()
    node._time._take(Message(clock=time_fields(round((77.0 + STEP) * 1e9))))
    assert node._wait_for_leader()
    node.step()
    assert desk.call(node, "reset").success
    assert stamps(desk)[-1] == pytest.approx(77.0 + STEP)  # its own reset moves no clock
    node._time._take(Message(clock=time_fields(round(BEGIN * 1e9))))  # that of the other does
    assert not node._wait_for_leader()
    node._time._take(Message(clock=time_fields(round((BEGIN + STEP) * 1e9))))
    assert node._wait_for_leader()
    node.step()
    assert stamps(desk)[-1] == pytest.approx(BEGIN + STEP)


class Wire(list):
    """Messages of one topic, which all nodes hear that listen to it."""

    def __init__(self, desk, topic):
        super().__init__()
        self.desk, self.topic = desk, topic

    def append(self, message):
        super().append(message)
        for ends in self.desk.answers.values():
            for end in list(ends):
                if end.topic == self.topic:
                    end.callback(message)


def test_two_in_namespaces_have_one_clock_that_runs_forwards(desk, monkeypatch):
    spaces = iter(("/tb1", "/tb2"))
    with monkeypatch.context() as patch:
        plain = Node.__init__
        patch.setattr(
            Node, "__init__", lambda node, name: plain(node, name, namespace=next(spaces))
        )
        desk.sent["/clock"] = Wire(desk, "/clock")
        first, second = (make(desk, monkeypatch) for _ in range(2))
    ends = [
        SimpleNamespace(node_namespace=node.get_namespace(), node_name=node.get_name())
        for node in (first, second)
    ]
    for node in (first, second):
        node.get_publishers_info_by_topic = lambda topic: ends if topic == "/clock" else []
        node._time.find_leader()
        node.publish()
    assert (first._time.is_led, second._time.is_led) == (False, True)
    for _ in range(20):
        first.step()
        while second._wait_for_leader():
            second.step()
            now = desk.sent["/clock"][-1].clock
            assert stamps(desk, "/tb2/scan")[-1] <= now.sec + 1e-9 * now.nanosec + 1e-6
    shown = [one.clock.sec + 1e-9 * one.clock.nanosec for one in desk.sent["/clock"]]
    assert shown == pytest.approx([BEGIN + STEP * number for number in range(21)])
    assert stamps(desk, "/tb1/scan") == pytest.approx(shown)
    assert stamps(desk, "/tb2/scan") == pytest.approx(shown)


def test_a_clock_that_stands_is_waited_for_and_said(desk, monkeypatch, capfd):
    node = make(desk, monkeypatch, "a_sim")
    node._time.find_leader()
    desk.later += 5.0
    desk.tick(node)
    assert "waiting for /clock" in capfd.readouterr().err


@pytest.mark.parametrize(("heirs", "leads"), [((), True), (("z_sim",), True), (("a_sim",), False)])
def test_where_the_leader_has_ended_the_first_by_name_of_the_others_leads_on(
    desk, monkeypatch, capfd, heirs, leads
):
    node = make(desk, monkeypatch, "a_sim")
    node._time.find_leader()
    node.publish()
    node._time._take(Message(clock=time_fields(round((BEGIN + 1.5 * STEP) * 1e9))))
    assert node._wait_for_leader()
    node.step()
    # It asks whether there is a leader, and again once the heirs have come forward.
    have_clocks(node, iter([(), heirs]))
    assert not node._wait_for_leader()
    assert node._time.is_led is not leads
    assert "it goes on from here" in capfd.readouterr().err
    if leads:
        node.step()
        shown = [one.clock.sec + 1e-9 * one.clock.nanosec for one in desk.sent["/clock"]]
        assert shown == pytest.approx([BEGIN + 2.0 * STEP])
        assert stamps(desk) == pytest.approx([BEGIN, BEGIN + STEP, BEGIN + 2.0 * STEP])
        desk.later += 5.0
        desk.tick(node)
        assert "waiting for /clock" not in capfd.readouterr().err
