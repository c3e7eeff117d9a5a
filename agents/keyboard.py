"""A real person who drives by keyboard and sees what the robot believes: its map as it grows, its path and its scan.

:mod:`slamgym.agents.teleop` imitates such people; here is one.
"""

import math

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, Pilot
from slamgym.core.geometry import transform_points, unit_vectors
from slamgym.core.types import Observation, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import crop_known
from slamgym.viz.map_pictures import GrowingView
from slamgym.viz.window import Window

_KEYS = {"up": (1, 0), "down": (-1, 0), "left": (0, 1), "right": (0, -1)}
_KEYS |= {"w": _KEYS["up"], "s": _KEYS["down"], "a": _KEYS["left"], "d": _KEYS["right"]}
"""Meaning of a key: signs of the speed and of the rate of turn."""
_DONE = ("return", "enter")

_TURN_RATE = 1.0  # people turn more slowly than the robot can [rad/s]
_ARROW = np.array([[-0.15, 0.12], [0.3, 0.0], [-0.15, -0.12], [-0.15, 0.12]])  # robot frame [m]


class _Hands(Pilot):
    """One drive."""

    def __init__(self, context: ExplorerContext, window: Window) -> None:
        self._context, self._window = context, window
        self._view = GrowingView()
        self._path: list[Pose2D] = []
        self._turn_rate = min(_TURN_RATE, context.max_angular)
        self._directions = unit_vectors(context.geometry.angles)

    def act(self, observation: Observation) -> Twist2D:
        """Show what the robot believes, and take the keys; see :meth:`Pilot.act`."""
        context, pose = self._context, Pose2D(*observation["pose"].tolist())
        self._path.append(pose)
        ends = self._directions * np.minimum(observation["scan"], context.geometry.range_max)[:, None]
        sight = transform_points(pose, transform_points(context.geometry.mount, ends))
        grid = crop_known(OccupancyGrid(observation["map"][0], context.frame), pose)
        paths = [np.array(self._path), transform_points(pose, _ARROW), sight]
        minutes, seconds = divmod(int(observation["time"][0]), 60)
        caption = f"{minutes}:{seconds:02d}   arrows or W A S D: drive   Enter: done, save   close the window: give up"
        self._window.show(self._view.draw(grid, paths, caption))
        keys = self._window.keys
        self.finished = not keys.isdisjoint(_DONE)
        ahead, left = np.sum([_KEYS[key] for key in keys if key in _KEYS] or [(0, 0)], axis=0)
        return Twist2D(
            math.copysign(context.max_linear, ahead) if ahead else 0.0,
            math.copysign(self._turn_rate, left) if left else 0.0,
        )


class Keyboard(BatchedExplorer):
    """A person at a window. There is one of them, so one environment.

    Args:
        context: What the environment says about the robot and its map.
        window: Where the map is shown and keys are pressed.
    """

    def __init__(self, context: ExplorerContext, window: Window) -> None:
        super().__init__(context, "keyboard", lambda _: _Hands(context, window))
