"""Hypotheses written as a dataset: what ``slamgym dataset render`` and the trainings take."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from slamgym import __version__
from slamgym.cad import write_houseexpo
from slamgym.core.config import config_hash
from slamgym.core.documents import json_text
from slamgym.core.errors import InputFileError
from slamgym.core.progress import tell
from slamgym.core.types import GridFrame, OccupancyGrid, Pose2D, Trajectory
from slamgym.dataset.curate.split import split_path
from slamgym.dataset.folder import open_dataset, stage_pair
from slamgym.dataset.format import (
    EDITION,
    FIELD_FILE,
    FORMAT_VERSION,
    Layout,
    is_dataset,
    read_dataset_config,
)
from slamgym.dataset.generate.recipe import MIXTURE
from slamgym.dataset.record import MapPair, Slot
from slamgym.interop import write_ros_map, write_tum

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.commands.deforming.arguments import DeformArguments
    from slamgym.commands.deforming.hypotheses import DrawnMap, Subject


def write_dataset(drawn: Iterable[tuple[Subject, DrawnMap]], arguments: DeformArguments) -> str:
    """Write the hypotheses as a dataset, each with a line on standard output; returns how many of what there are.

    Raises:
        InputFileError: If the folder exists with something in it and is not to be overwritten, or can't be written.
    """
    settings = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in vars(arguments).items()
        if name not in ("out", "overwrite")
    }
    config = {
        "format_version": FORMAT_VERSION,
        "edition": EDITION,
        "version": __version__,
        "deform": settings,
    }
    digest = config_hash(config)
    plan_ids: list[str] = []
    with _new_folder(arguments) as root, open_dataset(root, config) as folder:
        if is_dataset(arguments.plan) and split_path(arguments.plan).is_file():
            shutil.copy(split_path(arguments.plan), split_path(root))
        for subject, hypothesis in drawn:
            slot = subject.slot
            outcome = hypothesis.outcome
            frame = _moved(hypothesis.grid.frame, outcome.start)
            pair = MapPair(hypothesis.cad.cells, hypothesis.grid.cells, frame)
            conditions = {
                "method": arguments.method,
                "explorer": subject.settings.explorer if subject.driven else "roadmap",
                MIXTURE: subject.recipe,
            }
            write = partial(_write_episode, plan=subject.plan, hypothesis=hypothesis, frame=frame)
            staged = folder.stage(slot.name)
            stage_pair(staged, write, slot, subject.plan, pair, outcome, conditions, digest)
            folder.commit(slot, staged, {})
            plan_ids.append(slot.plan_id)
            tell(_summary(slot, hypothesis))
    plans = set(plan_ids)
    return f"{len(plan_ids)} map(s) of {plan_ids[0] if len(plans) == 1 else f'{len(plans)} plans'}"


def _check_folder(root: Path, is_replaced: bool) -> None:
    """Refuse a folder that holds what ``slamgym deform`` didn't write, or may not be replaced."""
    if root.resolve() == Path.cwd():
        raise InputFileError(root, "is the folder that you are in; name one inside it")
    if not root.exists() or (root.is_dir() and not any(root.iterdir())):
        return
    if not Layout(root).config.is_file() or "deform" not in read_dataset_config(root):
        raise InputFileError(root, "holds no dataset of `slamgym deform`; choose a new folder")
    if not is_replaced:
        raise InputFileError(root, "exists already; give --overwrite to replace it")


@contextmanager
def _new_folder(arguments: DeformArguments) -> Iterator[Path]:
    """A folder to fill, which appears whole if the block ends well, or not at all."""
    root = arguments.out
    _check_folder(root, arguments.overwrite)
    part = root.with_name(f".{root.name}.{os.getpid()}.part")
    try:
        part.mkdir(parents=True)
        yield part
        if root.is_dir():
            shutil.rmtree(root)
        part.replace(root)
    except OSError as error:
        raise InputFileError(root, f"can't be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _displacement(hypothesis: DrawnMap) -> dict[str, float]:
    """Distance of the map's walls from their place: rms, 95th percentile and largest [m]; nothing if not known."""
    if hypothesis.field is None:
        return {}
    length = np.hypot(*hypothesis.field)[hypothesis.grid.cells == 0]
    if len(length) == 0:
        length = np.zeros(1)
    return {
        "rms": float(np.sqrt(np.mean(length**2))),
        "p95": float(np.percentile(length, 95)),
        "max": float(length.max()),
    }


def _summary(slot: Slot, hypothesis: DrawnMap) -> str:
    parts = ["drawn"]
    truth = hypothesis.outcome.truth
    if len(truth):
        parts = [
            f"{truth.length:.1f} m driven, {len(truth)} scans",
            f"{hypothesis.parameters['method']} took {hypothesis.cpu_seconds:.3f} s",
        ]
    moved = _displacement(hypothesis)
    if moved:
        parts.append(f"walls displaced {moved['rms']:.3f} m rms, {moved['max']:.3f} m at most")
    return f"{slot.name}: {', '.join(parts)}"


def _write_episode(folder: Path, plan: FloorPlan, hypothesis: DrawnMap, frame: GridFrame) -> None:
    """``plan.json`` (world frame), the map and the paths (map frame), and what else the hypothesis knows.

    ``cad.png``: the plan on the map's frame; ``field.npz``: the displacement field (2, H, W) float32 [m], x and y, true
    minus measured, out(q) = in(q + d(q)); ``parameters.json``: what was drawn, the settings.
    """
    write_houseexpo(folder / "plan.json", plan)
    write_ros_map(folder, OccupancyGrid(hypothesis.grid.cells, frame))
    cv2.imwrite(str(folder / "cad.png"), hypothesis.cad.cells)
    outcome = hypothesis.outcome
    offset = np.array([*outcome.start[:2], 0.0])
    paths = {"truth": outcome.truth, "odometry": outcome.odometry, "estimate": outcome.estimate}
    for name, path in paths.items() if len(outcome.truth) else ():
        write_tum(folder / f"{name}.tum", Trajectory(path.stamps, path.poses - offset))
    if hypothesis.field is not None:
        np.savez_compressed(folder / FIELD_FILE, field=hypothesis.field)
    record = {**hypothesis.parameters, "displacement_m": _displacement(hypothesis)}
    (folder / "parameters.json").write_text(json_text(record), encoding="utf-8")


def _moved(frame: GridFrame, start: Pose2D) -> GridFrame:
    """A frame of the world in the map frame, whose origin is the start."""
    return frame._replace(origin_x=frame.origin_x - start.x, origin_y=frame.origin_y - start.y)
