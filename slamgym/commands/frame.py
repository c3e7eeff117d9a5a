"""Shared by the commands: -o/--out, extras, a folder of results with a summary, tables."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import tyro

from slamgym import __version__
from slamgym.core.config import suggest
from slamgym.core.documents import YAML_SUFFIXES, json_text
from slamgym.core.errors import ConfigError, InputFileError, SlamgymError
from slamgym.core.files import spare_inputs, storage_errors, write_text
from slamgym.core.progress import tell
from slamgym.core.text import printable

if TYPE_CHECKING:
    from slamgym.viz.window import Window

Out = Annotated[Path, tyro.conf.arg(aliases=["-o"])]
MaybeOut = Annotated[Path | None, tyro.conf.arg(aliases=["-o"])]
SUMMARY = "summary.json"
"""Written last: where it is, everything else is complete."""
_TABLE_WIDTH = 160
"""A table that is cut off says less than one whose lines a terminal wraps."""


class Extra(NamedTuple):
    """Packages that a command or an option needs beyond the base installation."""

    name: str
    """As ``pyproject.toml`` has it."""
    packages: tuple[str, ...]
    """Those of its packages that are needed, as they are imported."""


LEARNING = Extra("agents", ("torch", "stable_baselines3", "tensorboard", "matplotlib"))
TRANSLATING = Extra("gan", ("torch", "safetensors"))
PARQUET = Extra("hub", ("datasets", "pyarrow"))
WEBDATASET = Extra("hub", ("webdataset",))
ROS2 = Extra(
    "ros2",
    ("rclpy", "nav_msgs", "sensor_msgs", "std_srvs", "visualization_msgs", "diagnostic_msgs"),
)


def require(extra: Extra, what: str, otherwise: str = "") -> None:
    """Refuse with one sentence where a package is missing, before any work is done.

    Args:
        extra: The packages.
        what: The command or option that needs them.
        otherwise: What works without them, behind the advice to install them.

    Raises:
        SlamgymError: If one of them isn't installed.
    """
    for package in extra.packages:
        if not is_installed(package):
            raise SlamgymError(
                f"{what} needs the package {package!r}; install it with: pip install 'slamgym[{extra.name}]'"
                f"{otherwise}"
            )


def is_installed(package: str) -> bool:
    """True if a package can be imported, which isn't done."""
    return importlib.util.find_spec(package) is not None


def open_window(title: str, frames_per_second: float, otherwise: str) -> Window:
    """A window that somebody can see.

    Args:
        title: Of the window.
        frames_per_second: See :class:`~slamgym.viz.window.Window`.
        otherwise: What to do without a screen.

    Raises:
        SlamgymError: If there is no screen, or pygame isn't installed.
    """
    from slamgym.viz.window import Window

    window = Window(title, frames_per_second)
    if window.is_unseen:
        window.close()
        raise SlamgymError(f"no screen was found; {otherwise}")
    return window


def require_folder(out: Path) -> None:
    """Refuse before any work is done what can't become a folder of results.

    Raises:
        InputFileError: If it is a file.
    """
    if out.exists() and not out.is_dir():
        raise InputFileError(out, "is a file; name a folder for the results")


def spare_maps(maps: Sequence[Path], out: Path, role: str) -> None:
    """Refuse to write a map over one that is read; ``role`` says in the error what that is to the command.

    Raises:
        InputFileError: If the folder of the results is one of the maps, or would hold it under the same name.
    """
    for target in (out, out / "map.yaml", out / "map.pgm", out / "map.png"):
        spare_inputs(maps, target, role)


def begin_results(folder: Path) -> None:
    """Make a folder of results, or let the one that is there count as incomplete."""
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / SUMMARY).unlink(missing_ok=True)


def end_results(folder: Path, summary: Mapping[str, Any], lines: Iterable[str]) -> None:
    """Write the summary as JSON for scripts, and show the lines for people.

    Raises:
        StorageError: If it can't be written.
    """
    write_text(folder / SUMMARY, json_text({"version": __version__, **summary}))
    tell(*lines)


def show_table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], title: str | None = None, *below: str
) -> None:
    """Print a table on standard output, and sentences below it.

    Args:
        headings: Of the columns; the first is aligned to the left.
        rows: Cells; an empty row draws a line.
        title: Above the table.
        below: Sentences.
    """
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title and printable(title), title_justify="left")
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="right" if number else "left")
    for row in rows:
        if row:
            table.add_row(*map(printable, row))
        else:
            table.add_section()
    width = max(Console().width, _TABLE_WIDTH)
    console = Console(file=sys.stdout, width=width, highlight=False, markup=False)
    console.print(table, *map(printable, below), sep="\n")


def maps_in(folder: Path, is_picture: Callable[[Path], bool], what: str) -> list[Path]:
    """ROS maps of a folder by their yaml files, then pictures that belong to none.

    Args:
        folder: The folder; hidden files are left out.
        is_picture: Which of the other files are maps, too.
        what: What was looked for, for the error.

    Raises:
        InputFileError: If there is none.
    """
    files = [
        path
        for path in sorted(folder.iterdir())
        if path.is_file() and not path.name.startswith(".")
    ]
    maps = [path for path in files if path.suffix.lower() in YAML_SUFFIXES]
    belonging = {path.stem for path in maps}
    maps += [
        path
        for path in files
        if path not in maps and path.stem not in belonging and is_picture(path)
    ]
    if not maps:
        raise InputFileError(
            folder, f"holds no ROS maps ({', '.join(YAML_SUFFIXES)}) and no {what}"
        )
    return maps


def require_plan(source: str, plan_id: str, ids: Sequence[str]) -> str:
    """The id of a plan that is there.

    Raises:
        ConfigError: If it isn't; the error suggests the nearest.
    """
    if plan_id not in ids:
        raise ConfigError(f"{source} has no plan {plan_id!r}; {suggest(plan_id, ids[:1000])}")
    return plan_id


def require_input(path: Path, what: str) -> None:
    """Refuse a path at which nothing lies.

    Raises:
        InputFileError: Naming what should lie there.
    """
    if not path.exists():
        raise InputFileError(path, f"doesn't exist; give {what}")
