"""The common form of all explorers: one policy, any number of environments.

An explorer keeps one :class:`Pilot` for each environment of a batch, with all that it remembers of that
environment's episode. ``predict`` distinguishes a single observation from a batch by the shape of the pose.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamgym.core.config import config_hash, to_dict
from slamgym.core.types import Float32Array, FloatArray, Observation, Twist2D
from slamgym.planning.context import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig

Rule = Callable[[ExplorationLoop], FloatArray | Float32Array]
"""Scores the candidates of a loop, shape (N,); the robot drives to the one with the highest score, and is done when all
are -inf.

Those that come with the package are frozen dataclasses of their settings: what they print identifies them.
"""


class Pilot(ABC):
    """Drives one robot through one building."""

    finished: bool = False
    """Nothing that the robot can get to is left to explore."""
    decisions: int = 0
    """Number of choices of where to go."""
    loop: ExplorationLoop | None = None
    """The frontiers that it chooses among, where it goes by any."""

    @abstractmethod
    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step.

        Args:
            observation: Unbatched: ``"map"`` uint8 (1, H, W), ``"scan"`` (num_beams,) [m], ``"pose"`` (3,)
                in the map frame, ``"velocity"`` (2,), ``"time"`` (1,) [s].
        """


class FrontierPilot(Pilot):
    """The exploration loop with a rule that chooses.

    Args:
        context: What the environment says about the robot and its map.
        config: How frontiers are offered and driven to.
        rule: Scores the candidates.
    """

    loop: ExplorationLoop

    def __init__(self, context: ExplorerContext, config: ExplorationLoopConfig, rule: Rule) -> None:
        self.loop = ExplorationLoop(context, config)
        self._rule = rule

    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step; see :meth:`Pilot.act`."""
        loop = self.loop
        is_due = loop.observe(observation)
        while is_due:
            self.decisions += 1
            scores = self._rule(loop)
            if scores.max() == -np.inf:
                loop.finish()
                break
            is_due = not loop.choose(int(np.argmax(scores))) and bool(loop.candidates)
        self.finished = loop.finished
        return loop.command()


class BatchedExplorer:
    """A policy over pilots, as Stable-Baselines3's ``PolicyPredictor`` wants it.

    Args:
        context: What the environment says about the robot and its map.
        fingerprint: Short hash of all that decides what it does.
        begin: Makes a fresh pilot for the environment of an index.
    """

    def __init__(
        self, context: ExplorerContext, fingerprint: str, begin: Callable[[int], Pilot]
    ) -> None:
        self.context = context
        self.fingerprint = fingerprint
        self.begin = begin
        self._pilots: list[Pilot] = []
        self._times: list[float] = []

    @property
    def finished(self) -> bool:
        """True if nothing that the robots can get to is left to explore, in any environment."""
        return bool(self._pilots) and all(pilot.finished for pilot in self._pilots)

    @property
    def decisions(self) -> int:
        """Number of choices of where to go, in all environments together."""
        return sum(pilot.decisions for pilot in self._pilots)

    @property
    def loops(self) -> list[ExplorationLoop | None]:
        """:attr:`Pilot.loop` of each environment."""
        return [pilot.loop for pilot in self._pilots]

    def predict(
        self,
        observation: Observation,
        state: tuple[NDArray[Any], ...] | None = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = False,  # noqa: ARG002 - part of the protocol
    ) -> tuple[Float32Array, tuple[NDArray[Any], ...] | None]:
        """Choose the action of one observation, or of a batch of them.

        Args:
            observation: As :meth:`Pilot.act` takes it, or with a leading batch axis.
            state: Handed back as it is: the explorer itself remembers each environment.
            episode_start: Which environments begin an episode, shape (n,). A clock that runs backwards begins
                one too.
            deterministic: Without effect.

        Returns:
            Actions, shape (2,) or (n, 2), and ``state``. A finished pilot gets zeros.
        """
        batched = np.ndim(observation["pose"]) == 2
        count = len(observation["pose"]) if batched else 1
        starts = np.zeros(count, np.bool_)
        if episode_start is not None:
            starts = np.atleast_1d(episode_start)
        if len(self._pilots) != count:
            self._pilots = [self.begin(i) for i in range(count)]
            self._times = [-np.inf] * count
        actions = np.zeros((count, 2), np.float32)
        for i in range(count):
            one = observation
            if batched:
                one = {key: value[i] for key, value in observation.items()}
            time = float(one["time"][0])
            if starts[i] or time < self._times[i]:
                self._pilots[i] = self.begin(i)
            self._times[i] = time
            pilot = self._pilots[i]
            if not pilot.finished:
                actions[i] = self.context.to_action(pilot.act(one))
        return (actions if batched else actions[0]), state


class FrontierExplorer(BatchedExplorer):
    """The exploration loop with a rule that keeps no memory, in any number of environments.

    Args:
        context: What the environment says about the robot and its map.
        rule: Scores the candidates.
        config: How frontiers are offered and driven to.
    """

    def __init__(
        self, context: ExplorerContext, rule: Rule, config: ExplorationLoopConfig | None = None
    ) -> None:
        self.rule = rule
        self.config = config or ExplorationLoopConfig()
        fingerprint = config_hash({"rule": repr(rule), "loop": to_dict(self.config)})
        super().__init__(context, fingerprint, lambda _: FrontierPilot(context, self.config, rule))
