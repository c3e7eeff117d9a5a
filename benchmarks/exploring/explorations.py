"""Whole explorations: CPU seconds of 7 minutes of robot time, and where they go.

    python benchmarks/exploring/explorations.py [--plans json.tar.gz] [--explorations 10] [--minutes 7] [--mode rbpf]

An exploration is what ``slamgym generate --plans-filter useful`` does for one pair, on one core: the environment with
180 beams, the explorer, and writing images, maps, trajectories and the log. Explorers that are done early need less
than the full time, so the sums are scaled to the full robot time. The fixed programs of :mod:`report` are timed before
each exploration.
"""

import functools
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro

from slamgym.agents.explorer import BatchedExplorer
from slamgym.agents.registry import make_explorer
from slamgym.cad import PlanGroup, PlanSource, open_plans
from slamgym.cad.plan_filter import passes
from slamgym.dataset import DatasetConfig, PairRecord
from slamgym.dataset.generate import exploration
from slamgym.dataset.generate.build import schedule_groups
from slamgym.dataset.generate.exploration import ExplorationTask, run_exploration
from slamgym.envs import EpisodeConfig, ExploreConfig, ExploreEnv
from slamgym.envs.warmup import warm_up
from slamgym.sim import Lidar, WheelOdometry, World
from slamgym.slam import SlamConfig
from slamgym.slam.config import Mode
from slamgym.slam.mapper import Mapper

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import Yardsticks, print_and_save

GOAL = 6.5
"""CPU time of a 7-minute exploration with 180 beams, in Python loops of ten million additions."""

PARTS: dict[str, list[tuple[Any, str]]] = {
    "SLAM": [(Mapper, "update")],
    "explorer (frontiers, navigation)": [(BatchedExplorer, "predict")],
    "world and sensors": [
        (World, "step"),
        (Lidar, "look"),
        (Lidar, "measure"),
        (WheelOdometry, "update"),
    ],
    "observation (map published)": [(ExploreEnv, "_observe")],
    "coverage, errors, log": [(ExploreEnv, "step")],
    "start": [(ExploreEnv, "reset")],
    "writing the pair": [(exploration, name) for name in ("make_pair", "stage_pair")],
}
"""Functions of each part, which is timed without what they call of the other parts."""


@dataclass(frozen=True)
class Arguments:
    """CPU time of whole explorations."""

    explorations: int = 10
    """Number of explorations, each of another plan."""
    minutes: float = 7.0
    """Limit of robot time; the paper's 7."""
    mode: Mode = "pose_graph"
    """SLAM mode."""
    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    seed: int = 0
    """Seed of the dataset."""


class Profile:
    """CPU seconds by part; nested parts are charged to the inner one alone."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inner = [0.0]

    def timed(self, part: str, function: Any) -> Any:
        """A function that charges its time to a part."""

        @functools.wraps(function)
        def run(*args: Any, **kwargs: Any) -> Any:
            self._inner.append(0.0)
            began = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent = time.process_time() - began
                self.seconds[part] += spent - self._inner.pop()
                self._inner[-1] += spent

        return run

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Time the parts inside the block."""
        kept = [
            (owner, name, getattr(owner, name))
            for places in PARTS.values()
            for owner, name in places
        ]
        for part, places in PARTS.items():
            for owner, name in places:
                setattr(owner, name, self.timed(part, getattr(owner, name)))
        try:
            yield
        finally:
            for owner, name, function in kept:
                setattr(owner, name, function)


@dataclass(frozen=True)
class Cost:
    """Cost of one exploration."""

    robot_seconds: float
    cpu_seconds: float
    yardsticks: Yardsticks


def main() -> None:
    arguments = tyro.cli(Arguments)
    warm_up()
    env = ExploreConfig(slam=SlamConfig(mode=arguments.mode))
    config = DatasetConfig(
        arguments.seed, "useful", EpisodeConfig(minutes=arguments.minutes, env=env)
    )
    plans = open_plans(arguments.plans)
    tasks = list(islice(explorations(plans, config), arguments.explorations))
    profile = Profile()
    explore(tasks[0])  # loads compiled kernels from disk; not counted
    with profile.watching():
        costs = [explore(task) for task in tasks]
    report(arguments, profile, costs)


def explorations(plans: PlanSource, config: DatasetConfig) -> Iterator[ExplorationTask]:
    """First explorations of ``slamgym generate``."""
    for slot in schedule_groups([PlanGroup(plans.ids, 1.0)], config.seed):
        plan = plans.load(slot.plan_id)
        if passes(plan, config.plans_filter):
            yield ExplorationTask(slot, plan, None, config, make_explorer)


def explore(task: ExplorationTask) -> Cost:
    """One exploration, written to disk as ``slamgym generate`` writes it."""
    yardsticks = Yardsticks.measure(1)
    with TemporaryDirectory() as folder:
        outcome = run_exploration(replace(task, staged=Path(folder) / "pair"))
        record = PairRecord.from_line((Path(folder) / "pair/episode/episode.json").read_text())
    return Cost(record.robot_seconds, outcome.timing["cpu_seconds"], yardsticks)


def report(arguments: Arguments, profile: Profile, costs: list[Cost]) -> None:
    total = sum(cost.cpu_seconds for cost in costs)
    scale = 60.0 * arguments.minutes / sum(cost.robot_seconds for cost in costs)
    loop, kernel = np.mean([cost.yardsticks for cost in costs], axis=0).tolist()
    parts = sorted(profile.seconds.items(), key=lambda item: -item[1])
    parts += [("other", total - sum(profile.seconds.values())), ("all", total)]
    rows = [
        [part, round(seconds * scale, 3), round(100.0 * seconds / total, 1)]
        for part, seconds in parts
    ]
    title = (
        f"{arguments.minutes:g} min of robot time, {arguments.mode}: {total * scale / loop:.2f} loops; "
        f"goal {GOAL:g} ({len(costs)} explorations of {Path(arguments.plans).name}, "
        f"{60.0 / (total * scale):.1f} per CPU minute)"
    )
    print_and_save(
        "exploring/explorations",
        title,
        rows,
        ["part", "CPU [s]", "share [%]"],
        times=("CPU [s]",),
        yardsticks=Yardsticks(loop, kernel),
    )


if __name__ == "__main__":
    main()
