"""How much of buildings that it doesn't learn on a policy sees in a given time, all of them in one batch."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from slamgym.agents.wheels.config import WheelsConfig
from slamgym.cad import FloorPlan
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
        "observation": {"preset": "compact", "map": "global", "crop_px": 1, "crop_resolution": side},
        "coverage_goal": config.coverage_goal,
        "time_limit": None,
        "terminate_when_explored": False,
        **changes,
    }
    return BatchExploreEnv(count, plans, autoreset_mode="same_step", **settings)


def validate_wheels(
    config: WheelsConfig, act: Callable[[Any], Any], plans: Sequence[FloorPlan], seed: int = 0
) -> dict[str, float]:
    """Explore each plan once, without noise in the actions.

    Args:
        config: The run.
        act: From observations, shape (N, n), to actions, shape (N, 2).
        plans: Buildings.
        seed: Of starts and noise.

    Returns:
        Mean coverage, contacts in five minutes, path [m], and CPU time [s].
    """
    begin = time.process_time()
    env = make_batch(config, list(plans), len(plans), coverage_goal=None)
    observations, _ = env.reset(seed=seed)
    for i, plan in enumerate(plans):
        options = {"reset_mask": np.arange(len(plans)) == i, "plan": plan.id}
        observations, _ = env.reset(seed=[seed + i] * len(plans), options=options)
    for step in range(round(config.evaluate_seconds / env.config.control_step)):
        if step % config.network.hold == 0:
            actions = act(observations)
        observations, _, _, _, infos = env.step(actions)
    return {
        "coverage": float(infos["coverage"].mean()),
        "contacts": float(infos["collisions"].mean()) * CONTACT_SECONDS / config.evaluate_seconds,
        "path": float(infos["path_length"].mean()),
        "cpu_seconds": time.process_time() - begin,
    }
