"""Draw the parametric model's map of every test pair, for `slamgym gan evaluate --generated parametric=OUT`.

Each map is of the pair's own plan along the path that the robot truly drove, on a lattice of 5 cm, and brought into the
pair's image as `slamgym dataset render` does with the simulated map, so that nothing but the model makes a difference.

Run: ``python benchmarks/gan/gan_parametric_maps.py DATASET IMAGES -o OUT``, where IMAGES was rendered from DATASET.
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import cv2
import numpy as np

from slamgym.cad import read_houseexpo
from slamgym.core.progress import show_progress
from slamgym.core.types import GridFrame, OccupancyGrid, Trajectory
from slamgym.dataset.format import Layout, read_manifest
from slamgym.dataset.images.format import read_images
from slamgym.dataset.images.square_images import resample_map
from slamgym.interop import read_tum
from slamgym.parametric import deform, from_recorded, preset

RESOLUTION, MARGIN = 0.05, 1.5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path, help="folder that `slamgym generate` has written")
    parser.add_argument("images", type=Path, help="folder that `slamgym dataset render` made of it")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--preset", choices=("realistic", "faithful"), default="realistic")
    parser.add_argument("--split", choices=("train", "test"), default="test")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    config = preset(arguments.preset)
    starts = {record.name: record.start for record in read_manifest(arguments.dataset)}
    records = read_images(arguments.images, arguments.split)
    arguments.out.mkdir(parents=True, exist_ok=True)
    with show_progress("maps", 0, len(records)) as advance:
        for i, record in enumerate(records):
            episode = Layout(arguments.dataset).episode(record.name)
            plan, start = read_houseexpo(episode / "plan.json"), starts[record.name]
            truth = read_tum(episode / "truth.tum")
            # The files are in the map frame, the model works in the plan's.
            path = Trajectory(truth.stamps, truth.poses + np.array([start[0], start[1], 0.0]))
            frame = GridFrame.covering(plan.bounds, RESOLUTION, MARGIN)
            rng = np.random.default_rng([arguments.seed, i])
            cells = deform(plan, from_recorded(path), config, rng, frame).grid.cells
            moved = GridFrame(RESOLUTION, frame.origin_x - start[0], frame.origin_y - start[1], *frame.shape)
            image = resample_map(OccupancyGrid(cells, moved), record.frame)
            cv2.imwrite(str(arguments.out / f"{record.name}.png"), image)
            advance()


if __name__ == "__main__":
    main()
