"""Nodes in this process without middleware, and ROS for those in others."""

import contextlib
import importlib
import inspect
import os
import tempfile
import time
import warnings
from pathlib import Path
from types import SimpleNamespace

import pytest
from ros_stand_ins import Transforms
from stub_robot import StubRobot

from slamgym.core.files import StorageError, exclusive_lock


@pytest.fixture(scope="session")
def ros_domain():
    """A domain of this process's own: tests that run at the same time don't meet."""
    pytest.importorskip("rclpy")
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # a parser that its messages import is older than its Python
        importlib.import_module("rosidl_generator_py")
    with free_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield


@contextlib.contextmanager
def free_domain():
    """A domain that no other process of these tests has, as long as the block lasts."""
    for number in range(100):
        domain = 1 + (os.getpid() + number) % 100
        lock = Path(tempfile.gettempdir()) / f"slamgym_ros_domain_{domain}"
        with contextlib.suppress(StorageError), exclusive_lock(lock):
            yield domain
            return
    raise AssertionError("a hundred test runs at once leave no ROS domain free")


class Desk:
    """Nodes whose topics end here: what they publish is kept, and what they are to receive is handed to them.

    Attributes:
        sent: Each topic's messages, in the order of publishing.
        qos: How each topic was offered last.
        later: The wall clock of the nodes is so far ahead [s].
    """

    def __init__(self):
        self.sent, self.nodes, self.answers, self.later = {}, [], {}, 0.0
        self.qos = {}

    def publisher(self, node, kind, topic, qos, *_, **__):
        name = node.resolve_topic_name(topic)
        self.qos[name] = qos
        self.sent.setdefault(name, [])
        return SimpleNamespace(
            publish=lambda message: self.sent[name].append(message),
            topic=name,
            kind=kind,
            node=node,
        )

    def subscription(self, node, kind, topic, callback, qos, **_):
        end = SimpleNamespace(
            topic=node.resolve_topic_name(topic), callback=callback, kind=kind, qos=qos
        )
        self.answers.setdefault(node, []).append(end)
        return end

    def make(self, kind, *args):
        node = kind(*args)
        self.nodes.append(node)
        return node

    def hand(self, node, topic, message):
        """Give a node a message, and wait until it has done what follows; returns the node."""
        for end in list(self.answers[node]):
            if end.topic == topic:
                end.callback(message)
        return self.settle(node)

    def settle(self, node):
        """Wait until the worker has done what is pending."""
        for _ in range(30_000):
            with node.worker.lock:
                if node.worker.is_over or not node.worker.num_pending:
                    return node
            time.sleep(0.001)
        raise AssertionError("the worker hangs")

    def call(self, node, name, **request):
        """Call a service; returns its response."""
        service = next(one for one in node.services if one.srv_name == f"~/{name}")
        answer = service.callback(
            SimpleNamespace(**request), SimpleNamespace(success=None, message="")
        )
        while inspect.iscoroutine(answer):  # as an executor does
            try:
                answer.send(None)
            except StopIteration as end:
                return end.value
            time.sleep(0.001)
        return answer

    def tick(self, node):
        """Let each of the node's timers come once."""
        for timer in list(node.timers):
            timer.callback()
        return self.settle(node)


@pytest.fixture
def desk(ros_domain, monkeypatch, tmp_path):
    """Nodes in this process without middleware."""
    import rclpy
    from rclpy.node import Node

    from slamgym.ros2 import node as nodes
    from slamgym.ros2 import topics

    monkeypatch.chdir(tmp_path)
    desk = Desk()
    rclpy.init()
    with monkeypatch.context() as patch:
        now = time.monotonic
        patch.setattr(time, "monotonic", lambda: now() + desk.later)
        patch.setattr(
            Node, "create_publisher", lambda *args, **names: desk.publisher(*args, **names)
        )
        patch.setattr(
            Node, "create_subscription", lambda *args, **names: desk.subscription(*args, **names)
        )
        patch.setattr(Node, "destroy_publisher", lambda _node, _end: True)
        patch.setattr(
            Node, "destroy_subscription", lambda node, end: desk.answers[node].remove(end)
        )
        for module in (nodes, topics):
            patch.setattr(module, "TFMessage", Transforms)
        try:
            yield desk
        finally:
            for node in desk.nodes:
                node.worker.is_over = True
                with node.worker.lock:
                    node.destroy_node()
            rclpy.try_shutdown()


@pytest.fixture
def stub_robot():
    """Makes a robot of the arguments of :class:`stub_robot.StubRobot`."""
    return StubRobot
