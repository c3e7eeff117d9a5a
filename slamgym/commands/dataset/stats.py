"""``slamgym dataset stats``: what lies in a dataset."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from slamgym.core.config import Arguments, to_dict
from slamgym.core.text import printable

if TYPE_CHECKING:
    from rich.table import Table

    from slamgym.dataset.statistics import DatasetStatistics, GroupStatistics

STATISTICS_COLUMNS = (
    "", "pairs", "plans", "robot h", "complete [%]", "kept [%]", "coverage p5, p50 [%]", "ATE p50, p95 [m]",
    "walls p50, p95 [m]", "robot min p50, max", "CPU s",
)  # fmt: skip
TABLE_WIDTH = 160


class StatsArguments(Arguments):
    """Show what lies in a dataset: pairs, coverage, errors, endings and bytes, also by condition.

    `complete` is the share of pairs that saw 95 % of the reachable floor; `kept` is what cleaning keeps; ATE is
    the position error of the SLAM estimate; `walls` the distance of drawn walls to true ones.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    json: bool = False
    """Write JSON instead of tables."""
    parquet: Path | None = None
    """Also write the manifest as a Parquet file; needs pyarrow (extra `hub`)."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(StatsArguments, args=argv, prog="slamgym dataset stats")
    from slamgym.dataset.format import read_manifest
    from slamgym.dataset.record import require_parquet, write_parquet
    from slamgym.dataset.statistics import dataset_statistics

    if arguments.parquet is not None:
        require_parquet()
    statistics = dataset_statistics(arguments.dataset)
    if arguments.parquet is not None:
        write_parquet(arguments.parquet, list(read_manifest(arguments.dataset)))
    if arguments.json:
        sys.stdout.write(json.dumps(to_dict(statistics), indent=1) + "\n")
    else:
        _print(statistics)
    return 0


def _print(statistics: DatasetStatistics) -> None:
    # A table that is cut off says less than one whose lines a terminal wraps.
    from rich.console import Console

    console = Console(file=sys.stdout, width=max(Console().width, TABLE_WIDTH), highlight=False, markup=False)
    console.print(_table(statistics))
    total = sum(statistics.bytes.values())
    pairs = max(statistics.whole.pairs, 1)
    largest = ", ".join(
        f"{name} {size / pairs / 1e3:.0f} kB" for name, size in list(statistics.bytes.items())[:4]
    )
    console.print(f"{total / 1e9:.2f} GB, {total / pairs / 1e3:.0f} kB a pair ({largest})")
    for title, counts in (
        ("ended by", statistics.endings),
        ("plans without a pair", statistics.rejected),
        ("dropped by cleaning", statistics.left_out),
    ):
        if counts:
            console.print(
                printable(f"{title}: " + ", ".join(f"{count} {name}" for name, count in counts.items()))
            )


def _table(statistics: DatasetStatistics) -> Table:
    from rich.table import Table

    table = Table(title=printable(statistics.dataset), title_justify="left")
    for number, column in enumerate(STATISTICS_COLUMNS):
        table.add_column(column, justify="right" if number else "left", no_wrap=number == 0)
    table.add_row("all", *_cells(statistics.whole))
    for name, groups in statistics.by_condition.items():
        table.add_section()
        for label, group in groups.items():
            table.add_row(printable(f"{name}: {label}"), *_cells(group))
    return table


def _cells(group: GroupStatistics) -> list[str]:
    return [
        str(group.pairs),
        str(group.plans),
        f"{group.robot_hours:.1f}",
        f"{100 * group.complete:.1f}",
        "-" if group.kept is None else f"{100 * group.kept:.1f}",
        f"{100 * group.coverage[0]:.1f}, {100 * group.coverage[1]:.1f}",
        f"{group.ate[0]:.3f}, {group.ate[1]:.3f}",
        f"{group.map_error[0]:.3f}, {group.map_error[1]:.3f}",
        f"{group.minutes[0]:.1f}, {group.minutes[1]:.1f}",
        "-" if group.cpu_seconds is None else f"{group.cpu_seconds:.2f}",
    ]
