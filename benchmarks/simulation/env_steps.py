"""Environment steps per second of one core, and how that depends on the settings and on the building.

Times are CPU seconds of this process, all its threads together. ``--batch`` measures a batch of environments and a
single one, in turns, so that both see the same load of the machine; what threads gain where each has a core follows
from the CPU time of each. ``--decisions`` measures the level of decisions instead: decisions per CPU second, and what a
decision of ``tour`` costs.

    python benchmarks/simulation/env_steps.py [--batch | --decisions] [--plans procedural]
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely

from slamgym.agents.plan_splits import draw_plans
from slamgym.agents.rules import FrontierTour
from slamgym.cad import FloorPlan, open_plans
from slamgym.envs import BatchExploreEnv, ExploreEnv, ExploreFrontiersEnv
from slamgym.envs.batch import threads

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/envs", "slamgym/sim", "slamgym/slam")
"""What is measured."""

MODES = ("ground_truth", "dead_reckoning", "pose_graph", "rbpf")
GOAL = 3000
"""Steps/s that ground_truth localisation should reach."""
STAGES = ("drive", "draw_noise", "sense", "are_complete", "record", "figures", "observe")
"""Methods of a batch's parts whose time is taken."""
BATCHES = (
    ("ground_truth", "dict", ((8, 1), (64, 1), (64, 2))),
    ("ground_truth", "compact", ((8, 1), (64, 1), (64, 2))),
    ("pose_graph", "dict", ((16, 1), (16, 2))),
)
"""Localisation, preset, and numbers of robots and threads."""
PLAN = "home_000334"
COARSE = {"slam": {"resolution": 0.1}, "observation": {"map_resolution": 0.1}}
DECISION_MODES: dict[str, dict[str, Any]] = {
    "ground truth, 0.1 m cells (training)": {"localization": "ground_truth", **COARSE},
    "ground truth, 0.05 m cells": {"localization": "ground_truth"},
    "particle filter, 0.05 m cells (evaluation)": {"localization": "rbpf"},
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--decisions", action="store_true", help="measure decisions instead of steps"
    )
    parser.add_argument(
        "--batch", action="store_true", help="measure a batch beside a single environment"
    )
    parser.add_argument("--plans", default="procedural", help="floor plans of --decisions")
    arguments = parser.parse_args()
    if arguments.decisions:
        measure_decisions(arguments.plans)
    elif arguments.batch:
        measure_batch()
    else:
        measure_steps()


def measure_steps() -> None:
    print_and_save(
        "simulation/env_steps_modes",
        f"Environment steps per CPU second, by localisation and observed map (goal: ground_truth {GOAL:,})",
        list(modes()),
        ("localisation", "map", "steps/s", "ms per step", "reset ms"),
        MODULES,
        times=("steps/s", "ms per step", "reset ms"),
    )
    print_and_save(
        "simulation/env_steps_growth",
        "How the cost of a step grows",
        list(growth()),
        ("localisation", "what", "value", "steps/s", "ms per step"),
        MODULES,
        times=("steps/s", "ms per step"),
    )
    print_and_save(
        "simulation/env_resets",
        "Resets",
        list(resets()),
        ("plans", "first reset of a plan ms", "later ones ms"),
        MODULES,
        times=("first reset of a plan ms", "later ones ms"),
    )


def modes() -> Iterator[tuple[Any, ...]]:
    for mode in MODES:
        for view in ("egocentric", "global"):
            env = ExploreEnv("bundled", localization=mode, observation={"map": view})
            rate = steps_per_second(env)
            yield mode, view, rate, 1e3 / rate, 1e3 * seconds_per_reset(env)


def growth() -> Iterator[tuple[Any, ...]]:
    for particles in (10, 30, 100):
        yield (
            "rbpf",
            "particles",
            particles,
            *cost(localization="rbpf", slam={"particles": particles}),
        )
    for mode in ("ground_truth", "rbpf"):
        for beams in (90, 180, 360, 720):
            yield mode, "beams", beams, *cost(localization=mode, lidar={"num_beams": beams})
        for pillars in (0, 25, 100, 400):
            plan = hall_with_pillars(pillars)
            yield mode, "walls", len(plan.segments()), *cost(plan, localization=mode)
        for factor in (1.0, 2.0, 4.0):
            plan = stretched(factor)
            yield mode, "floor area m2", round(plan.area), *cost(plan, localization=mode)


def resets() -> Iterator[tuple[Any, ...]]:
    env = ExploreEnv("bundled", localization="ground_truth")
    env.reset(seed=0)
    begin = time.process_time()
    names = open_plans("bundled").ids
    for name in names:
        env.reset(options={"plan": name})
    first = (time.process_time() - begin) / len(names)
    yield f"bundled ({len(names)})", 1e3 * first, 1e3 * seconds_per_reset(env)
    furnished = ExploreEnv(
        "bundled", localization="ground_truth", clutter={"furniture": 1.0, "people": 2}
    )
    yield "bundled, furnished again at every reset", None, 1e3 * seconds_per_reset(furnished)


def cost(plan: FloorPlan | str = "bundled", **settings: Any) -> tuple[float, float]:
    rate = steps_per_second(ExploreEnv(plan, **settings))
    return rate, 1e3 / rate


def measure_batch(turns: int = 5) -> None:
    """Median rates of turns of 0.5 CPU seconds; episodes end when all is explored, as by default."""
    rows, stages = [], []
    for mode, preset, sizes in BATCHES:
        settings: dict[str, Any] = {
            "localization": mode,
            "observation": {"preset": preset},
            "time_limit": None,
        }
        single = ExploreEnv("bundled", **settings)
        for count, num_threads in sizes:
            batch = BatchExploreEnv(
                count, "bundled", autoreset_mode="same_step", threads=num_threads, **settings
            )
            batch.reset(seed=1)
            batch_rate(batch, 2.0)
            rates = np.array(
                [(steps_per_second(single, 0.5), *batch_rates(batch)) for _ in range(turns)]
            )
            ratios = rates[:, 1:] / rates[:, :1]
            spread = [figure(ratios[:, 0]) for figure in (np.median, np.min, np.max)]
            key = [mode, preset, count, num_threads]
            rows.append([*key, *np.median(rates[:, :2], axis=0), *spread, np.median(ratios[:, 1])])
            if num_threads == 1:
                stages.append([mode, preset, count, *stage_costs(batch)])
    columns = ["localisation", "preset", "robots", "threads", "single steps/s", "batch steps/s"]
    columns += ["ratio", "least", "most", "ratio with a core for each thread"]
    print_and_save(
        "simulation/env_steps_batch",
        "Steps per CPU second of a batch of robots",
        rows,
        columns,
        MODULES,
    )
    columns = ["localisation", "preset", "robots", *STAGES]
    print_and_save(
        "simulation/env_steps_batch_stages",
        "CPU time of the stages of a step for each robot of a batch, in us; draw_noise is a part of sense",
        stages,
        columns,
        MODULES,
    )


class TimedPool:
    """Threads whose CPU time is taken, by which one knows how long they take where each has a core of its own.

    Attributes:
        saved: CPU time that the parts of each division took less that of the longest thread [s].
    """

    def __init__(self, pool: Any) -> None:
        self._pool, self.saved = pool, 0.0

    def map(self, work: Any, parts: list[Any]) -> list[float]:
        """Let the threads work; returns the CPU time of each part [s]."""

        def timed(part: Any) -> float:
            begin = time.thread_time()
            work(part)
            return time.thread_time() - begin

        spent = list(self._pool.map(timed, parts))
        self.saved += sum(spent) - max(max(spent), sum(spent) / self._pool._max_workers)
        return spent


def batch_rates(env: BatchExploreEnv) -> tuple[float, float]:
    """Steps per CPU second, and per second where each thread has a core."""
    original = threads._pool
    pool = TimedPool(original(os.getpid(), env._explorations.fleet.threads))
    threads._pool = lambda *_: pool  # type: ignore[assignment]
    begin = time.process_time()
    rate = batch_rate(env, 0.5)
    seconds = time.process_time() - begin
    threads._pool = original
    return rate, rate * seconds / (seconds - pool.saved)


def stage_costs(env: BatchExploreEnv) -> list[float]:
    """CPU time of each stage for a step of one robot [us]."""
    spent = dict.fromkeys(STAGES, 0.0)
    parts: Any = env._explorations
    owners = {
        "drive": parts.fleet,
        "draw_noise": parts.fleet,
        "sense": parts.beliefs,
        "record": parts.assessment,
        "observe": parts.observer,
    }

    def timed(name: str, function: Any) -> Any:
        def call(*arguments: Any) -> Any:
            begin = time.thread_time()
            result = function(*arguments)
            spent[name] += time.thread_time() - begin
            return result

        return call

    for name in STAGES:
        owner = owners.get(name, parts)
        attribute = name if hasattr(owner, name) else f"_{name}"
        setattr(owner, attribute, timed(name, getattr(owner, attribute)))
    begin = time.thread_time()
    rate = batch_rate(env, 1.0)
    steps = rate * (time.thread_time() - begin)
    return [1e6 * seconds / steps for seconds in spent.values()]


def batch_rate(env: BatchExploreEnv, seconds: float) -> float:
    """Wander about as :func:`steps_per_second` does, from where the robots are."""
    rng, count = np.random.default_rng(0), env.num_envs
    turns, backs = np.zeros(count), np.zeros(count, dtype=np.bool_)
    begin, steps = time.process_time(), 0
    while time.process_time() - begin < seconds:
        turns = 0.9 * turns + 0.2 * rng.standard_normal(count)
        actions = np.column_stack([np.where(backs, -1.0, 0.8), np.where(backs, 1.0, turns)])
        *_, infos = env.step(actions)
        backs = (infos["reward_terms"]["collision"] < 0.0) & ~backs
        steps += count
    return steps / (time.process_time() - begin)


def steps_per_second(env: ExploreEnv, seconds: float = 3.0) -> float:
    """Wander about for some CPU seconds after a warm-up; resets count."""
    env.reset(seed=1)
    rng = np.random.default_rng(0)
    for _ in range(50):
        env.step(env.action_space.sample())
    begin, steps, turn = time.process_time(), 0, 0.0
    while time.process_time() - begin < seconds:
        for _ in range(50):
            turn = 0.9 * turn + 0.2 * rng.standard_normal()
            _, _, terminated, truncated, info = env.step((0.8, turn))
            if info["reward_terms"]["collision"] < 0.0:
                env.step((-1.0, 1.0))
                steps += 1
            if terminated or truncated:
                env.reset()
            steps += 1
    return steps / (time.process_time() - begin)


def seconds_per_reset(env: ExploreEnv, count: int = 40) -> float:
    for seed in range(5):
        env.reset(seed=seed)
    begin = time.process_time()
    for _ in range(count):
        env.reset()
    return (time.process_time() - begin) / count


def hall_with_pillars(count: int) -> FloorPlan:
    """A hall of 20 x 20 m with pillars of 0.2 m on a square grid: four walls each."""
    side = round(count**0.5)
    places = [20.0 * (i + 0.5) / side for i in range(side)]
    pillars = [shapely.box(x - 0.1, y - 0.1, x + 0.1, y + 0.1) for x in places for y in places]
    hall = shapely.box(0, 0, 20, 20).difference(shapely.union_all(pillars))
    assert isinstance(hall, shapely.Polygon)
    return FloorPlan(f"hall_{count}", hall)


def stretched(factor: float) -> FloorPlan:
    """A bundled home, enlarged: the same number of walls on more floor."""
    source = open_plans("bundled")
    plan = source.load(PLAN if PLAN in source.ids else source.ids[0])
    return FloorPlan(
        f"{plan.id}_x{factor:g}", shapely.affinity.scale(plan.free_space, factor, factor)
    )


def measure_decisions(name: str) -> None:
    """Explore four validation plans of a source in each mode."""
    cv2.setNumThreads(1)
    plans = draw_plans([name], "validation", 4)
    rows = []
    for mode, settings in DECISION_MODES.items():
        env = ExploreFrontiersEnv(plans, time_limit=600.0, **settings)
        env.reset(seed=0)
        env.step(0)  # compiles
        spent, decisions, lasting = 0.0, 0, 0.0
        clocks: list[float] = []
        for seed, plan in enumerate(plans):
            begin = time.process_time()
            env.reset(seed=seed, options={"plan": plan})
            over = False
            while not over:
                begin_choice = time.process_time()
                action = int(np.argmax(FrontierTour()(env.loop))) if env.loop.candidates else 0
                clocks.append(time.process_time() - begin_choice)
                _, _, terminated, truncated, info = env.step(action)
                over, decisions, lasting = (
                    terminated or truncated,
                    decisions + 1,
                    lasting + info["duration"],
                )
            spent += time.process_time() - begin
        spent -= sum(clocks)
        rows.append(
            [
                mode,
                round(decisions / spent),
                round(lasting / decisions, 1),
                round(1e3 * float(np.mean(clocks)), 1),
                round(1e3 * float(np.quantile(clocks, 0.99)), 1),
            ]
        )
    columns = [
        "mode",
        "decisions / CPU s",
        "s of robot time each",
        "choosing, mean [ms]",
        "choosing, p99 [ms]",
    ]
    times = [column for column in columns[1:] if column != "s of robot time each"]
    print_and_save(
        "simulation/decision_rate",
        "Decisions on four validation plans",
        rows,
        columns,
        MODULES,
        times,
    )


if __name__ == "__main__":
    main()
