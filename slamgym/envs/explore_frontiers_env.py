"""The environment at the level of decisions: each step chooses a frontier, and the robot drives there."""

import dataclasses
import operator
from collections.abc import Mapping
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from slamgym.core.config import suggest
from slamgym.core.errors import ActionError, ConfigError
from slamgym.core.geometry import compose
from slamgym.core.types import BoolArray, Observation, Pose2D
from slamgym.envs.config import ExploreConfig, resolve_config, resolve_part
from slamgym.envs.explore_env import RENDER_MODES, ExploreEnv, StepInfo, figures_of_one
from slamgym.envs.frontier_features import MOST_FRONTIERS, FrontierFeatures
from slamgym.envs.path_drive import STRIDE, stride
from slamgym.envs.plan_cache import PlanCache, PlansArgument
from slamgym.envs.rewards import FRONTIER_REWARD, RewardTerms
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig

DRIVES = ("physics", "path")
"""How the robot gets to the frontier that is chosen."""
DEFAULT_TIME_LIMIT = 1200.0
"""Most homes are explored within 600 s; the limit is there for those that go round in circles [s]."""


class ExploreFrontiersEnv(gym.Env[Observation, np.int64]):
    """Choose a frontier; the navigation stack drives there with full physics and SLAM.

    ## Description

    The exploration of :class:`~slamgym.envs.explore_env.ExploreEnv` as a semi-Markov decision process (Sutton,
    Precup and Singh 1999). At each step up to K frontiers of the robot's map are offered, those with the shortest
    paths, in rows of an order drawn at random: a row's number says nothing. The chosen one is driven to by the same
    navigation stack that the classical explorers use. The step ends when the frontier has gone or was reached or given
    up, or after ``horizon`` seconds; then the map has grown and the next choice is due. What comes when no frontier is
    left (a look around, relaxed footprints, rooms that the map has closed) happens by itself.

    ## Action Space

    ``Discrete(K)``, K = 32 by default: the frontier of that row. ``passes_over=True`` adds K: the frontier of that row
    is passed over, which takes no time, and isn't offered again until the map has changed around it. With a promise
    (``loop={"promise": {}}`` for 98%:95%) there is one action more: the last says *done*, which ends the exploration,
    whatever is left. The observation's ``"mask"`` says which rows hold a frontier, :meth:`action_masks` which actions
    there are; any other chooses the nearest frontier.

    ## Observation Space

    ``Dict`` of float32 arrays, all from the robot's belief:

    | Key         | Shape          | Meaning |
    |-------------|----------------|---------|
    | "frontiers" | (K, 32)        | features of each, beams sent there included (:mod:`.frontier_features`) |
    | "lengths"   | (K + 1, K + 1) | path lengths between the robot, first, and the frontiers [10 m] |
    | "globals"   | (12,)          | features of the whole exploration |
    | "mask"      | (K,)           | 1 for rows that hold a frontier |

    ## Rewards

    The sum of the rewards of the control steps within the option, each discounted by
    ``discount ** seconds since the decision``. The terms are those of
    :class:`~slamgym.envs.rewards.RewardConfig`; by default -0.02 per second, -0.01 per step in contact and 2
    of potential-based coverage, which is charged at the end.

    ## Discounting

    Time passes in seconds, so the value of what follows counts ``discount ** info["duration"]``, not a
    constant gamma. A learner that reads ``info["duration"]`` is exact for any discount. With the default discount of 1
    the task is to minimise time, and a standard learner with gamma = 1 is exact.

    ## Starting State, Episode End, Info

    As :class:`~slamgym.envs.explore_env.ExploreEnv`, with these differences: the episode terminates when the
    robot has tried all that it can reach, or the true coverage reaches ``coverage_goal`` (privileged, off by
    default); ``time_limit`` is 1200 s. ``info`` adds ``duration`` [s] of the step and ``time`` [s]; ``reward_terms``
    are summed over the step.

    ## Arguments

    Args:
        plans: As in ExploreEnv.
        config: As in ExploreEnv.
        loop: How frontiers are offered and driven to, or a mapping of the fields that differ.
        discount: Per second.
        passes_over: True to offer passing frontiers over as actions.
        drive: ``"physics"``, or ``"path"`` for training at known poses: the robot is put a second farther along its
            path and scans there (:mod:`slamgym.envs.path_drive`), without contacts, three times as fast.
        render_mode: As in ExploreEnv.
        reward_terms: As in ExploreEnv.
        **settings: As in ExploreEnv. ``localization="ground_truth"`` is the fast mode for training.

    Attributes:
        order: Which of the loop's candidates each row holds.

    Raises:
        ConfigError: If a setting is unknown or makes no sense.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 5}  # noqa: RUF012 - Gymnasium declares it so

    def __init__(
        self,
        plans: PlansArgument | PlanCache = "bundled",
        config: ExploreConfig | None = None,
        *,
        loop: ExplorationLoopConfig | Mapping[str, Any] | None = None,
        discount: float = 1.0,
        passes_over: bool = False,
        drive: Literal["physics", "path"] = "physics",
        render_mode: str | None = None,
        reward_terms: RewardTerms | None = None,
        **settings: Any,
    ) -> None:
        if not 0.0 < discount <= 1.0:
            raise ConfigError(f"discount must lie in (0, 1], not {discount}")
        config = config or ExploreConfig(reward=FRONTIER_REWARD, time_limit=DEFAULT_TIME_LIMIT)
        asked = resolve_config(config, settings)
        self._is_sketched = drive == "path"
        if self._is_sketched:  # it stands while it scans
            asked = dataclasses.replace(asked, lidar=dataclasses.replace(asked.lidar, sweep=0.0))
        self.loop_config: ExplorationLoopConfig = resolve_part(
            "loop", ExplorationLoopConfig(max_candidates=MOST_FRONTIERS), loop or {}
        )
        if drive not in DRIVES:
            raise ConfigError(f"no drive {drive!r}; {suggest(str(drive), DRIVES)}")
        self.discount = discount
        self.config = dataclasses.replace(
            asked.for_explorer(),
            coverage_goal=asked.coverage_goal,
            record=asked.record or render_mode is not None,
        )
        self.inner = ExploreEnv(
            plans, self.config, render_mode=render_mode, reward_terms=reward_terms
        )
        if self._is_sketched and self.config.slam.mode != "ground_truth":
            raise ConfigError('drive="path" needs localization="ground_truth"')
        self._stride = max(1, round(STRIDE / self.config.control_step))  # [control steps]
        self.render_mode = render_mode
        num_rows = self.loop_config.max_candidates
        self.observation_space = FrontierFeatures(num_rows).space
        self._done = num_rows * (1 + passes_over)  # the action, where there is a promise
        self.action_space = spaces.Discrete(self._num_actions)
        self._context = self.inner.explorer_context()
        self._loop: ExplorationLoop | None = None

    @property
    def loop(self) -> ExplorationLoop:
        """The running exploration.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if self._loop is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        return self._loop

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode, up to the first decision; see :meth:`ExploreEnv.reset`."""
        super().reset(seed=seed)
        observation, info = self.inner.reset(seed=seed, options=options)
        self._loop = ExplorationLoop(self._context, self.loop_config)
        self._features = FrontierFeatures(self.loop_config.max_candidates)
        is_due = self._loop.observe(observation)
        _, self._truncated, info = self._drive(is_due, info)
        return self._observe(info, duration=0.0)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive to a frontier until the next decision; see :class:`gymnasium.Env`."""
        loop = self.loop
        begin = loop.time
        reward = 0.0
        info = {**self._info, "reward_terms": {}}
        if loop.candidates and not (self._truncated or self._is_complete(info)):
            is_due = self._choose(self._row(action))
            reward, self._truncated, info = self._drive(is_due, info)
        terminated = self._is_complete(info)
        info["is_success"] = terminated
        if terminated or self._truncated:
            info["map_error"] = self.inner.map_error()
        observation, info = self._observe(info, loop.time - begin)
        return observation, reward, terminated, self._truncated and not terminated, info

    def action_masks(self) -> BoolArray:
        """Mask of the actions there are, shape (actions,), as ``MaskablePPO`` of sb3-contrib asks for it."""
        actions = np.arange(self._num_actions)
        mask = actions % self.loop_config.max_candidates < len(self.loop.candidates)
        mask[self._done :] = self.loop.may_stop
        return mask

    @property
    def _num_actions(self) -> int:
        return self._done + (self.loop_config.promise is not None)

    def _choose(self, row: int) -> bool:
        """Choose a frontier, pass it over or say *done*; returns whether the next decision is due at once."""
        loop = self.loop
        if row == self._done and loop.may_stop:
            loop.finish()
            return False
        passed_over = row - self.loop_config.max_candidates
        if row < self._done and 0 <= passed_over < len(self.order):
            loop.pass_over(self.order[passed_over])
            return bool(loop.candidates)
        index = self.order[row] if row < len(self.order) else 0
        return not loop.choose(index) and bool(loop.candidates)

    def _is_complete(self, info: Mapping[str, Any]) -> bool:
        """True if the robot has tried all that it can reach, or has seen enough."""
        return self.loop.finished or bool(info.get("is_success"))

    def _row(self, action: Any) -> int:
        """The candidate's row that an action names.

        Raises:
            ActionError: If there is no such row.
        """
        rows = self._num_actions
        try:
            index = operator.index(action)
        except TypeError:
            index = -1
        if not 0 <= index < rows:
            raise ActionError(
                action, f"a whole number from 0 to {rows - 1}, as the action space has it"
            )
        return index

    def render(self) -> Any:
        """The frame of the running exploration; see :meth:`ExploreEnv.render`."""
        return self.inner.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        self.inner.close()

    def _drive(self, is_due: bool, info: dict[str, Any]) -> tuple[float, bool, dict[str, Any]]:
        """Drive until the next decision or the end: (discounted reward, truncated, info)."""
        loop = self.loop
        begin = loop.time
        weight = 1.0
        total = 0.0
        terms: dict[str, float] = {}
        terminated = False
        truncated = False
        while not (is_due or loop.finished or terminated or truncated):
            weight = self.discount ** (loop.time - begin)
            observation, reward, terminated, truncated, info = self._advance(loop)
            total += weight * reward
            _add(terms, info["reward_terms"], weight)
            is_due = loop.observe(observation)
        if self._is_sketched:  # whose info is made once
            info = {**self.inner.info(), "is_success": terminated}
        if loop.finished and not terminated:
            reward, last_terms = self.inner.conclude()
            total += weight * reward
            _add(terms, last_terms, weight)
        return total, truncated and not terminated, {**info, "reward_terms": terms}

    def _advance(self, loop: ExplorationLoop) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Let the environment below go on for a control step, or for a stride along the path."""
        if not self._is_sketched:
            return self.inner.step(self._context.to_action(loop.command()))
        seconds = self._stride * self.config.control_step
        pose, length = stride(loop, seconds)
        start = self.inner.start
        true_pose = compose(Pose2D(start.x, start.y, 0.0), pose)
        observation, outcome = self.inner.place(true_pose, length, self._stride)
        ends = bool(outcome.terminations[0]), bool(outcome.truncations[0])
        return (
            observation,
            float(outcome.rewards[0]),
            *ends,
            {"reward_terms": figures_of_one(outcome.terms)},
        )

    def _observe(self, info: dict[str, Any], duration: float) -> tuple[Observation, dict[str, Any]]:
        self.order = self.np_random.permutation(len(self.loop.candidates)).tolist()
        observation = self._features.observe(self.loop, self.order)
        figures = {**info, "duration": duration, "time": self.loop.time}
        self._info = StepInfo(figures, self.inner.map_error)
        return observation, self._info


def _add(sums: dict[str, float], terms: Mapping[str, float], weight: float) -> None:
    """Add weighted terms to sums."""
    for name, value in terms.items():
        sums[name] = sums.get(name, 0.0) + weight * value
