"""How a benchmark shows its figures: a table in the terminal and a JSON file under ``benchmarks/results``.

The JSON carries what a reader needs to assess a time: the machine, the versions and the date.
"""

import importlib.metadata
import json
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

RESULTS = Path(__file__).parent / "results"

_PACKAGES = ("slamgym", "numpy", "numba", "pymunk", "shapely", "opencv-python-headless", "gymnasium")


def print_and_save(
    name: str,
    title: str,
    rows: Sequence[Sequence[Any] | Mapping[str, Any]],
    columns: Sequence[str],
) -> Path:
    """Print a table and write it, with the machine it was measured on, as JSON.

    Args:
        name: Folder and file stem under ``benchmarks/results``.
        title: Heading of the table; states what one row is.
        rows: One sequence per row in the order of ``columns``, or one mapping from column to value.
        columns: Column headings, with their units.

    Returns:
        The JSON file written.

    Raises:
        ValueError: If a row doesn't fit the columns.
    """
    records = [_record(row, columns) for row in rows]
    _print(title, records, columns)
    path = RESULTS / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    document = {"name": name, "title": title, **environment(), "columns": list(columns), "rows": records}
    path.write_text(json.dumps(document, indent=1, default=_plain) + "\n", encoding="utf-8")
    return path


def environment() -> dict[str, Any]:
    """The machine, the versions and the date of a measurement."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {"cpu": _cpu_name(), "cores": os.cpu_count(), "system": platform.platform()},
        "versions": {"python": platform.python_version()} | _package_versions(),
        "command": " ".join(["python", f"benchmarks/{Path(sys.argv[0]).name}", *sys.argv[1:]]),
    }


def _record(row: Sequence[Any] | Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    values = [row[column] for column in columns] if isinstance(row, Mapping) else list(row)
    if len(values) != len(columns):
        raise ValueError(f"a row has {len(values)} values but there are {len(columns)} columns: {row!r}")
    return dict(zip(columns, values, strict=True))


def _print(title: str, records: list[dict[str, Any]], columns: Sequence[str]) -> None:
    table = Table(title=title, title_justify="left")
    for column in columns:
        numeric = all(isinstance(record[column], int | float) or record[column] is None for record in records)
        table.add_column(escape(column), justify="right" if numeric else "left")
    for record in records:
        table.add_row(*[_cell(record[column]) for column in columns])
    # A file or a pipe has no width of its own: wide enough that no column is cut.
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(table)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool) or not isinstance(value, float):
        return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)
    if value == 0 or 0.001 <= abs(value) < 1e6:
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return f"{value:.3g}"


def _plain(value: Any) -> Any:
    """JSON form of numpy scalars and arrays."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _cpu_name() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _package_versions() -> dict[str, str]:
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions
