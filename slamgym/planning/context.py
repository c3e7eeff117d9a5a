"""What an explorer may know before the first observation: its own body, its scanner and the map's frame."""

import numpy as np

from slamgym.core.config import Positive, Settings
from slamgym.core.types import Float32Array, GridFrame, LaserGeometry, Twist2D


class ExplorerContext(Settings):
    """The facts about a robot and its environment that don't change during an exploration.

    An environment hands it to an explorer; it says nothing of the floor plan.
    """

    frame: GridFrame
    """Frame of the observation's ``"map"``: the fixed canvas, centred on the start of the robot."""
    geometry: LaserGeometry
    """Beams of the observation's ``"scan"``."""
    robot_radius: Positive = 0.22
    """Radius of the circle about the axle that holds the robot [m]."""
    max_linear: Positive = 0.26
    """Largest forward speed [m/s] (TurtleBot3 Waffle Pi)."""
    max_angular: Positive = 1.82
    """Largest rate of turn [rad/s] (TurtleBot3 Waffle Pi)."""
    linear_acceleration: Positive = 2.5
    """Largest change of the forward speed [m/s2]."""
    angular_acceleration: Positive = 3.2
    """Largest change of the rate of turn [rad/s2]."""
    control_step: Positive = 0.2
    """Time from one observation to the next [s]."""
    map_update_interval: float = 2.0
    """Time between two publications of the map [s]."""
    normalized_actions: bool = True
    """Whether an action is a share of the largest speeds, in [-1, 1], rather than [m/s] and [rad/s]."""

    def to_action(self, command: Twist2D) -> Float32Array:
        """The environment's action, shape (2,), for a velocity command, clipped to the robot's limits."""
        linear = min(max(command.linear, -self.max_linear), self.max_linear)
        angular = min(max(command.angular, -self.max_angular), self.max_angular)
        if self.normalized_actions:
            linear, angular = linear / self.max_linear, angular / self.max_angular
        return np.array([linear, angular], dtype=np.float32)
