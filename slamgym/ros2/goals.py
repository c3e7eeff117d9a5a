"""Goals for another navigation: Nav2's action, or a topic where nav2_msgs isn't installed."""

import functools
import threading
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient

from slamgym.core.types import Pose2D
from slamgym.interop.ros_messages import Fields, pose_fields
from slamgym.ros2.node import RosNode, fill

try:
    from nav2_msgs.action import NavigateToPose
except ImportError:  # no wheel has it: it comes with Nav2
    NavigateToPose = None

SUCCEEDED = 4
"""Status of a goal that was reached (action_msgs/GoalStatus)."""
GoalEnd = Callable[[int, bool], None]
"""Takes a goal's number, and true if it was reached."""
_NO_NUMBER = -1
"""No goal has this number."""


class GoalSender:
    """Sends the goal that is wanted now, and says how it ended; on the topic ``goal_pose`` nobody says that.

    Args:
        node: The node.
        ended: Called with the goal's number, and true if it was reached.
    """

    def __init__(self, node: RosNode, ended: GoalEnd) -> None:
        self._node = node
        self._ended = ended
        self._action = None
        if NavigateToPose:
            self._action = ActionClient(node, NavigateToPose, "navigate_to_pose")
        self._topic = node.create_publisher(PoseStamped, "goal_pose", 10)
        self._number = 0
        self._handle: Any = None
        self._here: PoseStamped | None = None  # the robot
        self._lock = threading.RLock()  # goals come from the worker, the rest from the executor

    def send(self, number: int, goal: Pose2D | None, here: Pose2D | None, header: Fields) -> None:
        """Send a goal if its number is new; without a goal the last one is cancelled.

        Args:
            number: Of the goal.
            goal: Where to, map frame.
            here: The robot, which a topic's last goal is replaced by.
            header: Of the message.
        """
        with self._lock:
            if here is not None:
                self._here = _stamped(here, header)
            if number != self._number:
                self._number = number
                if goal is None:
                    self.cancel()
                else:
                    self._send(number, _stamped(goal, header))

    def _send(self, number: int, goal: PoseStamped) -> None:
        if self._action is None:
            self._topic.publish(goal)
        elif self._action.server_is_ready():
            answer = self._action.send_goal_async(NavigateToPose.Goal(pose=goal))
            answer.add_done_callback(functools.partial(self._take_answer, number))
        else:
            self._node.once(
                "navigation", "waiting for the action navigate_to_pose: is Nav2 running?"
            )
            self._ended(number, False)

    def cancel(self) -> None:
        """Have the navigation give up the goal; on a topic the robot's own place replaces it."""
        with self._lock:
            if self._handle is not None:
                self._handle.cancel_goal_async()
                self._handle = None
            if self._action is None and self._here is not None:
                self._topic.publish(self._here)

    def halt(self) -> None:
        """The same at once, also of a goal that isn't accepted yet; the next one is sent, whichever number it has."""
        with self._lock:
            self._number = _NO_NUMBER
            self.cancel()

    def _take_answer(self, number: int, answer: Any) -> None:
        handle = answer.result()
        if not handle.accepted:
            self._ended(number, False)
            return
        with self._lock:
            if number == self._number:
                self._handle = handle
            else:  # it isn't wanted any more
                handle.cancel_goal_async()
        result = handle.get_result_async()
        result.add_done_callback(functools.partial(self._take_result, number, handle))

    def _take_result(self, number: int, handle: Any, result: Any) -> None:
        """Say how a goal ended, unless it was cancelled here."""
        if handle is self._handle:
            self._ended(number, result.result().status == SUCCEEDED)


def _stamped(pose: Pose2D, header: Fields) -> PoseStamped:
    return fill(PoseStamped(), {"header": header, "pose": pose_fields(pose)})
