"""Time and memory of a merge: two drives through a home, and through an office of 1,500 m2, by the command.

    python benchmarks/slam/merging_cost.py CACHE [--pairs 3]

Two drives of 4 minutes in a home, of 30 in an office. Start-up and writing of the command count. Drives are kept in the
cache.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from drives import Conditions
from merging_drives import make
from report import print_and_save

from slamgym.cad import PlanGeneratorConfig, generate_plan
from slamgym.slam.graph.graph_files import GRAPH, read_graph

MODULES = ("slamgym/slam/merge", "slamgym/slam/graph")
"""What is measured."""
FIRST = 50_000
"""Number of the first building."""
KINDS = {
    "two homes": (PlanGeneratorConfig(kind="home"), 4.0),
    "two offices": (PlanGeneratorConfig(kind="office", office_area=(1_400.0, 1_600.0)), 30.0),
}
"""Settings of the buildings, and the length of a drive [minutes]."""
COLUMNS = ("maps", "pairs", "merged", "area [m2]", "nodes", "CPU s", "most CPU s", "memory [MB]")


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cache", type=Path)
    parser.add_argument("--pairs", type=int, default=3)
    arguments = parser.parse_args()
    rows = [row(kind, arguments.pairs, arguments.cache) for kind in KINDS]
    title = "what a merge takes"
    print_and_save(
        "slam/merging_cost", title, rows, COLUMNS, MODULES, times=("CPU s", "most CPU s")
    )


def row(kind: str, pairs: int, cache: Path) -> dict[str, Any]:
    """All pairs of one kind of building."""
    config, minutes = KINDS[kind]
    areas, nodes, seconds, memory, statuses = [], [], [], [], []
    for number in range(FIRST, FIRST + pairs):
        plan = generate_plan(number, config)
        folders = [cache / f"cost_{config.kind}_{number}" / str(drive) for drive in range(2)]
        for seed, folder in enumerate(folders):
            if not (folder / GRAPH).exists():
                make(plan, number + 100_000 * seed, Conditions(minutes=minutes), 0.7 * seed, folder)
        areas.append(plan.area)
        nodes.append(sum(len(read_graph(folder).poses) for folder in folders))
        status, took, megabytes = merge(folders)
        statuses.append(status)
        seconds.append(took)
        memory.append(megabytes)
        print(kind, number, areas[-1], nodes[-1], status, took, megabytes, file=sys.stderr)
    return {
        "maps": kind,
        "pairs": pairs,
        "merged": statuses.count(0),
        "area [m2]": round(float(np.median(areas))),
        "nodes": round(float(np.median(nodes))),
        "CPU s": round(float(np.median(seconds)), 1),
        "most CPU s": round(max(seconds), 1),
        "memory [MB]": round(max(memory)),
    }


def merge(folders: list[Path]) -> tuple[int, float, float]:
    """Exit status, CPU time [s] and peak memory [MB] of the command."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "slamgym", "merge", *map(str, folders), "-o", f"{out}/map"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
    return os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


if __name__ == "__main__":
    main()
