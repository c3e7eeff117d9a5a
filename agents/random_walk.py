"""Random walk: the floor that every explorer must beat."""

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, Pilot
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import Observation, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.path_follower import PathFollower


class _Walk(Pilot):
    """Straight on until something is near, then to a random heading."""

    def __init__(self, context: ExplorerContext, rng: np.random.Generator) -> None:
        self._follower = PathFollower(context)
        self._rng = rng
        self._heading: float | None = None
        self._turning = True

    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step; see :meth:`Pilot.act`."""
        follower = self._follower
        theta = float(observation["pose"][2])
        points = follower.points(observation["scan"])
        if not follower.is_free_ahead(points):
            self._turning = True
        if self._turning:
            if self._heading is None:
                self._heading = float(self._rng.uniform(-np.pi, np.pi))
            error = float(wrap_angle(self._heading - theta))
            if abs(error) > follower.config.turned:
                return Twist2D(0.0, float(np.copysign(follower.turn_rate(error), error)))
            self._heading = None
            if not follower.is_free_ahead(points):
                return Twist2D(0.0, 0.0)
            self._turning = False
        return Twist2D(follower.context.max_linear, 0.0)


class RandomWalk(BatchedExplorer):
    """Drives straight on, and to a random heading where something is near; never finishes.

    Args:
        context: What the environment says about the robot and its map.
        seed: Random seed of the headings; each environment of a batch has its own stream.
    """

    def __init__(self, context: ExplorerContext, seed: int = 0) -> None:
        super().__init__(
            context,
            "random walk",
            lambda index: _Walk(context, np.random.default_rng([seed, index])),
        )
