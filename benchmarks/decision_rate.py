"""Speed at the level of decisions: decisions per CPU second, and what a decision of the trained policy costs.

``python benchmarks/decision_rate.py [PLANS]``. Rates are of one process; with ``--workers 2`` two of them run.
"""

import sys
import time

import cv2
import numpy as np
from report import print_and_save

from slamgym.agents.pretrained_policy import read_policy
from slamgym.agents.rl.training_envs import draw_plans
from slamgym.envs import ExploreFrontiersEnv
from slamgym.envs.frontier_features import FrontierFeatures
from slamgym.planning.exploration_loop import ExplorationLoop

COARSE = {"slam": {"resolution": 0.1}, "observation": {"map_resolution": 0.1}}
MODES = {
    "ground truth, 0.1 m cells (training)": {"localization": "ground_truth", **COARSE},
    "ground truth, 0.05 m cells": {"localization": "ground_truth"},
    "particle filter, 0.05 m cells (evaluation)": {"localization": "rbpf"},
}


def main() -> None:
    cv2.setNumThreads(1)
    plans = draw_plans([sys.argv[1] if len(sys.argv) > 1 else "procedural"], "validation", 4)
    scorer = read_policy().scorer()
    rows = []
    for mode, settings in MODES.items():
        env = ExploreFrontiersEnv(plans, time_limit=600.0, **settings)
        env.reset(seed=0)
        env.step(0)  # compiles
        spent, decisions, lasting = 0.0, 0, 0.0
        clocks: list[float] = []
        for seed, plan in enumerate(plans):
            begin = time.process_time()
            observation, _ = env.reset(seed=seed, options={"plan": plan})
            over = False
            while not over:
                clocks.append(cost_of_choosing(env.loop, scorer))
                observation, _, terminated, truncated, info = env.step(scorer.choose(observation))
                over, decisions, lasting = terminated or truncated, decisions + 1, lasting + info["duration"]
            spent += time.process_time() - begin
        spent -= sum(clocks)
        rows.append(
            [
                mode,
                f"{decisions / spent:.0f}",
                f"{lasting / decisions:.1f}",
                f"{1e3 * np.mean(clocks):.1f}",
                f"{1e3 * np.quantile(clocks, 0.99):.1f}",
            ]
        )
    columns = [
        "mode",
        "decisions / CPU s",
        "s of robot time each",
        "choosing, mean [ms]",
        "choosing, p99 [ms]",
    ]
    print_and_save("decision_rate", "Decisions on four validation plans", rows, columns)


def cost_of_choosing(loop: ExplorationLoop, scorer: object) -> float:
    """CPU time of features and network for the loop's candidates [s]."""
    begin = time.process_time()
    observation = FrontierFeatures(loop.config.max_candidates).observe(loop)
    scorer.choose(observation)  # type: ignore[attr-defined]
    return time.process_time() - begin


if __name__ == "__main__":
    main()
