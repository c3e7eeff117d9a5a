"""Subjects of ``slamgym deform``, plans or the pairs of a dataset, and the map that each method makes of them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.cad.plan_filter import passes, usual_reason
from slamgym.cad.sources import open_plans
from slamgym.commands.frame import require_plan
from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError, InputFileError, PlanError, SlamgymError
from slamgym.core.names import exploration_seed
from slamgym.core.progress import say
from slamgym.core.types import FREE, Float32Array, GridFrame, OccupancyGrid, Pose2D, Trajectory
from slamgym.dataset.format import Layout, is_dataset, read_dataset_config, read_manifest
from slamgym.dataset.generate.recipe import (
    MIXTURE,
    apply_conditions,
    episode_conditions,
    open_recipe,
)
from slamgym.dataset.record import Outcome, PairRecord, Slot
from slamgym.envs.episode import EpisodeConfig, time_limit
from slamgym.envs.plan_cache import Streams
from slamgym.parametric.config import ParametricConfig
from slamgym.parametric.generator import map_along_path
from slamgym.parametric.model import DRIFT_MARGIN, Deformation, deform
from slamgym.parametric.paths import check_recorded, trajectory_from_file
from slamgym.parametric.tours import plan_trajectory, rooms_left_out
from slamgym.sim import Clutter, make_clutter

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.commands.deforming.arguments import DeformArguments
    from slamgym.envs import ExploreConfig
    from slamgym.gan.translation.translate import LearnedTranslator


@dataclass(frozen=True)
class Subject:
    """A hypothesis before it is drawn."""

    slot: Slot
    plan: FloorPlan
    settings: EpisodeConfig
    """Of the exploration that it might be of, or was recorded of."""
    seed: int
    """Of that exploration: it furnished the building."""
    recipe: str
    """Name of the recipe that the settings are from; empty for none."""
    driven: Trajectory | None = None
    """The recorded true path, world frame; None to plan one."""


def subjects(arguments: DeformArguments) -> Iterator[Subject]:
    """All that is to be drawn, plan by plan, or pair by pair of a dataset.

    Raises:
        ConfigError: If the source has no such plan.
        PlanError: If the only plan can't be used; one of many is left out by whoever draws it.
        InputFileError: If a file of the dataset is missing or malformed.
    """
    if is_dataset(arguments.plan):
        yield from _of_dataset(Path(arguments.plan), arguments)
        return
    recipe = None if arguments.recipe is None else open_recipe(arguments.recipe)
    for place, plan in enumerate(_plans(arguments)):
        for repetition in range(arguments.count):
            slot = _slot(arguments, place * arguments.count + repetition, plan.id, repetition)
            settings = EpisodeConfig()
            if recipe is not None:
                settings, _ = episode_conditions(recipe, settings, slot.seed)
            turned = plan.turned(settings.turn_deg)
            yield Subject(slot, turned, settings, slot.seed, arguments.recipe or "")


def _plans(arguments: DeformArguments) -> Iterator[FloorPlan]:
    """The plans; one of many that can't be used is left out, a single one is an error."""
    source = open_plans(arguments.plan)
    ids = source.ids
    if arguments.plan_id is not None:
        ids = [require_plan(arguments.plan, arguments.plan_id, ids)]
    is_one = arguments.plan_id is not None or (
        arguments.plans == 1 and arguments.plans_filter == "none"
    )
    found = 0
    reasons: list[str] = []
    for plan_id in ids:
        try:
            plan = source.load(plan_id)
            if not (
                plan.raster(arguments.resolution or ParametricConfig.resolution).cells == FREE
            ).any():
                raise PlanError(
                    plan.id, "has no free cell; use a finer --resolution or another plan"
                )
        except PlanError as error:
            if is_one:
                raise
            reasons.append(error.reason)
            continue
        if is_one or passes(plan, arguments.plans_filter):
            found += 1
            yield plan
        else:
            reasons.append(f"--plans-filter {arguments.plans_filter} omits it")
        if found == arguments.plans:
            return
    if not found:
        raise ConfigError(
            f"none of the {len(source):,} plans of {arguments.plan} can be used; {usual_reason(reasons)}"
        )


def _of_dataset(root: Path, arguments: DeformArguments) -> Iterator[Subject]:
    records = list(read_manifest(root))
    if not records:
        raise ConfigError(f"{root}: holds no pairs yet")
    stride = max(record.index for record in records) + 1
    base = recorded_settings(root)
    for record in records:
        settings = apply_conditions(base, record.conditions)
        plan, driven = recorded_drive(root, record)
        for repetition in range(arguments.count):
            number = record.index + repetition * stride
            slot = _slot(
                arguments, number, record.plan_id, record.repetition * arguments.count + repetition
            )
            recipe = str(record.conditions.get(MIXTURE, ""))
            yield Subject(slot, plan, settings, record.seed, recipe, driven)


def recorded_settings(root: Path) -> EpisodeConfig:
    """Settings that all explorations of a dataset share; the conditions of a pair come on top.

    Raises:
        InputFileError: If it isn't a dataset of explorations.
    """
    try:
        return from_dict(EpisodeConfig, read_dataset_config(root)["episode"])
    except (ConfigError, KeyError) as error:
        raise InputFileError(
            root,
            f"is no dataset of explorations ({error}); give one that this version's `slamgym generate` made",
        ) from error


def recorded_drive(root: Path, record: PairRecord) -> tuple[FloorPlan, Trajectory]:
    """The plan of a pair and the path that the robot truly drove, in the plan's frame.

    Raises:
        InputFileError: If a file of the pair is missing or malformed.
        PlanError: If the plan's file is.
    """
    from slamgym.cad import read_houseexpo
    from slamgym.interop import read_tum

    folder = Layout(root).episode(record.name)
    truth = read_tum(folder / "truth.tum")
    x, y, _ = record.start
    return read_houseexpo(folder / "plan.json"), Trajectory(
        truth.stamps, truth.poses + np.array([x, y, 0.0])
    )


def _slot(arguments: DeformArguments, number: int, plan_id: str, repetition: int) -> Slot:
    return Slot(number, plan_id, repetition, exploration_seed(arguments.seed, plan_id, number))


@dataclass(frozen=True)
class DrawnMap:
    """A SLAM map that might have been drawn of a plan. Everything is in the plan's world frame."""

    grid: OccupancyGrid
    cad: OccupancyGrid  # the plan on the same frame
    field: (
        Float32Array | None
    )  # (2, H, W) [m] true minus measured, out(q) = in(q + d(q)); None if not known
    outcome: Outcome  # without poses where a method knows no path
    parameters: dict[str, Any]
    cpu_seconds: float = 0.0


def hypotheses(
    wanted: Iterable[Subject], arguments: DeformArguments
) -> Iterator[tuple[Subject, DrawnMap]]:
    """Make the maps one by one; each follows from the seed and its number.

    Raises:
        SlamgymError: If nothing can be drawn of any plan; one of many is left out, and said.
    """
    translator = None
    if arguments.method == "modelprog":
        from slamgym.gan.translation.translate import load_translator

        translator = load_translator(arguments.weights or "modelprog", "cad2slam")
    left_out: SlamgymError | None = None
    drawn = 0
    for subject in wanted:
        rng = np.random.default_rng([arguments.seed, subject.slot.index])
        try:
            if arguments.method == "generator":
                made = _generated(subject, arguments, rng)
            elif arguments.method == "parametric":
                made = _parametric(subject, arguments, rng)
            else:
                made = _without_path(subject, arguments, rng, translator)
        except SlamgymError as error:
            if arguments.plans == 1 and subject.driven is None:
                raise
            say(f"left out: {error}")
            left_out = error
            continue
        drawn += 1
        yield subject, made
    if left_out is not None and not drawn:
        raise left_out


def _parametric(subject: Subject, arguments: DeformArguments, rng: np.random.Generator) -> DrawnMap:
    config = ParametricConfig(
        method=arguments.conversion or "ekf_schur",
        equations=arguments.equations or "corrected",
        severity=arguments.severity,
        resolution=arguments.resolution or ParametricConfig.resolution,
    )
    frame = square_around(subject.plan, arguments.size) if arguments.size else None
    map_frame = square_around(subject.plan, arguments.resize) if arguments.resize else None
    path = _path(subject, arguments, rng, None)
    began = time.process_time()
    result = deform(subject.plan, path, config, rng, frame, map_frame)
    return _drawn(result, config.method, to_dict(config), time.process_time() - began)


def _generated(subject: Subject, arguments: DeformArguments, rng: np.random.Generator) -> DrawnMap:
    env = subject.settings.env
    if arguments.resolution is not None:
        env = replace(env, slam=replace(env.slam, resolution=arguments.resolution))
    # The furniture of a recipe may stand on a path that somebody else planned.
    clutter = None if arguments.trajectory else furnished(subject.plan, env, subject.seed)
    path = _path(subject, arguments, rng, clutter)
    began = time.process_time()
    result = map_along_path(subject.plan, path, env, rng, clutter)
    return _drawn(result, "generator", to_dict(env), time.process_time() - began)


def furnished(plan: FloorPlan, env: ExploreConfig, seed: int) -> Clutter | None:
    """What stands in a building in the exploration of this seed; None for nothing."""
    if env.clutter.is_empty:
        return None
    return make_clutter(
        plan, Streams.spawn(np.random.default_rng(seed)).clutter, env.clutter, env.robot
    )


def _drawn(
    result: Deformation, method: str, config: dict[str, Any], cpu_seconds: float
) -> DrawnMap:
    seconds = float(np.ptp(result.true.stamps))
    is_floor = result.cad.cells == FREE
    outcome = Outcome(
        finished="deformed",
        coverage=float(result.seen[is_floor].mean()),
        robot_seconds=seconds,
        time_limit=seconds,
        start=Pose2D(*result.true.poses[0].tolist()),
        truth=result.true,
        odometry=result.odometry,
        estimate=result.believed,
        final_estimate=Pose2D(*result.believed.poses[-1].tolist()),
    )
    parameters = {"method": method, "drawn": result.parameters, "config": config}
    return DrawnMap(result.grid, result.cad, result.field, outcome, parameters, cpu_seconds)


def _without_path(
    subject: Subject,
    arguments: DeformArguments,
    rng: np.random.Generator,
    translator: LearnedTranslator | None,
) -> DrawnMap:
    """Methods ``modelprog`` and ``elastic``."""
    plan = subject.plan
    resolution = arguments.resolution or ParametricConfig.resolution
    cad = plan.raster(resolution, GridFrame.covering(plan.bounds, resolution, 0.5))
    if translator is None:
        from slamgym.gan.translation.elastic import bend_with_field

        cells, field = bend_with_field(cad.cells, resolution, rng)
    else:
        field = None
        # The network has no dice: the first map is the plan's, the others are of the plan bent as drift would.
        drift = rng if subject.slot.repetition else None
        cells = translator.translate_cells(cad.cells, resolution, drift=drift)
    point = plan.free_space.representative_point()
    unknown_path = Trajectory(np.empty(0), np.empty((0, 3)))
    outcome = Outcome(
        finished="deformed",
        coverage=1.0,
        robot_seconds=0.0,
        time_limit=0.0,
        start=Pose2D(point.x, point.y, 0.0),
        truth=unknown_path,
        odometry=unknown_path,
        estimate=unknown_path,
        final_estimate=Pose2D(0.0, 0.0, 0.0),
    )
    return DrawnMap(OccupancyGrid(cells, cad.frame), cad, field, outcome, {})


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


def _path(
    subject: Subject, arguments: DeformArguments, rng: np.random.Generator, clutter: Clutter | None
) -> Trajectory:
    plan = subject.plan
    robot = subject.settings.env.robot
    if arguments.trajectory is not None:
        return trajectory_from_file(arguments.trajectory, plan, robot)
    if subject.driven is not None:
        check_recorded(subject.driven)
        return subject.driven
    path = plan_trajectory(plan, rng, arguments.prm_kind, robot, clutter)
    last = max(2, int(np.searchsorted(path.stamps, time_limit(plan, subject.settings.minutes))))
    path = Trajectory(path.stamps[:last], path.poses[:last])
    left_out = rooms_left_out(plan, path) if arguments.prm_kind == "tour" else []
    if left_out:
        say(f"{plan.id}: the tour leaves out {', '.join(left_out)}")
    return path
