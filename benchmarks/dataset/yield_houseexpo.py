"""Share of explorations of real floor plans that are fit for a dataset, and what stopped the others.

    python benchmarks/dataset/yield_houseexpo.py json.tar.gz [--pairs 100] [--minutes auto 7]

Every limit of robot time explores the same plans from the same starts. The plans are filtered as ``slamgym
generate --plans-filter useful`` does, "passes cleaning" is what ``slamgym dataset clean`` keeps. The datasets
stay in ``--out`` to be looked at; run again, the benchmark continues where it was stopped.
"""

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from slamgym.agents.registry import make_explorer
from slamgym.cad import open_plans
from slamgym.core.intervals import wilson_interval
from slamgym.dataset import DatasetConfig, PairRecord, build_dataset, read_manifest
from slamgym.dataset.faults import Criteria, record_faults
from slamgym.envs import EpisodeConfig

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

GOOD_COVERAGE = 0.95
GOAL_COVERAGE, GOAL_CLEAN = 90.0, 95.0
"""Goals with ``auto``: explorations that see 95 % of the reachable floor, and that pass cleaning [%]."""


@dataclass(frozen=True)
class Arguments:
    """Yield of explorations."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans: a folder or a .tar.gz."""
    pairs: int = 100
    """Number of explorations, each of another plan."""
    minutes: tuple[Literal["auto"] | float, ...] = ("auto", 7.0)
    """Limits of robot time; the paper's is 7."""
    explorer: str = "explore_lite"
    """Who drives."""
    seed: int = 1
    """Seed of the datasets."""
    workers: int = 2
    """Processes."""
    out: Path = Path("out/yield")
    """Folder of the datasets."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    rows, faults = [], []
    for minutes in arguments.minutes:
        root = arguments.out / f"minutes_{minutes if minutes == 'auto' else f'{minutes:g}'}"
        records = explored(arguments, minutes, root)
        rows.append(row(minutes, records))
        faults += [[minutes, reason, count] for reason, count in reasons(records)]
    title = (
        f"{arguments.pairs} explorations by {arguments.explorer} (95 % interval); goals for auto: "
        f"{GOAL_COVERAGE:g} % see {100 * GOOD_COVERAGE:.0f} % of the floor, {GOAL_CLEAN:g} % pass cleaning"
    )
    columns = ["minutes", "explorations", "seen 95 % of the floor [%]", "passes cleaning [%]"]
    columns += [
        "robot time, median [min]",
        "path, median [m]",
        "position error, median [m]",
        "contacts, mean",
    ]
    print_and_save("dataset/yield_houseexpo", title, rows, columns)
    print_and_save(
        "dataset/yield_faults", "Why the others don't pass", faults, ["minutes", "fault", "explorations"]
    )


def explored(arguments: Arguments, minutes: Literal["auto"] | float, root: Path) -> list[PairRecord]:
    """The explorations with one limit of robot time."""
    config = DatasetConfig(arguments.seed, "useful", EpisodeConfig(arguments.explorer, minutes))
    plans = open_plans(arguments.plans)
    build_dataset(root, plans, config, make_explorer, pairs=arguments.pairs, workers=arguments.workers)
    return list(read_manifest(root))


def row(minutes: str | float, records: list[PairRecord]) -> list[object]:
    seen = sum(record.coverage >= GOOD_COVERAGE for record in records)
    clean = sum(not record_faults(record, Criteria()) for record in records)
    return [
        minutes,
        len(records),
        share(seen, len(records)),
        share(clean, len(records)),
        round(float(np.median([record.robot_seconds for record in records])) / 60.0, 2),
        round(float(np.median([record.path_length for record in records])), 1),
        round(float(np.median([record.ate for record in records])), 3),
        round(float(np.mean([record.collisions for record in records])), 2),
    ]


def share(count: int, total: int) -> str:
    """A share with its interval, in per cent."""
    interval = wilson_interval(count, total)
    return f"{100 * count / total:.1f} [{100 * interval.low:.1f}, {100 * interval.high:.1f}]"


def reasons(records: list[PairRecord]) -> list[tuple[str, int]]:
    """The first fault of each exploration that has one, without its figures, and how many share it."""
    faults = (record_faults(record, Criteria()) for record in records)
    return Counter(found[0].reason for found in faults if found).most_common()


if __name__ == "__main__":
    main()
