r"""Coverage by the policy that drives the wheels, in 90 s of buildings that it didn't learn on, and by frontier rules.

Every explorer gets the same plans of the test split, starts and seeds; 95 % bootstrap intervals over plans. With
``--until`` explorations end at this coverage, and times are set against those of the first explorer; ``--curve`` draws
``docs/images/wheels_curve.png``.

    python benchmarks/exploring/wheels.py --plans procedural json.tar.gz --count 60 [--localization rbpf]
    python benchmarks/exploring/wheels.py --plans procedural json.tar.gz --until 0.99 --seconds 900 \
        --explorers tour wheels
    python benchmarks/exploring/wheels.py --curve seed0/validation.csv seed1/validation.csv seed2/validation.csv
"""

import argparse
import itertools
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents import make_explorer
from slamgym.agents.evaluation.report import with_bounds
from slamgym.agents.plan_splits import draw_plans
from slamgym.cad import FloorPlan
from slamgym.core.intervals import mean_interval, ratio_of_means
from slamgym.core.types import FloatArray
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("agents/rl", "slamgym/envs", "slamgym/planning", "slamgym/sim")
"""What is measured."""

CONTACT_MINUTES = 5.0
COLUMNS = ("coverage", "contacts in 5 min", "path [m]", "time [s]")
TITLES = {"time_99": "time until 99 % are seen [s]", "contacts": "contacts in 5 min"}
IMAGE = Path(__file__).parents[2] / "docs" / "images" / "wheels_curve.png"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plans", nargs="+", default=["procedural"])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=90.0)
    parser.add_argument("--until", type=float, default=2.0)
    parser.add_argument("--localization", default="ground_truth")
    parser.add_argument("--explorers", nargs="+", default=["wheels", "random", "explore_lite"])
    parser.add_argument("--curve", type=Path, nargs="+", help="draw validations of runs instead")
    arguments = parser.parse_args()
    if arguments.curve:
        draw_curve(arguments.curve)
        return
    plans = draw_plans(arguments.plans, "test", arguments.count)
    rows = []
    times = []
    for name in arguments.explorers:
        row, spent = measure(name, plans, arguments)
        times.append(spent)
        row["time / first"] = with_bounds(ratio_of_means(spent, times[0]))
        print(row, flush=True)
        rows.append(row)
    whole = "_whole" if arguments.until <= 1.0 else ""
    title = f"{len(plans)} held-out plans, {arguments.seconds:.0f} s, localisation {arguments.localization}"
    print_and_save(
        f"exploring/wheels{whole}_{arguments.localization}", title, rows, list(rows[0]), MODULES
    )


def measure(
    name: str, plans: Sequence[FloorPlan], arguments: argparse.Namespace
) -> tuple[dict[str, Any], FloatArray]:
    """One row, and the time of each exploration (N,) [s]; one that doesn't get there counts as the limit."""
    begin = time.process_time()
    outcomes = np.array([explore(name, plan, seed, arguments) for seed, plan in enumerate(plans)])
    row: dict[str, Any] = {"explorer": name, "plans": len(plans)}
    for column, values in zip(COLUMNS, outcomes.T, strict=True):
        row[column] = with_bounds(mean_interval(values))
    if arguments.until <= 1.0:
        row["time over"] = int((outcomes[:, 0] < arguments.until).sum())
    return row | {"CPU s a plan": (time.process_time() - begin) / len(plans)}, outcomes[:, -1]


def draw_curve(paths: Sequence[Path]) -> None:
    """Time and contacts over the CPU time of trainings; a star where their last weights are averaged."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    for axes, column in zip(figure.subplots(1, 2), TITLES, strict=True):
        for number, path in enumerate(paths):
            table = np.genfromtxt(path, delimiter=",", names=True)
            spent = table["training_cpu_seconds"]
            colour = f"C{number}"
            axes.plot(spent[:-1], table[column][:-1], color=colour, marker="o", markersize=3)
            axes.plot(spent[-1], table[column][-1], color=colour, marker="*", markersize=9)
        axes.set(xlabel="CPU time of the training [s]", ylim=(0.0, None), title=TITLES[column])
        axes.grid(alpha=0.3)
    figure.savefig(IMAGE, dpi=110)


def explore(
    name: str, plan: FloorPlan, seed: int, arguments: argparse.Namespace
) -> tuple[float, ...]:
    """Coverage, contacts in five minutes, path [m] and time [s] of one exploration."""
    seconds = arguments.seconds
    config = ExploreConfig(time_limit=seconds).for_explorer()
    env = ExploreEnv(plan, config, localization=arguments.localization)
    explorer = make_explorer(name, env.explorer_context(), seed)
    steps = episode_steps(env, explorer, env.reset(seed=seed))
    for info in itertools.islice(steps, round(seconds / config.control_step) + 1):
        outcome = info
        spent = env.simulation.time
        if info["coverage"] >= arguments.until:
            break
    else:
        spent = seconds
    contacts = outcome["collisions"] * CONTACT_MINUTES * 60.0 / spent
    return outcome["coverage"], contacts, outcome["path_length"], spent


if __name__ == "__main__":
    main()
