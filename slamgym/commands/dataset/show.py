"""``slamgym dataset show``: draw pairs for people to look at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from slamgym.core.config import Arguments, Count, suggest
from slamgym.core.errors import ConfigError
from slamgym.core.progress import tell
from slamgym.core.types import ByteArray

if TYPE_CHECKING:
    from slamgym.dataset.images.format import ImageRecord
    from slamgym.dataset.record import PairRecord

Order = Literal["index", "ate", "map_error", "coverage", "robot_seconds", "area", "collisions"]
LOWEST_FIRST = ("index", "coverage")
"""What is listed from the lowest value up; of all else the highest values come first."""


class ShowArguments(Arguments):
    """Draw pairs of a dataset, or of a folder of rendered images, on one sheet.

    Without names and order, the pairs are spread evenly over the dataset.
    """

    folder: tyro.conf.Positional[Path]
    """A folder that `slamgym generate` or `slamgym dataset render` has written."""
    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Pairs to draw, by name, by index or by plan."""
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Picture to write, .png or .jpg; contact_sheet.png in the folder without it."""
    sort: Order | None = None
    """Draw the first pairs in this order, the worst first: ``ate``, ``map_error``, ``coverage``, ..."""
    reverse: bool = False
    """The best first."""
    limit: Count = 12
    """Pairs on the sheet."""
    columns: Count = 2
    """Pairs beside each other."""

    def _check(self) -> None:
        if self.out is not None and self.out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
            raise ConfigError(f"--out {self.out}: a picture is a .png or a .jpg")


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(ShowArguments, args=argv, prog="slamgym dataset show")
    from slamgym.dataset.check import is_image_folder
    from slamgym.dataset.format import read_manifest
    from slamgym.dataset.images.format import read_images
    from slamgym.dataset.statistics import sheet_entries
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.sheets import draw_contact_sheet

    output = arguments.out or arguments.folder / "contact_sheet.png"
    if is_image_folder(arguments.folder):
        images = read_images(arguments.folder)
        chosen_images = choose(images, arguments)
        picture = _draw_images(arguments, chosen_images)
        write_picture(output, picture)
        _list(chosen_images)
    else:
        records = list(read_manifest(arguments.folder))
        chosen = choose(records, arguments)
        heading = f"slamgym: {len(chosen)} of {len(records)} pairs"
        picture = draw_contact_sheet(heading, sheet_entries(arguments.folder, chosen), arguments.columns)
        write_picture(output, picture)
        _list(chosen)
    tell(f"{output}")
    return 0


def choose(records: Sequence[Any], arguments: ShowArguments) -> list[Any]:
    """The records to draw, in the order in which they are drawn.

    Raises:
        ConfigError: If there is none, or a name, an index or an order is unknown.
    """
    if not records:
        raise ConfigError(f"{arguments.folder}: holds no pairs yet")
    chosen = list(records)
    if arguments.names:
        chosen = [record for name in arguments.names for record in _named(records, name)]
    order = arguments.sort
    if order is not None:
        if not hasattr(records[0], order) and order != "index":
            raise ConfigError(f"rendered images don't know {order!r}; order the dataset by it instead")
        down = (order not in LOWEST_FIRST) != arguments.reverse
        chosen.sort(key=lambda record: _value(record, order), reverse=down)
        return chosen[: arguments.limit]
    if arguments.names:
        return chosen[: arguments.limit]
    places = np.unique(np.linspace(0, len(chosen) - 1, min(arguments.limit, len(chosen))).astype(int))
    return [chosen[place] for place in places]


def _value(record: PairRecord | ImageRecord, order: str) -> Any:
    return record.name if order == "index" else getattr(record, order)


def _named(records: Sequence[Any], name: str) -> list[Any]:
    """The pairs that a word means: one by its name or index, or all of a plan."""
    found = [record for record in records if name in (record.name, record.plan_id)]
    if not found and name.isdigit():
        found = [record for record in records if int(record.name.partition("_")[0]) == int(name)]
    if not found:
        known = [record.name for record in records[:1000]]
        raise ConfigError(f"there is no pair {name!r}; {suggest(name, known)}")
    return found


def _draw_images(arguments: ShowArguments, records: Sequence[ImageRecord]) -> ByteArray:
    """A sheet of rendered pairs as they are, with their names."""
    from slamgym.dataset.images.format import load_images
    from slamgym.viz.sheets import Card, draw_sheet

    cards = [
        Card(
            load_images(arguments.folder, record),
            [f"{record.split}  {record.name[:40]}  {record.metres_per_px:.3f} m/px"],
        )
        for record in records
    ]
    return draw_sheet(cards, arguments.columns, max(record.size for record in records))


def _list(records: Sequence[PairRecord] | Sequence[ImageRecord]) -> None:
    for record in records:
        tell(
            f"{record.name}  {100 * record.coverage:5.1f} % covered, position error {record.ate:.3f} m, "
            f"walls {record.map_error:.3f} m, {record.explorer}"
        )
