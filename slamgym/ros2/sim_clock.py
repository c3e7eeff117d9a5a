"""One clock for all simulators on a network: /clock, which belongs to no namespace."""

import math
import threading
from typing import Any

from rosgraph_msgs.msg import Clock

from slamgym.interop.ros_messages import time_fields
from slamgym.ros2.node import RosNode

BEGIN = 10.0
"""Time at the start of a run [s]: stamps of 0 mean that a driver has set none."""
LISTENING_TIME = 1.0
"""Before the start another simulator's clock is listened for so long [s]."""
STILL_TIME = 1.0
"""A clock that isn't heard for so long stands; whoever waits for it looks so often whether it is to end [s]."""
TOPIC = "/clock"


class SimClock:
    """Publishes a simulator's time, or goes by the clock of another simulator that is there already.

    Args:
        node: The simulator.

    Attributes:
        began: Stamp of the robot's time 0 [s].
        is_led: Another simulator's clock is gone by.
    """

    def __init__(self, node: RosNode) -> None:
        self.began = BEGIN
        self._node = node
        self._heard = -math.inf  # [s]
        self._ticked = threading.Event()
        self._offer()

    def _offer(self) -> None:
        """Publish the clock, as long as no leader is found."""
        self._publisher = self._node.create_publisher(Clock, TOPIC, 10)
        self.is_led = False

    def find_leader(self) -> None:
        """Listen for another simulator; of those that begin at the same time the first by name leads.

        Two clocks on one topic would go back and forth.
        """
        self._listening = self._node.create_subscription(Clock, TOPIC, self._take, 10)
        self._lead_or_follow()
        if self.is_led:
            self._ticked.wait(LISTENING_TIME)
            self.begin()

    def _lead_or_follow(self) -> None:
        """Listen for a while; then go by what is heard, or by who comes first by name, or else lead."""
        node = self._node
        is_heard = self._ticked.wait(LISTENING_TIME)
        own_name = f"{node.get_namespace()}/{node.get_name()}"
        first_name = min(self._publishers(), default=own_name)
        if not is_heard and first_name >= own_name:
            node.destroy_subscription(self._listening)
            node.single.append(TOPIC)
            return
        self.is_led = True
        node.destroy_publisher(self._publisher)
        node.need(TOPIC)
        node.get_logger().info(
            f"another simulator publishes {TOPIC}: this one goes by it, whatever its speed is"
        )

    def _publishers(self) -> list[str]:
        """The names of the nodes that publish the clock."""
        ends = self._node.get_publishers_info_by_topic(TOPIC)
        return [f"{end.node_namespace}/{end.node_name}" for end in ends]

    def _take_over(self) -> None:
        """Publish the clock in place of a leader that has ended, unless another does; stamps go on as they were."""
        self._node.get_logger().info(f"nobody publishes {TOPIC} any more: it goes on from here")
        self._node.heard(TOPIC, for_good=True)
        self._offer()
        self._lead_or_follow()

    def begin(self) -> None:
        """Begin the robot's time anew, now."""
        self.began = max(self._heard, BEGIN) if self.is_led else BEGIN

    def tick(self, time: float) -> None:
        """Publish the robot's time [s], unless another leads."""
        if not self.is_led:
            stamp = time_fields(round((self.began + time) * 1e9))
            message = Clock()
            message.clock.sec = stamp["sec"]
            message.clock.nanosec = stamp["nanosec"]
            self._publisher.publish(message)

    def wait_for(self, time: float) -> bool:
        """Wait until the leader's clock shows the robot's time [s], for a while; true if it does.

        Where there is no leader any more, this one leads or goes by a new one from now on.
        """
        while self._heard < self.began + time - 1e-6:
            self._ticked.clear()
            if self._heard < self.began + time - 1e-6 and not self._ticked.wait(STILL_TIME):
                if not self._publishers():
                    self._take_over()
                return False
        return True

    def follow_back(self, time: float) -> None:
        """Where the leader's clock has jumped back behind the robot's time [s], go on from there."""
        if self._heard < self.began + time - STILL_TIME:
            self.began = self._heard - time

    def _take(self, message: Any) -> None:
        self._heard = message.clock.sec + 1e-9 * message.clock.nanosec
        self._node.heard(TOPIC)
        self._ticked.set()
