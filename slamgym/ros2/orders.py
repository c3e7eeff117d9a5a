"""Orders to a robot: a velocity, or a goal for another navigation."""

import math
from typing import NamedTuple

from slamgym.core.types import Pose2D, Twist2D
from slamgym.planning.navigator import Goal, Navigator


class DriveOrder(NamedTuple):
    """What the robot is to do now."""

    twist: Twist2D
    goal: Pose2D | None
    """Where another navigation is to drive, map frame; None for nowhere."""
    number: int
    """Changes with the goal."""


class GoalDesk:
    """Hands the goals of navigators over to another navigation, by numbers.

    Attributes:
        pose: Of the goal as it was last handed over; None for nowhere.
        number: Of that goal.
    """

    def __init__(self) -> None:
        self.pose: Pose2D | None = None
        self.number = 0
        self._goal: Goal | None = None
        self._owner: Navigator | None = None

    def order(self, twist: Twist2D, navigator: Navigator | None) -> DriveOrder:
        """The order of a velocity and the goal of a navigator; None for no goal."""
        goal = None
        if navigator is not None and navigator.is_active:
            goal = navigator.goal
        if goal is not self._goal:
            self._goal = goal
            self._owner = navigator
            self.pose = None
            if goal is not None and navigator is not None:
                self.pose = _pose_at(goal, navigator)
            self.number += 1
        return DriveOrder(twist, self.pose, self.number)

    def end(self, number: int, reached: bool) -> None:
        """Tell the navigator what became of the goal of a number; what became of older ones is passed over."""
        if number == self.number and self._owner is not None:
            self._owner.end(reached)


def _pose_at(goal: Goal, navigator: Navigator) -> Pose2D:
    """The end of the path to a goal, looking where the goal wants, or along the path."""
    path = navigator.follower.path
    end = path[-1]
    x, y = end.tolist()
    to_x, to_y = goal.look_at or (2.0 * end - path[-2]).tolist()
    return Pose2D(x, y, math.atan2(to_y - y, to_x - x))
