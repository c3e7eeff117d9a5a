"""From actions to velocities."""

from typing import Any

import numpy as np
from gymnasium import spaces

from slamgym.core.types import Twist2D
from slamgym.envs.config import ExploreConfig


class Actions:
    """The actions that the settings name.

    Attributes:
        space: Their space.
    """

    def __init__(self, config: ExploreConfig) -> None:
        linear, angular = config.robot.max_linear, config.robot.max_angular
        self._scale = (linear, angular) if config.actions == "normalized" else (1.0, 1.0)
        self._commands: tuple[Twist2D, ...] = ()
        self.space: spaces.Space[Any]
        if config.actions == "discrete":
            self._commands = (Twist2D(linear, 0.0), Twist2D(0.0, angular), Twist2D(0.0, -angular))
            self.space = spaces.Discrete(len(self._commands))
        else:
            high = np.array([linear, angular]) / self._scale
            self.space = spaces.Box(-high.astype(np.float32), high.astype(np.float32), dtype=np.float32)

    def to_command(self, action: Any) -> Twist2D:
        """The velocity that an action asks for; the world cuts off what exceeds the robot's limits."""
        if self._commands:
            return self._commands[int(action)]
        return Twist2D(float(action[0]) * self._scale[0], float(action[1]) * self._scale[1])
