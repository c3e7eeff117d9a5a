"""Explorations of the track `large` of slamgym-bench in any SLAM mode: floor seen, and cost against the map's size.

Costs are CPU times of a decision and of a control step while so much of the floor is known, so that growth is seen
within one run. Run: ``python benchmarks/exploring/large_buildings.py``.
"""

import argparse
import dataclasses
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.bench.manifest import bench_tasks, open_bench_plans, read_bench
from slamgym.agents.evaluation.trial import Task, TrialConfig, explorer_in
from slamgym.core.progress import say
from slamgym.core.types import Observation
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps, fitted_env
from slamgym.slam import SlamConfig

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/planning", "slamgym/slam")
"""What is measured."""

KNOWN = (0.0, 100.0, 300.0, 800.0, 1600.0, 3200.0)
"""Known areas from which on costs are counted apart [m2]."""
ENOUGH = 0.95
"""Share of the floor to be seen."""


class Watch:
    """An explorer with the known area, the CPU time and the number of decisions of each of its steps."""

    def __init__(self, explorer: Any) -> None:
        self.explorer = explorer
        self.steps: list[tuple[float, float, int]] = []

    @property
    def finished(self) -> bool:
        """True if the explorer says that it is done."""
        return bool(self.explorer.finished)

    def predict(self, observation: Observation) -> Any:
        """The explorer's action."""
        before = self.explorer.decisions
        begin = time.thread_time()
        answer = self.explorer.predict(observation)
        spent = time.thread_time() - begin
        (loop,) = self.explorer.loops
        self.steps.append((loop.known_area, spent, self.explorer.decisions - before))
        return answer


def explore(task: Task, mode: Any) -> tuple[list[Any], np.ndarray]:
    """A row of the table, and the explorer's steps, shape (N, 3)."""
    config = TrialConfig(env=ExploreConfig(slam=SlamConfig(mode=mode)))
    env = ExploreEnv(task.plan, fitted_env(task.plan, config.env, config.minutes))
    reset = env.reset(seed=task.seed, options={"plan": task.plan, "start": task.start})
    watch: Any = Watch(explorer_in(env, task.explorer, config, task.seed))
    began = time.process_time()
    enough = None
    errors = []
    for info in episode_steps(env, watch, reset):
        errors.append(info["pose_error"])
        if enough is None and info["coverage"] >= ENOUGH:
            enough = env.simulation.time
    spent = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    row = [
        task.plan.id[:24],
        round(task.plan.area),
        round(100.0 * info["coverage"], 1),
        "never" if enough is None else round(enough),
        f"{env.simulation.time:.0f}{'' if watch.finished else ' (limit)'}",
        round(float(np.max(errors)), 2),
        round(env.map_error(), 3),
        round(1e3 * spent / len(errors), 2),
        round(peak),
    ]
    return row, np.array(watch.steps)


def costs(steps: np.ndarray) -> list[list[Any]]:
    """CPU time of decisions and of all the explorer's steps by the known area, and relative to the second row."""
    rows = []
    first = None
    for low, high in zip(KNOWN, (*KNOWN[1:], np.inf), strict=True):
        part = steps[(steps[:, 0] >= low) & (steps[:, 0] < high)]
        choosing = part[part[:, 2] > 0, 1]
        if len(choosing) == 0:
            continue
        mean, median, every = (
            1e3 * value for value in (choosing.mean(), np.median(choosing), part[:, 1].mean())
        )
        first = (mean, every) if low == KNOWN[1] else first
        ratios = [round(mean / first[0], 1), round(every / first[1], 1)] if first else ["", ""]
        times = [round(mean, 2), round(median, 2), round(every, 3)]
        rows.append([f"from {low:.0f}", len(choosing), *times, *ratios])
    return rows


def main() -> None:
    """Explore, print and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mode", default="pose_graph", help="SLAM mode")
    parser.add_argument("--explorer", default="nearest")
    parser.add_argument(
        "--plans", default="", help="ids with commas between them; by default all of the track"
    )
    arguments = parser.parse_args()
    track = read_bench().track("large")
    chosen = [
        one
        for one in track.buildings
        if not arguments.plans or one.plan in arguments.plans.split(",")
    ]
    track = dataclasses.replace(track, buildings=tuple(chosen))
    rows = []
    steps = []
    for task in bench_tasks(track, open_bench_plans(track, ""), arguments.explorer):
        row, taken = explore(task, arguments.mode)
        rows.append(row)
        steps.append(taken)
        say(" ".join(map(str, row)))
    seen = sum(row[2] >= 100.0 * ENOUGH for row in rows)
    name = f"exploring/large_{arguments.explorer}_{arguments.mode}"
    title = f"{arguments.explorer}, {arguments.mode}: {seen} of {len(rows)} see {ENOUGH:.0%} of the floor"
    heads = "plan|area [m2]|seen [%]|95 % after [s]|end [s]|worst pose error [m]|walls [m]|step [ms]|peak [MB]"
    print_and_save(name, title, rows, heads.split("|"), MODULES, times=["step [ms]"])
    heads = (
        "known [m2]|decisions|mean [ms]|median [ms]|all steps [ms]|mean / first|all steps / first"
    )
    title = "CPU time of a decision, and of all the explorer's steps, while so much is known"
    times = ["mean [ms]", "median [ms]", "all steps [ms]"]
    print_and_save(
        f"{name}_cost", title, costs(np.vstack(steps)), heads.split("|"), MODULES, times=times
    )


if __name__ == "__main__":
    main()
