"""What each method of ``slamgym deform`` makes of a plan."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.core.config import to_dict
from slamgym.core.errors import SlamgymError
from slamgym.core.progress import say
from slamgym.core.types import FREE, Float32Array, FloatArray, GridFrame, OccupancyGrid, Trajectory
from slamgym.parametric.config import ParametricConfig, SensingConfig, preset, realistic
from slamgym.parametric.model import DRIFT_MARGIN, Deformation, deform
from slamgym.parametric.paths import TimedTrajectory, from_recorded, plan_trajectory, trajectory_from_file

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.commands.deforming.arguments import DeformArguments
    from slamgym.commands.deforming.subjects import Subject
    from slamgym.envs import ExploreConfig
    from slamgym.envs.episode import EpisodeConfig
    from slamgym.gan.translation.translate import LearnedTranslator


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


def hypotheses(wanted: Iterable[Subject], arguments: DeformArguments) -> Iterator[tuple[Subject, DrawnMap]]:
    """Make the maps one by one; each follows from the seed and its number.

    Raises:
        SlamgymError: If nothing can be drawn of any plan; one of many is left out, and said.
    """
    draw = _drawing_of(arguments)
    left_out: SlamgymError | None = None
    drawn = 0
    for subject in wanted:
        rng = np.random.default_rng([arguments.seed, subject.slot.index])
        try:
            made = draw(subject, rng)
        except SlamgymError as error:
            if arguments.plans == 1 and subject.recorded is None:
                raise
            say(f"left out: {error}")
            left_out = error
            continue
        drawn += 1
        yield subject, made
    if left_out is not None and not drawn:
        raise left_out


def _drawing_of(arguments: DeformArguments) -> Callable[[Subject, np.random.Generator], DrawnMap]:
    if arguments.method == "elastic":
        return lambda subject, rng: _elastic(subject, arguments, rng)
    if arguments.method == "modelprog":
        from slamgym.gan.translation.translate import load_translator

        translator = load_translator(arguments.weights or "modelprog", "cad2slam")
        return lambda subject, rng: _modelprog(subject, arguments, rng, translator)
    if arguments.trajectory is None:
        return lambda subject, rng: _along_path(subject, arguments, rng)
    way = arguments.trajectory
    return lambda subject, rng: _along_path(subject, arguments, rng, trajectory_from_file(way, subject.plan))


def _along_path(
    subject: Subject,
    arguments: DeformArguments,
    rng: np.random.Generator,
    given: TimedTrajectory | None = None,
) -> DrawnMap:
    """Methods ``parametric`` and ``generator``."""
    config = model_settings(arguments, subject.slot.index, subject.recorded)
    frame = square_around(subject.plan, arguments.size) if arguments.size else None
    if frame is not None:
        config = replace(config, resolution=frame.resolution)
    path = given or _path(subject, arguments, rng)
    return _of_deformation(deform(subject.plan, path, config, rng, frame))


def generator_config(env: ExploreConfig) -> ParametricConfig:
    """The generator's settings for the robot, the sensors and the mapper of an exploration."""
    return realistic(SensingConfig(env.lidar, env.clutter, env.slam), env.odometry)


def model_settings(
    arguments: DeformArguments, number: int, recorded: EpisodeConfig | None = None
) -> ParametricConfig:
    """The model's settings for one hypothesis: a recipe draws others for each, an exploration had its own."""
    config = preset("faithful")
    if arguments.method == "generator":
        from slamgym.core.names import exploration_seed
        from slamgym.dataset.generate.recipe import episode_conditions, open_recipe
        from slamgym.envs.episode import EpisodeConfig

        env = (recorded or EpisodeConfig()).env
        if arguments.recipe is not None:
            seed = exploration_seed(arguments.seed, "deform", number)
            env = episode_conditions(open_recipe(arguments.recipe), EpisodeConfig(), seed)[0].env
        config = generator_config(env)
    config = replace(config, severity=arguments.severity, resolution=arguments.resolution)
    if arguments.conversion is not None:
        config = replace(config, method=arguments.conversion)
    if arguments.calibration is not None:
        from slamgym.parametric.calibration import read_calibration

        config = replace(config, two_phase=read_calibration(arguments.calibration))
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
    )


def square_around(plan: FloorPlan, size_px: int) -> GridFrame:
    """A square grid of ``size_px`` that holds the plan and its margin, the plan in the middle."""
    min_x, min_y, max_x, max_y = plan.bounds
    side = max(max_x - min_x, max_y - min_y) + 2.0 * DRIFT_MARGIN
    return GridFrame(
        resolution=side / size_px,
        origin_x=0.5 * (min_x + max_x - side),
        origin_y=0.5 * (min_y + max_y - side),
        height_px=size_px,
        width_px=size_px,
    )


def _path(subject: Subject, arguments: DeformArguments, rng: np.random.Generator) -> TimedTrajectory:
    if subject.driven is not None:
        return from_recorded(subject.driven)
    if arguments.explorer is None:
        return plan_trajectory(subject.plan, rng, arguments.prm_kind)
    from slamgym.agents.registry import make_explorer
    from slamgym.envs.episode import record_path

    seed = arguments.seed + subject.slot.index
    recorded = record_path(subject.plan, arguments.explorer, seed, make_explorer)
    return from_recorded(recorded, f"the path of {arguments.explorer}")


def _elastic(subject: Subject, arguments: DeformArguments, rng: np.random.Generator) -> DrawnMap:
    from slamgym.gan.translation.elastic import bend_with_field

    cad = _cad_around(subject.plan, arguments.resolution)
    cells, field = bend_with_field(cad.cells, arguments.resolution, rng)
    return _without_path(subject.plan, OccupancyGrid(cells, cad.frame), cad, field)


def _modelprog(
    subject: Subject, arguments: DeformArguments, rng: np.random.Generator, translator: LearnedTranslator
) -> DrawnMap:
    cad = _cad_around(subject.plan, arguments.resolution)
    # The network has no dice: the first map is the plan's, the others are of the plan bent as drift would.
    drift = rng if subject.slot.repetition else None
    cells = translator.translate_cells(cad.cells, arguments.resolution, drift=drift)
    return _without_path(subject.plan, OccupancyGrid(cells, cad.frame), cad, None)


def _cad_around(plan: FloorPlan, resolution: float) -> OccupancyGrid:
    return plan.raster(resolution, GridFrame.covering(plan.bounds, resolution, 0.5))


def _without_path(
    plan: FloorPlan, grid: OccupancyGrid, cad: OccupancyGrid, field: Float32Array | None
) -> DrawnMap:
    point = plan.free_space.representative_point()
    return DrawnMap(grid, cad, np.array([point.x, point.y, 0.0]), field, {}, 1.0, {})
