"""What ``slamgym deform`` draws maps of: plans of a source, or the pairs of a dataset."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slamgym.cad.plan_filter import passes
from slamgym.cad.plan_index import PlanSource
from slamgym.cad.sources import open_plans
from slamgym.core.config import from_dict, suggest
from slamgym.core.errors import ConfigError, InputFileError, PlanError
from slamgym.core.names import exploration_seed
from slamgym.core.types import FREE, Trajectory
from slamgym.dataset.format import Layout, is_dataset, read_dataset_config, read_manifest
from slamgym.dataset.generate.recipe import apply_conditions
from slamgym.dataset.record import PairRecord, Slot
from slamgym.envs.episode import EpisodeConfig

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.commands.deforming.arguments import DeformArguments


@dataclass(frozen=True)
class Subject:
    """A hypothesis before it is drawn."""

    slot: Slot
    plan: FloorPlan
    driven: Trajectory | None = None
    """The recorded true path, world frame; None to plan one."""
    recorded: EpisodeConfig | None = None
    """The settings of the recorded exploration."""


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
    for place, plan in enumerate(_plans(arguments)):
        for repetition in range(arguments.count):
            number = place * arguments.count + repetition
            yield Subject(_slot(arguments, number, plan.id, repetition), plan)


def load_plan(source: PlanSource, plan_id: str, resolution: float) -> FloorPlan:
    """A plan that has a free cell."""
    plan = source.load(plan_id)
    if not (plan.raster(resolution).cells == FREE).any():
        raise PlanError(plan.id, "has no free cell; use a finer --resolution or another plan")
    return plan


def _plans(arguments: DeformArguments) -> Iterator[FloorPlan]:
    source = open_plans(arguments.plan)
    if arguments.plan_id is not None:
        if arguments.plan_id not in source.ids:
            raise ConfigError(
                f"{arguments.plan} has no plan {arguments.plan_id!r}; {suggest(arguments.plan_id, source.ids)}"
            )
        yield load_plan(source, arguments.plan_id, arguments.resolution)
    elif arguments.plans == 1 and arguments.plans_filter == "none":
        yield load_plan(source, source.ids[0], arguments.resolution)
    else:
        yield from islice(_usable_plans(source, arguments), arguments.plans)


def _usable_plans(source: PlanSource, arguments: DeformArguments) -> Iterator[FloorPlan]:
    found = 0
    for plan_id in source.ids:
        try:
            plan = load_plan(source, plan_id, arguments.resolution)
        except PlanError:
            continue
        if passes(plan, arguments.plans_filter):
            found += 1
            yield plan
    if not found:
        raise ConfigError(
            f"none of the {len(source)} plans of {arguments.plan} can be used; "
            "give other plans or another --plans-filter"
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
            slot = _slot(arguments, number, record.plan_id, record.repetition * arguments.count + repetition)
            yield Subject(slot, plan, driven, settings)


def recorded_settings(root: Path) -> EpisodeConfig:
    """What all explorations of a dataset have in common; the conditions of a pair come on top.

    Raises:
        InputFileError: If it isn't a dataset of explorations.
    """
    try:
        return from_dict(EpisodeConfig, read_dataset_config(root)["episode"])
    except (ConfigError, KeyError) as error:
        why = "give one that this version's `slamgym generate` made"
        raise InputFileError(root, f"is no dataset of explorations ({error}); {why}") from error


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
    return read_houseexpo(folder / "plan.json"), Trajectory(truth.stamps, truth.poses + np.array([x, y, 0.0]))


def _slot(arguments: DeformArguments, number: int, plan_id: str, repetition: int) -> Slot:
    return Slot(number, plan_id, repetition, exploration_seed(arguments.seed, plan_id, number))
