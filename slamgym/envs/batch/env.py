"""The environment for many robots at once, with Gymnasium's interface of vector environments."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from slamgym.core.config import suggest
from slamgym.core.errors import ActionError, ConfigError
from slamgym.core.jit import announce_compilation
from slamgym.core.types import BoolArray, Float32Array, FloatArray, IntArray
from slamgym.envs.batch.exploration import Explorations
from slamgym.envs.batch.stepping import drive_all
from slamgym.envs.batch.threads import usable_threads
from slamgym.envs.config import ExploreConfig, resolve_config
from slamgym.envs.observations import observation_space
from slamgym.envs.plan_cache import PlanCache, PlansArgument, ResetOptions
from slamgym.envs.rewards import Reward, RewardTerms
from slamgym.envs.simulation import Actions

BATCH_SITES = 1024
"""Buildings that a batch keeps ready: a training draws from hundreds again and again."""


class BatchExploreEnv(VectorEnv[Any, Any, Any]):
    """Many of :class:`~slamgym.envs.ExploreEnv` in one process, each step computed by kernels over all of them.

    The step is the single environment's: the same seeds and actions give the same, to the byte.
    ``gym.make_vec("slamgym/Explore-v4", num_envs=64)`` makes it.

    Not in a batch: a log of every scan, and rendering; each is refused with one sentence. Maps are drawn by kernels
    where poses are known, scans are taken at once and the observation shows the map about the robot, else each robot
    has its own mapper as in a single environment.

    Args:
        num_envs: How many.
        plans: Floor plans, as for the single environment; all robots draw from them.
        config: Settings; the defaults where None.
        autoreset_mode: What happens after an episode's end, as in Gymnasium; also by name, ``"next_step"``,
            ``"same_step"`` or ``"disabled"``.
        render_mode: None.
        reward_terms: More terms of the reward: name to (weight, function of one robot's step).
        threads: So many work on the robots, with the same results; by default as many as the process may use, see
            :func:`~slamgym.envs.batch.threads.usable_threads`.
        max_episode_steps: Where Gymnasium's ``TimeLimit`` would cut episodes off, as ``gym.make_vec`` passes it on.
        **settings: As for the single environment.

    Raises:
        ConfigError: If a setting is unknown, makes no sense, or isn't supported in a batch.
        InputFileError: If the plans can't be read.
    """

    def __init__(
        self,
        num_envs: int = 1,
        plans: PlansArgument = "bundled",
        config: ExploreConfig | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        reward_terms: RewardTerms | None = None,
        threads: int | None = None,
        max_episode_steps: int | None = None,
        **settings: Any,
    ) -> None:
        if threads is None:
            threads = usable_threads()
        if min(num_envs, threads) < 1:
            raise ConfigError(
                f"num_envs and threads must be at least 1, not {num_envs} and {threads}"
            )
        config = resolve_config(config, settings)
        if max_episode_steps is not None:
            most = min(max_episode_steps, config.max_steps or max_episode_steps)
            config = replace(config, time_limit=most * config.control_step)
        self.config = config
        _refuse_unsupported(config, render_mode)
        self.num_envs = num_envs
        self.metadata = {"autoreset_mode": _mode(autoreset_mode)}
        self.single_observation_space = observation_space(config)
        self._actions = Actions(config)
        self.single_action_space = self._actions.space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        sites = PlanCache(plans, config.robot, config.lidar.surfaces, BATCH_SITES)
        self._generators: list[np.random.Generator] = []
        self._over = np.zeros(num_envs, dtype=np.bool_)
        self._explorations = Explorations(
            config,
            num_envs,
            sites,
            Reward(config.reward, reward_terms),
            threads=threads,
            prefers_kernels=True,
        )

    @property
    def ranges(self) -> Float32Array:
        """The newest scans as seen from where the robots are now, shape (N, num_beams) [m]."""
        return self._explorations.beliefs.ranges

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes.

        Args:
            seed: Of the first environment, the others count on from there; or one for each.
            options: As for the single environment, for all alike; ``reset_mask``, shape (N,), begins only some.

        Raises:
            ConfigError: If an option is unknown, or a start leaves no room for the robot.
            PlanError: If a plan can't be explored.
        """
        announce_compilation(drive_all)
        options = dict(options or {})
        mask = self._read_mask(options.pop("reset_mask", None))
        wanted = ResetOptions.read(options)
        self._seed(np.flatnonzero(mask), seed)
        return self._begin(mask, wanted)

    def _begin(self, mask: BoolArray, wanted: ResetOptions) -> tuple[Any, dict[str, Any]]:
        """Begin some episodes: observations of all robots, and infos of those."""
        explorations = self._explorations
        explorations.begin(mask, self._generators, wanted)
        self._over = self._over & ~mask
        observations = explorations.observer.observe(np.flatnonzero(mask), mask)
        return observations, self._figures(mask) | self._plans(mask)

    def _seed(self, ids: IntArray, seed: int | Sequence[int | None] | None) -> None:
        """Make the generators of environments that are seeded, and of those that have none."""
        seeds: Sequence[int | None] = [None] * self.num_envs
        if isinstance(seed, int):
            seeds = range(seed, seed + self.num_envs)
        elif seed is not None:
            seeds = seed
        if len(seeds) != self.num_envs:
            raise ConfigError(f"seed must be a number or {self.num_envs} of them, not {len(seeds)}")
        for i in ids.tolist():
            if i == len(self._generators):
                self._generators.append(seeding.np_random(seeds[i])[0])
            elif seeds[i] is not None:
                self._generators[i] = seeding.np_random(seeds[i])[0]

    def step(self, actions: Any) -> tuple[Any, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Drive all robots for one control step.

        Raises:
            ActionError: If the actions are of another kind than those of the space.
            gymnasium.error.ResetNeeded: Before the first reset, or where an episode is over and none begins by itself.
        """
        explorations = self._explorations
        mode = self.metadata["autoreset_mode"]
        if not explorations.fleet.each or (mode == AutoresetMode.DISABLED and self._over.any()):
            raise gym.error.ResetNeeded(
                "call reset() first, with options['reset_mask'] for those that are over"
            )
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        fresh = self._over if mode == AutoresetMode.NEXT_STEP else ~everyone
        lived = ~fresh
        begins = fresh if fresh.any() else None
        commands = self._actions.to_commands(actions)
        if len(commands) != self.num_envs:
            raise ActionError(actions, f"{self.num_envs} actions, one for each environment")
        outcome = explorations.step(commands, begins, self._generators)
        rewards = np.where(fresh, 0.0, outcome.rewards)
        self._over = over = outcome.terminations | outcome.truncations
        is_published = explorations.is_published
        observations = explorations.observer.observe(np.flatnonzero(everyone), is_published)
        infos = self._figures(everyone) | self._plans(fresh)
        infos |= _entries({"reward_terms": _entries(outcome.terms, lived)}, lived)
        infos |= _entries({"is_success": outcome.terminations}, lived)
        infos |= self._map_errors(over)
        if mode == AutoresetMode.SAME_STEP and over.any():
            observations, infos = self._renew(over, observations, infos)
        return observations, rewards, outcome.terminations, outcome.truncations, infos

    def _renew(
        self, over: BoolArray, observations: Any, infos: dict[str, Any]
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next episodes at once; what the last ones ended with goes into the infos."""
        last = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(over).tolist():
            if isinstance(observations, dict):
                last[i] = {key: value[i] for key, value in observations.items()}
            else:
                last[i] = observations[i]
        observations, fresh_infos = self._begin(over, ResetOptions())
        ended = {"final_obs": last, "final_info": _narrowed(infos, over)}
        going_on = _narrowed(infos, ~over)
        return observations, _joined(going_on, fresh_infos) | _entries(ended, over)

    def _figures(self, mask: BoolArray) -> dict[str, Any]:
        """The newest figures of some robots, as infos; the map's error of those whose reward has read it."""
        figures = _entries(self._explorations.figures(), mask)
        return figures | self._map_errors(self._explorations.assessment.errors_read() & mask)

    def _map_errors(self, mask: BoolArray) -> dict[str, Any]:
        """The errors of some robots' maps, as infos."""
        if not mask.any():
            return {}
        errors = np.zeros(self.num_envs)
        for i in np.flatnonzero(mask).tolist():
            errors[i] = self._explorations.assessment.map_error(i)
        return _entries({"map_error": errors}, mask)

    def _plans(self, mask: BoolArray) -> dict[str, Any]:
        """The ids of the buildings in which an episode begins, as infos."""
        if not mask.any():
            return {}
        plans = np.array(
            [robot.prepared.plan.id for robot in self._explorations.fleet.each], dtype=object
        )
        plans[~mask] = None
        return _entries({"plan": plans}, mask)

    def _read_mask(self, given: Any) -> BoolArray:
        """Which environments a reset is about."""
        mask = np.ones(self.num_envs, dtype=np.bool_) if given is None else np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ConfigError(
                f"reset_mask must be booleans of shape ({self.num_envs},) with one that is true, not {mask!r}"
            )
        if not self._explorations.fleet.each and not mask.all():
            raise ConfigError("the first reset must begin all environments; leave out reset_mask")
        return mask


def _entries(values: dict[str, Any], mask: BoolArray) -> dict[str, Any]:
    """Values with the mask of those to whom they apply, as vector environments give infos; nothing if to none."""
    entries = dict(values) if mask.any() else {}
    for name in list(entries):
        entries[f"_{name}"] = mask.copy()
    return entries


def _narrowed(infos: dict[str, Any], mask: BoolArray) -> dict[str, Any]:
    """Infos of fewer environments; those of none are left out."""
    narrowed: dict[str, Any] = {}
    for name, value in infos.items():
        if name.startswith("_"):
            continue
        left = infos[f"_{name}"] & mask
        if left.any():
            narrowed[name] = _narrowed(value, mask) if isinstance(value, dict) else value
            narrowed[f"_{name}"] = left
    return narrowed


def _joined(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """Infos of some environments and of others."""
    joined = {**first, **second}
    for name in first.keys() & second.keys():
        if name.startswith("_"):
            joined[name] = first[name] | second[name]
        elif isinstance(first[name], dict):
            joined[name] = _joined(first[name], second[name])
        else:
            mask = first[f"_{name}"].reshape(-1, *[1] * (first[name].ndim - 1))
            joined[name] = np.where(mask, first[name], second[name])
    return joined


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """An autoreset mode by its name."""
    if isinstance(mode, AutoresetMode):
        return mode
    names = {one.name.lower(): one for one in AutoresetMode}
    if mode.lower() not in names:
        raise ConfigError(f"unknown autoreset_mode {mode!r}; {suggest(mode.lower(), names)}")
    return names[mode.lower()]


def _refuse_unsupported(config: ExploreConfig, render_mode: str | None) -> None:
    """Refuse what single environments have and a batch doesn't."""
    if render_mode is not None:
        raise ConfigError(
            "a batch of environments has no pictures; leave out render_mode, or make single environments"
        )
    if config.record:
        raise ConfigError(
            "a batch of environments has no log of every scan; set record=False, or make single environments"
        )
