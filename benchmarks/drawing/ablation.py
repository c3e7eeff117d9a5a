"""The worth of each rule of `slamgym cad`: drawings with all rules but one, against plans and annotated real maps.

    slamgym generate --plans json.tar.gz --plans-filter useful -o out/homes --pairs 20 --recipe reference
    python benchmarks/drawing/ablation.py homes=out/homes --rooms real_rooms -o out/ablation.json

``--rooms`` is a folder of annotated maps, ``*/*/rooms.json`` and ``map.yaml``, with a ``score.py`` that scores a
drawing's JSON. The networks run once a map. A result that is in the file already isn't made again.
"""

import argparse
import importlib
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from drawings import homes, score

from slamgym.core.types import BoolArray, Float32Array, OccupancyGrid
from slamgym.drawing import (
    corrections,
    edges,
    load_floor_model,
    make_drawing,
    openings,
)
from slamgym.drawing.formats.json import format_json
from slamgym.interop import read_map

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save


def nowhere(probability: Float32Array, *_: object) -> BoolArray:
    """A correction that corrects nothing."""
    return np.zeros(probability.shape, np.bool_)


RULES: dict[str, tuple[Any, str, Any]] = {
    "none": (corrections, "CONTACT", corrections.CONTACT),
    "walls that were seen and lost": (corrections, "lost_walls", nowhere),
    "unseen floor takes a sure model": (corrections, "doubted_floor", nowhere),
    "unseen floor between rooms": (corrections, "dividing_floor", nowhere),
    "steps in walls": (edges, "MERGE", 0.0),
    "rounded corners": (edges, "CHAMFER", 0.0),
    "worn ends of walls": (edges, "_cap", lambda *_: False),
    "gaps at ends of walls": (openings, "_gaps_at_wall_ends", lambda *_: []),
    "watershed for passages": (openings, "_passages", lambda _: []),
    "wide doors need wider floor": (openings, "SURE_DOOR", np.inf),
    "niches are no rooms": (openings, "SMALLEST_ROOM", 0.0),
    "partly seen rooms": (openings, "OPEN_ROOM", 0.0),
}
"""Each with what is put in its place: a module, a name in it, a value."""
PLAN_COLUMNS = ("maps", "without", "room F1", "wall F1, 5 cm", "wall F1, 10 cm", "doors", "drawn", "invented")
ROOM_COLUMNS = ("maps", "without", "room F1", "usable", "merged", "split", "doors", "drawn", "invented")


class Remembered:
    """A model that is asked once."""

    def __init__(self, name: str) -> None:
        self._model, self._answers = load_floor_model(name), dict[bytes, Float32Array]()

    def probability(self, grid: OccupancyGrid, angle_deg: float) -> Float32Array:
        """Probability of being floor."""
        key = grid.cells.tobytes()
        if key not in self._answers:
            self._answers = {key: self._model.probability(grid, angle_deg)}
        return self._answers[key]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("datasets", nargs="*", help="NAME=FOLDER made by `slamgym generate`")
    parser.add_argument("--rooms", type=Path, help="folder of annotated maps and their score.py")
    parser.add_argument("--model", default="slam2cad-metric", help="as `slamgym cad --model`")
    parser.add_argument("-o", "--output", type=Path, required=True, help="JSON file of all results")
    arguments = parser.parse_args()
    path: Path = arguments.output
    results = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    model = Remembered(arguments.model)
    for name, draw_and_score in cases(arguments.datasets, arguments.rooms, model):
        for rule in RULES:
            if rule not in results.setdefault(name, {}):
                with mock.patch.object(*RULES[rule]):
                    results[name][rule] = draw_and_score()
        path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    for kind, columns in (("plans", PLAN_COLUMNS), ("rooms", ROOM_COLUMNS)):
        sets = sorted({name.split("/")[0] for name in results if (name[:6] == "rooms/") == (kind == "rooms")})
        rows = [row(one, rule, results) for one in sets for rule in RULES]
        table = [[r.get(column, "") for column in columns] for r in rows]
        if table:
            print_and_save(f"drawing/ablation_{kind}", "Drawings without one rule", table, columns)


def cases(datasets: Sequence[str], rooms: Path | None, model: Remembered) -> Iterator[tuple[str, Any]]:
    """Maps by their names, and functions that draw and score them."""
    for named in datasets:
        name, _, folder = named.partition("=")
        for case in homes(Path(folder), 0):
            yield f"{name}/{case.name}", lambda case=case: against_plan(case, model)
    if rooms is not None:
        sys.path.insert(0, str(rooms))
        scorer = importlib.import_module("score")
        for truth in sorted(rooms.glob("*/*/rooms.json")):
            yield f"rooms/{truth.parent.name}", lambda truth=truth: against_rooms(truth, scorer, model)


def against_plan(case: Any, model: Remembered) -> dict[str, float]:
    """Figures of a map whose plan is known."""
    found = score(case, "", model)
    return {
        "room F1": found.room_f1[1],
        "wall F1, 5 cm": found.wall_f1[0],
        "wall F1, 10 cm": found.wall_f1[1],
        "doors": found.doors,
        "drawn": len(found.door_widths),
        "invented": found.doors_invented,
    }


def against_rooms(truth: Path, scorer: Any, model: Remembered) -> dict[str, float]:
    """Figures of an annotated map; boundaries wider than a door may be drawn or not."""
    drawing = make_drawing(read_map(truth.parent / "map.yaml").grid, truth.parent.name, model)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drawing.json"
        path.write_text(format_json(drawing), encoding="utf-8")
        found = scorer.score(str(truth.parent), str(path), 1.6)
    names = {"f1": "room F1", "doors_true": "doors", "door_hits": "drawn", "door_false": "invented"}
    return {names.get(key, key): found[key] or 0 for key in ("usable", "merged", "split", *names)}


def row(maps: str, rule: str, results: dict[str, dict[str, dict[str, float]]]) -> dict[str, Any]:
    """Means of F1 and sums of counts over a set of maps."""
    found = [entry[rule] for name, entry in results.items() if name.split("/")[0] == maps]
    figures = {
        key: round(float(np.mean([one[key] for one in found])), 3)
        if "F1" in key
        else int(sum(one[key] for one in found))
        for key in found[0]
    }
    return {"maps": maps, "without": rule, **figures}


if __name__ == "__main__":
    main()
