"""The environments of a training run: its floor plans in the order of a curriculum, and those that validate it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv

from slamgym.agents.plan_splits import PlanSplit, split_plans
from slamgym.agents.rl.train_config import FURNISHED, Curriculum, TrainConfig
from slamgym.cad import FloorPlan, check_plan, open_plans
from slamgym.cad.plan_filter import AREA, LONG_SIDE, passes
from slamgym.core.errors import ConfigError, PlanError
from slamgym.envs import RewardFunction
from slamgym.envs.config import ObservationConfig
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.planning.exploration_loop import ExplorationLoopConfig
from slamgym.planning.promise import Promise
from slamgym.sim import ClutterConfig, RobotConfig


class StagedPlans:
    """Plans as a source that grows with the stages of a curriculum.

    Args:
        plans: The plans.
        curriculum: Which are offered when.
    """

    def __init__(self, plans: Sequence[FloorPlan], curriculum: Curriculum) -> None:
        self._plans = {plan.id: plan for plan in sorted(plans, key=lambda plan: plan.area)}
        self._all = list(self._plans)
        areas = np.array([self._plans[plan_id].area for plan_id in self._all])
        self._counts = [max(1, int(np.count_nonzero(areas <= limit))) for limit in curriculum.areas]
        self._counts.append(len(self._all))
        self.ids: Sequence[str] = []
        self.set_stage(0)

    def set_stage(self, stage: int) -> None:
        """Offer the plans of a stage."""
        self.ids = self._all[: self._counts[min(stage, len(self._counts) - 1)]]

    def __len__(self) -> int:
        return len(self.ids)

    def load(self, plan_id: str) -> FloorPlan:
        """The plan of an id."""
        return self._plans[plan_id]


def draw_plans(
    specs: Sequence[str], split: PlanSplit, count: int, seed: int = 0, largest_area: float = AREA[1]
) -> list[FloorPlan]:
    """Draw plans that are worth exploring from a split of some sources, as many from each.

    Generated plans have to be of the size of homes too, which :func:`slamgym.cad.plan_filter.passes` asks of
    HouseExpo's alone, if nothing else is asked for.

    Args:
        specs: What :func:`slamgym.cad.open_plans` takes; one that is named twice gives twice as many.
        split: Of which split.
        count: How many in all; fewer if the sources have no more.
        seed: Of the draw.
        largest_area: Of a generated plan [m2].

    Raises:
        ConfigError: If none is left.
    """
    plans: dict[str, FloorPlan] = {}
    for number, spec in enumerate(specs):
        source = split_plans(open_plans(spec), split)
        wanted = (count * (number + 1)) // len(specs)
        for index in np.random.default_rng(seed).permutation(len(source)):
            if len(plans) >= wanted:
                break
            plan = _load(source, source.ids[int(index)], largest_area)
            if plan is not None:
                plans[plan.id] = plan
    if not plans:
        raise ConfigError(f"{', '.join(specs)}: no plan of the split {split!r} is worth exploring")
    return list(plans.values())


def _load(source: object, plan_id: str, largest_area: float) -> FloorPlan | None:
    try:
        plan: FloorPlan = source.load(plan_id)  # type: ignore[attr-defined]
        check_plan(plan, RobotConfig().radius)
    except PlanError:
        return None
    is_large = plan.extent > _longest_side(largest_area) or not AREA[0] <= plan.area <= largest_area
    return None if is_large or not passes(plan, "useful") else plan


EPISODE_INFO = ("time", "path_length", "coverage", "collisions", "map_error", "pose_error")
"""What the log of episodes holds beside reward and length."""


class Staged(gym.Wrapper[Any, Any, Any, Any]):
    """Lets a curriculum change the plans of an environment; other processes are reached by method calls.

    Args:
        env: The environment.
        plans: Its plans.
    """

    def __init__(self, env: gym.Env[Any, Any], plans: StagedPlans) -> None:
        super().__init__(env)
        self._plans = plans

    def set_stage(self, stage: int) -> None:
        """Draw the plans of the next episodes from a stage of the curriculum."""
        self._plans.set_stage(stage)

    def action_masks(self) -> Any:
        """What sb3-contrib asks for."""
        return self.env.get_wrapper_attr("action_masks")()


def _longest_side(largest_area: float) -> float:
    """Of plans up to an area [m], in proportion to homes."""
    return LONG_SIDE * max(1.0, largest_area / AREA[1]) ** 0.5


def make_env(config: TrainConfig, plans: Any, **changes: Any) -> ExploreFrontiersEnv:
    """The environment of a run, without wrappers.

    Args:
        config: The run.
        plans: Floor plans, a sequence or a source.
        **changes: Settings of the environment that differ from the run's.
    """
    canvas = ObservationConfig().holding(_longest_side(config.largest_area))
    settings: dict[str, Any] = {
        "localization": config.localization,
        "odometry": config.odometry,
        "slam": {"particles": config.particles, "resolution": config.resolution},
        "observation": {"map_resolution": config.resolution, "map_size": canvas.map_size},
        "discount": config.discount,
        "reward": config.reward,
        "coverage_goal": config.coverage_goal,
        "time_limit": config.time_limit,
        "extra_features": config.network.extra_features,
        **changes,
    }
    promise = Promise.parse(config.promise) if config.promise else None
    return ExploreFrontiersEnv(plans, loop=ExplorationLoopConfig(promise=promise), **settings)


def make_learning_envs(
    config: TrainConfig,
    plans: Sequence[FloorPlan],
    reward_terms: Mapping[str, tuple[float, RewardFunction]] | None = None,
) -> VecEnv:
    """All environments of a run, each with a seed of its own.

    Args:
        config: The run.
        plans: What to learn on.
        reward_terms: Terms of the user's own, name to (weight, function).
    """

    def maker(clutter: ClutterConfig) -> Callable[[], gym.Env[Any, Any]]:
        def make() -> gym.Env[Any, Any]:
            staged = StagedPlans(plans, config.curriculum)
            env = make_env(config, staged, reward_terms=reward_terms, clutter=clutter)
            return Monitor(Staged(env, staged), info_keywords=EPISODE_INFO)

        return make

    furnished = round(config.furnished * config.num_envs)
    makers = [maker(FURNISHED if index < furnished else ClutterConfig()) for index in range(config.num_envs)]
    envs: VecEnv = DummyVecEnv(makers) if config.workers == 1 else SubprocVecEnv(makers, start_method="fork")
    envs.seed(config.seed)
    return envs
