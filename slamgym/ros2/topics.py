"""Topics that need more than a subscription: those of the robot's place, of its laser, of maps and of velocities."""

import functools
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy
from sensor_msgs.msg import LaserScan

from slamgym.core.types import Twist2D
from slamgym.interop.ros_messages import Fields, stamp_of
from slamgym.ros2.frames import RobotFrames
from slamgym.ros2.node import FIXED_FRAMES, LATCHED, RELIABLE, SENSOR, RosNode, TFMessage, fill
from slamgym.ros2.stamps import StampGate


def listen_to_odometry(node: RosNode, frames: RobotFrames, then: Callable[[], None]) -> None:
    """Hand odometry and transforms over, and call ``then`` after each message."""

    def take_odometry(message: Any) -> None:
        node.heard("odom")
        frames.take_odometry(message)
        then()

    def take_transforms(message: Any, static: bool) -> None:
        if frames.take_transforms(message, static=static):
            node.heard("odom")
        then()

    node.listen(Odometry, "odom", take_odometry, SENSOR)
    if TFMessage:
        node.listen(TFMessage, "/tf", functools.partial(take_transforms, static=False), SENSOR)
        node.listen(
            TFMessage, "/tf_static", functools.partial(take_transforms, static=True), FIXED_FRAMES
        )


def listen_to_scans(node: RosNode, callback: Callable[[Any], None]) -> None:
    """Subscribe to the laser."""
    gate: StampGate[Any] = StampGate("scan", node.once)

    def take(message: Any) -> None:
        node.heard("scan")
        stamp = stamp_of(message.header, 0.0)
        if stamp <= 0.0:
            node.once("stamp", "scans without a stamp are left out: have the driver set it")
            return
        for usable in gate.take(stamp, message):
            callback(usable.item)

    node.listen(LaserScan, "scan", take, SENSOR)


class KeptTopic:
    """A subscription to a topic whose last message is kept, or not, as its publisher has it: else they don't match.

    Args:
        node: The node.
        kind: Of the messages.
        topic: Its name.
        callback: Called with each message.
    """

    def __init__(
        self, node: RosNode, kind: Any, topic: str, callback: Callable[[Any], None]
    ) -> None:
        self._node = node
        self._subscribe = functools.partial(node.create_subscription, kind, topic, callback)
        self._full_name = node.resolve_topic_name(topic)
        self._is_kept = True
        self._subscription = self._subscribe(LATCHED)
        node.create_timer(0.5, self._adapt, clock=node.wall_clock)

    def _adapt(self) -> None:
        publishers = self._node.get_publishers_info_by_topic(self._full_name)
        kept = {end.qos_profile.durability != DurabilityPolicy.VOLATILE for end in publishers}
        if len(kept) == 1 and kept != {self._is_kept}:
            self._node.destroy_subscription(self._subscription)
            self._is_kept = not self._is_kept
            self._subscription = self._subscribe(LATCHED if self._is_kept else RELIABLE)


class VelocityTopic:
    """``cmd_vel`` as Twist or TwistStamped, whichever the others use.

    Args:
        node: The node.
        receive: Called with a command; None to publish.
    """

    def __init__(self, node: RosNode, receive: Callable[[Twist2D], None] | None = None) -> None:
        self._node = node
        self._receive = receive
        self._kind: Any = None
        self._end: Any = None
        self._lock = threading.Lock()  # the type may change while another thread sends
        self._open(Twist)
        node.single.append("cmd_vel")
        node.create_timer(0.5, self._adapt, clock=node.wall_clock)

    def _open(self, kind: Any) -> None:
        self._kind = kind
        if self._receive is None:
            self._end = self._node.create_publisher(kind, "cmd_vel", 10)
        else:
            self._end = self._node.create_subscription(kind, "cmd_vel", self._take, 10)

    def _adapt(self) -> None:
        """Change the type if the other side has only the other one."""
        node = self._node
        topic = node.resolve_topic_name("cmd_vel")
        if self._receive is None:
            ends = node.get_subscriptions_info_by_topic(topic)
            close = node.destroy_publisher
        else:
            ends = node.get_publishers_info_by_topic(topic)
            close = node.destroy_subscription
        stamped = {end.topic_type.endswith("TwistStamped") for end in ends}
        if len(stamped) == 1 and stamped != {self._kind is TwistStamped}:
            with self._lock:
                close(self._end)
                self._open(TwistStamped if self._kind is Twist else Twist)

    def _take(self, message: Any) -> None:
        twist = message.twist if self._kind is TwistStamped else message
        command = Twist2D(float(twist.linear.x), float(twist.angular.z))
        if np.isfinite(command).all() and self._receive is not None:
            self._receive(command)

    def send(self, command: Twist2D, header: Fields) -> None:
        """Publish a command, from any thread."""
        fields: Fields = {
            "linear": {"x": float(command.linear)},
            "angular": {"z": float(command.angular)},
        }
        with self._lock:
            if self._kind is TwistStamped:
                fields = {"header": header, "twist": fields}
            self._end.publish(fill(self._kind(), fields))
