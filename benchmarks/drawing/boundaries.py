"""Fit what makes a line across the floor a boundary between two rooms, the constants of slamgym.drawing.boundaries.

    slamgym generate --plans json.tar.gz --plans-filter useful -o out/homes --pairs 40
    python benchmarks/drawing/boundaries.py real_rooms --datasets out/homes --held-out MAP,MAP --groups uos,EX

The folder holds annotated maps, ``*/*/rooms.json`` and ``map.yaml``. A logistic function of the signs of all candidates
is fitted to real and simulated maps together. Cross-validation leaves one building out at a time, with all maps whose
name begins with the same prefix; maps held out take no part in any fit. Both constants are printed.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import average_precision_score, log_loss
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from slamgym.cad import read_houseexpo
from slamgym.cad.doors import find_openings
from slamgym.core.types import BoolArray, FloatArray, GridFrame, OccupancyGrid
from slamgym.dataset.format import Layout, read_manifest
from slamgym.drawing import FloorModel, load_floor_model
from slamgym.drawing.boundaries import WIDEST, boundary_log_odds, candidates, cross
from slamgym.drawing.floor import seen_floor
from slamgym.drawing.vectorise import known_part
from slamgym.interop import read_map
from slamgym.metrics.wall_direction import find_wall_direction

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/drawing",)
"""What is measured."""

MOST_ERROR, LEAST_COVERAGE = 0.3, 0.6
"""Explorations with a larger trajectory error [m], or that saw less, are left out."""
REGULARISATION = 0.1
"""Inverse strength, of standardised signs."""
SIMULATED_WEIGHT = 0.2
"""A candidate of a simulated map, against one of a real map."""
COLUMNS = (
    "maps",
    "fitted to",
    "number",
    "candidates",
    "boundaries",
    "found",
    "average precision",
    "log loss",
)


@dataclass(frozen=True)
class Truth:
    """Boundaries of a map, (N, 2, 2) [m]."""

    certain: FloatArray
    ambiguous: FloatArray
    """A drawing may have them or not."""


@dataclass(frozen=True)
class Example:
    """The candidates of a map that are boundaries, or surely none."""

    name: str
    signs: FloatArray
    is_boundary: BoolArray
    found: int
    """True boundaries that are among the candidates."""
    boundaries: int


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rooms", type=Path, help="folder of annotated maps")
    parser.add_argument(
        "--datasets", nargs="*", type=Path, default=[], help="folders made by `slamgym generate`"
    )
    parser.add_argument("--model", default="slam2cad", help="as `slamgym cad --model`")
    parser.add_argument(
        "--held-out", default="", metavar="NAMES", help="real maps that nothing is fitted to"
    )
    parser.add_argument(
        "--groups",
        default="",
        metavar="PREFIXES",
        help="maps whose names begin so show one building",
    )
    arguments = parser.parse_args()
    model = load_floor_model(arguments.model)
    held_out = set(filter(None, arguments.held_out.split(",")))
    prefixes = tuple(filter(None, arguments.groups.split(",")))
    real = [example for case in real_maps(arguments.rooms) for example in examples(*case, model)]
    if missing := held_out - {one.name for one in real}:
        parser.error(f"--held-out: no map is called {', '.join(sorted(missing))}")
    simulated = [
        example
        for folder in arguments.datasets
        for case in explorations(folder)
        for example in examples(*case, model)
    ]
    kept = [one for one in real if one.name not in held_out]
    constant, weights = fit(kept, simulated)
    apart = [one for one in real if one.name in held_out]
    rows = [
        row("real", "other buildings", kept, left_out_log_odds(kept, simulated, prefixes)),
        row(
            "held out", "real, simulated", apart, [constant + one.signs @ weights for one in apart]
        ),
        row(
            "simulated",
            "real, simulated",
            simulated,
            [constant + one.signs @ weights for one in simulated],
        ),
        row("real", "as in the package", real, [boundary_log_odds(one.signs) for one in real]),
    ]
    table = [[one[column] for column in COLUMNS] for one in rows if one["number"]]
    print_and_save(
        "drawing/boundaries", "Log odds of boundaries between rooms", table, COLUMNS, MODULES
    )
    print(f"BOUNDARY_CONSTANT = {constant:.2f}")
    print(f"BOUNDARY_WEIGHTS = np.array([{', '.join(f'{weight:.2f}' for weight in weights)}])")


def real_maps(folder: Path) -> Iterator[tuple[str, OccupancyGrid, Truth]]:
    """Annotated maps and their boundaries."""
    for path in sorted(folder.glob("*/*/rooms.json")):
        grid = read_map(path.parent / "map.yaml").grid
        doors = json.loads(path.read_text(encoding="utf-8"))["doors"]
        lines = np.array([in_metres([door["a"], door["b"]], grid.frame) for door in doors]).reshape(
            -1, 2, 2
        )
        sure = np.array(
            [door["kind"] != "ambiguous" and door["width_m"] <= WIDEST for door in doors], bool
        )
        yield path.parent.name, grid, Truth(lines[sure], lines[~sure])


def in_metres(pixels: Sequence[Sequence[float]], frame: GridFrame) -> FloatArray:
    """Columns and rows of the middles of pixels, from the top left, as places [m]."""
    cols, rows = np.asarray(pixels, np.float64).T
    x = frame.origin_x + (cols + 0.5) * frame.resolution
    y = frame.origin_y + (frame.height_px - 0.5 - rows) * frame.resolution
    return np.column_stack([x, y])


def explorations(folder: Path) -> Iterator[tuple[str, OccupancyGrid, Truth]]:
    """Simulated maps and the openings of their plans; where the plan names doors, others are ambiguous."""
    for record in read_manifest(folder):
        if record.ate > MOST_ERROR or record.coverage < LEAST_COVERAGE:
            continue
        episode = Layout(folder).episode(record.name)
        plan = read_houseexpo(episode / "plan.json")
        named, openings = (
            np.array([(door.start, door.end) for door in doors]).reshape(-1, 2, 2)
            - record.start[:2]
            for doors in (plan.doors, find_openings(plan.free_space))
        )
        truth = Truth(named, openings) if len(named) else Truth(openings, named)
        yield record.name, read_map(episode / "map.yaml").grid, truth


def examples(name: str, grid: OccupancyGrid, truth: Truth, model: FloorModel) -> Iterator[Example]:
    """The candidates of a map as the drawing finds them; nothing if it has none."""
    grid = known_part(grid)
    angle = find_wall_direction(grid.cells).angle_deg
    layers = model(grid, angle)
    seen, floor = seen_floor(grid, angle)
    if floor.is_empty:
        return
    lines, signs = candidates(floor, seen, layers, grid.frame)
    if not len(lines):
        return
    matched, close = compared(lines, truth.certain)
    is_boundary = np.any(matched, axis=1)
    beside = np.any(np.hstack([close, compared(lines, truth.ambiguous)[1]]), axis=1) & ~is_boundary
    found = int(np.any(matched, axis=0).sum())
    yield Example(name, signs[~beside], is_boundary[~beside], found, len(truth.certain))


def compared(lines: FloatArray, true_lines: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Which lines are which true ones, and which lie near them, both (N, M)."""
    (along, width), (true_along, true_width) = (directions(some) for some in (lines, true_lines))
    offset = lines.mean(axis=1)[:, None] - true_lines.mean(axis=1)[None]
    is_same = np.abs((offset * true_along).sum(axis=2)) <= np.maximum(0.2, 0.2 * true_width)
    is_same &= np.abs(cross(offset, true_along[None])) <= 0.3
    is_same &= np.abs(along @ true_along.T) > 0.9
    is_same &= np.abs(width[:, None] - true_width) < np.maximum(0.25, 0.3 * true_width)
    return is_same, np.hypot(*np.moveaxis(offset, 2, 0)) < np.maximum(0.5, 0.6 * true_width)


def directions(lines: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (N, 2) and lengths (N,) of lines."""
    along = lines[:, 1] - lines[:, 0]
    width = np.maximum(np.hypot(*along.T), 1e-9)
    return along / width[:, None], width


def fit(real: Sequence[Example], simulated: Sequence[Example]) -> tuple[float, FloatArray]:
    """Constant and weights of the log odds."""
    both = [*real, *simulated]
    sizes = [len(one.is_boundary) for one in both]
    importance = np.repeat([1.0] * len(real) + [SIMULATED_WEIGHT] * len(simulated), sizes)
    model = make_pipeline(StandardScaler(), LogisticRegression(C=REGULARISATION, max_iter=500))
    signs = np.concatenate([one.signs for one in both])
    is_boundary = np.concatenate([one.is_boundary for one in both])
    model.fit(signs, is_boundary, logisticregression__sample_weight=importance)
    scaler, logistic = model[0], model[1]
    weights = logistic.coef_[0] / scaler.scale_
    return float(logistic.intercept_[0] - weights @ scaler.mean_), weights


def left_out_log_odds(
    real: Sequence[Example], simulated: Sequence[Example], prefixes: tuple[str, ...]
) -> list[FloatArray]:
    """Log odds of the candidates of each map by what was fitted without its building."""
    buildings = [next((p for p in prefixes if one.name.startswith(p)), one.name) for one in real]
    fits = {
        building: fit(
            [one for one, b in zip(real, buildings, strict=True) if b != building], simulated
        )
        for building in set(buildings)
    }
    return [fits[b][0] + one.signs @ fits[b][1] for one, b in zip(real, buildings, strict=True)]


def row(
    maps: str, fitted_to: str, some: Sequence[Example], log_odds: Sequence[FloatArray]
) -> dict[str, Any]:
    """Figures of a set of maps."""
    if not some:
        return {"number": 0}
    is_boundary = np.concatenate([one.is_boundary for one in some])
    probability = 1.0 / (1.0 + np.exp(-np.concatenate(log_odds)))
    return {
        "maps": maps,
        "fitted to": fitted_to,
        "number": len(some),
        "candidates": len(is_boundary),
        "boundaries": sum(one.boundaries for one in some),
        "found": sum(one.found for one in some),
        "average precision": round(float(average_precision_score(is_boundary, probability)), 3),
        "log loss": round(float(log_loss(is_boundary, probability)), 4),
    }


if __name__ == "__main__":
    main()
