"""Memory and physics over very many steps under random actions: does either give way?

    python benchmarks/simulation/soak.py [--steps 1000000] [--localization ground_truth]

An action is drawn from the action space and held for a geometrically distributed number of steps, so that the robot
gets somewhere and pushes against walls. After every step its body must lie on the floor. The resident set is
read from /proc; what is allocated until all plans were seen (caches) doesn't count as growth.

A resident set also holds memory that was freed and that the C library keeps; so where growth begins to count and at
the end it is measured once more after `malloc_trim` has given that back to the system.
"""

import ctypes
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import tyro

from slamgym.envs import ExploreEnv

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save, resident_mb

MODULES = ("slamgym/envs", "slamgym/sim", "slamgym/slam")
"""What is measured."""

GOAL_MB = 5.0
"""Growth after the settling steps that a run should stay below."""


@dataclass(frozen=True)
class Arguments:
    """Memory and physics over very many steps."""

    steps: int = 1_000_000
    """Steps of the environment."""
    settle: int = 100_000
    """Growth counts from here."""
    localization: str = "ground_truth"
    """As the environment takes it; with rbpf a step costs some twenty times as much."""
    plans: str = "bundled"
    """Floor plans."""
    hold: float = 5.0
    """Mean number of steps for which an action is held."""
    seed: int = 0
    """Random seed of everything."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    env = ExploreEnv(arguments.plans, localization=arguments.localization)
    every = max(1, arguments.steps // 100)
    samples, trimmed, episodes, collisions, outside = [], [], 0, 0, 0
    began = time.process_time()
    for step, (is_over, on_floor) in enumerate(wander(env, arguments), start=1):
        outside += not on_floor
        if is_over:
            episodes, collisions = episodes + 1, collisions + env.simulation.collisions
        if step % every == 0:
            samples.append((step, resident_mb(os.getpid())))
        if step in (arguments.settle, arguments.steps):
            trimmed.append(trimmed_mb())
    rate = arguments.steps / (time.process_time() - began)
    table = np.array([sample for sample in samples if sample[0] >= arguments.settle])
    slope = 1e6 * float(np.polyfit(table[:, 0], table[:, 1], 1)[0])
    early, late, most = table[0, 1], table[-1, 1], table[:, 1].max()
    print_and_save(
        f"exploring/soak_{arguments.localization}",
        f"{arguments.steps:,} random steps on {arguments.plans} plans (goal: growth below {GOAL_MB:g} MB)",
        [
            [arguments.localization, rate, episodes, collisions, outside]
            + [round(float(value), 1) for value in (early, late, most, late - early, slope)]
            + [round(value, 1) for value in (*trimmed, trimmed[-1] - trimmed[0])]
        ],
        (
            "localisation",
            "steps/s",
            "episodes",
            "collisions",
            "steps off the floor",
            f"at {arguments.settle:,} steps [MB]",
            "at the end [MB]",
            "most after settling [MB]",
            "growth [MB]",
            "slope [MB per million steps]",
            f"trimmed at {arguments.settle:,} steps [MB]",
            "trimmed at the end [MB]",
            "growth, trimmed [MB]",
        ),
        MODULES,
        times=("steps/s",),
    )


def trimmed_mb() -> float:
    """The resident set after freed memory was given back; of glibc alone."""
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    return resident_mb(os.getpid())


def wander(env: ExploreEnv, arguments: Arguments) -> Iterator[tuple[bool, bool]]:
    """Step under random actions; whether the episode is over, and whether the robot is on the floor."""
    rng = np.random.default_rng(arguments.seed)
    env.action_space.seed(arguments.seed)
    env.reset(seed=arguments.seed)
    action: Any = None
    for _ in range(arguments.steps):
        if action is None or rng.random() < 1.0 / arguments.hold:
            action = env.action_space.sample()
        _, _, terminated, truncated, _ = env.step(action)
        yield terminated or truncated, is_on_floor(env)
        if terminated or truncated:
            env.reset()


def is_on_floor(env: ExploreEnv) -> bool:
    """True if the whole body of a round robot lies on the plan's floor."""
    x, y, _ = env.simulation.true_pose
    floor = env.plan.free_space
    shapely.prepare(floor)
    beside = shapely.dwithin(floor.boundary, shapely.Point(x, y), env.config.robot.radius - 1e-6)
    return bool(shapely.contains_xy(floor, x, y)) and not bool(beside)


if __name__ == "__main__":
    main()
