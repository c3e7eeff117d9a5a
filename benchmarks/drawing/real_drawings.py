"""Drawings of real robots' maps, graded by eye without knowing what drew them.

    python benchmarks/drawing/real_drawings.py draw slam_maps/real slam_maps/giraff_real_homes -o out/grading --every 2
    # look at out/grading/sheet_*.png, write out/grading/grades.json: {"1": ["usable", "why"], ...}
    python benchmarks/drawing/real_drawings.py table out/grading

Every tile shows a map next to one drawing of it, in an order drawn by chance; which model drew it stands in key.json.
The rule: `usable` if no seen room is merged or missing, no seen door closed, no room invented in the layer SEEN and
the direction is right within 5 degrees; `useless` if the building can't be recognised; else `partly`.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely
from shapely import Polygon

from slamgym.core.errors import SlamgymError
from slamgym.core.types import ByteArray, FloatArray, GridFrame, OccupancyGrid
from slamgym.drawing import Drawing, load_floor_model, make_drawing
from slamgym.drawing.evidence import filled
from slamgym.drawing.vectorise import known_part
from slamgym.interop import read_map
from slamgym.metrics import unseen_share
from slamgym.viz.canvas import draw_text, fixed_point, frame_pixels, write_picture

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/drawing",)
"""What is measured."""

PANEL = (430, 470)
"""Height and width of a map or a drawing [px]."""
TILES = (3, 2)
"""Rows and columns of a sheet."""
GRADES = ("usable", "partly", "useless")
ROOM_COLOURS = (
    (255, 236, 210),
    (214, 236, 255),
    (221, 246, 221),
    (250, 221, 240),
    (240, 240, 200),
    (225, 225, 250),
)
SEEN_WALL, INFERRED_WALL, DOOR, ECHO = (25, 28, 32), (165, 175, 190), (20, 100, 220), (232, 89, 12)
HIDDEN_ROOM = (225, 227, 230)
"""A room in the layer INFERRED."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    draw = commands.add_parser("draw", help="draw maps and write the sheets")
    draw.add_argument("folders", nargs="+", type=Path, help="ROS maps")
    draw.add_argument("-o", "--output", type=Path, required=True)
    draw.add_argument("--models", default="slam2cad,none", help="as `slamgym cad --model`")
    draw.add_argument("--every", type=int, default=1, help="take every so many maps of each folder")
    draw.add_argument("--skip", type=int, default=0, help="begin with this one")
    draw.add_argument("--seed", type=int, default=0, help="of the order")
    draw.add_argument("--workers", type=int, default=1, help="processes")
    draw.set_defaults(run=draw_sheets)
    table = commands.add_parser("table", help="count the grades")
    table.add_argument("output", type=Path, help="folder with key.json and grades.json")
    table.set_defaults(run=count_grades)
    arguments = parser.parse_args()
    arguments.run(arguments)


def draw_sheets(arguments: argparse.Namespace) -> None:
    """Draw every map by every model and write the tiles in an order drawn by chance."""
    paths = [
        p
        for f in arguments.folders
        for p in sorted(f.glob("*.yaml"))[arguments.skip :: arguments.every]
    ]
    models = arguments.models.split(",")
    with ProcessPoolExecutor(arguments.workers) as pool:
        results = list(pool.map(draw_map, paths, [models] * len(paths)))
    drawn = [one for some in results for one in some]
    order = np.random.default_rng(arguments.seed).permutation(len(drawn)).tolist()
    arguments.output.mkdir(parents=True, exist_ok=True)
    key = {
        str(number): {"map": drawn[k][0], "model": drawn[k][1], **drawn[k][3]}
        for number, k in enumerate(order, 1)
    }
    (arguments.output / "key.json").write_text(json.dumps(key, indent=1) + "\n", encoding="utf-8")
    rows, cols = TILES
    for first in range(0, len(order), rows * cols):
        some = order[first : first + rows * cols]
        tiles = [numbered(drawn[k][2], first + place) for place, k in enumerate(some, 1)]
        tiles += [np.full_like(tiles[0], 255)] * (rows * cols - len(tiles))
        sheet = np.vstack([np.hstack(tiles[r * cols : (r + 1) * cols]) for r in range(rows)])
        write_picture(arguments.output / f"sheet_{first // (rows * cols) + 1:02d}.png", sheet)


def draw_map(
    path: Path, models: Sequence[str]
) -> list[tuple[str, str, ByteArray, dict[str, float]]]:
    """A map by each model: its name, the model's, the tile and figures."""
    drawn = []
    for name in models:
        try:
            drawing = make_drawing(read_map(path).grid, path.stem, load_floor_model(name))
        except SlamgymError as error:
            print(f"{path.stem} by {name}: {error}", flush=True)
            continue
        drawn.append((path.stem, name, tile(drawing), figures(drawing)))
    return drawn


def figures(drawing: Drawing) -> dict[str, float]:
    """Figures that are counted without looking."""
    seen = filled(
        drawing.floor.difference(shapely.union_all(list(drawing.inferred_floor))),
        drawing.grid.frame,
    )
    inferred = sum(float(part.area) for part in drawing.inferred_floor)
    return {
        "never seen, in SEEN": round(unseen_share(seen, drawing.grid.cells != 205), 4),
        "inferred": round(inferred / drawing.area, 3),
        "rooms": len(drawing.rooms),
        "doors": len(drawing.doors),
    }


def tile(drawing: Drawing) -> ByteArray:
    """A map, and its drawing over its echoes."""
    height, width = PANEL
    grid = known_part(drawing.grid)
    min_x, min_y, max_x, max_y = grid.frame.bounds
    cell = max((max_x - min_x) / width, (max_y - min_y) / height)
    frame = GridFrame(cell, min_x, max_y - height * cell, height, width)
    grey = sampled(grid, frame)
    plain = np.repeat(grey[..., None], 3, axis=2)
    page = np.full_like(plain, 255)
    for number, room in enumerate(drawing.rooms):
        fill(
            page,
            room.polygon,
            ROOM_COLOURS[number % len(ROOM_COLOURS)] if room.layer == "SEEN" else HIDDEN_ROOM,
            frame,
        )
    for part in drawing.inferred_floor:
        fill(page, part, HIDDEN_ROOM, frame)
    for wall in drawing.walls:
        fill(page, wall.polygon, SEEN_WALL if wall.layer == "SEEN" else INFERRED_WALL, frame)
    for door in drawing.doors:
        ends = fixed_point(frame_pixels(np.array([door.start, door.end]), frame, 1.0) - 0.5)
        cv2.line(page, ends[0], ends[1], DOOR, 3, cv2.LINE_AA, 4)
    page[grey == 0] = (0.5 * page[grey == 0] + 0.5 * np.array(ECHO)).astype(np.uint8)
    radians = np.radians(drawing.angle_deg)
    arm = np.array([np.cos(radians), -np.sin(radians)]) * 25
    for x, y in (arm, np.array([arm[1], -arm[0]])):
        cv2.line(
            page,
            (35, height - 35),
            (round(35 + x), round(height - 35 + y)),
            (200, 0, 0),
            1,
            cv2.LINE_AA,
        )
    pair = np.hstack([plain, np.full((height, 4, 3), 90, np.uint8), page])
    return np.pad(pair, ((24, 4), (2, 6), (0, 0)), constant_values=190)


def numbered(picture: ByteArray, number: int) -> ByteArray:
    """A tile with its number."""
    result = picture.copy()
    draw_text(result, str(number), 8, 18, 0.6, (0, 0, 0))
    return result


def sampled(grid: OccupancyGrid, frame: GridFrame) -> ByteArray:
    """The map in the pixels of a frame; where several cells share one, the darkest."""
    factor = grid.frame.resolution / frame.resolution
    if factor < 1.0:
        side = max(1, round(1.0 / factor))
        cells = cv2.erode(grid.cells, np.ones((side, side), np.uint8))
    else:
        cells = grid.cells
    matrix = np.array([[factor, 0.0, 0.0], [0.0, factor, 0.0]])
    matrix[:, 2] = 0.5 * factor - 0.5
    size = (frame.width_px, frame.height_px)
    image = cv2.warpAffine(cells, matrix, size, flags=cv2.INTER_NEAREST, borderValue=205)
    return np.asarray(image, dtype=np.uint8)


def fill(page: ByteArray, shape: Polygon, colour: tuple[int, int, int], frame: GridFrame) -> None:
    def to_page(points: FloatArray) -> np.ndarray:
        return fixed_point(frame_pixels(points, frame, 1.0) - 0.5)

    rings = [to_page(shapely.get_coordinates(ring)) for ring in (shape.exterior, *shape.interiors)]
    cv2.fillPoly(page, rings, colour, cv2.LINE_AA, 4)


def count_grades(arguments: argparse.Namespace) -> None:
    """Open the key and count."""
    key = json.loads((arguments.output / "key.json").read_text(encoding="utf-8"))
    grades = json.loads((arguments.output / "grades.json").read_text(encoding="utf-8"))
    columns = (
        "map",
        "model",
        "grade",
        "reason",
        "never seen, in SEEN",
        "inferred",
        "rooms",
        "doors",
    )
    rows: list[dict[str, Any]] = []
    for number, (grade, reason) in grades.items():
        if grade not in GRADES:
            raise SystemExit(
                f"tile {number}: the grade is {grade!r}, not one of {', '.join(GRADES)}"
            )
        rows.append({**key[number], "grade": grade, "reason": reason})
    rows.sort(key=lambda one: (one["map"], one["model"]))
    print_and_save(
        "drawing/real",
        "Drawings of real robots' maps, graded blind",
        [[r[c] for c in columns] for r in rows],
        columns,
        MODULES,
    )
    for model in sorted({one["model"] for one in rows}):
        some = [one for one in rows if one["model"] == model]
        print(model, counts(some))


def counts(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Number of drawings with each grade, and the floor never seen in the layer SEEN."""
    found: dict[str, float] = {
        grade: sum(one["grade"] == grade for one in rows) for grade in GRADES
    }
    shares = [one["never seen, in SEEN"] for one in rows]
    return found | {"never seen, mean": round(float(np.mean(shares)), 4), "most": max(shares)}


if __name__ == "__main__":
    main()
