"""Drawings against true plans: walls, rooms, doors and dimensions of what `slamgym cad` draws, model by model.

    slamgym generate --plans json.tar.gz --plans-filter useful -o out/homes --pairs 20
    python benchmarks/drawing/drawings.py empty=out/homes --last 10 --tb3 tb3_house --models exact,slam2cad,none

Each drawing is laid over its plan by a rigid motion, which can't make up for a wrong size, and its vectors are moved
by the same. The model ``exact`` is given the plan itself: what is lost by the vectors alone. Doors and walls between
rooms are looked up in the plan; a door counts as drawn if the drawing has one there as a vector, and as closed if no
floor is drawn through it (which :mod:`slamgym.metrics.openings` tells).
Maps that no model's drawing lies over its plan are left out and named.
"""

import argparse
import functools
import operator
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import shapely
from shapely import LineString, MultiPolygon
from shapely.geometry.base import BaseGeometry

from slamgym.cad import FloorPlan, read_houseexpo
from slamgym.cad.doors import find_openings
from slamgym.cad.floorplan import floor_share, ring_segments
from slamgym.core.types import FREE, BoolArray, Float32Array, FloatArray, GridFrame, OccupancyGrid
from slamgym.dataset.format import Layout, load_pair, read_manifest
from slamgym.drawing import FloorModel, load_floor_model, make_drawing
from slamgym.drawing.evidence import filled
from slamgym.drawing.openings import Gap, divide
from slamgym.metrics import (
    Dimensions,
    Openings,
    Similarity,
    aligned_error,
    boundary_score,
    compare_openings,
    intersection_over_union,
    measure_dimensions,
    room_score,
)
from slamgym.metrics.layers import DOOR_DEPTH, MapLayers

sys.path.insert(0, str(Path(__file__).parents[1]))
from corners import CornerCounts, count_corners
from realism.same_building import exact_plan, people_of_the_house
from report import print_and_save

MODULES = ("gan/translation", "slamgym/drawing")
"""What is measured."""

EXACT = "exact"
FINE = 2
"""Vectors are measured on cells so many times finer than the map's."""
LIES_OVER = 0.75
"""Intersection over union of a drawing and its plan from which on the alignment counts as found."""
SAME_DOOR = 0.5
"""A drawn door is the true one if their middles lie so near [m]."""
SAME_ROOM = 0.5
"""A drawn room is the true one from this intersection over union on, as in :func:`room_score`."""
STRAIGHT_WITHIN = 0.03
"""Corners of the true outline that stand out less aren't counted [m]."""
RIGHT = 0.05
"""An error of a width up to which it is right [m]."""
FLOOR_COLUMNS = (
    "maps", "model", "number", "wall F1, 5 cm", "wall F1, 10 cm", "room F1, raster", "room F1, vectors",
    "vertices / true", "room width, median cm", "within 5 cm",
    "corner precision", "corner recall", "corner F1", "angle precision", "angle recall", "angle F1", "CPU s",
)  # fmt: skip
OPENING_COLUMNS = (
    "maps", "model", "doors", "drawn", "closed", "invented", "width, median cm", "walls", "walls opened",
)  # fmt: skip
Shape = TypeVar("Shape", bound=BaseGeometry)


@dataclass(frozen=True)
class Case:
    """A map and the true floor, in the same frame but for what the map is displaced."""

    name: str
    grid: OccupancyGrid
    truth: MultiPolygon


@dataclass
class ExactFloor:
    """The plan in place of a model."""

    truth: MultiPolygon

    def __call__(self, grid: OccupancyGrid, angle_deg: float) -> MapLayers:  # noqa: ARG002 - part of the protocol
        """Shares of floor, and the plan's openings as doors."""
        lines = [gap.line.buffer(DOOR_DEPTH, cap_style="flat") for gap in true_gaps(self.truth)]
        return MapLayers.of_floor(
            shares(self.truth, grid.frame), filled(shapely.union_all(lines), grid.frame)
        )


@dataclass(frozen=True)
class Score:
    """Quality of one drawing."""

    overlap: float
    wall_f1: tuple[float, float]
    room_f1: tuple[float, float]
    """F1 score of the rooms of the raster, and of the polygons."""
    vertices: float
    corners: CornerCounts
    doors: int
    """Openings of the plan that part two rooms."""
    door_widths: list[float]
    """Errors of the true doors that are drawn as doors [m]."""
    doors_invented: int
    """Drawn doors that are none."""
    seconds: float
    dimensions: Dimensions = field(repr=False)
    openings: Openings = field(repr=False)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("datasets", nargs="*", help="NAME=FOLDER made by `slamgym generate`")
    parser.add_argument(
        "--last", type=int, default=0, help="so many maps of each dataset; 0 takes all"
    )
    parser.add_argument(
        "--least-seen",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="leave maps out that show less of the floor: robots that were stopped early",
    )
    parser.add_argument(
        "--tb3", type=Path, help="folder of the TurtleBot3 house: cad.json, cad_walls.png, runs/"
    )
    parser.add_argument(
        "--models", default=f"{EXACT},slam2cad,none", help="as `slamgym cad --model`; exact"
    )
    arguments = parser.parse_args()
    sets: dict[str, list[Case]] = {}
    for named in arguments.datasets:
        name, _, folder = named.partition("=")
        maps = homes(Path(folder), arguments.last)
        sets[name] = [case for case in maps if seen_share(case) >= arguments.least_seen]
    if arguments.tb3 is not None:
        sets["TurtleBot3 house"] = list(house(arguments.tb3))
    models = arguments.models.split(",")
    loaded = {name: load_floor_model(name) for name in models if name != EXACT}
    rows: list[dict[str, Any]] = []
    for name, cases in sets.items():
        scores: dict[str, list[Score]] = {model: [] for model in models}
        for case in cases:
            found = {m: score(case, m, loaded.get(m, ExactFloor(case.truth))) for m in models}
            if (
                max(s.overlap for m, s in found.items() if m != EXACT or len(models) == 1)
                < LIES_OVER
            ):
                print(f"{name}: {case.name} left out, no drawing lies over the plan")
                continue
            for model, result in found.items():
                scores[model].append(result)
        rows += [row(name, model, found) for model, found in scores.items() if found]
    title = "against true plans; rigid alignment"
    print_and_save(
        "drawing/floor",
        f"Drawn floors {title}",
        [[r[c] for c in FLOOR_COLUMNS] for r in rows],
        FLOOR_COLUMNS,
        MODULES,
        times=("CPU s",),
    )
    print_and_save(
        "drawing/openings",
        f"Drawn doors and walls {title}",
        [[r[c] for c in OPENING_COLUMNS] for r in rows],
        OPENING_COLUMNS,
        MODULES,
    )


def seen_share(case: Case) -> float:
    """Share of the true floor that is free in the map, by area."""
    free = np.count_nonzero(case.grid.cells == FREE) * case.grid.frame.resolution**2
    return float(free / case.truth.area)


def homes(folder: Path, last: int) -> Iterator[Case]:
    """The maps of a dataset, in the frame of their images."""
    for record in list(read_manifest(folder))[-last:]:
        _, slam = load_pair(folder, record.name)
        plan = read_houseexpo(Layout(folder).episode(record.name) / "plan.json")
        truth = shapely.affinity.translate(plan.free_space, -record.start[0], -record.start[1])
        grid = OccupancyGrid(slam, GridFrame(record.resolution, *record.origin, *record.shape))
        yield Case(record.name, grid, MultiPolygon([truth]))


def house(folder: Path) -> Iterator[Case]:
    """People's maps of the TurtleBot3 house, each in the middle of an image as its plan is."""
    plan: FloorPlan = exact_plan(folder / "cad_walls.png", folder / "cad.json", furniture=False)
    pairs = people_of_the_house(folder)
    min_x, min_y, max_x, max_y = plan.bounds
    for i, name in enumerate(pairs.names):
        side, cell = len(pairs.slam[i]), pairs.scale(i)
        origin = (0.5 * (min_x + max_x - side * cell), 0.5 * (min_y + max_y - side * cell))
        grid = OccupancyGrid(pairs.slam[i], GridFrame(cell, *origin, side, side))
        yield Case(name, grid, MultiPolygon([plan.free_space]))


def score(case: Case, name: str, model: FloorModel) -> Score:
    """Draw a map and measure its drawing."""
    begun = time.process_time()
    drawing = make_drawing(case.grid, case.name, model)
    seconds = time.process_time() - begun
    coarse, frame = case.grid.frame, fine_frame(case)
    true_floor = shares(case.truth, frame)
    motion = Similarity(0.0, 0.0, 0.0, 0.0)
    if name != EXACT:
        motion = motion_onto(true_floor, shares(drawing.floor, frame))
    floor = shares(moved(drawing.floor, frame, motion), frame)
    inside, truth = floor >= 0.5, true_floor >= 0.5
    true_rooms = divide(case.truth, true_gaps(case.truth))
    rooms = [moved(room.polygon, frame, motion) for room in drawing.rooms]
    doors = [moved(LineString([door.start, door.end]), frame, motion) for door in drawing.doors]
    widths, invented = compare_doors(doors, [door.line for door in true_rooms.doors])
    return Score(
        overlap=intersection_over_union(inside, truth),
        wall_f1=tuple(boundary_score(inside, truth, frame.resolution, t).f1 for t in (0.05, 0.1)),  # type: ignore[arg-type]
        room_f1=(
            room_score(inside[::FINE, ::FINE], truth[::FINE, ::FINE], coarse.resolution).f1,
            polygons_f1(rooms, true_rooms.rooms),
        ),
        vertices=vertices(drawing.floor) / vertices(case.truth.simplify(STRAIGHT_WITHIN)),
        corners=count_corners(rooms, true_rooms.rooms, STRAIGHT_WITHIN),
        doors=len(true_rooms.doors),
        door_widths=widths,
        doors_invented=invented,
        seconds=seconds,
        dimensions=measure_dimensions(floor, true_floor, frame.resolution),
        openings=compare_openings(floor, true_floor, frame.resolution),
    )


def true_gaps(truth: MultiPolygon) -> list[Gap]:
    """The openings of a plan."""
    return [Gap(door.start, door.end) for part in truth.geoms for door in find_openings(part)]


def fine_frame(case: Case) -> GridFrame:
    """The map's frame with cells so small that vectors can be measured on them."""
    frame, cell = case.grid.frame, case.grid.frame.resolution / FINE
    return GridFrame(
        cell, frame.origin_x, frame.origin_y, frame.height_px * FINE, frame.width_px * FINE
    )


def motion_onto(true_floor: Float32Array, floor: Float32Array) -> Similarity:
    """The rigid motion that lays a drawn floor over the true one, both as shares of cells."""
    masks = [(share >= 0.5).astype(np.float64) for share in (floor, true_floor)]
    return aligned_error(masks[0], masks[1], scaling=False).similarity


def shares(floor: BaseGeometry, frame: GridFrame) -> Float32Array:
    """Share of floor of each cell."""
    parts = [part for part in shapely.get_parts(floor) if part.geom_type == "Polygon"]
    return floor_share(
        ring_segments(ring for p in parts for ring in (p.exterior, *p.interiors)), frame
    )


def moved(shape: Shape, frame: GridFrame, motion: Similarity) -> Shape:
    """A shape [m] after a motion that was found on images of a frame."""
    matrix = motion.matrix(*frame.shape)

    def move(points: FloatArray) -> FloatArray:
        cols = (points[:, 0] - frame.origin_x) / frame.resolution - 0.5
        rows = frame.height_px - 0.5 - (points[:, 1] - frame.origin_y) / frame.resolution
        x, y = matrix @ np.stack([cols, rows, np.ones(len(points))])
        return np.column_stack(
            [
                frame.origin_x + (x + 0.5) * frame.resolution,
                frame.origin_y + (frame.height_px - 0.5 - y) * frame.resolution,
            ]
        )

    return shapely.transform(shape, move)


def vertices(floor: BaseGeometry) -> int:
    """Vertices of all outlines."""
    rings = [ring for p in shapely.get_parts(floor) for ring in (p.exterior, *p.interiors)]
    return sum(len(ring.coords) - 1 for ring in rings)


def polygons_f1(rooms: Sequence[BaseGeometry], true_rooms: Sequence[BaseGeometry]) -> float:
    """F1 score of rooms that have a counterpart."""
    shared = [(a.intersection(b).area, a.area + b.area) for a in rooms for b in true_rooms]
    matched = sum(both > SAME_ROOM * (total - both) for both, total in shared)
    count = len(rooms) + len(true_rooms)
    return 2.0 * matched / count if count else 1.0


def compare_doors(
    drawn: Sequence[BaseGeometry], true_doors: Sequence[BaseGeometry]
) -> tuple[list[float], int]:
    """Errors of the widths of true doors that are drawn [m], and how many drawn doors are none."""
    left, errors = list(drawn), []
    for door in true_doors:
        nearest = min(left, key=door.centroid.distance, default=None)
        if nearest is not None and nearest.centroid.distance(door.centroid) < SAME_DOOR:
            left.remove(nearest)
            errors.append(nearest.length - door.length)
    return errors, len(left)


def row(name: str, model: str, scores: Sequence[Score]) -> dict[str, Any]:
    """One set drawn by one model."""
    widths = np.concatenate([s.dimensions.room_width for s in scores])
    door_widths = np.concatenate([s.door_widths for s in scores])
    corners = functools.reduce(operator.add, [s.corners for s in scores])
    return {
        "maps": name,
        "model": model,
        "number": len(scores),
        "wall F1, 5 cm": mean([s.wall_f1[0] for s in scores]),
        "wall F1, 10 cm": mean([s.wall_f1[1] for s in scores]),
        "room F1, raster": mean([s.room_f1[0] for s in scores]),
        "room F1, vectors": mean([s.room_f1[1] for s in scores]),
        "vertices / true": mean([s.vertices for s in scores]),
        "room width, median cm": centimetres(widths),
        "within 5 cm": mean(np.abs(widths) <= RIGHT),
        **corners.figures(),
        "CPU s": mean([s.seconds for s in scores]),
        "doors": sum(s.doors for s in scores),
        "closed": sum(s.openings.doors_closed for s in scores),
        "drawn": len(door_widths),
        "invented": sum(s.doors_invented for s in scores),
        "width, median cm": centimetres(door_widths),
        "walls": sum(s.openings.walls for s in scores),
        "walls opened": sum(s.openings.walls_opened for s in scores),
    }


def mean(values: Sequence[float] | BoolArray) -> float:
    """Rounded."""
    return round(float(np.mean(values)), 3)


def centimetres(errors: FloatArray) -> float:
    """Median [cm]."""
    return round(100.0 * float(np.median(errors)), 1) if len(errors) else float("nan")


if __name__ == "__main__":
    main()
