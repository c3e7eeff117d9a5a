"""Maps of the TurtleBot3 house: people's, and ours of the very same house with the recipe ``paper360``.

    python benchmarks/realism/same_building.py FOLDER --maps 40

FOLDER holds the exact drawing of the house (``cad.json``: polygons of walls and furniture; and the same as a
picture, ``cad_walls_furniture.png``) and ``runs/NAME/slam.yaml``, a map each. All maps are registered to the
drawing, measured, and handed to a classifier that has to tell ours from people's, one of their maps left out at
a time. People's front door is open, and three of ten drove out between the wings: so do ours in three houses of ten;
in the others the door is shut.

Not all of people's maps are GMapping's, whose canvas grows by patches of 32 cells. Of the ten, four have such a
canvas; four have Cartographer's, with 5 cells of margin, grey cells along the walls and hardly a fragment; in two
the canvas ends at the walls, as Karto's does. ``--gmapping`` compares with GMapping's alone.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely
from scipy.optimize import minimize
from shapely.geometry.base import BaseGeometry

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, read_image_plan
from slamgym.cad.floorplan import floor_share
from slamgym.core.files import read_bytes
from slamgym.core.pictures import decode_picture, grey_picture
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    FloatArray,
    GridFrame,
    IntArray,
)
from slamgym.dataset.generate.recipe import apply_conditions, open_recipe
from slamgym.envs import EpisodeConfig, run_episode
from slamgym.gan.data import PairSet
from slamgym.interop.ros_map import read_ros_map
from slamgym.metrics import wall_faces
from slamgym.metrics.map_statistics import look_statistics
from slamgym.metrics.maps import distance_to

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/sim", "slamgym/slam")
"""What is measured."""

RESOLUTION = 0.05
PERMUTATIONS = 50
GMAPPING_PATCH = 32
ROUND = ((4.0, 11.29, 0.25), (10.45, 8.27, 0.25))
LEGS = ((12.5, 9.83), (14.3, 9.85), (12.5, 8.51), (14.3, 8.53))
LEG = (0.12, 0.08)
"""Two bins and a table's legs that the drawing omits, as people's maps show them: x, y, and radius [m]; x and
y of the legs, and their sides [m], which are 3.9 x 2.9 cells in the mean of eight maps; two have no table."""
NO_TABLE = 5
"""Every so many-th of our houses has no table either."""
YARD = (1.02, 0.525, 13.5, 6.4)
"""The ground before the open front door: left, bottom, right and top [m]."""
POST = (9.42, 5.78, 9.54, 5.86)
"""Object that stands on it, as people's maps show it."""
YARD_END = 0.925
"""Our maps end here [m], at the end of the wings as people's do, and short of the yard's fence."""
OPEN_HOUSES = (1, 4, 8)
"""Which of ten of our houses have the door open."""
HOUSES = 10
_NEAR_WALL = 0.6  # [m] occupied cells farther from every CAD wall are stray, not displaced
_LAGS = (0.25, 1.0, 2.5)  # [m] of the spatial correlation of wall displacements
_DISPLACEMENTS = (
    "displacement_p50_m", "displacement_p90_m", "displacement_p95_m", "stray_share", "missed_share",
    *(f"displacement_correlation_{lag:g}m" for lag in _LAGS),
)  # fmt: skip
SHOWN = (
    "open_border",
    "fragments_per_100m2",
    "blobs_per_100m2",
    "share_unknown",
    "share_occupied",
    "median_blob_px",
    "wall_thickness_px",
    "run_1",
    "run_2",
    "run_3",
    "run_4_to_6",
    "displacement_p50_m",
    "displacement_p90_m",
    "missed_share",
)
COLUMNS = ("statistic", "people", "low", "high", "ours", "inside")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--maps", type=int, default=10, help="explorations of our own")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument(
        "--leave-out", type=int, default=0, help="so many of people's maps, the last by name"
    )
    parser.add_argument(
        "--keep",
        type=Path,
        help="folder for the pictures of our maps; those there are not made anew",
    )
    parser.add_argument(
        "--gmapping", action="store_true", help="only those of people's maps that GMapping made"
    )
    arguments = parser.parse_args()
    picture = arguments.folder / "cad_walls_furniture.png"
    solid = read_grey(picture) == 0
    runs = sorted((arguments.folder / "runs").glob("*/slam.yaml"))
    maps = [read_ros_map(path).cells for path in runs[: len(runs) - arguments.leave_out]]
    if arguments.gmapping:
        maps = [
            cells
            for cells in maps
            if cells.shape[0] % GMAPPING_PATCH == cells.shape[1] % GMAPPING_PATCH == 0
        ]
    people = [statistics(cells, solid) for cells in maps]
    drawing = arguments.folder / "cad.json"
    plans = [
        exact_plan(picture, drawing, k % NO_TABLE > 0, k in OPEN_HOUSES) for k in range(HOUSES)
    ]
    seeds = range(arguments.seed, arguments.seed + arguments.maps)
    ours = [
        statistics(our_map(plans[seed % HOUSES], seed, arguments.keep), solid) for seed in seeds
    ]
    rows = [compare(name, people, ours) for name in SHOWN]
    accuracy, chance = balanced_accuracy(people, ours)
    low, high = np.percentile(chance, (2.5, 97.5))
    rows.append(
        {
            "statistic": "balanced accuracy (people: chance)",
            "people": round(float(np.median(chance)), 2),
            "low": round(low, 2),
            "high": round(high, 2),
            "ours": round(accuracy, 2),
            "inside": accuracy <= high,
        }
    )
    name = "realism/same_building" + ("_gmapping" if arguments.gmapping else "")
    print_and_save(
        name, f"{len(people)} people's maps, {len(ours)} of ours", rows, COLUMNS, MODULES
    )


def read_grey(path: Path) -> ByteArray:
    """A picture in grey."""
    return grey_picture(decode_picture(path, read_bytes(path)))[0]


def exact_plan(
    picture: Path,
    drawing: Path,
    has_table: bool = True,
    is_open: bool = False,
    furniture: bool = True,
) -> FloorPlan:
    """The house's floor with the exact walls in the picture's frame; open, with the yard; furnished if wanted."""
    rough = read_image_plan(picture, RESOLUTION)
    shapes = json.loads(drawing.read_text())
    drawn = [*shapes["walls"], *(shapes["furniture"] if furniture else [])]
    solid = shapely.union_all([shapely.Polygon(points) for points in drawn])
    # The picture draws every cell that a wall touches, with the same margin on all sides.
    height, width = read_grey(picture).shape
    left, bottom, right, top = solid.bounds
    shift = (0.5 * (width * RESOLUTION - left - right), 0.5 * (height * RESOLUTION - bottom - top))
    bins = [shapely.Point(x, y).buffer(radius, quad_segs=6) for x, y, radius in ROUND]
    across, along = 0.5 * LEG[0], 0.5 * LEG[1]
    legs = [shapely.box(x - across, y - along, x + across, y + along) for x, y in LEGS]
    things = [*bins, *(legs if has_table else [])] if furniture else []
    solid = shapely.union_all([shapely.affinity.translate(solid, *shift), *things])
    floor: BaseGeometry = rough.free_space.buffer(1.5 * RESOLUTION, join_style="mitre")
    if is_open:
        floor = floor.union(shapely.box(*YARD)).difference(shapely.box(*POST))
    parts = shapely.get_parts(floor.difference(solid))
    return FloorPlan(rough.id, max(parts, key=lambda part: float(part.area)), source=str(drawing))


def people_of_the_house(folder: Path) -> PairSet:
    """People's maps of the TurtleBot3 house, each in the middle of an image as its plan is."""
    plan = exact_plan(folder / "cad_walls.png", folder / "cad.json", furniture=False)
    runs = [
        (path.parent.name, read_ros_map(path))
        for path in sorted((folder / "runs").glob("*/slam.yaml"))
    ]
    maps = [
        (name, known_part(grid.cells))
        for name, grid in runs
        if abs(grid.frame.resolution - RESOLUTION) < 1e-6
    ]
    min_x, min_y, max_x, max_y = plan.bounds
    longest = max(max_x - min_x, max_y - min_y) / RESOLUTION
    side = 32 * -(-round(1.1 * max(longest, *(max(cells.shape) for _, cells in maps))) // 32)
    origin = (0.5 * (min_x + max_x - side * RESOLUTION), 0.5 * (min_y + max_y - side * RESOLUTION))
    cad = np.rint(
        FREE * floor_share(plan.segments(), GridFrame(RESOLUTION, *origin, side, side))
    ).astype(np.uint8)
    names = tuple(name for name, _ in maps)
    slam = np.stack([in_the_middle(cells, side) for _, cells in maps])
    return PairSet(np.stack([cad] * len(maps)), slam, names, names, np.full(len(maps), RESOLUTION))


def known_part(cells: ByteArray) -> ByteArray:
    """A map cut to what isn't unknown."""
    rows, cols = np.nonzero(cells != UNKNOWN)
    return cells[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]


def in_the_middle(cells: ByteArray, side: int) -> ByteArray:
    """A map in the middle of a square of unknown cells."""
    square = np.full((side, side), UNKNOWN, np.uint8)
    row, col = ((side - length) // 2 for length in cells.shape)
    square[row : row + cells.shape[0], col : col + cells.shape[1]] = cells
    return square


def our_map(plan: FloorPlan, seed: int, keep: Path | None) -> ByteArray:
    """Our map of the house, kept as a picture if a folder is given."""
    file = keep / f"{seed:02d}.png" if keep else None
    if file and file.exists():
        return read_grey(file)
    config = apply_conditions(EpisodeConfig(), open_recipe("paper360").draw(seed))
    episode = run_episode(plan, seed, config, make_explorer)
    end = YARD_END - episode.start.y - episode.slam_map.frame.origin_y
    cells = episode.slam_map.cells[: -max(round(end / RESOLUTION), 1)]  # row 0 at the top
    if file:
        file.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(file), cells)
    return cells


def statistics(cells: ByteArray, solid: BoolArray) -> dict[str, float]:
    """Statistics of a map, cut to its largest free part, and of where its walls lie.

    Args:
        cells: The map.
        solid: The drawing's walls and furniture.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        (cells == FREE).astype(np.uint8), connectivity=4
    )
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    rows, cols = np.nonzero(labels == largest)
    pad = 4  # the walls round it
    cut = cells[
        max(rows.min() - pad, 0) : rows.max() + pad, max(cols.min() - pad, 0) : cols.max() + pad
    ]
    area = (cut == FREE).sum() * RESOLUTION**2 / 100.0
    _, _, blobs, _ = cv2.connectedComponentsWithStats(
        (cut == OCCUPIED).astype(np.uint8), connectivity=8
    )
    found = look_statistics(cut)
    found["fragments_per_100m2"] = (count - 2) / area
    found["median_blob_px"] = float(np.median(blobs[1:, cv2.CC_STAT_AREA]))
    placed = register(cut, solid)
    return found | displacement_statistics(placed, solid, RESOLUTION, np.random.default_rng(0))


def displacement_statistics(
    cells: ByteArray, cad_occupied: BoolArray, resolution: float, rng: np.random.Generator
) -> dict[str, float]:
    """Statistics of where the walls of a map lie against those of the CAD map.

    Args:
        cells: (H, W) the map.
        cad_occupied: (H, W) cells that are not free in the CAD map, on the same frame.
        resolution: [m/px].
        rng: Picks pairs of wall cells for the spatial correlation.

    Returns:
        Quantiles of the distance [m] from a map's wall cell to the nearest face of a CAD wall, its share of
        stray cells, the share of the CAD faces that the map misses, and the correlation of the signed
        distance (positive outside the free space) at some lags.
    """
    faces = wall_faces(~cad_occupied)
    to_face = distance_to(faces) * resolution
    signed = np.where(cad_occupied, to_face, -to_face)
    rows, cols = np.nonzero(cells == OCCUPIED)
    if len(rows) < 10 or not faces.any():
        return dict.fromkeys(_DISPLACEMENTS, 0.0)
    away = to_face[rows, cols]
    near = away < _NEAR_WALL
    to_map = distance_to(cells == OCCUPIED) * resolution
    values = np.percentile(away[near], (50, 90, 95)).tolist() if near.any() else [0.0] * 3
    values += [float((~near).mean()), float((to_map[faces] > 0.3).mean())]
    values += _correlations(rows[near], cols[near], signed, resolution, rng)
    return dict(zip(_DISPLACEMENTS, values, strict=True))


def _correlations(
    rows: IntArray, cols: IntArray, signed: FloatArray, resolution: float, rng: np.random.Generator
) -> list[float]:
    """Correlation of the signed displacement of pairs of wall cells at each lag."""
    values = signed[rows, cols]
    points = resolution * np.column_stack([rows, cols])
    pairs = rng.integers(0, len(rows), (20_000, 2))
    gap = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    correlations = []
    for lag in _LAGS:
        a, b = pairs[np.abs(gap - lag) < 0.3 * lag].T
        spread = values[a].std() * values[b].std() if len(a) > 20 else 0.0
        covariance = (
            ((values[a] - values.mean()) * (values[b] - values.mean())).mean() if len(a) else 0.0
        )
        correlations.append(float(covariance / spread) if spread > 0.0 else 0.0)
    return correlations


def register(cells: ByteArray, solid: BoolArray) -> ByteArray:
    """The map, moved onto the drawing: the rigid motion that brings its walls nearest to the drawing's faces."""
    away = np.minimum(distance_to(wall_faces(~solid)), 10.0).astype(np.float32)
    points = np.argwhere(cells == OCCUPIED)[:, ::-1].astype(np.float64)
    middle = points.mean(axis=0)
    target = np.argwhere(solid)[:, ::-1].mean(axis=0)

    def moved(motion: FloatArray) -> FloatArray:
        cos, sin = np.cos(motion[2]), np.sin(motion[2])
        result: FloatArray = (
            (points - middle) @ np.array([[cos, sin], [-sin, cos]]) + target + motion[:2]
        )
        return result

    def cost(motion: FloatArray) -> float:
        at = moved(motion).astype(np.float32)
        return float(cv2.remap(away, at[None], None, cv2.INTER_LINEAR, borderValue=10.0).mean())

    starts = [(x, y, np.radians(a)) for x in (-8, 0, 8) for y in (-8, 0, 8) for a in (-3, 0, 3)]
    best = sorted(starts, key=lambda start: cost(np.array(start)))[:4]
    steps = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 0.03]])
    found = min(
        (
            minimize(cost, s, method="Nelder-Mead", options={"initial_simplex": steps + s})
            for s in best
        ),
        key=lambda result: float(result.fun),
    ).x
    cos, sin = np.cos(found[2]), np.sin(found[2])
    turn = np.array([[cos, -sin], [sin, cos]])
    matrix = np.column_stack([turn, target + found[:2] - turn @ middle])
    size = (solid.shape[1], solid.shape[0])
    placed: ByteArray = cv2.warpAffine(
        cells, matrix, size, flags=cv2.INTER_NEAREST, borderValue=UNKNOWN
    )
    return placed


def compare(
    name: str, people: list[dict[str, float]], ours: list[dict[str, float]]
) -> dict[str, Any]:
    """Medians, and the bootstrap interval of the median of people's maps."""
    values = np.array([row[name] for row in people])
    draws = np.random.default_rng(0).choice(values, (2000, len(values)))
    low, high = np.percentile(np.median(draws, axis=1), (2.5, 97.5))
    median = float(np.median([row[name] for row in ours]))
    return {
        "statistic": name,
        "people": round(float(np.median(values)), 3),
        "low": round(low, 3),
        "high": round(high, 3),
        "ours": round(median, 3),
        "inside": bool(low <= median <= high),
    }


def balanced_accuracy(
    people: list[dict[str, float]], ours: list[dict[str, float]]
) -> tuple[float, FloatArray]:
    """Trees that tell ours from people's, one of theirs left out at a time; and the same with shuffled labels."""
    names = list(people[0])
    X = np.array([[row[name] for name in names] for row in [*people, *ours]])
    labels = np.arange(len(X)) < len(people)
    rng = np.random.default_rng(0)
    shuffled = [accuracy_of(X, rng.permutation(labels)) for _ in range(PERMUTATIONS)]
    return accuracy_of(X, labels), np.array(shuffled)


def accuracy_of(X: FloatArray, labels: BoolArray) -> float:
    """Mean of both kinds' shares that are told rightly; each fold omits one map of the first kind."""
    from sklearn.ensemble import ExtraTreesClassifier

    fold = np.empty(len(X), dtype=int)
    fold[labels] = np.arange(labels.sum())
    fold[~labels] = np.arange((~labels).sum()) % labels.sum()
    right = np.zeros(len(X))
    for k in range(int(labels.sum())):
        model = ExtraTreesClassifier(
            100, min_samples_leaf=2, class_weight="balanced", random_state=0
        )
        model.fit(X[fold != k], labels[fold != k])
        right[fold == k] = model.predict(X[fold == k]) == labels[fold == k]
    return float(0.5 * (right[labels].mean() + right[~labels].mean()))


if __name__ == "__main__":
    main()
