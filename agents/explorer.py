"""The common form of the hand-written explorers: one policy, any number of environments.

An explorer keeps one :class:`Exploration` for each environment of a batch, with all that it remembers of that
environment's episode. ``predict`` tells a single observation from a batch by the shape of the pose.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamgym.core.types import BoolArray, Float32Array, Twist2D
from slamgym.planning.context import ExplorerContext

Observation = Mapping[str, NDArray[Any]]


class Exploration(ABC):
    """One robot's exploration of one building."""

    finished: bool = False
    """Nothing that the robot can reach is left to explore."""
    decisions: int = 0
    """How often it was chosen where to go."""

    @abstractmethod
    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step.

        Args:
            observation: Unbatched: ``"map"`` uint8 (1, H, W), ``"scan"`` (num_beams,) [m], ``"pose"`` (3,)
                in the map frame, ``"velocity"`` (2,), ``"time"`` (1,) [s].
        """


class BatchedExplorer(ABC):
    """A policy over explorations, as Stable-Baselines3's ``PolicyPredictor`` wants it.

    Args:
        context: What the environment tells about the robot and its map.
        seed: Of random choices.
    """

    def __init__(self, context: ExplorerContext, seed: int = 0) -> None:
        self.context = context
        self.seed = seed
        self._explorations: list[Exploration] = []
        self._times: list[float] = []

    @abstractmethod
    def _begin(self, index: int) -> Exploration:
        """A fresh exploration for the environment of an index."""

    def reset(self) -> None:
        """Forget all episodes."""
        self._explorations, self._times = [], []

    @property
    def finished(self) -> bool:
        """Whether nothing reachable is left to explore, in any environment."""
        return bool(self._explorations) and all(e.finished for e in self._explorations)

    @property
    def decisions(self) -> int:
        """How often it was chosen where to go, in all environments together."""
        return sum(exploration.decisions for exploration in self._explorations)

    @property
    def finished_each(self) -> BoolArray:
        """:attr:`finished` of each environment, shape (n,)."""
        return np.array([e.finished for e in self._explorations], dtype=np.bool_)

    def predict(
        self,
        observation: Observation,
        state: tuple[NDArray[Any], ...] | None = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = False,  # noqa: ARG002 - part of the protocol
    ) -> tuple[Float32Array, tuple[NDArray[Any], ...] | None]:
        """Choose the action of one observation, or of a batch of them.

        Args:
            observation: As :meth:`Exploration.act` takes it, or with a leading batch axis.
            state: Handed back as it is: the explorer itself remembers each environment.
            episode_start: Which environments begin an episode, shape (n,). A clock that runs backwards begins
                one too.
            deterministic: Without effect.

        Returns:
            Actions, shape (2,) or (n, 2), and ``state``. A finished exploration gets zeros.
        """
        batched = np.ndim(observation["pose"]) == 2
        count = len(observation["pose"]) if batched else 1
        starts = (
            np.zeros(count, np.bool_) if episode_start is None else np.atleast_1d(episode_start).astype(bool)
        )
        if len(self._explorations) != count:
            self._explorations = [self._begin(i) for i in range(count)]
            self._times = [-np.inf] * count
        actions = np.zeros((count, 2), np.float32)
        for i in range(count):
            one = {key: value[i] for key, value in observation.items()} if batched else observation
            time = float(one["time"][0])
            if starts[i] or time < self._times[i]:
                self._explorations[i] = self._begin(i)
            self._times[i] = time
            if not self._explorations[i].finished:
                actions[i] = self.context.to_action(self._explorations[i].act(one))
        return (actions if batched else actions[0]), state
