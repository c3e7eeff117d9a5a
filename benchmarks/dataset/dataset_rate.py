"""Explorations an hour of ``slamgym generate``, the gain of a second worker, where the time goes, bytes a pair.

    python benchmarks/dataset/dataset_rate.py [--explorations 10] [--blocks 2] [--minutes 7] [--plans bundled]

The same explorations are made with one worker and with several, in turns, so that other load of the machine
falls on both. Workers are started before the clock, which stops when the first one has nothing left to
do: in a long run start and end don't count. CPU seconds hardly depend on what else runs; wall time does.
"""

import itertools
import statistics
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import tyro

from slamgym import cad, interop
from slamgym.agents.registry import make_explorer
from slamgym.cad import PlanSource, open_plans
from slamgym.cad.plan_filter import PlanFilter
from slamgym.core.parallel.backlog import Lost
from slamgym.core.parallel.engine import Engine, Execution
from slamgym.dataset import DatasetConfig, Layout, read_manifest
from slamgym.dataset import folder as dataset_folder
from slamgym.dataset.folder import DatasetFolder, open_dataset
from slamgym.dataset.generate import exploration
from slamgym.dataset.generate.build import SlotQueue
from slamgym.dataset.generate.exploration import run_exploration
from slamgym.dataset.generate.recipe import dataset_settings
from slamgym.envs import EpisodeConfig
from slamgym.envs.warmup import warm_up

sys.path.insert(0, str(Path(__file__).parents[1]))
from exploring.explorations import Profile
from report import print_and_save

MODULES = (
    "slamgym/dataset/generate",
    "slamgym/envs",
    "slamgym/planning",
    "slamgym/sim",
    "slamgym/slam",
)
"""What is measured."""

GOAL_RATE = 2000.0
"""Seven-minute explorations an hour on two cores."""
GOAL_GAIN = 1.85
"""Rate of two workers in that of one."""

PARTS_OF_WRITING: dict[str, list[tuple[Any, str]]] = {
    "drawing the pair, its figures": [(exploration, "make_pair"), (dataset_folder, "make_record")],
    "PNG": [(dataset_folder, "encode_png")],
    "scans.log.gz": [(interop, "write_carmen")],
    "trajectories (TUM)": [(interop, "write_tum")],
    "map, plan": [(interop, "write_ros_map"), (cad, "write_houseexpo")],
    "digests": [(dataset_folder, "digest_lines")],
    "waiting for the disk (fsync)": [(exploration, "sync_tree")],
    "commit": [(DatasetFolder, "commit"), (DatasetFolder, "write_index")],
}


@dataclass(frozen=True)
class Arguments:
    """Rate, gain of a second worker, profile and bytes of generated pairs."""

    explorations: int = 10
    """Per block."""
    blocks: int = 2
    """Blocks with one worker, and as many with several."""
    workers: int = 2
    """Number of workers in the blocks with several."""
    minutes: float = 7.0
    """Limit of robot time; the paper's 7."""
    particles: int = 30
    """Particles of the filter."""
    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    plans_filter: PlanFilter = "none"
    """As in `slamgym generate`."""
    seed: int = 0
    """Seed of the dataset."""


@dataclass(frozen=True)
class Finish:
    """An exploration that has come in."""

    time: float  # since the block's start [s]
    wall: float  # [s] in the worker
    cpu: float  # [s] in the worker


@dataclass(frozen=True)
class Block:
    """Explorations that were made together."""

    workers: int
    finishes: list[Finish]
    driver_cpu: float  # [s]

    @property
    def rate(self) -> float:
        """Explorations an hour while all workers were busy."""
        order = sorted(self.finishes, key=lambda finish: finish.time)
        first_idle = order[-self.workers].time
        done = float(len(order) - self.workers + 1)
        for finish in order[len(order) - self.workers + 1 :]:
            done += min(1.0, max(0.0, 1.0 - (finish.time - first_idle) / finish.wall))
        return 3600.0 * done / first_idle

    @property
    def cpu(self) -> float:
        """CPU seconds of a worker for one exploration."""
        return statistics.fmean(finish.cpu for finish in self.finishes)


def main() -> None:
    arguments = tyro.cli(Arguments)
    warm_up()
    plans, config = open_plans(arguments.plans), dataset_config(arguments)
    blocks: list[Block] = []
    with ExitStack() as stack:
        engines = {
            count: stack.enter_context(Execution(count).open()) for count in (1, arguments.workers)
        }
        quick = replace(config, episode=replace(config.episode, minutes=0.1))
        for count, engine in engines.items():  # the processes start and load the compiled kernels
            make_pairs(engine, count, plans, quick, 2 * count)
        for number, (count, engine) in itertools.product(range(arguments.blocks), engines.items()):
            print(f"block {number + 1} of {arguments.blocks}, {count} workers", flush=True)
            blocks.append(make_pairs(engine, count, plans, config, arguments.explorations))
    report_rate(arguments, blocks)
    with TemporaryDirectory() as root:
        profile_and_weigh(arguments, plans, config, Path(root))


def dataset_config(arguments: Arguments) -> DatasetConfig:
    base = DatasetConfig(
        seed=arguments.seed,
        plans_filter=arguments.plans_filter,
        episode=EpisodeConfig(minutes=arguments.minutes),
    )
    slam = replace(base.episode.env.slam, particles=arguments.particles)
    return replace(base, episode=replace(base.episode, env=replace(base.episode.env, slam=slam)))


def make_pairs(
    engine: Engine,
    workers: int,
    plans: PlanSource,
    config: DatasetConfig,
    pairs: int,
    root: str | None = None,
) -> Block:
    """Do what `slamgym generate` does, and note when each exploration came in."""
    finishes: list[Finish] = []
    with ExitStack() as stack:
        root = root or stack.enter_context(TemporaryDirectory())
        folder = stack.enter_context(open_dataset(Path(root), dataset_settings(config, plans)))
        queue = SlotQueue(folder, plans, config, make_explorer, pairs)
        began, cpu = time.perf_counter(), time.process_time()
        for outcome in engine.run(run_exploration, queue.draw()):
            if isinstance(outcome, Lost):
                raise SystemExit(f"an exploration failed: {outcome.reason}")
            now = time.perf_counter() - began
            folder.commit(outcome.slot, folder.stage(outcome.slot.name), outcome.timing)
            finishes.append(
                Finish(now, outcome.timing["wall_seconds"], outcome.timing["cpu_seconds"])
            )
        driver_cpu = time.process_time() - cpu
    if workers == 1:  # everything ran in this process
        driver_cpu -= sum(finish.cpu for finish in finishes)
    return Block(workers, finishes, driver_cpu)


def report_rate(arguments: Arguments, blocks: list[Block]) -> None:
    rows = []
    one = statistics.fmean(block.rate for block in blocks if block.workers == 1)
    for workers in (1, arguments.workers):
        mine = [block for block in blocks if block.workers == workers]
        cpu = statistics.fmean(block.cpu for block in mine)
        driver = statistics.fmean(block.driver_cpu / len(block.finishes) for block in mine)
        rates = [block.rate for block in mine]
        rows.append(
            {
                "workers": workers,
                "explorations an hour": round(statistics.fmean(rates)),
                "lowest block": round(min(rates)),
                "highest block": round(max(rates)),
                "of one worker's rate": round(statistics.fmean(rates) / one, 3),
                "CPU [s] each": round(cpu, 3),
                "driver's CPU [s] each": round(driver, 4),
                "an hour by CPU time": round(3600.0 * workers / (cpu + driver / workers)),
            }
        )
    title = (
        f"Explorations of {arguments.minutes:g} min, {arguments.particles} particles, plans {arguments.plans}; "
        f"{arguments.blocks} blocks of {arguments.explorations} each; goals: {GOAL_RATE:g} an hour on two cores, "
        f"{GOAL_GAIN:g} times the rate of one worker"
    )
    print_and_save(
        "dataset/dataset_rate",
        title,
        rows,
        list(rows[0]),
        MODULES,
        times=("CPU [s] each", "driver's CPU [s] each"),
    )


def profile_and_weigh(
    arguments: Arguments, plans: PlanSource, config: DatasetConfig, root: Path
) -> None:
    """Time the parts of the same explorations in this process, and weigh the files."""
    profile = Profile()
    began, cpu = time.perf_counter(), time.process_time()
    with Execution(1).open() as engine, watching(profile):
        make_pairs(engine, 1, plans, config, arguments.explorations, str(root))
    total, wall = time.process_time() - cpu, time.perf_counter() - began
    count = arguments.explorations
    parts = sorted(profile.seconds.items(), key=lambda part: -part[1])
    parts += [("start, other", total - sum(profile.seconds.values())), ("all", total)]
    rows = [
        [part, round(1000.0 * spent / count, 2), round(100.0 * spent / total, 1)]
        for part, spent in parts
    ]
    title = f"CPU time of a {arguments.minutes:g} min exploration and its pair; {count} of {arguments.plans}"
    print_and_save(
        "dataset/dataset_profile",
        title,
        rows,
        ["part", "CPU [ms]", "share [%]"],
        MODULES,
        times=("CPU [ms]",),
    )
    print(f"wall time {1000.0 * wall / count:.0f} ms each")
    sizes = weigh(root)
    robot_minutes = statistics.fmean(record.robot_seconds for record in read_manifest(root)) / 60.0
    title = f"Bytes of a pair, mean of {count}; {robot_minutes:.1f} min of robot time in the mean"
    bytes_rows = [[name, round(size / count)] for name, size in sizes.most_common()]
    print_and_save(
        "dataset/dataset_bytes",
        title,
        [*bytes_rows, ["all", round(sizes.total() / count)]],
        ["file", "bytes"],
        MODULES,
    )


@contextmanager
def watching(profile: Profile) -> Iterator[None]:
    """Time the parts inside the block, those of writing too."""
    places = [(part, *place) for part, owners in PARTS_OF_WRITING.items() for place in owners]
    kept = [(owner, name, getattr(owner, name)) for _, owner, name in places]
    for part, owner, name in places:
        setattr(owner, name, profile.timed(part, getattr(owner, name)))
    try:
        with profile.watching():
            yield
    finally:
        for owner, name, function in kept:
            setattr(owner, name, function)


def weigh(root: Path) -> Counter[str]:
    """Bytes by file name."""
    sizes: Counter[str] = Counter()
    layout = Layout(root)
    for side in ("A", "B"):
        sizes[f"{side}.png"] = sum(path.stat().st_size for path in (root / side).iterdir())
    for path in layout.episodes.rglob("*"):
        if path.is_file():
            sizes[path.name] += path.stat().st_size
    sizes["manifest line"] = layout.manifest.stat().st_size
    return sizes


if __name__ == "__main__":
    main()
