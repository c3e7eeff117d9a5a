"""How many explorations of real floor plans see the whole building, and what stopped the others.

    python benchmarks/yield_houseexpo.py json.tar.gz [--pairs 50] [--minutes auto]

The plans are filtered as ``slamgym generate --plans-filter useful`` does. The dataset stays in ``--out`` to
be looked at.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from report import print_and_save

from agents.registry import make_explorer
from slamgym.cad import open_plans
from slamgym.dataset import (
    DatasetConfig,
    EpisodeConfig,
    PairRecord,
    build_dataset,
    read_manifest,
    write_contact_sheet,
)

GOOD_COVERAGE = 0.95
GOAL = 90.0
"""Share of the explorations that shall see 95 % of the reachable floor or more [%]."""


@dataclass(frozen=True)
class Arguments:
    """Yield of explorations."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans: a folder or a .tar.gz."""
    pairs: int = 50
    """How many explorations, each of another plan."""
    minutes: Literal["auto"] | float = "auto"
    """Limit of robot time."""
    explorer: str = "explore_lite"
    """Who drives."""
    seed: int = 1
    """Seed of the dataset."""
    workers: int = 2
    """Processes."""
    out: Path = Path("out/yield")
    """Folder of the dataset."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    config = DatasetConfig(arguments.seed, "useful", EpisodeConfig(arguments.explorer, arguments.minutes))
    build_dataset(
        arguments.out,
        open_plans(arguments.plans),
        config,
        make_explorer,
        pairs=arguments.pairs,
        workers=arguments.workers,
    )
    records = list(read_manifest(arguments.out))
    rows = [row(name, group) for name, group in groups(records)]
    title = (
        f"{len(records)} explorations by {arguments.explorer}, minutes {arguments.minutes}: share that saw "
        f"{100 * GOOD_COVERAGE:.0f} % of the floor (goal: {GOAL:g} %)"
    )
    columns = ["group", "explorations", "seen [%]", "coverage, median [%]", "robot time, median [min]"]
    columns += ["path, median [m]", "position error, median [m]", "contacts, mean"]
    print_and_save("yield_houseexpo", title, rows, columns)
    for record in sorted(records, key=lambda r: r.coverage):
        if record.coverage < GOOD_COVERAGE:
            print(
                f"{record.plan_id}: {100 * record.coverage:.1f} %, {record.finished} after "
                f"{record.robot_seconds / 60:.1f} of {record.time_limit / 60:.1f} min"
            )
    print(f"contact sheet: {write_contact_sheet(arguments.out, arguments.pairs)}")


def groups(records: list[PairRecord]) -> list[tuple[str, list[PairRecord]]]:
    """All, and by the way they ended."""
    endings = sorted(Counter(record.finished for record in records))
    return [("all", records)] + [
        (f"ended by: {ending}", [r for r in records if r.finished == ending]) for ending in endings
    ]


def row(name: str, records: list[PairRecord]) -> list[object]:
    coverage = np.array([record.coverage for record in records])
    return [
        name,
        len(records),
        round(100.0 * float(np.mean(coverage >= GOOD_COVERAGE)), 1),
        round(100.0 * float(np.median(coverage)), 2),
        round(float(np.median([record.robot_seconds for record in records])) / 60.0, 2),
        round(float(np.median([record.path_length for record in records])), 1),
        round(float(np.median([record.ate for record in records])), 3),
        round(float(np.mean([record.collisions for record in records])), 2),
    ]


if __name__ == "__main__":
    main()
