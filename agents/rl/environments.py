"""The environments of training runs, and how a policy explores buildings in them that it doesn't learn on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from slamgym.agents.evaluation.coverage_curve import CoverageCurve
from slamgym.agents.plan_splits import longest_side
from slamgym.agents.rl.train_config import (
    CROP_SIDE,
    HOLD,
    TRAINING_PARTICLES,
    TRAINING_RESOLUTION,
    WHEELS_GOAL,
    TrainConfig,
    WheelsConfig,
)
from slamgym.cad import FloorPlan
from slamgym.core.config import Counted, Measured, Share
from slamgym.core.names import exploration_seed
from slamgym.envs.batch.env import BatchExploreEnv
from slamgym.envs.config import ObservationConfig
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.planning.exploration_loop import ExplorationLoopConfig
from slamgym.planning.promise import Promise

Choose = Callable[[dict[str, Any]], int]
"""From an observation of ``slamgym/ExploreFrontiers-v1`` to an action."""
CONTACT_SECONDS = 300.0
"""Contacts of driven wheels are counted in so many seconds."""


@dataclass(frozen=True)
class PolicyOutcome:
    """One exploration by choosing frontiers. Times and paths that were not reached count as those at the end."""

    time_95: Measured  # to 95 % of the floor truly seen [s]
    time_99: Measured  # [s]
    path_95: Measured  # [m]
    path_99: Measured  # [m]
    time: Measured  # until the explorer was done [s]
    path: Measured  # until then [m]
    coverage: Share
    decisions: Counted
    seconds: Measured  # of CPU
    map_error: Measured  # [m]


@dataclass(frozen=True)
class DriveOutcome:
    """One exploration of ``evaluate_seconds`` by driving the wheels."""

    coverage: float
    contacts: float  # in five minutes
    path: float  # [m]


def make_env(
    config: TrainConfig, plans: Any, resolution: float = TRAINING_RESOLUTION, **changes: Any
) -> ExploreFrontiersEnv:
    """The environment in which a run chooses frontiers, without wrappers.

    Args:
        config: The run.
        plans: Floor plans, a sequence or a source.
        resolution: Cell size of the robot's map [m].
        **changes: Settings of the environment that differ from the run's.
    """
    canvas = ObservationConfig().holding(longest_side(config.largest_area))
    settings: dict[str, Any] = {
        "localization": config.localization,
        "odometry": config.odometry,
        "slam": {"particles": TRAINING_PARTICLES, "resolution": resolution},
        "observation": {"map_resolution": resolution, "map_size": canvas.map_size},
        "reward": config.reward,
        "coverage_goal": config.coverage_goal,
        "time_limit": config.time_limit,
        **changes,
    }
    promise = Promise.parse(config.promise) if config.promise else None
    return ExploreFrontiersEnv(plans, loop=ExplorationLoopConfig(promise=promise), **settings)


def make_batch(config: WheelsConfig, plans: Any, count: int, **changes: Any) -> BatchExploreEnv:
    """The environments in which a run drives the wheels, in one batch.

    Args:
        config: The run.
        plans: Floor plans.
        count: How many environments.
        **changes: Settings of the environment that differ from the run's.
    """
    settings: dict[str, Any] = {
        "localization": "ground_truth",
        "reward": config.reward,
        "observation": {
            "preset": "compact_far", "map": "global", "crop_px": 1, "crop_resolution": CROP_SIDE,
        },
        "coverage_goal": WHEELS_GOAL,
        "time_limit": None,
        "terminate_when_explored": False,
        **changes,
    }  # fmt: skip
    return BatchExploreEnv(count, plans, autoreset_mode="same_step", **settings)


def explore_plan(env: ExploreFrontiersEnv, choose: Choose, plan: FloorPlan, seed: int) -> PolicyOutcome:
    """Explore one building to the end.

    Args:
        env: The environment.
        choose: The policy.
        plan: The building.
        seed: Of start and noise.
    """
    observation, info = env.reset(seed=seed, options={"plan": plan})
    points: list[tuple[float, float, float]] = []  # of the curve, known to within a decision
    begin, decisions, is_over = time.process_time(), 0, False
    while not is_over:
        observation, _, terminated, truncated, info = env.step(choose(observation))
        decisions += 1
        points.append((info["time"], info["path_length"], info["coverage"]))
        is_over = terminated or truncated
    curve = CoverageCurve(*np.array(points, dtype=np.float64).T)
    end = info["time"], info["path_length"]
    (time_95, path_95), (time_99, path_99) = (curve.reached(level) or end for level in (0.95, 0.99))
    return PolicyOutcome(
        time_95=time_95,
        time_99=time_99,
        path_95=path_95,
        path_99=path_99,
        time=info["time"],
        path=info["path_length"],
        coverage=info["coverage"],
        decisions=decisions,
        seconds=time.process_time() - begin,
        map_error=info["map_error"],
    )


def drive_plans(
    config: WheelsConfig,
    act: Callable[[Any], Any],
    plans: Sequence[FloorPlan],
    seeds: Sequence[int] | None = None,
) -> list[DriveOutcome]:
    """Explore each plan once in a batch of environments, without noise in the actions.

    Args:
        config: The run.
        act: From observations, shape (N, n), to actions, shape (N, 2).
        plans: Buildings.
        seeds: Of starts and noise, one for each plan; by default they follow from the plans' ids.
    """
    seeds = [exploration_seed(0, plan.id, 0) for plan in plans] if seeds is None else seeds
    env = make_batch(config, list(plans), len(plans), coverage_goal=None)
    observations, _ = env.reset(seed=seeds[0])
    for i, plan in enumerate(plans):
        options = {"reset_mask": np.arange(len(plans)) == i, "plan": plan.id}
        observations, _ = env.reset(seed=[seeds[i]] * len(plans), options=options)
    for step in range(round(config.evaluate_seconds / env.config.control_step)):
        if step % HOLD == 0:
            actions = act(observations)
        observations, _, _, _, infos = env.step(actions)
    contacts = infos["collisions"] * CONTACT_SECONDS / config.evaluate_seconds
    figures = zip(infos["coverage"].tolist(), contacts.tolist(), infos["path_length"].tolist(), strict=True)
    return [DriveOutcome(*row) for row in figures]


def mean_outcome(outcomes: Sequence[PolicyOutcome] | Sequence[DriveOutcome]) -> dict[str, float]:
    """Means over explorations of each field."""
    names = [entry.name for entry in fields(outcomes[0])]
    return {name: float(np.mean([getattr(one, name) for one in outcomes])) for name in names}
