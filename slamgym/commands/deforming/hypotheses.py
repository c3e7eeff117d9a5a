"""What each method of ``slamgym deform`` makes of a plan."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.cad.sources import open_plans
from slamgym.core.config import suggest, to_dict
from slamgym.core.errors import ConfigError, PlanError
from slamgym.core.types import FREE, Float32Array, FloatArray, GridFrame, OccupancyGrid, Trajectory
from slamgym.parametric.config import ParametricConfig, SensingConfig
from slamgym.parametric.model import Deformation, deform
from slamgym.parametric.paths import plan_trajectory, trajectory_from_file
from slamgym.parametric.presets import preset, realistic
from slamgym.parametric.trajectory import TimedTrajectory, from_recorded

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.commands.deforming.arguments import DeformArguments


@dataclass(frozen=True)
class DrawnMap:
    """A SLAM map that might have been drawn of a plan. Everything is in the plan's world frame."""

    grid: OccupancyGrid
    cad: OccupancyGrid  # the plan on the same frame
    start: FloatArray  # (3,) where the robot began; the origin of the map frame
    field: (
        Float32Array | None
    )  # (2, H, W) [m] true minus measured, out(q) = in(q + d(q)); None where not known
    paths: dict[str, Trajectory]  # "truth", "odometry" and "estimate"; empty where a method knows none
    coverage: float  # share of the floor that was seen
    parameters: dict[str, Any]
    seconds: float


def load_plan(arguments: DeformArguments, place: int = 0) -> FloorPlan:
    """The plan that the arguments name, or the one at a place of the source."""
    source = open_plans(arguments.plan)
    plan_id = arguments.plan_id if arguments.plan_id is not None else source.ids[place % len(source.ids)]
    if plan_id not in source.ids:
        raise ConfigError(f"{arguments.plan} has no plan {plan_id!r}; {suggest(plan_id, source.ids)}")
    plan = source.load(plan_id)
    if not (plan.raster(arguments.resolution).cells == FREE).any():
        raise PlanError(plan.id, "has no free cell; use a finer --resolution or another plan")
    return plan


def hypotheses(plan: FloorPlan, arguments: DeformArguments) -> Iterator[DrawnMap]:
    """Make the maps one by one; each follows from the seed and its number."""
    if arguments.method == "elastic":
        yield from _elastic(plan, arguments)
    elif arguments.method == "modelprog":
        yield from _modelprog(plan, arguments)
    else:
        yield from _along_paths(plan, arguments)


def _along_paths(plan: FloorPlan, arguments: DeformArguments) -> Iterator[DrawnMap]:
    """Methods ``parametric`` and ``generator``."""
    config = model_settings(arguments, 0)
    fixed = trajectory_from_file(arguments.trajectory, plan, config.motion) if arguments.trajectory else None
    for number in range(arguments.count):
        rng = np.random.default_rng([arguments.seed, number])
        config = model_settings(arguments, number)
        frame = square_around(plan, config, arguments.size) if arguments.size else None
        if frame is not None:
            config = replace(config, resolution=frame.resolution)
        path = fixed or _path(arguments, plan, config, rng, number)
        yield _of_deformation(deform(plan, path, config, rng, frame))


def model_settings(arguments: DeformArguments, number: int) -> ParametricConfig:
    """The model's settings for one hypothesis: a recipe draws others for each."""
    config = preset("faithful")
    if arguments.method == "generator":
        from slamgym.core.seeding import exploration_seed
        from slamgym.dataset.generate.recipe import episode_conditions, open_recipe
        from slamgym.envs.episode import EpisodeConfig

        env = EpisodeConfig().env
        if arguments.recipe is not None:
            seed = exploration_seed(arguments.seed, "deform", number)
            env = episode_conditions(open_recipe(arguments.recipe), EpisodeConfig(), seed)[0].env
        config = realistic(SensingConfig(env.lidar, env.clutter, env.slam), env.odometry)
    config = replace(config, severity=arguments.severity, resolution=arguments.resolution)
    if arguments.conversion is not None:
        config = replace(config, method=arguments.conversion)
    if arguments.calibration is not None:
        from slamgym.parametric.calibration import read_calibration

        config = replace(config, two_phase=read_calibration(arguments.calibration, config.two_phase))
    return config


def _of_deformation(result: Deformation) -> DrawnMap:
    floor = result.cad.cells == FREE
    return DrawnMap(
        grid=result.grid,
        cad=result.cad,
        start=result.true.poses[0],
        field=result.field,
        paths={"truth": result.true, "odometry": result.odometry, "estimate": result.believed},
        coverage=float(result.seen[floor].mean()),
        parameters={"drawn": result.parameters, "config": to_dict(result.config)},
        seconds=sum(result.seconds.values()),
    )


def square_around(plan: FloorPlan, config: ParametricConfig, size_px: int) -> GridFrame:
    """A square grid of ``size_px`` that holds the plan and its margin, the plan in the middle."""
    min_x, min_y, max_x, max_y = plan.bounds
    side = max(max_x - min_x, max_y - min_y) + 2.0 * config.margin
    return GridFrame(
        resolution=side / size_px,
        origin_x=0.5 * (min_x + max_x - side),
        origin_y=0.5 * (min_y + max_y - side),
        height_px=size_px,
        width_px=size_px,
    )


def _path(
    arguments: DeformArguments,
    plan: FloorPlan,
    config: ParametricConfig,
    rng: np.random.Generator,
    index: int,
) -> TimedTrajectory:
    if arguments.explorer is None:
        return plan_trajectory(plan, config.motion, rng, arguments.prm_kind)
    from slamgym.agents.registry import make_explorer
    from slamgym.envs.episode import record_path

    recorded = record_path(plan, arguments.explorer, arguments.seed + index, make_explorer)
    return from_recorded(recorded, f"the path of {arguments.explorer}")


def _elastic(plan: FloorPlan, arguments: DeformArguments) -> Iterator[DrawnMap]:
    from slamgym.gan.translation.elastic import bend_with_field

    cad = plan.raster(arguments.resolution, GridFrame.covering(plan.bounds, arguments.resolution, 0.5))
    for number in range(arguments.count):
        rng = np.random.default_rng([arguments.seed, number])
        cells, field = bend_with_field(cad.cells, arguments.resolution, rng)
        yield _without_path(plan, OccupancyGrid(cells, cad.frame), cad, field)


def _modelprog(plan: FloorPlan, arguments: DeformArguments) -> Iterator[DrawnMap]:
    from slamgym.gan.translation.translate import load_translator

    translator = load_translator(arguments.weights or "modelprog", "cad2slam")
    cad = plan.raster(arguments.resolution, GridFrame.covering(plan.bounds, arguments.resolution, 0.5))
    for number in range(arguments.count):
        # The network has no dice: the first map is the plan's, the others are of the plan bent as drift would.
        rng = np.random.default_rng([arguments.seed, number]) if number else None
        cells = translator.translate_cells(cad.cells, arguments.resolution, drift=rng)
        yield _without_path(plan, OccupancyGrid(cells, cad.frame), cad, None)


def _without_path(
    plan: FloorPlan, grid: OccupancyGrid, cad: OccupancyGrid, field: Float32Array | None
) -> DrawnMap:
    point = plan.free_space.representative_point()
    return DrawnMap(grid, cad, np.array([point.x, point.y, 0.0]), field, {}, 1.0, {}, 0.0)
