"""Shared by the nodes: parameters, topics, services, what a node waits for, and how it runs."""

import array
import contextlib
import dataclasses
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool, Trigger

from slamgym.core.config import Arguments, suggest
from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.interruption import deferred_interrupt
from slamgym.interop.ros_messages import Fields, header_fields
from slamgym.interop.transforms import clean_frame
from slamgym.ros2.worker import MOST_PENDING, Worker

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # no wheel has it: it comes with a ROS installation
    TFMessage = None

RELIABLE = QoSProfile(depth=10)
"""Of topics whose messages all arrive."""
SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of sensors' data, which may get lost."""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of topics whose last message late subscribers get, too."""
FIXED_FRAMES = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of a subscription to /tf_static, which has many publishers, each with a last message: as tf2_ros has it."""
PATIENCE = 3.0
"""A node says what it waits for after so long [s]."""


_Parameters = TypeVar("_Parameters", bound=Arguments)


def fill(message: Any, fields: Fields) -> Any:
    """Set the fields of a message from a mapping, and return it; those that aren't named stay as they are."""
    for name, value in fields.items():
        before = getattr(message, name)
        if isinstance(value, dict):
            fill(before, value)
        elif isinstance(before, array.array):
            setattr(message, name, array.array(before.typecode, np.asarray(value).tobytes()))
        else:
            setattr(message, name, value)
    return message


def _ros_name(name: str) -> str:
    """The name of an option's ROS parameter: `continue`, whose field has another name, as Python has that word."""
    return name.rstrip("_")


def _as_type_of(default: Any, value: Any) -> Any:
    """A parameter's value in the type of its default; as it is where it can't be, which its field refuses."""
    with contextlib.suppress(TypeError, ValueError):
        if isinstance(default, tuple):
            kind = str if default and isinstance(default[0], str) else float
            return tuple(map(kind, value))
        if isinstance(default, str | Path | float) and not isinstance(value, bool):
            return type(default)(value)
    return value


class RosNode(Node):
    """A node with parameters, a worker, and a watch over what it needs.

    Args:
        name: Of the node.
        parameters: What the command line says; ROS parameters of the same names overrule it.

    Attributes:
        single: Topics on which several publishers are a fault.
    """

    def __init__(self, name: str, parameters: Arguments) -> None:
        super().__init__(name)
        any_type = ParameterDescriptor(dynamic_typing=True)  # its field says what is wrong with it
        for field in dataclasses.fields(parameters):
            value = getattr(parameters, field.name)
            if isinstance(value, bool | int | float | str | Path | tuple):
                value = str(value) if isinstance(value, Path) else value
                self.declare_parameter(_ros_name(field.name), value, any_type)
        self._name_unknown_parameters()
        self.worker = Worker(self._wake)
        self._heard: dict[str, float] = {}
        self._missing: set[str] = set()
        self._said: set[str] = set()
        self.single = ["scan", "odom", "map"]
        self._born = time.monotonic()
        self._answering = ReentrantCallbackGroup()  # what waits for an answer holds nothing up
        self.wall_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._watch, clock=self.wall_clock)

    def _name_unknown_parameters(self) -> None:
        """Say which ROS parameters were given that the node doesn't have, as ROS itself does not."""
        for name in self._parameter_overrides:
            if not self.has_parameter(name) and not name.startswith("qos_overrides."):
                known = suggest(name, self._parameters)
                self.get_logger().warning(f"there is no parameter {name!r}; {known}")

    def read_parameters(self, parameters: _Parameters) -> _Parameters:
        """The parameters as they are now.

        Raises:
            ConfigError: If one has a value that its field doesn't allow.
        """
        changes = {}
        for field in dataclasses.fields(parameters):
            name = _ros_name(field.name)
            if self.has_parameter(name):
                default = getattr(parameters, field.name)
                value = self.get_parameter(name).value
                changes[field.name] = _as_type_of(default, value)
        return dataclasses.replace(parameters, **changes)

    def once(self, kind: str, sentence: str) -> None:
        """Warn, once for each kind of fault, whatever numbers are in it."""
        kind = re.sub(r"[\d.]+", "0", kind)
        if kind not in self._said:
            self._said.add(kind)
            self.get_logger().warning(sentence)

    def is_on_map(self, message: Any, topic: str) -> bool:
        """False, with a warning, if a message is in another frame than the map's."""
        frame = clean_frame(message.header.frame_id)
        wanted = self.get_parameter("map_frame").value
        if frame == wanted:
            return True
        self.once(
            topic,
            f"{topic} is in the frame {frame!r}, not {wanted!r} (parameter map_frame): left out",
        )
        return False

    def _wake(self) -> None:
        """Have the executor look whether the node is to end."""
        if self.executor is not None:
            self.executor.create_task(lambda: None)

    # --- what is waited for ---

    def need(self, what: str) -> None:
        """Expect something, a topic for example: where it doesn't come, or stops coming, the node says so."""
        self._heard.setdefault(what, -np.inf)

    def heard(self, what: str, *, for_good: bool = False) -> None:
        """Note that it came, if it is needed; ``for_good`` if it needn't come again."""
        if what in self._heard:
            self._heard[what] = np.inf if for_good else time.monotonic()

    @property
    def missing(self) -> list[str]:
        """What is waited for now."""
        since = max(time.monotonic() - PATIENCE, self._born)
        return [what for what, at in self._heard.items() if at < since]

    def _watch(self) -> None:
        """Say what is missing, and what has come."""
        if time.monotonic() - self._born < PATIENCE:
            return
        missing = set(self.missing)
        if missing - self._missing:
            self.get_logger().warning(f"waiting for {', '.join(sorted(missing))}")
        elif self._missing - missing:
            self.get_logger().info(f"received {', '.join(sorted(self._missing - missing))}")
        self._missing = missing
        if self.worker.dropped > MOST_PENDING:  # a few at once are no habit
            self.once(
                "behind", "scans come faster than they are worked off: the oldest are left out"
            )
        for topic in self.single:
            if self.count_publishers(self.resolve_topic_name(topic)) > 1:
                self.once(
                    f"publishers of {topic}",
                    f"{topic} has several publishers: stop all but one, or remap it (a killed one counts for "
                    "20 s more)",
                )

    # --- topics and services ---

    def offer(self, kind: Any, topic: str, qos: QoSProfile = RELIABLE) -> Callable[[Fields], None]:
        """Offer a topic; returns what publishes a message by its fields."""
        publisher = self.create_publisher(kind, topic, qos)
        return lambda fields: publisher.publish(fill(kind(), fields))

    def offer_transforms(self, topic: str, qos: QoSProfile = RELIABLE) -> Callable[..., None]:
        """Offer transforms; returns what publishes some by their fields, where ROS is installed."""
        if TFMessage is None:
            return lambda *_fields: None
        send = self.offer(TFMessage, topic, qos)
        return lambda *fields: send(
            {"transforms": [fill(TransformStamped(), one) for one in fields]}
        )

    def listen(
        self, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile = RELIABLE
    ) -> None:
        """Subscribe; a message with broken numbers is left out, with a warning."""

        def take(message: Any) -> None:
            try:
                callback(message)
            except ValueError as error:
                self.once(f"{topic} {error}", f"a message on {topic} is left out: {error}")

        self.create_subscription(kind, topic, take, qos)

    def serve(
        self, name: str, action: Callable[[], str], *others: str, at_once: bool = False
    ) -> None:
        """Offer a service without arguments that answers with a sentence; an error of the user's is a failure.

        Args:
            name: Of the service.
            action: Done by the worker, which may be busy.
            others: More names of the same service.
            at_once: True if it is done here and now instead.
        """

        async def answer(_request: Any, response: Any) -> Any:
            try:
                response.message = action() if at_once else await self.worker.ask(action)
                response.success = True
            except SlamgymError as error:
                response.success = False
                response.message = str(error)
            self.get_logger().info(response.message)
            return response

        for offered in (name, *others):
            self.create_service(Trigger, f"~/{offered}", answer, callback_group=self._answering)

    def serve_switch(self, name: str, switch: Callable[[bool], str]) -> None:
        """Offer a service that turns something on and off (SetBool) at once."""

        def answer(request: Any, response: Any) -> Any:
            response.message = switch(request.data)
            response.success = True
            return response

        self.create_service(SetBool, f"~/{name}", answer)

    def halt(self) -> None:
        """Stop the robot at once, whatever is computed; called in the executor's thread."""

    def close(self) -> None:
        """Leave things in order before the node ends."""

    def header(self, stamp: float, frame: str) -> Fields:
        """The fields of a header."""
        return header_fields(round(stamp * 1e9), frame)


def run_node(make: Callable[[], RosNode], ros_arguments: Sequence[str]) -> None:
    """Run a node until it is done or interrupted, by Ctrl-C or SIGTERM; a second one doesn't wait for its files.

    Args:
        make: Makes the node; called once ROS is initialised.
        ros_arguments: What follows ``--ros-args``, which itself comes first.

    Raises:
        SlamgymError: What ended the node's work, if it is the user's to fix.
    """
    # ROS's own handlers would close the topics before the robot is stopped.
    try:
        rclpy.init(args=list(ros_arguments), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise ConfigError(f"ROS refuses what follows --ros-args: {error}") from error
    try:
        with deferred_interrupt() as interruption:
            node = make()
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            try:
                while not (interruption.requested or node.worker.is_over):
                    executor.spin_once()  # the watch makes it return
            finally:
                node.worker.is_over = True
                node.halt()
                with node.worker.lock:
                    node.close()
                    node.destroy_node()
            if node.worker.error is not None:
                raise node.worker.error
    finally:
        rclpy.try_shutdown()
