"""A page to look at: six plans, three simulated maps of each, and three hypotheses of each method of `slamgym deform`.

The simulated maps differ by the seed of the exploration; parametric model and generator drive the true path of each.

Run: ``python benchmarks/parametric/deform_page.py --plans PATH --recipe reference --out docs/images/deform_page.png``.
"""

import argparse
import os
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import numpy as np
from deform_realism import CELL, METHODS, Maker
from parametric_conversions import useful_plans

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.types import ByteArray, GridFrame, OccupancyGrid, Trajectory
from slamgym.dataset.generate.recipe import episode_conditions, open_recipe
from slamgym.dataset.images.square_images import resample_map
from slamgym.envs.episode import EpisodeConfig, run_episode
from slamgym.viz.canvas import write_picture
from slamgym.viz.sheets import Card, draw_sheet

DRAWS, PANEL_PX = 3, 150


def row(plan: FloorPlan, recipe: str, maker: Maker, methods: tuple[str, ...]) -> list[ByteArray]:
    """The pictures of one plan, all on its frame."""
    frame = GridFrame.covering(plan.bounds, CELL, 1.0)
    pictures: list[list[ByteArray]] = [[] for _ in range(1 + len(methods))]
    for seed in range(DRAWS):
        config, _ = episode_conditions(open_recipe(recipe), EpisodeConfig(), seed)
        config = replace(config, turn_deg=0.0)
        episode = run_episode(plan, seed, config, make_explorer)
        start = episode.start
        moved = GridFrame(
            frame.resolution, frame.origin_x - start.x, frame.origin_y - start.y, *frame.shape
        )
        pictures[0].append(resample_map(episode.slam_map, moved))
        path = Trajectory(
            episode.truth.stamps, episode.truth.poses + np.array([start.x, start.y, 0.0])
        )
        for method, found in zip(methods, pictures[1:], strict=True):
            grid, _ = maker.make(method, plan, path, config, seed)
            found.append(resample_map(OccupancyGrid(grid.cells, grid.frame), frame))
    return [plan.raster(CELL, frame).cells, *(picture for kind in pictures for picture in kind)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", default="bundled")
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--recipe", default="reference")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--out", type=Path, default=Path("docs/images/deform_page.png"))
    arguments = parser.parse_args()
    methods = tuple(arguments.methods)
    maker = Maker(methods)
    titles = ["plan"] + [
        f"{name} {n + 1}" for name in ("simulated", *methods) for n in range(DRAWS)
    ]
    plans = useful_plans(arguments.plans, arguments.count)
    rows = [row(plan, arguments.recipe, maker, methods) for plan in plans]
    write_picture(arguments.out, draw_sheet([Card(each) for each in rows], 1, PANEL_PX, titles))
    print(f"{len(rows)} plans: {arguments.out}")


if __name__ == "__main__":
    main()
