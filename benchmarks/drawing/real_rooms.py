"""Drawings of real robots' maps against the rooms and doors that a person saw in them.

    python benchmarks/drawing/boundaries.py real_rooms -o out/rooms     # each map drawn without its building
    python benchmarks/drawing/real_rooms.py real_rooms "slam2cad=out/rooms/slam2cad" "cleaning=out/rooms/none"

``slam2cad-asked=out/rooms/slam2cad-asked --rival slam2cad=out/rooms/slam2cad --results drawing/questions`` says what a
report's questions add.
The folder holds annotated maps, ``*/*/rooms.json`` and ``map.yaml``, and ``score.py``, which scores a drawing's JSON.
Folders of drawings, by any program, are compared with a plain watershed: rooms are what is farther than 0.55 m from all
that isn't free in the cleaned map, and what flows there. Intervals are those of resampled buildings. The annotation has
the free floor with the fronts of furniture, so corners are those of outlines that were made straight within 25 cm.
"""

import argparse
import functools
import json
import operator
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.polygons import largest_part
from slamgym.core.intervals import mean_interval
from slamgym.drawing.signs import PLAIN_WATERSHED
from slamgym.metrics.cleaning import clean_map
from slamgym.metrics.rooms import label_rooms

sys.path.insert(0, str(Path(__file__).parents[1]))
from annotated import WIDEST_DOOR, AnnotatedMap, read_annotated, scorer
from corners import CornerCounts, count_corners
from report import print_and_save

MODULES = ("gan/translation", "slamgym/drawing")
"""What is measured."""
WATERSHED = "watershed"
STRAIGHT_WITHIN = 0.25
"""Corners that stand out less from a straight line are none [m]."""
BOUNDARIES = {"up to 1.6 m": WIDEST_DOOR, "all": None}
"""Which ones a drawing must have."""
SUMS = ("usable", "merged", "split", "missing", "closed")
COLUMNS = (
    "rooms by",
    "boundaries",
    "maps",
    "number",
    "room F1",
    "[95 %]",
    "more than the rival",
    "[95 %] of that",
    *SUMS,
    "door recall",
    "door precision",
    "lost [%]",
    "corner F1",
    "angle F1",
)

Score = dict[str, Any]
"""What the scorer says of a drawing."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rooms", type=Path, help="folder of annotated maps and their score.py")
    parser.add_argument(
        "drawings",
        nargs="*",
        metavar="NAME=FOLDER",
        help="folders with MAP.json, or MAP/drawing.json",
    )
    parser.add_argument(
        "--rival", metavar="NAME=FOLDER", help="what all are compared with; a plain watershed"
    )
    parser.add_argument("--results", default="drawing/rooms", help="name of the results file")
    arguments = parser.parse_args()
    score = scorer(arguments.rooms).score
    maps = read_annotated(arguments.rooms)
    rival_name, _, rival_folder = (arguments.rival or WATERSHED).partition("=")
    folders = dict(one.split("=", maxsplit=1) for one in arguments.drawings)

    def scores(folder: str, widest: float | None) -> list[Score]:
        """Of all maps; without a folder those of the watershed."""
        found = []
        for one in maps:
            path = drawing_of(one, Path(folder)) if folder else watershed(one)
            own = score(str(one.folder), path, widest)
            found.append(own | {"corners": corners_of(one, path)} if folder else own)
        return found

    rows = []
    for boundaries, widest in BOUNDARIES.items():
        rival = scores(rival_folder, widest)
        rows += figures(rival_name, boundaries, maps, rival, rival)
        for name, folder in folders.items():
            rows += figures(name, boundaries, maps, scores(folder, widest), rival)
    table = [[row[column] for column in COLUMNS] for row in rows]
    print_and_save(arguments.results, "Drawn rooms of real maps", table, COLUMNS, MODULES)


def drawing_of(one: AnnotatedMap, folder: Path) -> str:
    """Path of a map's drawing."""
    alone = folder / f"{one.name}.json"
    return str(alone if alone.is_file() else next((folder / one.name).glob("*.json")))


def corners_of(one: AnnotatedMap, path: str) -> CornerCounts:
    """The corners of a map's drawn rooms; those are left out that lie mostly where none need be."""
    document = json.loads(Path(path).read_text("utf-8"))
    rings = [room["polygon"] for room in document.get("drawing", document)["rooms"]]
    drawn = [largest_part(shapely.make_valid(Polygon(ring[0], ring[1:]))) for ring in rings]
    must = shapely.union_all(one.rooms)
    kept = [room for room in drawn if room.intersection(must).area > 0.5 * room.area]
    return count_corners(kept, one.rooms, STRAIGHT_WITHIN)


def watershed(one: AnnotatedMap) -> str:
    """Path of a picture of the rooms that the watershed finds in a map."""
    grid = one.grid
    cell = grid.frame.resolution
    rooms = label_rooms(clean_map(grid.cells, cell), cell, *PLAIN_WATERSHED)
    path = Path(tempfile.gettempdir()) / "watershed.png"
    cv2.imwrite(str(path), rooms.astype(np.uint16))
    return str(path)


PARTS: dict[str, Callable[[AnnotatedMap], bool]] = {
    "all": lambda one: True,  # noqa: ARG005 - as the others
    "dev": lambda one: one.set == "dev",
    "dev2": lambda one: one.set == "dev2",
    "robots": lambda one: not one.is_by_vacuum,
    "vacuums": lambda one: one.is_by_vacuum,
}
"""Maps that are shown apart."""


def figures(
    name: str,
    boundaries: str,
    maps: Sequence[AnnotatedMap],
    scores: Sequence[Score],
    rival: Sequence[Score],
) -> list[dict[str, Any]]:
    """Rows of the table: all maps, and parts of them."""
    rows = []
    for part, belongs in PARTS.items():
        chosen = [i for i, one in enumerate(maps) if belongs(one)]
        if chosen:
            some = [scores[i] for i in chosen]
            f1 = np.array([one["f1"] for one in some])
            more = f1 - np.array([rival[i]["f1"] for i in chosen])
            buildings = [maps[i].building for i in chosen]
            row = {"rooms by": name, "boundaries": boundaries, "maps": part, "number": len(some)}
            row |= {"room F1": round(float(f1.mean()), 3), "[95 %]": interval(f1, buildings)}
            row["more than the rival"] = round(float(more.mean()), 3)
            row["[95 %] of that"] = interval(more, buildings)
            rows.append(row | totals(some))
    return rows


def interval(values: np.ndarray, buildings: Sequence[str]) -> str:
    """The interval of a mean, if buildings are drawn again."""
    found = mean_interval(values, groups=buildings)
    return f"{found.low:.2f}, {found.high:.2f}"


def totals(some: Sequence[Score]) -> dict[str, Any]:
    """Counts over maps, and shares of all doors; None for those of a picture, which has no doors."""
    row: dict[str, Any] = {}
    has_doors = some[0]["closed"] is not None
    for count in SUMS:
        row[count] = sum(one[count] or 0 for one in some)
    hits, true, false = (
        sum(one.get(key) or 0 for one in some) for key in ("door_hits", "doors_true", "door_false")
    )
    row["closed"] = row["closed"] if has_doors else None
    row["door recall"] = round(hits / max(true, 1), 3) if has_doors else None
    row["door precision"] = round(hits / max(hits + false, 1), 3) if has_doors else None
    row["lost [%]"] = round(float(np.mean([one["lost_pct"] for one in some])), 2)
    counts = [one["corners"] for one in some if "corners" in one]
    corners = functools.reduce(operator.add, counts).figures() if counts else {}
    row |= {name: corners.get(name) for name in ("corner F1", "angle F1")}
    return row


if __name__ == "__main__":
    main()
