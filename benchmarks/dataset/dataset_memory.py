"""Memory over many pairs, and the cost of book-keeping in a folder that holds many.

    python benchmarks/dataset/dataset_memory.py [--pairs 2000] [--workers 2] [--committed 4000]

The explorations are short (seconds of robot time, few particles): leaks are per exploration and per pair, not
per second. The resident set of driver and workers is read from /proc now and then; a straight line through the
last three quarters of the samples says how fast it grows. Book-keeping is measured with pairs of empty files.
"""

import itertools
import json
import os
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tyro

from slamgym.agents.registry import make_explorer
from slamgym.cad import PlanGroup, open_plans
from slamgym.core.parallel.backlog import Lost
from slamgym.core.parallel.engine import Execution
from slamgym.dataset import DatasetConfig
from slamgym.dataset.folder import open_dataset
from slamgym.dataset.generate.build import SlotQueue, schedule_groups
from slamgym.dataset.generate.exploration import run_exploration
from slamgym.dataset.generate.recipe import dataset_settings
from slamgym.dataset.record import Slot
from slamgym.envs import EpisodeConfig
from slamgym.envs.warmup import warm_up

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save, resident_mb

MODULES = ("slamgym/dataset",)
"""What is measured."""

IN_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Where the datasets are made, as the disk is not what is measured."""


@dataclass(frozen=True)
class Arguments:
    """Memory over pairs and the cost of book-keeping."""

    pairs: int = 2000
    """Explorations; 10,000 take some ten minutes of CPU."""
    workers: int = 2
    """Processes."""
    minutes: float = 0.05
    """Robot time of each."""
    particles: int = 3
    """Particles of the filter."""
    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    committed: int = 4_000
    """Pairs of empty files for the cost of book-keeping; 0 omits it."""
    keep: int = 200
    """Fresh pairs between two clearances of their files, which would only fill the disk; the driver's own
    records of them stay."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    if arguments.pairs:
        measure_memory(arguments)
    if arguments.committed:
        measure_bookkeeping(arguments.committed)


def measure_memory(arguments: Arguments) -> None:
    warm_up()
    config = DatasetConfig(episode=EpisodeConfig(minutes=arguments.minutes))
    slam = replace(config.episode.env.slam, particles=arguments.particles)
    config = replace(
        config, episode=replace(config.episode, env=replace(config.episode.env, slam=slam))
    )
    plans = open_plans(arguments.plans)
    samples: list[list[float]] = []
    every = max(1, arguments.pairs // 100)
    began = time.perf_counter()
    with (
        TemporaryDirectory(dir=IN_MEMORY) as root,
        Execution(arguments.workers).open() as engine,
        open_dataset(Path(root), dataset_settings(config, plans)) as folder,
    ):
        queue = SlotQueue(folder, plans, config, make_explorer, arguments.pairs)
        for done, outcome in enumerate(engine.run(run_exploration, queue.draw()), start=1):
            if isinstance(outcome, Lost):
                raise SystemExit(f"an exploration failed: {outcome.reason}")
            folder.commit(outcome.slot, folder.stage(outcome.slot.name), outcome.timing)
            if done % arguments.keep == 0:
                _clear(Path(root))
            if done % every == 0:
                workers = [resident_mb(pid) for pid in child_processes() if is_worker(pid)]
                samples.append(
                    [done, resident_mb(os.getpid()), sum(workers), max(workers, default=0.0)]
                )
    seconds = time.perf_counter() - began
    table = np.array(samples)
    settled = table[len(table) // 4 :]
    rows = []
    for column, name in ((1, "driver"), (2, "all workers"), (3, "largest worker")):
        slope = np.polyfit(settled[:, 0], settled[:, column], 1)[0] if len(settled) > 1 else 0.0
        early, late = settled[0, column], table[-1, column]
        rows.append(
            [
                name,
                *(round(float(value), 1) for value in (early, late)),
                round(1000.0 * float(slope), 3),
            ]
        )
    title = (
        f"Resident memory over {arguments.pairs} pairs of {arguments.minutes:g} min, {arguments.workers} workers, "
        f"{seconds / arguments.pairs * 1000:.0f} ms a pair"
    )
    columns = [
        "process",
        f"at {int(settled[0, 0])} pairs [MB]",
        f"at {arguments.pairs} pairs [MB]",
        "growth [MB per 1,000 pairs]",
    ]
    print_and_save("dataset/dataset_memory", title, rows, columns, MODULES)


def measure_bookkeeping(count: int) -> None:
    """Commit pairs of empty files, and open the folder again."""
    rows = []
    slots = schedule_groups([PlanGroup([f"plan-{number:032d}" for number in range(1000)], 1.0)], 0)
    with TemporaryDirectory(dir=IN_MEMORY) as temporary:
        root = Path(temporary)
        for part in (count // 4, count - count // 4):
            with open_dataset(root, {"seed": 0}) as folder:
                batch = list(itertools.islice(slots, part))
                for slot in batch:
                    _stage_empty(folder.stage(slot.name), slot)
                began = time.process_time()
                for slot in batch:
                    folder.commit(slot, folder.stage(slot.name), {"cpu_seconds": 0.0})
                commit = time.process_time() - began
                began = time.process_time()
                folder.write_index()
                index = time.process_time() - began
            began = time.process_time()
            with open_dataset(root, {"seed": 0}) as folder:
                opened = time.process_time() - began
                pairs = len(folder.committed)
            rows.append(
                [
                    pairs,
                    *(
                        round(1e6 * spent / share, 1)
                        for spent, share in ((commit, part), (opened, pairs), (index, pairs))
                    ),
                ]
            )
    title = "Cost of book-keeping, CPU time"
    columns = [
        "pairs",
        "commit [us a pair]",
        "opening to go on [us a pair there]",
        "index [us a pair there]",
    ]
    print_and_save("dataset/dataset_bookkeeping", title, rows, columns, MODULES, times=columns[1:])


def _stage_empty(staged: Path, slot: Slot) -> None:
    (staged / "episode").mkdir(parents=True)
    line = json.dumps({"name": slot.name, "index": slot.index, "filling": "x" * 1500})
    (staged / "episode" / "episode.json").write_text(line + "\n")
    for side in "AB":
        (staged / f"{side}.png").touch()


def _clear(root: Path) -> None:
    for folder in (root / "A", root / "B"):
        for path in folder.iterdir():
            path.unlink()
    for path in (root / "episodes").iterdir():
        shutil.rmtree(path)


def child_processes() -> Iterator[int]:
    """Process ids of this process's children."""
    for task in Path("/proc/self/task").iterdir():
        yield from map(int, (task / "children").read_text().split())


def is_worker(pid: int) -> bool:
    """True if a child is a worker, rather than loky's resource tracker."""
    return b"popen_loky" in Path(f"/proc/{pid}/cmdline").read_bytes()


if __name__ == "__main__":
    main()
