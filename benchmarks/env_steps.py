"""Environment steps per second of one core, and how that depends on the settings and on the building.

Times are CPU seconds of this process, all its threads together. Run: ``python benchmarks/env_steps.py``.
"""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from report import print_and_save

from slamgym.cad import FloorPlan, open_plans
from slamgym.envs import ExploreEnv

MODES = ("ground_truth", "dead_reckoning", "scan_matching", "rbpf")
GOAL = 3000
"""Steps/s that ground_truth localisation is to reach."""
PLAN = "home_000334"


def main() -> None:
    print_and_save(
        "env_steps_modes",
        f"Environment steps per CPU second, by localisation and observed map (goal: ground_truth {GOAL:,})",
        list(modes()),
        ("localisation", "map", "steps/s", "ms per step", "reset ms"),
    )
    print_and_save(
        "env_steps_growth",
        "How the cost of a step grows",
        list(growth()),
        ("localisation", "what", "value", "steps/s", "ms per step"),
    )
    print_and_save(
        "env_resets", "Resets", list(resets()), ("plans", "first reset of a plan ms", "later ones ms")
    )


def modes() -> Iterator[tuple[Any, ...]]:
    for mode in MODES:
        for view in ("egocentric", "global"):
            env = ExploreEnv("bundled", localization=mode, observation={"map": view})
            rate = steps_per_second(env)
            yield mode, view, rate, 1e3 / rate, 1e3 * seconds_per_reset(env)


def growth() -> Iterator[tuple[Any, ...]]:
    for particles in (10, 30, 100):
        yield "rbpf", "particles", particles, *cost(localization="rbpf", slam={"particles": particles})
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
    furnished = ExploreEnv("bundled", localization="ground_truth", clutter={"furniture": 1.0, "people": 2})
    yield "bundled, furnished anew at every reset", None, 1e3 * seconds_per_reset(furnished)


def cost(plan: FloorPlan | str = "bundled", **settings: Any) -> tuple[float, float]:
    rate = steps_per_second(ExploreEnv(plan, **settings))
    return rate, 1e3 / rate


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
    return FloorPlan(f"hall_{count}", shapely.box(0, 0, 20, 20).difference(shapely.union_all(pillars)))


def stretched(factor: float) -> FloorPlan:
    """A bundled home, enlarged: the same number of walls on more floor."""
    source = open_plans("bundled")
    plan = source.load(PLAN if PLAN in source.ids else source.ids[0])
    return FloorPlan(f"{plan.id}_x{factor:g}", shapely.affinity.scale(plan.free_space, factor, factor))


if __name__ == "__main__":
    main()
