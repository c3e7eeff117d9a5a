"""Progress of the robot towards a goal: whether it moves, comes nearer, is stuck, and recovers from that."""

import math
from dataclasses import dataclass

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import Pose2D

STUCK_TIME = 4.0
"""Without moving for so long the robot recovers [s]; a half turn on the spot takes less."""
_STUCK_DISTANCE = 0.1
"""Moving less than this is standing still [m], which errors of the pose may be."""
_STUCK_TURN = 0.3
"""Turning by more than this is moving, too [rad]."""
_ELSEWHERE = 0.5
"""So far from where the recoveries began the robot has got away, and they begin anew [m]."""


@dataclass
class GoalProgress:
    """The robot's progress towards goals since it last stood without one."""

    moved_to: Pose2D
    """Where the robot last moved."""
    moved_at: float
    """[s]."""
    recovered_from: Pose2D
    """Where the first of the recoveries began."""
    nearer_at: float
    """When it last came nearer [s]."""
    planned_at: float = -math.inf
    """[s]."""
    best_remaining: float = math.inf
    """The shortest path left since the goal was set [m]."""
    arrived: bool = False
    outcome: bool | None = None
    """What another navigation said: whether it is reached."""
    recoveries: int = 0
    """Number since the last progress."""
    recovery: str = ""
    """The one in progress."""
    recovery_from: Pose2D = Pose2D(0.0, 0.0, 0.0)
    recovery_at: float = 0.0
    """[s]."""

    @classmethod
    def begin(cls, pose: Pose2D, time: float) -> "GoalProgress":
        """Progress of a robot that stands without a goal."""
        return cls(moved_to=pose, moved_at=time, recovered_from=pose, nearer_at=time)

    def begin_goal(self, time: float) -> None:
        """Note that a goal was set."""
        self.arrived = False
        self.outcome = None
        self.best_remaining = math.inf
        self.nearer_at = time

    def note_pose(self, pose: Pose2D, time: float) -> None:
        """Note where the robot is, and whether it moves."""
        turned = abs(wrap_angle(pose.theta - self.moved_to.theta))
        if apart(pose, self.moved_to) > _STUCK_DISTANCE or turned > _STUCK_TURN:
            self.moved_to = pose
            self.moved_at = time

    def note_remaining(self, remaining: float, pose: Pose2D, time: float) -> None:
        """Note the length of the path that is left [m], and whether the robot comes nearer."""
        if remaining >= self.best_remaining - _STUCK_DISTANCE:
            return
        self.best_remaining = remaining
        self.nearer_at = time
        if apart(pose, self.recovered_from) > _ELSEWHERE:
            self.recoveries = 0
            self.recovered_from = pose

    def is_stuck(self, time: float, patience: float) -> bool:
        """True if the robot has stood still, or for longer than a patience [s] not come nearer."""
        return time - self.moved_at > STUCK_TIME or time - self.nearer_at > patience

    def begin_recovery(self, pose: Pose2D, time: float) -> None:
        """Note the beginning of a recovery."""
        if self.recoveries == 0:
            self.recovered_from = pose
        self.moved_to = pose
        self.moved_at = time
        self.nearer_at = time
        self.best_remaining = math.inf
        self.recovery_from = pose
        self.recovery_at = time


def apart(first: Pose2D, second: Pose2D) -> float:
    """Distance of two positions [m]."""
    return math.hypot(first.x - second.x, first.y - second.y)
