"""Calibration of the confidence of drawn walls, and where its coefficients come from.

    python benchmarks/drawing/wall_confidence.py --fit out/empty out/furnished --try empty=out/fresh furnished=out/other

A wall is true if half of a face of it lies within 20 cm of the true outline, after the rigid motion that lays the
drawing over its plan. The coefficients of `slamgym.drawing.confidence` are fitted on the first datasets, made by
`slamgym generate`, and the table shows the second, of other plans, by the coefficients that the package has.
"""

import argparse
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from drawings import LIES_OVER, fine_frame, homes, motion_onto, moved, seen_share, shares
from scipy.optimize import minimize
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from slamgym.core.types import BoolArray, FloatArray
from slamgym.drawing import DrawnWall, load_floor_model, make_drawing
from slamgym.drawing.confidence import confidences, wall_signs
from slamgym.drawing.evidence import Evidence
from slamgym.drawing.walls import WallPiece
from slamgym.metrics import intersection_over_union

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/drawing",)
"""What is measured."""

TRUE_WITHIN, STEP = 0.2, 0.05
"""Largest distance to a true wall, and the distance between the places that are looked at [m]."""
LIMITS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
PENALTY = 1e-4
"""Penalty on the squared coefficients."""
COLUMNS = ("maps", "walls", "said", "true", "Brier score", "of a constant")
BIN_COLUMNS = ("confidence", "walls", "said", "true")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--fit", nargs="*", type=Path, default=[], help="datasets to fit the coefficients on"
    )
    parser.add_argument(
        "--try", nargs="*", default=[], dest="fresh", help="NAME=FOLDER of other plans"
    )
    parser.add_argument("--model", default="slam2cad", help="as `slamgym cad --model`")
    parser.add_argument("--least-seen", type=float, default=0.7, help="of the true floor")
    arguments = parser.parse_args()
    if arguments.fit:
        signs, true = judged(arguments.fit, arguments.model, arguments.least_seen)
        first, *others = fitted(signs, true)
        found = 1.0 / (1.0 + np.exp(-(first + signs @ np.array(others))))
        print(f"{len(true)} walls: {first} and {others}, Brier score {brier(found, true):.4f}")
    rows, said, right = [], [], []
    for named in arguments.fresh:
        name, _, folder = named.partition("=")
        signs, true = judged([Path(folder)], arguments.model, arguments.least_seen)
        sure = confidences(signs)
        constant = np.full(len(true), true.mean())
        scores = [round(brier(values, true), 3) for values in (sure, constant)]
        rows.append([name, len(true), *(round(float(v.mean()), 2) for v in (sure, true)), *scores])
        said.append(sure)
        right.append(true)
    if rows:
        print_and_save(
            "drawing/wall_confidence", "Confidence of drawn walls", rows, COLUMNS, MODULES
        )
        title = "Confidence of drawn walls, all maps"
        bins = table(np.concatenate(said), np.concatenate(right))
        print_and_save("drawing/wall_confidence_bins", title, bins, BIN_COLUMNS, MODULES)


def judged(folders: Sequence[Path], model: str, least_seen: float) -> tuple[FloatArray, BoolArray]:
    """Signs of all walls that a model draws, (N, 3), and which of them are true."""
    floor_model = load_floor_model(model)
    signs, true = [], []
    for folder in folders:
        for case in homes(folder, 0):
            if seen_share(case) < least_seen:
                continue
            drawing = make_drawing(case.grid, case.name, floor_model)
            frame = fine_frame(case)
            true_floor = shares(case.truth, frame)
            motion = motion_onto(true_floor, shares(drawing.floor, frame))
            floor = shares(moved(drawing.floor, frame, motion), frame)
            if intersection_over_union(floor >= 0.5, true_floor >= 0.5) < LIES_OVER:
                continue
            outline = case.truth.boundary
            shapely.prepare(outline)
            pieces = [piece_of(wall, side) for wall in drawing.walls for side in (1.0, -1.0)]
            lines = [LineString(piece.places(np.array([0.0, 1.0]), 0.0)) for piece in pieces]
            faces = [moved(line, frame, motion) for line in lines]
            near = [share_near(face, outline) >= 0.5 for face in faces]
            true.append(np.array(near).reshape(-1, 2).any(axis=1))
            evidence = Evidence(case.grid)
            signs.append(wall_signs(pieces[::2], evidence))
    return np.concatenate(signs), np.concatenate(true)


def piece_of(wall: DrawnWall, side: float = 1.0) -> WallPiece:
    """The stretch of a face that a wall was drawn from; with a ``side`` of -1 the other face."""
    start, end = complex(*wall.start), complex(*wall.end)
    aside = 0.5j * side * wall.thickness * (end - start) / wall.length
    return WallPiece(start + aside, end + aside, wall.thickness, wall.thickness_known)


def share_near(face: BaseGeometry, outline: BaseGeometry) -> float:
    """Share of a face that has the true outline next to it."""
    places = shapely.points(shapely.get_coordinates(shapely.segmentize(face, STEP)))
    return float((shapely.distance(outline, places) <= TRUE_WITHIN).mean())


def fitted(signs: FloatArray, true: BoolArray) -> list[float]:
    """The constant and the weights under which the walls are likeliest."""
    inputs = np.column_stack([np.ones(len(signs)), signs])

    def loss(weights: FloatArray) -> float:
        odds = inputs @ weights
        return float(
            np.mean(np.logaddexp(0.0, odds) - true * odds) + PENALTY * np.sum(weights[1:] ** 2)
        )

    found = minimize(loss, np.zeros(inputs.shape[1]), method="BFGS").x
    return [round(float(value), 2) for value in found]


def brier(sure: FloatArray, true: BoolArray) -> float:
    """Mean squared error of probabilities."""
    return float(np.mean((sure - true) ** 2))


def table(sure: FloatArray, true: BoolArray) -> list[list[object]]:
    """Walls by what was said of them."""
    rows: list[list[object]] = []
    for low, high in itertools.pairwise(LIMITS):
        there = (sure > low) & (sure <= high)
        if there.any():
            said, share = (round(float(values[there].mean()), 2) for values in (sure, true))
            rows.append([f"{low:g}-{high:g}", int(there.sum()), said, share])
    return rows


if __name__ == "__main__":
    main()
