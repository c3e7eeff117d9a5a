"""Annotated maps of real robots: their boundaries, buildings and scorer, and drawings in the scorer's form."""

import functools
import importlib
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.polygons import largest_part
from slamgym.core.types import FloatArray, GridFrame, IntArray, OccupancyGrid
from slamgym.drawing.boundaries import WIDEST
from slamgym.drawing.evidence import filled_patch, values_at
from slamgym.drawing.openings import Division
from slamgym.interop import read_map

WIDEST_DOOR = 1.6
"""Wider boundaries may be drawn or not, unless all are asked for [m]."""
VACUUMS = ("Hypfer", "sca075", "konqi", "jaidenlabelle")
"""Owners of the repositories whose maps were made by vacuums."""
MAY_BE_USED = "ok-with-notice"


@dataclass(frozen=True)
class AnnotatedMap:
    """One map, and what a person saw in it."""

    folder: Path
    about: dict[str, Any]
    """Its rooms.json."""

    @property
    def name(self) -> str:
        """Its folder's."""
        return self.folder.name

    @property
    def set(self) -> str:
        """Of maps annotated together."""
        return self.folder.parent.name

    @property
    def building(self) -> str:
        """Maps of one owner count as one building: several show the same."""
        return str(self.about["source_repo"]).split("/", maxsplit=1)[0]

    @property
    def is_by_vacuum(self) -> bool:
        """Whether a vacuum made it; their firmware thins walls."""
        return self.building in VACUUMS

    @property
    def may_be_used(self) -> bool:
        """Whether weights fitted to it may be published."""
        return bool(self.about["redistribution"] == MAY_BE_USED)

    @property
    def grid(self) -> OccupancyGrid:
        """The map."""
        return read_map(self.folder / "map.yaml").grid

    @functools.cached_property
    def _labels(self) -> IntArray:
        labels = cv2.imread(str(self.folder / "labels.png"), cv2.IMREAD_UNCHANGED)
        return np.asarray(labels, np.int64)

    def rooms_at(self, places: FloatArray) -> IntArray:
        """Numbers of the rooms at places (..., 2) [m], 0 for none."""
        return values_at(self._labels, self.grid.frame, places, 0)

    def room_in(self, shape: Polygon) -> int:
        """The number of the room of which most is in a polygon, 0 for none."""
        patch = filled_patch(shape, self.grid.frame)
        inside = self._labels[patch.place][patch.inside]
        return int(np.bincount(inside[inside > 0], minlength=1).argmax())

    @property
    def rooms(self) -> list[Polygon]:
        """Outlines of the rooms that a drawing must have [m]."""
        frame = self.grid.frame
        kept = [one for one in self.about["rooms"] if not (one["partial"] or one["small"])]
        rings = [in_metres(one["polygon"], frame) for one in kept]
        return [largest_part(shapely.make_valid(Polygon(ring))) for ring in rings if len(ring) > 3]

    @property
    def pairs_by_taste(self) -> list[frozenset[int]]:
        """Rooms that may be drawn as one."""
        doors = self.about["doors"]
        return [frozenset(door["rooms"]) for door in doors if door["kind"] == "ambiguous"]

    def boundaries(self) -> tuple[FloatArray, FloatArray]:
        """Those that a drawing must have, (N, 2, 2), and those that it may have, (M, 2, 2) [m]."""
        frame = self.grid.frame
        doors = self.about["doors"]
        lines = [in_metres([door["a"], door["b"]], frame) for door in doors]
        sure = [door["kind"] != "ambiguous" and door["width_m"] <= WIDEST for door in doors]
        all_lines = np.array(lines).reshape(-1, 2, 2)
        return all_lines[np.array(sure, bool)], all_lines[~np.array(sure, bool)]


def read_annotated(folder: Path) -> list[AnnotatedMap]:
    """All maps of a folder of sets, ``*/*/rooms.json``."""
    paths = sorted(folder.glob("*/*/rooms.json"))
    return [AnnotatedMap(path.parent, json.loads(path.read_text("utf-8"))) for path in paths]


def in_metres(pixels: Sequence[Sequence[float]], frame: GridFrame) -> FloatArray:
    """Columns and rows of the middles of pixels, from the top left, as places [m]."""
    cols, rows = np.asarray(pixels, np.float64).T
    x = frame.origin_x + (cols + 0.5) * frame.resolution
    y = frame.origin_y + (frame.height_px - 0.5 - rows) * frame.resolution
    return np.column_stack([x, y])


def scorer(folder: Path) -> Any:
    """The module ``score.py`` that comes with the maps."""
    sys.path.insert(0, str(folder))
    return importlib.import_module("score")


def write_division(division: Division, path: Path) -> None:
    """Rooms and doors alone, as the scorer reads them."""
    document = {
        "rooms": [{"polygon": rings(room)} for room in division.rooms],
        "doors": [{"start": door.start, "end": door.end} for door in division.doors],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document), encoding="utf-8")


def rings(polygon: Polygon) -> list[list[tuple[float, ...]]]:
    """The outline and the holes."""
    return [list(ring.coords) for ring in (polygon.exterior, *polygon.interiors)]
