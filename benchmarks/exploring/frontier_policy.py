"""Policies that choose frontiers, against the rules, on fresh homes: time until done, failures counted as the limit.

    python benchmarks/exploring/frontier_policy.py procedural:home:90711 --count 40 [--trainings FILE ...]
        [--out folder]

It runs ``slamgym agents evaluate`` with its default promise and mapper; what the folder holds isn't done again. Nothing
was trained or chosen on the homes of that seed. Trainings with other seeds get rows of their own, and one with the
shipped policy together, whose intervals hold for other plans and other seeds.
"""

import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from slamgym.agents.evaluation.evaluate import EvaluationConfig, evaluate
from slamgym.agents.evaluation.report import with_bounds
from slamgym.agents.evaluation.summary import DONE, censored, succeeded
from slamgym.agents.evaluation.trial import Trial
from slamgym.agents.pretrained_policy import read_policy
from slamgym.agents.rl.train_config import POLICY
from slamgym.cad import open_plans
from slamgym.core.intervals import crossed_mean, crossed_ratio, mean_interval, ratio_of_means
from slamgym.core.parallel.engine import Execution
from slamgym.core.types import FloatArray

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("agents", "slamgym/planning", "slamgym/slam")
"""What is measured."""
CURVE = Path(__file__).parents[2] / "docs" / "images" / "frontier_curve.png"
SHIPPED = "frontier_policy"
RIVALS = ("explore_lite", "nearest", "tour")
"""The policy's time is divided by theirs."""


@dataclass(frozen=True)
class Arguments:
    """Evaluate policies that choose frontiers."""

    plans: tyro.conf.Positional[str]
    """Floor plans."""
    count: int = 40
    """Number of them."""
    explorers: str = "explore_lite,nearest,tour,frontier_policy"
    """Names, with commas between them."""
    trainings: tuple[Path, ...] = ()
    """Weights of the same training with other seeds."""
    seed: int = 0
    """Decides plans, starts and noise."""
    out: Path = Path("out/frontier_policy")
    """Folder of the explorations."""
    runs: tuple[Path, ...] = ()
    """Folders of trainings, whose curves are drawn into the docs."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    if arguments.runs:
        draw_curves(arguments.runs)
    seeds = {f"rl:{path}": seed_of(path) for path in arguments.trainings}
    names = (*arguments.explorers.split(","), *seeds)
    config = EvaluationConfig(explorers=names, count=arguments.count, seed=arguments.seed)
    found = evaluate(open_plans(arguments.plans), config, arguments.out, Execution(1)).trials
    by_name = {name: [trial for trial in found if trial.explorer == name] for name in names}
    plans = set.intersection(*({trial.plan for trial in own} for own in by_name.values()))
    aligned = {
        name: sorted((one for one in own if one.plan in plans), key=lambda one: one.plan)
        for name, own in by_name.items()
    }
    rows = [row_of(seeds.get(name, name), [name], aligned) for name in names]
    if seeds:
        rows.append(row_of("all seeds", [SHIPPED, *seeds], aligned))
    title = f"{len(plans)} homes of {arguments.plans}"
    print_and_save("exploring/frontier_policy", title, rows, list(rows[0]), MODULES)


def draw_curves(runs: Sequence[Path]) -> None:
    """Draw how explorations of trainings became shorter, from their logs, of which each resumption begins another."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    _, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7.0, 4.0), layout="tight")
    for run in runs:
        rows: list[dict[str, str]] = []
        for log in sorted(run.glob("log/*/progress.csv"), key=lambda path: int(path.parent.name)):
            rows += csv.DictReader(log.open())
        decisions = [float(row["time/total_timesteps"]) for row in rows]
        seconds = [float(row["rollout/episode_seconds"]) for row in rows]
        above.plot(decisions, seconds, label=seed_of(run / POLICY))
        below.plot(decisions, [100.0 * float(row["rollout/episode_coverage"]) for row in rows])
    above.legend()
    above.set_ylabel("robot time [s]")
    above.set_ylim(bottom=0.0)
    below.set_ylabel("floor seen [%]")
    below.set_xlabel("decisions; means over the last 100 explorations")
    plt.savefig(CURVE, dpi=100)


def seed_of(path: Path) -> str:
    """What a training is called by."""
    _, about = read_policy(path)
    return f"seed {about['training']['seed']}"


def row_of(title: str, names: list[str], trials: dict[str, list[Trial]]) -> dict[str, Any]:
    """Figures of an explorer, or of several trainings of it; trials are in the same order for all."""
    times = times_of(names, trials)
    # With one training other plans alone are drawn.
    mean = mean_interval(times[0]) if len(names) == 1 else crossed_mean(times)
    row: dict[str, Any] = {
        "explorer": title,
        "n": times.size,
        "success [%]": round(
            100.0 * float(np.mean([succeeded(trial) for name in names for trial in trials[name]])),
            1,
        ),
        "time [s]": with_bounds(mean, 0),
    }
    for rival in RIVALS:
        theirs = times_of([rival], trials)
        ratio = (
            ratio_of_means(times[0], theirs[0]) if len(names) == 1 else crossed_ratio(times, theirs)
        )
        row[f"/ {rival}"] = with_bounds(ratio)
    return row


def times_of(names: list[str], trials: dict[str, list[Trial]]) -> FloatArray:
    """Times until done, failures at the time limit, shape (explorers, plans) [s]."""
    return np.array([[censored(trial, "time", DONE) for trial in trials[name]] for name in names])


if __name__ == "__main__":
    main()
