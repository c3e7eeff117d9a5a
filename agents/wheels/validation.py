"""How much of buildings that it doesn't learn on a policy sees in a given time, all of them in one batch."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamgym.agents.wheels.config import WheelsConfig
from slamgym.cad import FloorPlan
from slamgym.core.names import exploration_seed
from slamgym.envs.batch.env import BatchExploreEnv

CONTACT_SECONDS = 300.0
"""Contacts are counted in so many seconds of driving."""


def make_batch(config: WheelsConfig, plans: Any, count: int, **changes: Any) -> BatchExploreEnv:
    """The environments of a run, in one batch.

    Args:
        config: The run.
        plans: Floor plans.
        count: How many environments.
        **changes: Settings of the environment that differ from the run's.
    """
    side = config.network.crop_side
    settings: dict[str, Any] = {
        "localization": config.localization,
        "odometry": config.odometry,
        "reward": config.reward,
        "observation": {"preset": "compact_far", "map": "global", "crop_px": 1, "crop_resolution": side},
        "coverage_goal": config.coverage_goal,
        "time_limit": None,
        "terminate_when_explored": False,
        **changes,
    }
    return BatchExploreEnv(count, plans, autoreset_mode="same_step", **settings)


@dataclass(frozen=True)
class DriveOutcome:
    """One exploration of ``evaluate_seconds``."""

    coverage: float
    contacts: float  # in five minutes
    path: float  # [m]


def drive_plans(
    config: WheelsConfig,
    act: Callable[[Any], Any],
    plans: Sequence[FloorPlan],
    seeds: Sequence[int] | None = None,
) -> list[DriveOutcome]:
    """Explore each plan once, without noise in the actions.

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
        if step % config.network.hold == 0:
            actions = act(observations)
        observations, _, _, _, infos = env.step(actions)
    contacts = infos["collisions"] * CONTACT_SECONDS / config.evaluate_seconds
    figures = zip(infos["coverage"].tolist(), contacts.tolist(), infos["path_length"].tolist(), strict=True)
    return [DriveOutcome(*row) for row in figures]


def validate_wheels(
    config: WheelsConfig, act: Callable[[Any], Any], plans: Sequence[FloorPlan], seed: int = 0
) -> dict[str, float]:
    """Means over plans: the fields of :class:`DriveOutcome`, and the CPU time of all [s]."""
    begin = time.process_time()
    outcomes = drive_plans(config, act, plans, range(seed, seed + len(plans)))
    means = {
        entry.name: float(np.mean([getattr(outcome, entry.name) for outcome in outcomes]))
        for entry in dataclasses.fields(DriveOutcome)
    }
    return {**means, "cpu_seconds": time.process_time() - begin}
