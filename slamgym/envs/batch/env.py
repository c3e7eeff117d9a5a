"""The environment for many robots at once, with Gymnasium's interface of vector environments."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import announce_compilation
from slamgym.core.types import BoolArray, Float32Array, FloatArray, IntArray, Pose2D
from slamgym.envs.assessment import MapError
from slamgym.envs.batch.fleet import Fleet
from slamgym.envs.batch.observing import BatchObserver
from slamgym.envs.batch.stepping import drive_all
from slamgym.envs.batch.threads import divide_work, usable_threads
from slamgym.envs.config import ExploreConfig, resolve_config
from slamgym.envs.coverage import CELL
from slamgym.envs.observations import observation_space
from slamgym.envs.plan_cache import PlanCache, PlansArgument, ResetOptions, Streams
from slamgym.envs.rewards import Reward, RewardTerms, StepRecord
from slamgym.envs.simulation import Actions

BATCH_SITES = 1024
"""Buildings that a batch keeps ready: a training draws from hundreds again and again."""


class BatchExploreEnv(VectorEnv[Any, Any, Any]):
    """Many of :class:`~slamgym.envs.ExploreEnv` in one process, each step computed by kernels over all of them.

    For the same seeds and actions everything observed, rewarded and ended is the same, to the byte, as in the single
    environments. ``gym.make_vec("slamgym/Explore-v2", num_envs=64)`` makes it.

    Not in a batch: people and furniture that moves, the whole map as a picture, a log of every scan, and rendering;
    each is refused with one sentence. ``info`` has no ``map_error``.

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
        **settings: Any,
    ) -> None:
        if threads is None:
            threads = usable_threads()
        if min(num_envs, threads) < 1:
            raise ConfigError(
                f"num_envs and threads must be at least 1, not {num_envs} and {threads}"
            )
        self.config = config = resolve_config(config, settings)
        self._reward = Reward(config.reward, reward_terms)
        _refuse_unsupported(config, render_mode)
        self.num_envs = num_envs
        self.metadata = {"autoreset_mode": _mode(autoreset_mode)}
        self.single_observation_space = observation_space(config)
        self._actions = Actions(config)
        self.single_action_space = self._actions.space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._plan_cache = PlanCache(plans, config.robot, config.lidar.surfaces, BATCH_SITES)
        self._generators: list[np.random.Generator] = []
        # Of each robot; None before its first map, and where no reward reads it.
        self._map_errors: list[MapError | None] = [None] * num_envs
        self._over = np.zeros(num_envs, dtype=np.bool_)
        self._fleet = Fleet(config, num_envs, threads)
        self._observer = BatchObserver(config, self._fleet)

    @property
    def ranges(self) -> Float32Array:
        """The newest scans, shape (N, num_beams) [m]."""
        return self._fleet.scans.ranges

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
        ids = np.flatnonzero(mask)
        self._seed(ids, seed)
        self._begin(ids, wanted)
        self._sense(ids, mask)
        self._over = self._over & ~mask
        observations = self._observer.observe(ids, mask)
        infos = _entries(self._figures()._asdict(), mask)
        return observations, infos | self._plans(mask)

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
        fleet = self._fleet
        mode = self.metadata["autoreset_mode"]
        if not fleet.each or (mode == AutoresetMode.DISABLED and self._over.any()):
            raise gym.error.ResetNeeded(
                "call reset() first, with options['reset_mask'] for those that are over"
            )
        everyone = np.arange(self.num_envs)
        fresh = self._over if mode == AutoresetMode.NEXT_STEP else np.zeros_like(self._over)
        lived = ~fresh
        path = fleet.robots.path.copy()
        coverage = fleet.shares
        fleet.drive(np.flatnonzero(lived), self._actions.to_commands(actions))
        driven = fleet.robots.path - path
        if fresh.any():
            self._begin(np.flatnonzero(fresh), ResetOptions())
        is_published = fleet.robots.steps % self.config.publication_steps == 0
        self._sense(everyone, is_published)

        terminations = self._are_complete(is_published & lived) & lived
        truncations = self._are_cut_off() & lived
        figures = self._figures()
        rewards, terms = self._rewards(figures, driven, coverage, terminations)
        rewards[fresh] = 0.0
        over = terminations | truncations
        self._over = over
        observations = self._observer.observe(everyone, is_published)
        infos = _entries(figures._asdict(), np.ones_like(lived)) | self._plans(fresh)
        infos |= _entries({"reward_terms": _entries(terms, lived)}, lived)
        infos |= _entries({"is_success": terminations}, over)
        if mode == AutoresetMode.SAME_STEP and over.any():
            observations, infos = self._renew(over, observations, infos)
        return observations, rewards, terminations, truncations, infos

    def _renew(
        self, over: BoolArray, observations: Any, infos: dict[str, Any]
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next episodes at once; what the last ones ended with goes into the infos."""
        ids = np.flatnonzero(over)
        last = np.full(self.num_envs, None, dtype=object)
        for i in ids.tolist():
            if isinstance(observations, dict):
                last[i] = {key: value[i] for key, value in observations.items()}
            else:
                last[i] = observations[i]
        self._begin(ids, ResetOptions())
        self._sense(ids, over)
        self._over = np.zeros_like(over)
        terms = _narrowed(infos["reward_terms"], ~over)
        fresh_infos = _entries(self._figures()._asdict(), np.ones_like(over))
        fresh_infos |= _entries({"reward_terms": terms}, ~over)
        fresh_infos |= self._plans(over)
        fresh_infos |= _entries({"final_obs": last, "final_info": _narrowed(infos, over)}, over)
        return self._observer.observe(ids, over), fresh_infos

    def _begin(self, ids: IntArray, wanted: ResetOptions) -> None:
        """Draw buildings and starts and put robots down; :meth:`Fleet.sense` is still to be called."""
        for i in ids.tolist():
            streams = Streams.spawn(self._generators[i])
            prepared, start = self._plan_cache.choose_site(wanted, streams, self.config.clutter)
            self._fleet.begin(i, prepared, start, streams)
            self._map_errors[i] = None
        self._observer.begin(ids)

    def _sense(self, ids: IntArray, is_published: BoolArray) -> None:
        """Let robots scan; of episodes that begin the first map is kept, for rewards that may measure it."""
        self._fleet.sense(ids, is_published)
        if not self._reward.may_measure:
            return
        for i in ids.tolist():
            if self._map_errors[i] is None:
                prepared = self._fleet.each[i].prepared
                start = Pose2D(*self._fleet.robots.start[i].tolist())
                self._map_errors[i] = MapError(prepared, start, partial(self._fleet.grid, i))

    def _are_complete(self, published: BoolArray) -> BoolArray:
        """Mask of explorations that are complete by one of the rules in force."""
        config = self.config
        fleet = self._fleet
        complete = np.zeros(self.num_envs, dtype=np.bool_)
        if config.coverage_goal is not None:
            complete = fleet.shares >= config.coverage_goal
        if config.terminate_when_explored:

            def look(ids: IntArray) -> None:
                for i in ids.tolist():
                    pose = Pose2D(*fleet.maps.believed[i].tolist())
                    complete[i] = fleet.each[i].detector.is_explored(fleet.grid(i), pose)

            divide_work(look, np.flatnonzero(published & ~complete), fleet.threads)
        return complete

    def _are_cut_off(self) -> BoolArray:
        """Mask of explorations whose time limit is over."""
        if self.config.max_steps is None:
            return np.zeros(self.num_envs, dtype=np.bool_)
        return self._fleet.robots.steps >= self.config.max_steps

    def _rewards(
        self, figures: "_Figures", driven: FloatArray, coverage: FloatArray, terminations: BoolArray
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Rewards, shape (N,), and what each term contributed."""
        fleet = self._fleet
        errors = [error.of_next_step() for error in self._map_errors if error is not None]
        record: Any = StepRecord  # of arrays, a number for each robot
        steps = record(
            duration=self.config.control_step,
            time=fleet.times,
            distance=driven,
            contact=fleet.robots.contact.copy(),
            coverage=figures.coverage,
            previous_coverage=coverage,
            pose_error=figures.pose_error,
            terminated=terminations,
            floor_area=fleet.scenes.floor_cells * CELL**2,
            map_errors=errors,
        )
        return self._reward.of_many(steps)

    def _figures(self) -> "_Figures":
        """The newest figures of every robot."""
        fleet = self._fleet
        # Robots that are mapped together have no doubts.
        doubtful_scans = np.zeros(self.num_envs, dtype=np.int64)
        is_doubtful = np.zeros(self.num_envs, dtype=np.bool_)
        if not fleet.is_mapped_together:
            for i in range(self.num_envs):
                stats = fleet.mapper(i).stats
                doubtful_scans[i] = len(stats.doubtful)
                is_doubtful[i] = stats.is_doubtful
        apart = fleet.maps.believed - (fleet.robots.pose - fleet.robots.start * (1.0, 1.0, 0.0))
        return _Figures(
            coverage=fleet.shares,
            path_length=fleet.robots.path.copy(),
            collisions=fleet.robots.collisions.copy(),
            pose_error=np.hypot(apart[:, 0], apart[:, 1]),
            heading_error=np.abs(wrap_angle(apart[:, 2])),
            doubtful_scans=doubtful_scans,
            is_doubtful=is_doubtful,
            true_pose=fleet.robots.pose.copy(),
        )

    def _plans(self, mask: BoolArray) -> dict[str, Any]:
        """The ids of the buildings in which an episode begins, as infos."""
        if not mask.any():
            return {}
        plans = np.array([robot.prepared.plan.id for robot in self._fleet.each], dtype=object)
        plans[~mask] = None
        return _entries({"plan": plans}, mask)

    def _read_mask(self, given: Any) -> BoolArray:
        """Which environments a reset is about."""
        mask = np.ones(self.num_envs, dtype=np.bool_) if given is None else np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ConfigError(
                f"reset_mask must be booleans of shape ({self.num_envs},) with one that is true, not {mask!r}"
            )
        if not self._fleet.each and not mask.all():
            raise ConfigError("the first reset must begin all environments; leave out reset_mask")
        return mask


class _Figures(NamedTuple):
    """What ``info`` shows of every robot, as :class:`~slamgym.envs.ExploreEnv` describes it; shape (N, ...)."""

    coverage: FloatArray
    path_length: FloatArray
    collisions: IntArray
    pose_error: FloatArray
    heading_error: FloatArray
    doubtful_scans: IntArray
    is_doubtful: BoolArray
    true_pose: FloatArray


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
    observation = config.observation
    if render_mode is not None:
        raise ConfigError(
            "a batch of environments has no pictures; leave out render_mode, or make single environments"
        )
    if config.record:
        raise ConfigError(
            "a batch of environments has no a log of every scan; set record=False, or make single environments"
        )
    if config.clutter.people > 0:
        raise ConfigError(
            "a batch of environments has no people; set clutter.people to 0, or make single environments"
        )
    if config.clutter.changes > 0.0:
        raise ConfigError(
            "a batch of environments has no furniture that is moved; set clutter.changes to 0, or make single "
            "environments"
        )
    if config.lidar.sweep > 0.0:
        raise ConfigError(
            "a batch of environments has no scanners that take their time; set lidar.sweep to 0, or make single "
            "environments"
        )
    if observation.map == "global" and not observation.is_compact:
        raise ConfigError(
            "a batch of environments has no the whole map as a picture; give observation.map='egocentric' or "
            "preset='compact', or make single environments"
        )
