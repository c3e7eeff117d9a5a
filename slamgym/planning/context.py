"""Facts that an explorer is given before the first observation: its own body, its scanner and the map's frame."""

from dataclasses import dataclass

import numpy as np

from slamgym.core.types import Float32Array, GridFrame, LaserGeometry, Twist2D


@dataclass(frozen=True)
class ExplorerContext:
    """Facts about a robot and its environment that don't change during an exploration.

    An environment hands it to an explorer; it says nothing of the floor plan.
    """

    frame: GridFrame
    """Frame of the observation's ``"map"``: the fixed canvas, centred on the start of the robot."""
    geometry: LaserGeometry
    """Beams of the observation's ``"scan"``."""
    robot_radius: float = 0.22
    """Radius of the circle about the axle that holds the robot [m]."""
    max_linear: float = 0.26
    """Largest forward speed [m/s] (TurtleBot3 Waffle Pi)."""
    max_angular: float = 1.82
    """Largest rate of turn [rad/s] (TurtleBot3 Waffle Pi)."""
    control_step: float = 0.2
    """Time from one observation to the next [s]."""
    map_update_interval: float = 2.0
    """Time between two publications of the map [s]."""
    normalized_actions: bool = True
    """True if an action is a share of the largest speeds, in [-1, 1]; else it is in [m/s] and [rad/s]."""

    drives: bool = True
    """False if another navigation drives to the goals that are set."""

    def to_action(self, command: Twist2D) -> Float32Array:
        """The environment's action, shape (2,), for a velocity command, clipped to the robot's limits."""
        linear = min(max(command.linear, -self.max_linear), self.max_linear)
        angular = min(max(command.angular, -self.max_angular), self.max_angular)
        if self.normalized_actions:
            linear = linear / self.max_linear
            angular = angular / self.max_angular
        return np.array([linear, angular], dtype=np.float32)
