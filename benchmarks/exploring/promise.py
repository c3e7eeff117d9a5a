"""When an exploration may stop: how often are promises kept in each group of buildings, and what time do they save?

    python benchmarks/exploring/promise.py json.tar.gz [--write]  # a table; --write stores the calibration

Plans of the split ``validation``, the default mapper and four explorers in turn. Stopping earlier changes nothing of
what came before, so all promises are judged on the same explorations. Some 4 s of CPU each, 15 s in large buildings.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np
import tyro
from safetensors.numpy import save_file

from slamgym.agents.plan_groups import BUILDING_GROUPS, plans_of
from slamgym.agents.plan_splits import PlanSplit
from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.intervals import ratio_of_means, wilson_interval
from slamgym.core.names import exploration_seed
from slamgym.core.types import FloatArray
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps, explored_env, fitted_env
from slamgym.planning.promise import CALIBRATION, SMALLEST_CALIBRATED, Promise
from slamgym.sim import ClutterConfig

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("agents/rules.py", "slamgym/planning", "slamgym/slam")
"""What is measured."""

EXPLORERS = ("nearest", "rl", "tour", "next_best_view")
PROMISES = ("95%", "98%", "99%", "2m2")


class Exploration(NamedTuple):
    """One exploration, without a promise: two moments, each a time [s] and the share truly seen."""

    area: float  # reachable floor [m2]
    stop: FloatArray  # where a promise ends it
    end: FloatArray


@dataclass(frozen=True)
class Arguments:
    """Settings of the explorations."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans."""
    count: int = 80
    """Explorations of each group."""
    split: PlanSplit = "validation"
    """Split of the plans."""
    write: bool = False
    """Store the calibration as the one of the package."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    found = {name: explore_group(arguments, name) for name in BUILDING_GROUPS}
    explored = [one for group in found.values() for one in group]
    rows = [
        {"group": name, **figures(group)} for name, group in (found | {"all": explored}).items()
    ]
    print_and_save(
        "exploring/promise", f"{len(explored)} explorations", rows, list(rows[0]), MODULES
    )
    if arguments.write:
        share = np.array([1.0 - one.stop[1] for one in explored], np.float32)
        area = share * np.array([one.area for one in explored], np.float32)
        save_file({"share": share, "area": area}, CALIBRATION)


def explore_group(arguments: Arguments, name: str) -> list[Exploration]:
    """Explore plans of a group by several explorers in turn."""
    clutter = BUILDING_GROUPS[name].clutter
    plans = plans_of(arguments.plans, name, arguments.split)
    return [
        explore(plan, clutter[number % len(clutter)], EXPLORERS[number % len(EXPLORERS)])
        for number, plan in zip(range(arguments.count), plans, strict=False)
    ]


def explore(plan: FloorPlan, clutter: ClutterConfig, name: str) -> Exploration:
    """Explore a building to the end."""
    env = ExploreEnv(plan, fitted_env(plan, explored_env(ExploreConfig(clutter=clutter)), "auto"))
    seed = exploration_seed(5, plan.id, 0)
    reset = env.reset(seed=seed, options={"plan": plan})
    explorer = make_explorer(name, env.explorer_context(), seed)
    explorer.predict(reset[0])
    loop = explorer.loops[0]
    assert loop is not None
    offer = loop._offer
    stops: list[tuple[float, float]] = []

    def recorded() -> None:
        offer()
        is_over = stops or loop.finished
        if is_over or loop.known_area < SMALLEST_CALIBRATED or loop.ways_on() != []:
            return
        state = loop.state
        with mock.patch.object(loop._blacklist, "clear"):
            loop.finish()
        if loop.finished:
            stops.append((loop.time, env.coverage.share))
            loop.state = state

    with mock.patch.object(loop, "_offer", recorded):
        for _ in episode_steps(env, explorer, reset):
            pass
    stops.append((env.simulation.time, env.coverage.share))
    return Exploration(env.coverage.floor_area, np.array(stops[0]), np.array(stops[-1]))


def figures(explored: list[Exploration]) -> dict[str, object]:
    """Figures on how well promises are kept, and their time over that without a promise."""
    row: dict[str, object] = {"explorations": len(explored)}
    for text in PROMISES:
        kept = sum(Promise.parse(text).holds(one.stop[1], one.area) for one in explored)
        interval = wilson_interval(kept, len(explored))
        row[f"{text} kept [%]"] = (
            f"{100 * kept / len(explored):.0f} [{100 * interval.low:.0f}, {100 * interval.high:.0f}]"
        )
    row["98% at the end [%]"] = round(
        100.0 * float(np.mean([one.end[1] >= 0.98 for one in explored]))
    )
    stops, ends = (
        np.array(times)
        for times in zip(*((one.stop[0], one.end[0]) for one in explored), strict=True)
    )
    ratio = ratio_of_means(stops, ends)
    row["time / without"] = f"{ratio.value:.2f} [{ratio.low:.2f}, {ratio.high:.2f}]"
    return row


if __name__ == "__main__":
    main()
