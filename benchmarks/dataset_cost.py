"""What large datasets cost, computed from the measured rate and bytes.

    python benchmarks/dataset_cost.py [--update docs/scale.md]

Reads the results of ``dataset_rate.py`` (CPU time and bytes of an exploration) and prints core-hours, hours on
some machines, bytes and files; ``--update`` puts the table into a document, between its two marks.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import tyro
from report import RESULTS

SIZES = (4_225, 35_000, 1_000_000)
"""The paper's dataset after cleaning, its explorations, and a large one."""
CORES = (2, 64, 1000)
FILES = 14
"""Files and folders of a pair."""
BEGIN, END = "<!-- cost: benchmarks/dataset_cost.py -->", "<!-- end of cost -->"


@dataclass(frozen=True)
class Arguments:
    """What large datasets cost."""

    update: Path | None = None
    """A document to put the table into."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    table = cost_table()
    print(table)
    if arguments.update is not None:
        text = arguments.update.read_text()
        before, _, rest = text.partition(BEGIN)
        _, _, after = rest.partition(END)
        if not rest or not after:
            raise SystemExit(f"{arguments.update}: has no marks {BEGIN} and {END}")
        arguments.update.write_text(f"{before}{BEGIN}\n\n{table}\n\n{END}{after}")


def cost_table() -> str:
    rate, sizes = _load("dataset_rate"), _load("dataset_bytes")
    several = rate["rows"][-1]
    cpu = several["CPU [s] each"] + several["driver's CPU [s] each"]
    size = next(row["bytes"] for row in sizes["rows"] if row["file"] == "all")
    lines = [
        f"{rate['title'].split(';')[0]}: {cpu:.2f} CPU seconds and {size / 1e6:.2f} MB each "
        f"({rate['machine']['cpu']}, {rate['date'][:10]}).",
        "",
        "| explorations | core-hours | "
        + " | ".join(f"hours on {cores:,} cores" for cores in CORES)
        + " | disk | files |",
        "|---|---|" + "---|" * len(CORES) + "---|---|",
    ]
    for count in SIZES:
        hours = count * cpu / 3600.0
        wall = " | ".join(
            f"{hours / cores:,.2g}" if hours / cores < 10 else f"{hours / cores:,.0f}" for cores in CORES
        )
        lines.append(
            f"| {count:,} | {hours:,.0f} | {wall} | {_bytes(count * size)} | {count * FILES / 1e6:.2g} million |"
        )
    return "\n".join(lines)


def _bytes(size: float) -> str:
    return f"{size / 1e12:.2f} TB" if size >= 1e12 else f"{size / 1e9:.1f} GB"


def _load(name: str) -> dict:
    return json.loads((RESULTS / f"{name}.json").read_text())


if __name__ == "__main__":
    main()
