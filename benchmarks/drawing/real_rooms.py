"""Drawings of real robots' maps against the rooms and doors that a person saw in them.

    python benchmarks/drawing/real_rooms.py real_rooms --model slam2cad -o out/real_rooms

The folder holds annotated maps, ``*/*/rooms.json`` and ``map.yaml``, and ``score.py``, which scores a drawing's JSON.
Boundaries wider than a door may be drawn or not.
"""

import argparse
import importlib
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.drawing import load_floor_model, make_drawing, write_drawing
from slamgym.interop import read_map

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("gan/translation", "slamgym/drawing")
"""What is measured."""

WIDEST_DOOR = 1.6
"""[m]."""
COUNTS = (
    "usable",
    "merged",
    "split",
    "missing",
    "doors_true",
    "door_hits",
    "door_false",
    "closed",
    "CPU s",
)
MEANS = ("f1", "lost_pct", "unseen_pct", "fan_pct")
"""Of the maps for which there is one."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rooms", type=Path, help="folder of annotated maps and their score.py")
    parser.add_argument("--model", default="slam2cad", help="as `slamgym cad --model`")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for the drawings")
    arguments = parser.parse_args()
    sys.path.insert(0, str(arguments.rooms))
    scorer, model = importlib.import_module("score"), load_floor_model(arguments.model)
    rows: list[dict[str, Any]] = []
    for truth in sorted(path.parent for path in arguments.rooms.glob("*/*/rooms.json")):
        begun = time.process_time()
        drawing = make_drawing(read_map(truth / "map.yaml").grid, truth.name, model)
        seconds = time.process_time() - begun
        (path,) = write_drawing(drawing, arguments.output / truth.name, ["json"])
        found = scorer.score(str(truth), str(path), WIDEST_DOOR)
        rows.append(
            {**found, "map": truth.name, "usable": int(found["usable"]), "CPU s": round(seconds, 2)}
        )
    total: dict[str, Any] = {"map": "all"}
    total |= {count: sum(row[count] or 0 for row in rows) for count in COUNTS}
    for mean in MEANS:
        values = [row[mean] for row in rows if row[mean] is not None]
        total[mean] = round(float(np.mean(values)), 3) if values else None
    columns = ("map", *MEANS, *COUNTS)
    table = [[row[column] for column in columns] for row in (*rows, total)]
    print_and_save(
        "drawing/rooms", "Drawn rooms of real maps", table, columns, MODULES, times=("CPU s",)
    )


if __name__ == "__main__":
    main()
