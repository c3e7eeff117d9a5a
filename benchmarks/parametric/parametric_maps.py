"""The figure of docs/parametric.md: one path of three plans, and the maps of every conversion of the parametric model.

Run: ``python benchmarks/parametric/parametric_maps.py --out docs/images/parametric_maps.png``.
"""

import argparse
import os
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import numpy as np

from slamgym.cad import FloorPlan, open_plans
from slamgym.commands.deforming.hypotheses import square_around
from slamgym.core.types import ByteArray, GridFrame, Trajectory
from slamgym.parametric import ParametricConfig, deform, plan_trajectory
from slamgym.parametric.config import ConversionMethod, Equations
from slamgym.viz.canvas import draw_path, fixed_point, frame_pixels, rescaled, write_picture
from slamgym.viz.sheets import Card, draw_sheet

PANEL_PX = 420
PATH_COLOUR = (30, 110, 190)


class Column(NamedTuple):
    """How the maps of a column are made."""

    title: str
    method: ConversionMethod
    size: int
    resize: int = 0
    equations: Equations = "corrected"


COLUMNS = (
    Column("ekf (a), 64 px", "ekf", 64),
    Column("ekf (b), enlarged to 256 px", "ekf", 64, 256),
    Column("ekf_schur, 256 px", "ekf_schur", 256),
    Column("two_phase, 256 px", "two_phase", 256),
    Column("ekf_schur, as printed", "ekf_schur", 256, equations="printed"),
)


def with_path(plan: FloorPlan, path: Trajectory, frame: GridFrame) -> ByteArray:
    """The plan with the true path."""
    cells = plan.raster(frame.resolution, frame).cells
    picture = rescaled(np.repeat(cells[:, :, None], 3, axis=2), 3.0)
    draw_path(picture, fixed_point(frame_pixels(path.poses, frame, 3.0)), PATH_COLOUR, 3)
    return picture


def row(plan: FloorPlan, seed: int) -> Card:
    """The pictures of one plan, all of one path and one robot."""
    path = plan_trajectory(plan, np.random.default_rng(seed))
    panels = [with_path(plan, path, square_around(plan, 256))]
    for column in COLUMNS:
        config = ParametricConfig(method=column.method, equations=column.equations)
        frame = square_around(plan, column.size)
        map_frame = square_around(plan, column.resize) if column.resize else None
        result = deform(plan, path, config, np.random.default_rng(seed), frame, map_frame)
        panels.append(result.grid.cells)
    return Card(panels)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", nargs=3, default=["home_000002", "home_000012", "home_000045"])
    parser.add_argument("--out", type=Path, default=Path("docs/images/parametric_maps.png"))
    arguments = parser.parse_args()
    source = open_plans("bundled")
    cards = [row(source.load(plan_id), seed) for seed, plan_id in enumerate(arguments.plans)]
    titles = ["plan and true path", *(column.title for column in COLUMNS)]
    write_picture(arguments.out, draw_sheet(cards, 1, PANEL_PX, titles))
    print(f"{len(cards)} plans: {arguments.out}")


if __name__ == "__main__":
    main()
