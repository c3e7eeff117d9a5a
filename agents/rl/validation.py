"""How well a policy explores buildings that it doesn't learn on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.core.config import Counted, Measured, Share

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan
    from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv

Choose = Callable[[dict[str, Any]], int]
"""From an observation of ``slamgym/ExploreFrontiers-v1`` to an action."""


@dataclass(frozen=True)
class PolicyOutcome:
    """One exploration. Times and paths that were not reached count as those at the end."""

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


def explore_plan(env: ExploreFrontiersEnv, choose: Choose, plan: FloorPlan, seed: int) -> PolicyOutcome:
    """Explore one building to the end.

    Args:
        env: The environment.
        choose: The policy.
        plan: The building.
        seed: Of start and noise.
    """
    observation, info = env.reset(seed=seed, options={"plan": plan})
    reached: dict[float, tuple[float, float]] = {}  # to within a decision
    begin, decisions, is_over = time.process_time(), 0, False
    while not is_over:
        observation, _, terminated, truncated, info = env.step(choose(observation))
        decisions += 1
        for share in (0.95, 0.99):
            if info["coverage"] >= share:
                reached.setdefault(share, (info["time"], info["path_length"]))
        is_over = terminated or truncated
    end = info["time"], info["path_length"]
    (time_95, path_95), (time_99, path_99) = reached.get(0.95, end), reached.get(0.99, end)
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


def mean_outcome(outcomes: Sequence[PolicyOutcome]) -> dict[str, float]:
    """Means over explorations: the fields of :class:`PolicyOutcome`, and ``decisions_per_second``."""
    means = {
        name: float(np.mean([getattr(outcome, name) for outcome in outcomes]))
        for name in PolicyOutcome.__dataclass_fields__
    }
    seconds = math.fsum(outcome.seconds for outcome in outcomes)
    means["decisions_per_second"] = sum(outcome.decisions for outcome in outcomes) / max(seconds, 1e-9)
    return means
