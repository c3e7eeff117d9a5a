"""Output of a benchmark's figures: a table in the terminal and a JSON file under ``benchmarks/results``.

The JSON carries what a reader needs to assess a time: the machine, the versions and the date. It names the commit and
the modules that were measured, so ``figures.py`` can say where they have changed since. Machines of one name differ by
three, so times are also divided by those of two fixed programs in the same run: a Python loop of ten million additions,
and a compiled walk through a table. A thousandth of such a loop is a "mloop", a millionth a "uloop".
"""

import functools
import importlib.metadata
import json
import os
import platform
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

RESULTS = Path(__file__).resolve().parent / "results"
UNCOMMITTED = "+"
"""Behind a commit: the modules had changes that it lacks."""

_PACKAGES = (
    "slamgym",
    "numpy",
    "numba",
    "pymunk",
    "shapely",
    "opencv-python-headless",
    "gymnasium",
)

ADDITIONS = 10_000_000
"""Number of additions in the Python loop."""
STEPS = 50_000_000
"""Number of steps in the compiled walk."""


class Yardsticks(NamedTuple):
    """Times of the fixed programs in this run [CPU s]."""

    loop: float
    kernel: float

    @staticmethod
    def measure(count: int = 5) -> "Yardsticks":
        """Medians of so many runs, one after the other."""
        walk, table = compiled_walk(), np.zeros(1 << 16, dtype=np.int64)
        both = [
            (cpu_seconds(add_up, ADDITIONS), cpu_seconds(walk, table, STEPS)) for _ in range(count)
        ]
        return Yardsticks(*(statistics.median(times) for times in zip(*both, strict=True)))


def cpu_seconds(function: Any, *arguments: Any) -> float:
    """CPU time of one call [s]."""
    begin = time.process_time()
    function(*arguments)
    return time.process_time() - begin


def resident_mb(pid: int) -> float:
    """Resident set of a process [MB]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def add_up(count: int) -> int:
    """The Python loop."""
    total = 0
    for i in range(count):
        total += i
    return total


def walk_through_table(table: np.ndarray, steps: int) -> None:
    """The compiled program: whole numbers, loads and stores all over 512 KB, as in the kernels of maps."""
    place = np.uint64(1)
    for _ in range(steps):
        place = place * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
        table[place >> np.uint64(48)] += 1


@functools.cache
def compiled_walk() -> Any:
    """The same, ready to be called with a table of 65,536 numbers."""
    import numba

    walk = numba.njit(walk_through_table)
    walk(np.zeros(1 << 16, dtype=np.int64), 1)
    return walk


def print_and_save(
    name: str,
    title: str,
    rows: Sequence[Sequence[Any] | Mapping[str, Any]],
    columns: Sequence[str],
    modules: Sequence[str],
    times: Sequence[str] = (),
    yardsticks: Yardsticks | None = None,
) -> Path:
    """Print a table and write it, with the machine it was measured on, as JSON.

    Args:
        name: Folder and file stem under ``benchmarks/results``.
        title: Heading of the table; states what one row is.
        rows: One sequence per row in the order of ``columns``, or one mapping from column to value.
        columns: Column headings, with their units.
        modules: Files and folders whose change makes the figures old, from the root of the repository.
        times: Those of CPU times, in us, ms or s, or per s. They are shown in loops first.
        yardsticks: Measured during the run; measured now where left out.

    Returns:
        The JSON file written.

    Raises:
        ValueError: If a row doesn't fit the columns.
    """
    records = [_record(row, columns) for row in rows]
    document = {
        "name": name,
        "title": title,
        **environment(modules),
        "columns": list(columns),
        "rows": records,
    }
    if times:
        measured = yardsticks or Yardsticks.measure()
        title += f". One loop took {measured.loop:.3f} CPU s, {measured.loop / measured.kernel:.2f} kernels"
        document["yardsticks"] = {"loop [CPU s]": measured.loop, "kernel [CPU s]": measured.kernel}
        for unit, second in (("loop", measured.loop), ("kernel", measured.kernel)):
            document[f"in {unit}s"] = [
                {_in_units(time, unit): _divided(record[time], time, second) for time in times}
                for record in records
            ]
        print_table(title, *_with_loops(records, columns, times, measured.loop))
    else:
        print_table(title, records, columns)
    path = RESULTS / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, indent=1, default=_plain) + "\n", encoding="utf-8")
    return path


def environment(modules: Sequence[str]) -> dict[str, Any]:
    """The machine, the versions and the date of a measurement, and what was measured."""
    return {
        "commit": commit_of(modules),
        "modules": list(modules),
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "machine": {"cpu": _cpu_name(), "cores": os.cpu_count(), "system": platform.platform()},
        "versions": {"python": platform.python_version()} | _package_versions(),
        "command": " ".join(["python", os.path.relpath(sys.argv[0], RESULTS.parents[1]), *_told()]),
    }


def _told() -> list[str]:
    """The arguments of this run, without the folders of this machine in which their files lie."""
    return [re.sub(r"(?:^|(?<==))/\S*/", "", argument) for argument in sys.argv[1:]]


def commit_of(modules: Sequence[str]) -> str | None:
    """The commit that is measured, marked if the modules have uncommitted changes; None without git."""
    commit = git("rev-parse", "--short=8", "HEAD")
    changed = git("status", "--porcelain", "--", *modules)
    return f"{commit}{UNCOMMITTED if changed else ''}" or None


def git(*arguments: str) -> str:
    """What a command of git prints; empty without git, outside of a repository, or where it fails."""
    try:
        done = subprocess.run(
            ["git", *arguments], cwd=RESULTS.parents[1], capture_output=True, text=True, check=False
        )
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


_UNIT = re.compile(r"(/ ?(?:CPU )?s)\b|(?<!')\b(us|ms|s)\b")  # per second, or a time


def _in_units(column: str, unit: str) -> str:
    """A heading with loops or kernels instead of seconds."""

    def named(found: re.Match[str]) -> str:
        return f"/{unit}" if found[1] else f"{found[2][:-1]}{unit}s"

    return _UNIT.sub(named, column, count=1)


def _divided(value: Any, column: str, second: float) -> float | None:
    """A time over that of a yardstick [s], or a rate times it."""
    found = _UNIT.search(column)
    if found is None:
        raise ValueError(f"the heading {column!r} doesn't say whether it is in us, ms or s")
    if not isinstance(value, int | float):
        return None
    return value * second if found[1] else value / second


def _with_loops(
    records: list[dict[str, Any]], columns: Sequence[str], times: Sequence[str], loop: float
) -> tuple[list[dict[str, Any]], list[str]]:
    """Records and columns with each time in loops, and as it was measured behind."""
    wide = []
    for record in records:
        one: dict[str, Any] = {}
        for column, value in record.items():
            if column in times:
                one[_in_units(column, "loop")] = _divided(value, column, loop)
            one[column] = value
        wide.append(one)
    headings = [
        [_in_units(column, "loop"), column] if column in times else [column] for column in columns
    ]
    return wide, [heading for some in headings for heading in some]


def _record(row: Sequence[Any] | Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    values = [row[column] for column in columns] if isinstance(row, Mapping) else list(row)
    if len(values) != len(columns):
        raise ValueError(
            f"a row has {len(values)} values but there are {len(columns)} columns: {row!r}"
        )
    return dict(zip(columns, values, strict=True))


def print_table(title: str, records: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Print a table, of figures that must not be kept or of a part of a benchmark.

    Args:
        title: Heading of the table; states what one row is.
        records: Rows, each a mapping from column to value.
        columns: Column headings, with their units.
    """
    table = Table(title=title, title_justify="left")
    for column in columns:
        numeric = all(
            isinstance(record[column], int | float) or record[column] is None for record in records
        )
        table.add_column(escape(column), justify="right" if numeric else "left")
    for record in records:
        table.add_row(*[_cell(record[column]) for column in columns])
    # A file or a pipe has no width: wide enough that no column is cut.
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(table)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool) or not isinstance(value, float):
        return (
            f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)
        )
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
