"""The paper's figures 7, 8 and 9 and its Table II, made anew for any plans."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from slamgym.agents.registry import make_explorer
from slamgym.cad.sources import open_plans
from slamgym.commands.deforming.arguments import DeformArguments, Method
from slamgym.commands.deforming.dataset import staged_folder
from slamgym.commands.deforming.hypotheses import generator_config, hypotheses, square_around
from slamgym.commands.deforming.subjects import load_plan, subjects
from slamgym.core.files import write_text
from slamgym.core.progress import tell
from slamgym.core.text import markdown
from slamgym.core.types import UNKNOWN, ByteArray, Float32Array, GridFrame, Trajectory
from slamgym.dataset.generate.recipe import episode_conditions, open_recipe
from slamgym.dataset.images.square_images import resample_map
from slamgym.envs.episode import Episode, EpisodeConfig, run_episode
from slamgym.parametric import (
    Deformation,
    ParametricConfig,
    deform,
    from_recorded,
    preset,
)
from slamgym.parametric.config import ConversionMethod
from slamgym.parametric.warp import warp
from slamgym.viz.canvas import TRUE_COLOUR, fitted, write_picture
from slamgym.viz.sheets import DEFORMATION_PX, draw_grid, draw_paths

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

_COARSE_PX, _FULL_PX = 64, 256
_TITLES = {
    "figure7": ("plan", "Modelprog", "Modelprog, plan bent", "Modelprog, bent otherwise"),
    "figure8": ("plan and true path", "EKF at 64 px", "its field, enlarged", "EKF (Schur)", "two-phase"),
    "figure9": ("plan", "simulated", "parametric", "generator", "Modelprog", "elastic"),
}
_TABLE: tuple[tuple[ConversionMethod, int, str], ...] = (
    ("ekf", _COARSE_PX, "15-94"),
    ("two_phase", _FULL_PX, "2.6-3.6"),
    ("ekf_schur", _FULL_PX, ""),
)
"""Conversion, side of the map [px], seconds in the paper (Matlab)."""


def draw_figures(arguments: DeformArguments) -> None:
    """Write ``figure7.png``, ``figure8.png``, ``figure9.png`` and ``table2.md``, a row for each plan.

    The true path is Explore Lite's in the simulator, by the recipe that the arguments name, else by its defaults.
    """
    rows: dict[str, list[list[ByteArray]]] = {name: [] for name in _TITLES}
    headings = ("plan", "conversion", "map px", "CPU seconds", "paper, seconds (Matlab)")
    table: list[list[str]] = []
    with staged_folder(arguments.out, arguments.overwrite) as folder:
        source = open_plans(arguments.plan)
        ids = source.ids if arguments.plan_id is None else [arguments.plan_id]
        for number in range(arguments.count):
            plan = load_plan(source, ids[number % len(ids)], arguments.resolution)
            config = EpisodeConfig()
            if arguments.recipe is not None:
                recipe = open_recipe(arguments.recipe)
                config, _ = episode_conditions(recipe, config, arguments.seed + number)
            config = replace(config, explorer="explore_lite", turn_deg=0.0)
            episode = run_episode(plan, arguments.seed + number, config, make_explorer)
            for name, row in _rows(plan, episode, config, arguments).items():
                rows[name].append(row)
            table += _times(plan, episode, arguments.seed)
        for name, pictures in rows.items():
            write_picture(folder / f"{name}.png", draw_grid(_TITLES[name], pictures, panel_px=DEFORMATION_PX))
        write_text(folder / "table2.md", markdown(headings, table))
    tell(f"{arguments.count} plan(s): {arguments.out}")


def _rows(
    plan: FloorPlan, episode: Episode, config: EpisodeConfig, arguments: DeformArguments
) -> dict[str, list[ByteArray]]:
    path = _true_path(episode)
    frame = GridFrame.covering(plan.bounds, arguments.resolution, 1.0)
    cad = plan.raster(frame.resolution, frame)
    env = config.env

    def run(settings: ParametricConfig, on: GridFrame = frame) -> Deformation:
        rng = np.random.default_rng(arguments.seed)
        return deform(plan, from_recorded(path), replace(settings, resolution=on.resolution), rng, on)

    def of_method(method: Method, count: int) -> list[ByteArray]:
        plain = DeformArguments(
            arguments.plan,
            arguments.out,
            method,
            count,
            plan_id=plan.id,
            seed=arguments.seed,
            resolution=arguments.resolution,
        )
        return [one.grid.cells for _, one in hypotheses(subjects(plain), plain)]

    faithful = preset("faithful")
    coarse = square_around(plan, _COARSE_PX)
    ekf, schur = run(replace(faithful, method="ekf"), coarse), run(faithful).grid.cells
    looks = generator_config(env)
    at_start = GridFrame(
        frame.resolution,
        frame.origin_x - episode.start.x,
        frame.origin_y - episode.start.y,
        *frame.shape,
    )
    modelprog = of_method("modelprog", 3)
    return {
        "figure7": [cad.cells, *modelprog],
        "figure8": [
            draw_paths(fitted(cad.cells, DEFORMATION_PX), cad.frame, {TRUE_COLOUR: path.poses}),
            ekf.grid.cells,
            _enlarged(plan, ekf.field, coarse, frame),
            schur,
            run(replace(faithful, method="two_phase")).grid.cells,
        ],
        "figure9": [
            cad.cells,
            resample_map(episode.slam_map, at_start),
            schur,
            run(looks).grid.cells,
            modelprog[0],
            of_method("elastic", 1)[0],
        ],
    }


def _times(plan: FloorPlan, episode: Episode, seed: int) -> list[list[str]]:
    """Rows of Table II: CPU time of one map, its kernels compiled."""
    path = from_recorded(_true_path(episode))
    rows = []
    for conversion, side, paper in _TABLE:
        config = replace(preset("faithful"), method=conversion)
        frame = square_around(plan, side)
        config = replace(config, resolution=frame.resolution)
        seconds = []
        for _ in range(2):
            begun = time.process_time()
            deform(plan, path, config, np.random.default_rng(seed), frame)
            seconds.append(time.process_time() - begun)
        rows.append([plan.id, conversion, str(side), f"{min(seconds):.3f}", paper or "-"])
    return rows


def _true_path(episode: Episode) -> Trajectory:
    """Where the robot truly was, world frame."""
    return Trajectory(
        episode.truth.stamps, episode.truth.poses + np.array([episode.start.x, episode.start.y, 0.0])
    )


def _enlarged(plan: FloorPlan, coarse: Float32Array, frame: GridFrame, full: GridFrame) -> ByteArray:
    """The coarse EKF's field, brought to full resolution as the paper does and applied to the CAD map."""
    rows, cols = np.indices(full.shape, dtype=np.float32)
    x, y = full.to_point(rows, cols)
    at_col = ((x - frame.origin_x) / frame.resolution - 0.5).astype(np.float32)
    at_row = (frame.height_px - (y - frame.origin_y) / frame.resolution - 0.5).astype(np.float32)
    field = np.stack(
        [cv2.remap(c, at_col, at_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for c in coarse]
    )
    cad = plan.raster(full.resolution, full, outside=UNKNOWN, wall_thickness=0.1).cells
    return warp(cad, field, full.resolution, UNKNOWN)
