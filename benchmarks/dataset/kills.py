"""Random kills: after each the dataset is whole, and in the end it is, byte for byte, that of a run in peace.

    python benchmarks/dataset/kills.py [--kills 100] [--pairs 150] [--seed 0]

Runs of ``slamgym generate`` with one or two workers are killed at random moments: SIGKILL, SIGTERM or SIGINT to the
driver, SIGKILL or SIGTERM to a worker, SIGTERM to the whole process group, as batch systems do. The same command goes
on each time; a dataset that is complete is compared as a whole and the next one begun.
"""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import tyro
from shapely import Polygon, box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.dataset import Layout

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/core/parallel", "slamgym/dataset")
"""What is measured."""

STARTER = """
import os, signal, sys
from slamgym.commands import cli
import slamgym.commands.generate, slamgym.agents.registry, slamgym.dataset.generate.build
for line in sys.stdin:
    pid = os.fork()
    if pid == 0:
        os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        os._exit(cli.main(line.split()))
    print(pid, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""
"""Starts run after run without importing everything again: a line of arguments in, process id and exit code out."""

DRIVER = ["SIGKILL", "SIGTERM", "SIGINT", "group SIGTERM"]
EXIT_CODES = {"SIGKILL": -9, "SIGTERM": 143, "SIGINT": 130, "group SIGTERM": 143}


@dataclass(frozen=True)
class Arguments:
    """Random kills."""

    kills: int = 100
    """Number of kills."""
    pairs: int = 150
    """Pairs of a dataset."""
    seed: int = 0
    """Random seed of the kills."""


class Runs:
    """Runs of one command, and what it has made so far."""

    def __init__(self, folder: Path, pairs: int) -> None:
        self.folder, self.pairs = folder, pairs
        plans = folder / "plans"
        plans.mkdir()
        for name, width in (("a", 3.0), ("b", 2.6), ("c", 3.4)):
            rooms = box(0, 0, width, 2.4).difference(box(1.4, 0.0, 1.6, 1.4))
            assert isinstance(rooms, Polygon)
            write_houseexpo(plans / f"{name}.json", FloorPlan(name, rooms))
        self._options = f"generate --plans {plans} --minutes 0.2 --set particles=5 --pairs {pairs}"
        self._starter = subprocess.Popen(
            [sys.executable, "-c", STARTER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def start(self, root: Path, workers: int) -> int:
        """Begin or go on with a dataset; returns the driver's process id."""
        assert self._starter.stdin is not None
        self._starter.stdin.write(f"{self._options} --out {root} --workers {workers}\n")
        self._starter.stdin.flush()
        return self._answer()

    def exit_code(self) -> int:
        """Wait for the end of the run."""
        return self._answer()

    def close(self) -> None:
        """End the starter."""
        self._starter.communicate()

    def _answer(self) -> int:
        assert self._starter.stdout is not None
        return int(self._starter.stdout.readline())


def main() -> None:
    """Kill, compare, report."""
    arguments = tyro.cli(Arguments)
    rng, counts, codes = random.Random(arguments.seed), Counter[str](), Counter[str]()
    with TemporaryDirectory() as temporary:
        runs = Runs(Path(temporary), arguments.pairs)
        peace = Path(temporary) / "peace"
        runs.start(peace, 1)
        assert runs.exit_code() == 0
        expected, datasets = content(peace), 0
        while sum(counts.values()) < arguments.kills:
            root = Path(temporary) / f"killed-{datasets}"
            datasets += 1
            while committed(root) < arguments.pairs and sum(counts.values()) < arguments.kills:
                kill_one_run(runs, root, rng, counts, codes, expected)
            runs.start(root, 2)
            assert runs.exit_code() == 0
            assert content(root) == expected, "the dataset differs from that of a run in peace"
            assert not Layout(root).rejected.exists()
            print(
                f"{sum(counts.values())} kills, {datasets} datasets of the same bytes", flush=True
            )
        runs.close()
    rows = [
        [
            what,
            counts[what],
            ", ".join(name.partition(": ")[2] for name in codes if name.startswith(f"{what}:")),
        ]
        for what in counts
    ]
    print_and_save(
        "dataset/kills",
        f"{sum(counts.values())} kills, {datasets} datasets: nothing lost, torn or twice; same bytes",
        rows,
        ["killed", "times", "exit codes"],
        MODULES,
    )


def kill_one_run(
    runs: Runs,
    root: Path,
    rng: random.Random,
    counts: Counter[str],
    codes: Counter[str],
    expected: dict[str, bytes],
) -> None:
    """Start a run, kill at most two of its workers and then itself, and look at what is left."""
    before = content(root) if root.exists() else {}
    workers = rng.choice([1, 2])
    driver = runs.start(root, workers)
    for _ in range(rng.choice([0, 0, 1, 2])):  # one task's worker may die twice
        if wait_for_more(root, driver) and (found := workers_of(driver)):
            time.sleep(rng.uniform(0.0, 0.1))
            name = rng.choice(["SIGKILL", "SIGTERM"])
            with contextlib.suppress(ProcessLookupError):
                os.kill(rng.choice(found), getattr(signal, name))
                counts[f"worker {name}"] += 1
    if rng.random() < 0.7:  # else perhaps while it starts
        wait_for_more(root, driver)
    time.sleep(rng.uniform(0.0, 0.2))
    how = rng.choice(DRIVER)
    is_alive = is_running(driver)
    if is_alive:
        number = getattr(signal, how.removeprefix("group "))
        with contextlib.suppress(ProcessLookupError):
            (os.killpg if how.startswith("group") else os.kill)(driver, number)
    code = runs.exit_code()
    if is_alive:
        counts[f"driver {how}"] += 1
        codes[f"driver {how}: {code}"] += 1
        # It may have ended by itself meanwhile, or not yet have had a handler.
        assert code in (EXIT_CODES[how], 0, -getattr(signal, how.removeprefix("group "))), (
            how,
            code,
        )
    check_left(root, before, expected)


def check_left(root: Path, before: dict[str, bytes], expected: dict[str, bytes]) -> None:
    """Check that earlier files stay as they were, and that every pair is whole and right."""
    left = content(root) if root.exists() else {}
    layout = Layout(root)
    names = {path.name for path in layout.episodes.iterdir()} if layout.episodes.exists() else set()
    pairs = {
        name: data
        for name, data in expected.items()
        if any(part in names for part in Path(name).parts)
    }
    pairs |= {
        name: data
        for name, data in expected.items()
        if Path(name).suffix == ".png" and Path(name).stem in names and len(Path(name).parts) == 2
    }
    assert all(left.get(name) == data for name, data in pairs.items()), "a pair is torn"
    assert {name for name in before if name.startswith("episodes")} <= left.keys(), "a pair is lost"
    if layout.manifest.exists():
        listed = [json.loads(line)["name"] for line in layout.manifest.read_text().splitlines()]
        assert len(set(listed)) == len(listed), "a pair is listed twice"
        assert set(listed) <= names, "a pair is listed that is not there"


def content(root: Path) -> dict[str, bytes]:
    """Every file but those of times and of a run under way."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
        and path.name not in ("timing.jsonl", ".lock")
        and ".incoming" not in path.parts
    }


def committed(root: Path) -> int:
    """Pairs so far."""
    episodes = Layout(root).episodes
    return len(list(episodes.iterdir())) if episodes.exists() else 0


def wait_for_more(root: Path, driver: int) -> bool:
    """Wait for one more pair; whether it came before the end of the run."""
    count = committed(root)
    while is_running(driver):
        if committed(root) > count:
            return True
        time.sleep(0.005)
    return False


def is_running(pid: int) -> bool:
    """True if a process is alive, and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def workers_of(driver: int) -> list[int]:
    """Process ids of the workers."""
    with contextlib.suppress(OSError):
        children = [
            int(child)
            for task in Path(f"/proc/{driver}/task").iterdir()
            for child in (task / "children").read_text().split()
        ]
        return [
            child
            for child in children
            if b"popen_loky" in Path(f"/proc/{child}/cmdline").read_bytes()
        ]
    return []


if __name__ == "__main__":
    main()
