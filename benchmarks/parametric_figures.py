"""Figures like the paper's 8 and 9: one path, and the maps that simulated SLAM and the model make of it.

Per plan a row: CAD map with the path, simulated SLAM, EKF at 64 px enlarged, EKF at full resolution (Schur),
two-phase, and the realistic preset.

Run: ``python benchmarks/parametric_figures.py --plans PATH --out docs/images/parametric_maps.png``.
"""

import argparse
import dataclasses
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import cv2
import numpy as np
from parametric_realism import Exploration, explore, useful_plans

from slamgym.core.types import UNKNOWN, ByteArray, Float32Array, GridFrame
from slamgym.parametric import Deformation, ParametricConfig, deform, from_recorded, preset
from slamgym.parametric.config import EkfConfig
from slamgym.parametric.warp import warp
from slamgym.viz.canvas import TRUE_COLOUR, write_picture
from slamgym.viz.overlays import draw_paths
from slamgym.viz.sheets import DEFORMATION_PX, draw_grid

COARSE_PX = 64
TITLES = (
    "CAD map and true path",
    "simulated SLAM",
    f"EKF at {COARSE_PX} px",
    "EKF field, upsized",
    "EKF (Schur), full size",
    "two-phase, faithful",
    "two-phase, realistic",
)


def coarse_frame(frame: GridFrame) -> GridFrame:
    """A grid of some 64 px over the same place."""
    resolution = max(frame.width_px, frame.height_px) * frame.resolution / COARSE_PX
    return GridFrame.covering(frame.bounds, resolution)


def enlarged_ekf(exploration: Exploration, coarse: Float32Array, frame: GridFrame) -> ByteArray:
    """The coarse EKF's field, brought to full resolution as the paper does and applied to the CAD map."""
    full = exploration.frame
    rows, cols = np.indices(full.shape, dtype=np.float32)
    x, y = full.to_point(rows, cols)
    at_col = ((x - frame.origin_x) / frame.resolution - 0.5).astype(np.float32)
    at_row = (frame.height_px - (y - frame.origin_y) / frame.resolution - 0.5).astype(np.float32)
    field = np.stack(
        [cv2.remap(c, at_col, at_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for c in coarse]
    )
    cad = exploration.plan.raster(full.resolution, full, outside=UNKNOWN, wall_thickness=0.1).cells
    return warp(cad, field, full.resolution, UNKNOWN)


def row(exploration: Exploration, seed: int) -> list[ByteArray]:
    """One plan: path, simulated SLAM, EKF, EKF upsized, Schur, two-phase, realistic."""
    path = from_recorded(exploration.path)
    frame = exploration.frame
    coarse = coarse_frame(frame)

    def run(config: ParametricConfig, on: GridFrame = frame) -> Deformation:
        return deform(exploration.plan, path, config, np.random.default_rng(seed), on)

    motion = dataclasses.replace(ParametricConfig().motion, scan_spacing=0.25, scan_angle=0.5)
    faithful = dataclasses.replace(preset("faithful"), motion=motion)
    ekf = run(
        dataclasses.replace(faithful, method="ekf", resolution=coarse.resolution, ekf=EkfConfig()), coarse
    )
    cad = exploration.plan.raster(frame.resolution, frame)
    return [
        draw_paths(cad, {TRUE_COLOUR: exploration.path.poses}, DEFORMATION_PX),
        exploration.slam,
        ekf.grid.cells,
        enlarged_ekf(exploration, ekf.field, coarse),
        run(dataclasses.replace(faithful, method="ekf_schur")).grid.cells,
        run(faithful).grid.cells,
        run(preset("realistic")).grid.cells,
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", default="bundled")
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--episodes", type=Path, default=Path("out/realism_episodes"))
    parser.add_argument("--out", type=Path, default=Path("docs/images/parametric_maps.png"))
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    arguments.episodes.mkdir(parents=True, exist_ok=True)
    plans = useful_plans(arguments.plans, arguments.count)
    rows = [row(explore(plan, arguments.episodes), arguments.seed) for plan in plans]
    write_picture(arguments.out, draw_grid(TITLES, rows, panel_px=DEFORMATION_PX))
    print(f"{len(rows)} plans: {arguments.out}")


if __name__ == "__main__":
    main()
