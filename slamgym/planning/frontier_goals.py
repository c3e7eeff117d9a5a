"""Goals of an exploration: one for a frontier, or one that shows that the robot can drive."""

import numpy as np

from slamgym.core.types import Pose2D
from slamgym.planning.frontier_candidates import FrontierCandidate
from slamgym.planning.navigator import Goal, Navigator

_NEAR_BY = 1.0
"""Driving farther than this shows that the robot can drive [m]."""


def send_to(navigator: Navigator, candidate: FrontierCandidate, pose: Pose2D, time: float) -> bool:
    """Send the robot to a frontier: to the candidate's place or another one; False if no path leads there.

    Args:
        navigator: The navigation stack.
        candidate: With the frontier.
        pose: The robot.
        time: Now [s].
    """
    frontier = candidate.frontier
    places = dict.fromkeys((candidate.target, frontier.middle, frontier.nearest))
    for place in places:
        navigator.set_goal(Goal(*place, look_at=frontier.middle), pose, time)
        if navigator.is_active:
            return True
    return False


def send_near_by(navigator: Navigator, pose: Pose2D, time: float) -> None:
    """Send the robot to a place near by, if it gets to one.

    Args:
        navigator: The navigation stack.
        pose: The robot.
        time: Now [s].
    """
    costmap = navigator.costmap
    space = navigator.reachable
    if costmap is None or space is None:
        return
    nearest_first = space.order[: space.num_centre]
    rows, cols = np.divmod(nearest_first, costmap.frame.width_px)
    places = costmap.frame.to_points(rows, cols)
    distances = np.hypot(*(places - pose[:2]).T)
    beyond = places[distances > _NEAR_BY]
    if len(beyond):
        x, y = beyond[0].tolist()
        navigator.set_goal(Goal(x, y), pose, time)
