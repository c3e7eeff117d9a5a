"""What an exploration orders, sent to the wheels or to another navigation; and a stop, which waits for nothing."""

import threading

from slamgym.core.types import Pose2D
from slamgym.planning.navigator import STOP
from slamgym.ros2.exploration import ExplorationState
from slamgym.ros2.goals import GoalEnd, GoalSender
from slamgym.ros2.node import RosNode
from slamgym.ros2.orders import DriveOrder
from slamgym.ros2.parameters import ExploreParameters
from slamgym.ros2.topics import VelocityTopic

STANDING = ExplorationState.PAUSED, ExplorationState.DONE
"""In these a robot is told once to stay still, and others may drive it then."""


class Driver:
    """Sends orders, which come from the worker, and stops, which come from the executor.

    Args:
        node: The node.
        parameters: Say who drives.
        ended: Called with the number of a goal, and true if it was reached.
    """

    def __init__(self, node: RosNode, parameters: ExploreParameters, ended: GoalEnd) -> None:
        self._node = node
        self._parameters = parameters
        self._goals: GoalSender | None = None
        if parameters.drive == "goals":
            self._goals = GoalSender(node, ended)
        else:
            self._velocity = VelocityTopic(node)
        self._is_moving = True
        self._is_halted = False
        self._stamp = 0.0  # of the last order [s]
        self._lock = threading.Lock()

    def halt(self) -> None:
        """Stop the robot now; what is being computed doesn't drive it any more."""
        with self._lock:
            self._is_halted = True
            self._stand()

    def release(self) -> None:
        """Let orders drive the robot again."""
        self._is_halted = False

    def rest(self) -> None:
        """Have wheels stand until the next order; another navigation sees for itself."""
        with self._lock:
            if self._goals is None and self._is_moving:
                self._stand()

    def send(
        self, order: DriveOrder, pose: Pose2D | None, state: ExplorationState, stamp: float
    ) -> None:
        """Send an order, unless the robot was stopped meanwhile.

        Args:
            order: It.
            pose: The robot on the map.
            state: Of the exploration.
            stamp: Robot time [s].
        """
        with self._lock:
            self._stamp = stamp
            is_moving = order.twist != STOP and not self._is_halted
            if self._is_halted:
                if self._goals is None and self._is_moving:
                    self._stand()
            elif self._goals is not None:
                header = self._node.header(stamp, self._parameters.map_frame)
                self._goals.send(order.number, order.goal, pose, header)
            elif self._is_moving or is_moving or state not in STANDING:
                header = self._node.header(stamp, self._parameters.base_frame)
                self._velocity.send(order.twist, header)
            self._is_moving = is_moving

    def _stand(self) -> None:
        if self._goals is not None:
            self._goals.halt()
        else:
            header = self._node.header(self._stamp, self._parameters.base_frame)
            self._velocity.send(STOP, header)
