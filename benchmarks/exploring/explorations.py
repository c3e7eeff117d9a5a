"""Whole explorations: CPU seconds of 7 minutes of robot time, and where they go.

    python benchmarks/exploring/explorations.py [--plans json.tar.gz] [--explorations 10] [--minutes 7] [--repeats 3]

An exploration is what ``slamgym generate --plans-filter useful`` does for one pair, on one core: the environment with
180 beams, the explorer, and writing images, maps, trajectories and the log. Explorers that are done early need less
than the full time, so the sums are scaled to the full robot time. The fixed programs of :mod:`report` are timed before
each exploration. The same explorations are made with the particle filter too, in turns, and all is repeated: other load
only adds time, so of each mode the repetition that took the fewest loops counts. A second table says what large
datasets cost: core-hours, hours on some machines, disk and files.
"""

import functools
import statistics
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
from slamgym.envs.batch.fleet import Fleet
from slamgym.envs.batch.observing import BatchObserver
from slamgym.envs.warmup import warm_up
from slamgym.slam import SlamConfig
from slamgym.slam.config import Mode
from slamgym.slam.mapper import Mapper

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import Yardsticks, print_and_save

GOAL = 6.5
"""CPU time of a 7-minute exploration with 180 beams, in Python loops of ten million additions."""
MODES: tuple[Mode, ...] = ("pose_graph", "rbpf")
"""The default and, to compare with, the particle filter."""
SIZES = (4_225, 35_000, 1_000_000)
"""The paper's dataset after cleaning, its explorations, and a large one."""
CORES = (2, 64, 1000)
"""Machines on which their hours are given."""
MODULES = (
    "agents/rules.py",
    "slamgym/dataset/generate",
    "slamgym/envs",
    "slamgym/planning",
    "slamgym/sim",
    "slamgym/slam",
)
"""What is measured."""

PARTS: dict[str, list[tuple[Any, str]]] = {
    "SLAM": [(Mapper, "update")],
    "explorer (frontiers, navigation)": [(BatchedExplorer, "predict")],
    "world and sensors": [(Fleet, "drive"), (Fleet, "look")],
    "observation (map published)": [(BatchObserver, "observe_one")],
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
    repeats: int = 3
    """Number of repetitions, of which the quickest counts."""
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
    sizes: list[int]
    """Bytes of each file."""
    yardsticks: Yardsticks


@dataclass(frozen=True)
class Run:
    """The explorations with one mode."""

    mode: Mode
    seconds: dict[str, float]
    """CPU time by part [s]."""
    costs: list[Cost]

    @property
    def yardsticks(self) -> Yardsticks:
        """Mean times of the fixed programs."""
        loop, kernel = np.mean([cost.yardsticks for cost in self.costs], axis=0).tolist()
        return Yardsticks(loop, kernel)

    @property
    def files(self) -> float:
        """Files of a pair."""
        return statistics.fmean(len(cost.sizes) for cost in self.costs)

    @property
    def bytes(self) -> float:
        """Bytes of a pair."""
        return statistics.fmean(sum(cost.sizes) for cost in self.costs)

    @property
    def total(self) -> float:
        """CPU time of all explorations [s]."""
        return sum(cost.cpu_seconds for cost in self.costs)

    def loops(self, minutes: float) -> float:
        """CPU time of so much robot time, in loops."""
        return self.total * self.scale(minutes) / self.yardsticks.loop

    def scale(self, minutes: float) -> float:
        """So much robot time as a share of all that was driven."""
        return 60.0 * minutes / sum(cost.robot_seconds for cost in self.costs)


def main() -> None:
    arguments = tyro.cli(Arguments)
    warm_up()
    repeats = [[measure(arguments, mode) for mode in MODES] for _ in range(arguments.repeats)]
    best = [
        min(runs, key=lambda run: run.loops(arguments.minutes))
        for runs in zip(*repeats, strict=True)
    ]
    report(arguments, *best)


def measure(arguments: Arguments, mode: Mode) -> Run:
    """Make all explorations with a mode, and profile them."""
    env = ExploreConfig(slam=SlamConfig(mode=mode))
    config = DatasetConfig(
        arguments.seed, "useful", EpisodeConfig(minutes=arguments.minutes, env=env)
    )
    plans = open_plans(arguments.plans)
    tasks = list(islice(explorations(plans, config), arguments.explorations))
    profile = Profile()
    explore(tasks[0])  # loads compiled kernels from disk; not counted
    with profile.watching():
        costs = [explore(task) for task in tasks]
    return Run(mode, dict(profile.seconds), costs)


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
        sizes = [path.stat().st_size for path in Path(folder).rglob("*") if path.is_file()]
    return Cost(record.robot_seconds, outcome.timing["cpu_seconds"], sizes, yardsticks)


def report(arguments: Arguments, run: Run, baseline: Run) -> None:
    """Parts and sum of a mode, and the sum of the baseline in loops of the same length."""
    parts = sorted(run.seconds.items(), key=lambda item: -item[1])
    parts += [("other", run.total - sum(run.seconds.values())), ("all", run.total)]
    scale = run.scale(arguments.minutes)
    rows = [
        [part, round(seconds * scale, 3), round(100.0 * seconds / run.total, 1)]
        for part, seconds in parts
    ]
    loop = run.yardsticks.loop
    own_loops, loops = run.loops(arguments.minutes), baseline.loops(arguments.minutes)
    rows.append(
        [f"all, {baseline.mode}", round(loops * loop, 3), round(100.0 * loops / own_loops, 1)]
    )
    title = (
        f"{arguments.minutes:g} min of robot time, {run.mode}: {own_loops:.2f} loops; goal {GOAL:g} "
        f"({len(run.costs)} explorations of {Path(arguments.plans).name}, the least of {arguments.repeats} repetitions)"
    )
    print_and_save(
        "exploring/explorations",
        title,
        rows,
        ["part", "CPU [s]", "share [%]"],
        MODULES,
        times=("CPU [s]",),
        yardsticks=run.yardsticks,
    )
    title = "What explorations cost: core-hours, hours on so many cores, disk, files"
    cores = [f"hours on {count}" for count in CORES]
    columns = ["explorations", "core-hours", *cores, "GB", "million files"]
    costs = [cost_of(count, own_loops * loop, run) for count in SIZES]
    print_and_save("exploring/explorations_cost", title, costs, columns, MODULES)


def cost_of(count: int, cpu_seconds: float, run: Run) -> list[float]:
    """A row of the table of costs."""
    hours = count * cpu_seconds / 3600.0
    shared = [hours / cores for cores in CORES]
    return [count, hours, *shared, count * run.bytes / 1e9, count * run.files / 1e6]


if __name__ == "__main__":
    main()
