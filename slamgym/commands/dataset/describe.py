"""``slamgym dataset stats`` and ``show``: what lies in a dataset, as tables or as pictures."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import tyro

from slamgym.commands.frame import MaybeOut, show_table
from slamgym.core.config import Arguments, Count, suggest, to_dict
from slamgym.core.documents import json_text
from slamgym.core.errors import ConfigError
from slamgym.core.progress import tell

if TYPE_CHECKING:
    from slamgym.dataset.record import PairRecord
    from slamgym.dataset.statistics import DatasetStatistics, GroupStatistics

STATISTICS_COLUMNS = (
    "", "pairs", "plans", "robot h", "complete [%]", "kept [%]", "coverage p5, p50 [%]", "ATE p50, p95 [m]",
    "walls p50, p95 [m]", "robot min p50, max", "CPU s",
)  # fmt: skip
_COLUMNS = 2
"""Pairs in a row of a sheet."""
Order = Literal["index", "ate", "map_error", "coverage", "robot_seconds", "area", "collisions"]
_SORT_KEYS: dict[Order, Callable[[PairRecord], str | float]] = {
    "index": lambda record: record.name,
    "ate": lambda record: record.ate,
    "map_error": lambda record: record.map_error,
    "coverage": lambda record: record.coverage,
    "robot_seconds": lambda record: record.robot_seconds,
    "area": lambda record: record.area,
    "collisions": lambda record: record.collisions,
}
"""By what the pairs are ordered."""
NOT_OF_IMAGES = ("robot_seconds", "area", "collisions")
"""Orders that the records of rendered images know nothing of."""
LOWEST_FIRST = ("index", "coverage")
"""Listed from the lowest value up; of all others the highest values come first."""


class StatsArguments(Arguments):
    """Show what lies in a dataset: pairs, coverage, errors and endings, also by condition.

    `complete` is the share of pairs that saw 95 % of the reachable floor; `kept` is what cleaning keeps; ATE is
    the position error of the SLAM estimate; `walls` the distance of drawn walls to true ones.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the dataset."""
    json: bool = False
    """Write JSON instead of tables."""


def stats(arguments: StatsArguments) -> None:
    """Run ``slamgym dataset stats``."""
    from slamgym.dataset.statistics import dataset_statistics

    statistics = dataset_statistics(arguments.dataset)
    if arguments.json:
        sys.stdout.write(json_text(to_dict(statistics)))
    else:
        _print(statistics)


def _print(statistics: DatasetStatistics) -> None:
    rows: list[list[str]] = [["all", *_cells(statistics.whole)]]
    for name, groups in statistics.by_condition.items():
        rows += [[], *([f"{name}: {label}", *_cells(group)] for label, group in groups.items())]
    below = []
    for title, counts in (
        ("ended by", statistics.endings),
        ("plans without a pair", statistics.rejected),
        ("dropped by cleaning", statistics.left_out),
    ):
        if counts:
            below.append(
                f"{title}: " + ", ".join(f"{count} {name}" for name, count in counts.items())
            )
    show_table(STATISTICS_COLUMNS, rows, statistics.dataset, *below)


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


class ShowArguments(Arguments):
    """Draw pairs of a dataset, or of a folder of rendered images, on one sheet.

    Without names and order, the pairs are spread evenly over the dataset.
    """

    folder: tyro.conf.Positional[Path]
    """A folder that `slamgym generate` or `slamgym dataset render` has written."""
    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Pairs to draw, by name, by index or by plan."""
    out: MaybeOut = None
    """Picture to write, .png or .jpg; contact_sheet.png in the folder without it."""
    sort: Order | None = None
    """Draw the first pairs in this order, the worst first: ``ate``, ``map_error``, ``coverage``, ..."""
    limit: Count = 12
    """Pairs on the sheet."""

    def _check(self) -> None:
        if self.out is not None and self.out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
            raise ConfigError(f"--out {self.out}: a picture is a .png or a .jpg")


def show(arguments: ShowArguments) -> None:
    """Run ``slamgym dataset show``."""
    chosen, output = draw_pairs(arguments)
    for record in chosen:
        tell(
            f"{record.name}  {100 * record.coverage:5.1f} % covered, position error {record.ate:.3f} m, "
            f"walls {record.map_error:.3f} m, {record.explorer}"
        )
    tell(f"{output}")


def draw_pairs(arguments: ShowArguments) -> tuple[list[Any], Path]:
    """Draw the sheet; returns the records of its pairs, and where it lies."""
    from slamgym.dataset.check import is_image_folder
    from slamgym.dataset.format import read_manifest
    from slamgym.dataset.images.format import load_images, read_images
    from slamgym.dataset.statistics import sheet_entries
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.sheets import Card, draw_contact_sheet, draw_sheet

    output = arguments.out or arguments.folder / "contact_sheet.png"
    if is_image_folder(arguments.folder):
        chosen = choose(read_images(arguments.folder), arguments)
        cards = [
            Card(
                load_images(arguments.folder, record),
                [f"{record.split}  {record.name[:40]}  {record.metres_per_px:.3f} m/px"],
            )
            for record in chosen
        ]
        write_picture(output, draw_sheet(cards, _COLUMNS, max(record.size for record in chosen)))
    else:
        records = list(read_manifest(arguments.folder))
        chosen = choose(records, arguments)
        heading = f"slamgym: {len(chosen)} of {len(records)} pairs"
        write_picture(
            output, draw_contact_sheet(heading, sheet_entries(arguments.folder, chosen), _COLUMNS)
        )
    return chosen, output


def choose(records: Sequence[Any], arguments: ShowArguments) -> list[Any]:
    """The records to draw, in the order in which they are drawn.

    Raises:
        ConfigError: If there is none, or a name, an index or an order is unknown.
    """
    from slamgym.dataset.check import is_image_folder

    if not records:
        raise ConfigError(f"{arguments.folder}: holds no pairs yet")
    chosen = list(records)
    if arguments.names:
        chosen = [record for name in arguments.names for record in _named(records, name)]
    order = arguments.sort
    if order is not None:
        if is_image_folder(arguments.folder) and order in NOT_OF_IMAGES:
            raise ConfigError(
                f"rendered images don't know {order!r}; order the dataset by it instead"
            )
        chosen.sort(key=_SORT_KEYS[order], reverse=order not in LOWEST_FIRST)
    elif not arguments.names:
        places = np.linspace(0, len(chosen) - 1, min(arguments.limit, len(chosen)))
        chosen = [chosen[place] for place in np.unique(places.astype(int))]
    return chosen[: arguments.limit]


def _named(records: Sequence[Any], name: str) -> list[Any]:
    """The pairs that a word means: one by its name or index, or all of a plan."""
    found = [record for record in records if name in (record.name, record.plan_id)]
    if not found and name.isdigit():
        found = [record for record in records if int(record.name.partition("_")[0]) == int(name)]
    if not found:
        known = [record.name for record in records[:1000]]
        raise ConfigError(f"there is no pair {name!r}; {suggest(name, known)}")
    return found
