"""Possible gain by choosing better: a chooser that knows the building, on the loop that all explorers share.

    python benchmarks/exploring/choices.py json.tar.gz --count 40

At every choice ``knows the plan`` picks the frontier that costs least in hindsight: the shortest tour through all
frontiers and all hidden floor begins there (:mod:`slamgym.agents.hindsight`, which learning imitates). It drives like
the others, so what it gains is due to its choices alone. Validation plans, true poses, promise 98 % (95 % sure).
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.plan_splits import draw_plans
from slamgym.agents.pretrained_policy import read_policy
from slamgym.agents.rl.imitation import oracle
from slamgym.agents.rules import FrontierTour, Nearest
from slamgym.agents.scoring import FrontierScorer
from slamgym.cad import FloorPlan
from slamgym.core.intervals import ratio_of_means
from slamgym.core.names import exploration_seed
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

Choose = Callable[[dict[str, Any]], int]
"""From an observation of ``slamgym/ExploreFrontiers-v2`` to an action."""
REFERENCE = "tour"
LEVELS = {"time_95": "95 %", "time_99": "99 %", "time": "done"}


def by_rule(rule: Callable[[Any], Any]) -> Callable[[ExploreFrontiersEnv], Choose]:
    """The candidate that a rule scores highest."""
    return lambda env: lambda _: int(np.argmax(rule(env.loop)))


def by_network(scorer: FrontierScorer) -> Choose:
    """The candidate that a network scores highest."""
    return lambda seen: int(scorer.scores(seen).argmax()) if seen["mask"].any() else 0


def knows_the_plan(env: ExploreFrontiersEnv) -> Choose:
    """Chooser of what costs least in hindsight; made when the exploration has begun."""
    made: list[Choose] = []

    def choose(observation: dict[str, Any]) -> int:
        if not made:
            made.append(oracle(env))
        return made[0](observation)

    return choose


CHOOSERS: dict[str, Callable[[ExploreFrontiersEnv], Choose]] = {
    "tour": by_rule(FrontierTour()),
    "nearest": by_rule(Nearest()),
    "rl": lambda _: by_network(read_policy().scorer()),
    "knows the plan": knows_the_plan,
}


def explore_plan(env: ExploreFrontiersEnv, choose: Choose, plan: FloorPlan, seed: int) -> dict[str, float]:
    """Times of one exploration [s], to within a decision; levels that were not reached count as the end."""
    observation, info = env.reset(seed=seed, options={"plan": plan})
    found: dict[str, float] = {}
    is_over = False
    while not is_over:
        observation, _, terminated, truncated, info = env.step(choose(observation))
        for name, share in (("time_95", 0.95), ("time_99", 0.99)):
            if info["coverage"] >= share:
                found.setdefault(name, info["time"])
        is_over = terminated or truncated
    return {name: found.get(name, info["time"]) for name in LEVELS}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plans", help="HouseExpo archive, or what else --plans takes")
    parser.add_argument("--count", type=int, default=40)
    arguments = parser.parse_args()
    plans = draw_plans((arguments.plans,), "validation", arguments.count)
    loop = {"promise": {"seen": 0.98, "confidence": 0.95}}
    env = ExploreFrontiersEnv(plans, loop=loop, localization="ground_truth", time_limit=3000.0)
    outcomes = {
        name: [explore_plan(env, make(env), plan, exploration_seed(0, plan.id, 0)) for plan in plans]
        for name, make in CHOOSERS.items()
    }
    rows = []
    for name, own in outcomes.items():
        row: dict[str, Any] = {"choices by": name, "plans": len(plans)}
        for field, level in LEVELS.items():
            times, reference = (
                np.array([one[field] for one in found]) for found in (own, outcomes[REFERENCE])
            )
            ratio = ratio_of_means(times, reference)
            row |= {f"{level} [s]": times.mean(), f"{level} / {REFERENCE}": ratio.value}
            row |= {f"{level} low": ratio.low, f"{level} high": ratio.high}
        rows.append(row)
    print_and_save(
        "exploring/choices", f"Time to a level of coverage against {REFERENCE}", rows, list(rows[0])
    )


if __name__ == "__main__":
    main()
