"""Beliefs of robots at every choice, with the truth: data for stopping."""

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from slamgym.agents.plan_splits import PlanSplit, split_of
from slamgym.agents.registry import make_explorer
from slamgym.agents.rl.train_config import FURNISHED
from slamgym.cad import FloorPlan, PlanSource, check_plan
from slamgym.cad.plan_filter import passes
from slamgym.core.errors import PlanError
from slamgym.core.names import exploration_seed, shuffled
from slamgym.core.types import BoolArray, FloatArray, OccupancyGrid, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps, explored_env, time_limit
from slamgym.planning import crop_known
from slamgym.planning.remaining import Remains
from slamgym.sim import ClutterConfig
from slamgym.slam import SlamConfig
from slamgym.slam.config import Mode

EXPLORERS = ("nearest", "rl", "tour", "next_best_view")


class Snapshot(NamedTuple):
    """One choice."""

    time: float  # [s]
    coverage: float  # truly seen
    known: OccupancyGrid  # the known part of the map
    pose: Pose2D  # believed
    seen: BoolArray  # floor truly seen, as the exploration's floor
    remains: Remains | None  # what the map doesn't show yet


class Exploration(NamedTuple):
    """One exploration to its end, without a promise."""

    plan: FloorPlan
    start: Pose2D
    floor: BoolArray  # reachable, row 0 at the top
    floor_frame: Any
    snapshots: list[Snapshot]
    curve: FloatArray  # (N, 2) time [s] and coverage

    @property
    def area(self) -> float:
        """Reachable floor [m2]."""
        return float(np.count_nonzero(self.floor)) * self.floor_frame.resolution**2


def explorations(
    source: PlanSource, split: PlanSplit, count: int, mode: Mode, is_furnished: bool = False
) -> Iterator[Exploration]:
    """Explore plans of a split by several explorers in turn.

    Args:
        source: Floor plans.
        split: Which of them.
        count: So many.
        mode: Localisation mode: ``ground_truth`` or ``rbpf``.
        is_furnished: True if furniture stands in them, and leaves hang in half of the doors; the order of the plans is
            another then, so that few are explored both ways.
    """
    clutter = FURNISHED if is_furnished else ClutterConfig()
    config = explored_env(ExploreConfig(slam=SlamConfig(mode=mode), clutter=clutter))
    done = 0
    order = shuffled([plan for plan in source.ids if split_of(plan) == split], 78 if is_furnished else 77)
    for plan_id in order:
        if done == count:
            return
        try:
            plan = source.load(plan_id)
            check_plan(plan, config.robot.radius, 0.5 * config.observation.map_size)
        except PlanError:
            continue
        if passes(plan, "useful"):
            yield _explore(plan, config, EXPLORERS[done % len(EXPLORERS)])
            done += 1


def _explore(plan: FloorPlan, config: ExploreConfig, name: str) -> Exploration:
    env = ExploreEnv(plan, dataclasses.replace(config, time_limit=time_limit(plan, "auto")))
    seed = exploration_seed(5, plan.id, 0)
    reset = env.reset(seed=seed, options={"plan": plan})
    explorer = make_explorer(name, env.explorer_context(), seed)
    explorer.predict(reset[0])
    loop = explorer.loops[0]
    assert loop is not None
    offer = loop._offer
    snapshots: list[Snapshot] = []

    def recorded() -> None:
        offer()
        seen = env.coverage.seen.copy()
        known = crop_known(loop.known_map(), loop.pose)
        remains = loop.remains()
        remains = remains and dataclasses.replace(
            remains, costmap=None
        )  # which would take most of the memory
        snapshots.append(Snapshot(loop.time, env.coverage.share, known, loop.pose, seen, remains))

    with mock.patch.object(loop, "_offer", recorded):
        curve = [(env.simulation.time, info["coverage"]) for info in episode_steps(env, explorer, reset)]
    floor = env.coverage._floor[::-1]
    return Exploration(plan, env.start, floor, env.coverage.frame, snapshots, np.array(curve))
