"""Hypotheses written as a dataset: what ``slamgym dataset render`` and the trainings take."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from slamgym import __version__
from slamgym.cad import write_houseexpo
from slamgym.core.errors import InputFileError
from slamgym.core.pictures import encode_png
from slamgym.core.types import GridFrame, OccupancyGrid, Pose2D, Trajectory
from slamgym.dataset.curate.split import split_path
from slamgym.dataset.format import FIELD_FILE, FORMAT_VERSION, SIDES, SUMS, Layout, digest_lines, is_dataset
from slamgym.dataset.pair import MapPair
from slamgym.dataset.record import Outcome, Slot, make_record
from slamgym.interop import write_ros_map, write_tum
from slamgym.viz.canvas import write_picture
from slamgym.viz.sheets import draw_deformation

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.commands.deforming.arguments import DeformArguments
    from slamgym.commands.deforming.hypotheses import DrawnMap
    from slamgym.commands.deforming.subjects import Subject


class DeformedDataset:
    """A dataset of hypotheses that is being written.

    Args:
        root: An empty folder.
        arguments: How they are made.
    """

    def __init__(self, root: Path, arguments: DeformArguments) -> None:
        self._layout = Layout(root)
        self._arguments = arguments
        settings = {
            name: str(value) if isinstance(value, Path) else value
            for name, value in vars(arguments).items()
            if name not in ("out", "overwrite", "figures")
        }
        config = {"format_version": FORMAT_VERSION, "version": __version__, "deform": settings}
        self._hash = hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:12]
        self._layout.config.write_text(json.dumps(config, indent=1) + "\n", encoding="utf-8")
        for side in SIDES:
            (root / side).mkdir()
        self.count = 0
        self._plan_ids: dict[str, None] = {}
        if is_dataset(arguments.plan) and split_path(arguments.plan).is_file():
            shutil.copy(split_path(arguments.plan), split_path(root))

    def add(self, subject: Subject, hypothesis: DrawnMap) -> str:
        """Write one, and say so in a line."""
        slot, plan = subject.slot, subject.plan
        frame = _moved(hypothesis.grid.frame, hypothesis.start)
        images = {"A": encode_png(hypothesis.cad.cells), "B": encode_png(hypothesis.grid.cells)}
        folder = self._layout.episode(slot.name)
        folder.mkdir(parents=True)
        _write_episode(folder, plan, hypothesis, frame)
        sums = digest_lines(folder)
        (folder / SUMS).write_bytes(sums)
        files = {**images, "episode": sums}
        pair = MapPair(hypothesis.cad.cells, hypothesis.grid.cells, frame)
        conditions = self._conditions(subject)
        record = make_record(slot, plan, pair, _outcome(hypothesis), files, conditions, self._hash)
        line = record.to_line()
        (folder / "episode.json").write_text(line, encoding="utf-8")
        for side in SIDES:
            self._layout.image(side, slot.name).write_bytes(images[side])
        with self._layout.manifest.open("a", encoding="utf-8") as manifest:
            manifest.write(line)
        self.count += 1
        self._plan_ids[slot.plan_id] = None
        return _summary(slot, hypothesis)

    @property
    def of_what(self) -> str:
        """The plan, or how many there are."""
        return next(iter(self._plan_ids)) if len(self._plan_ids) == 1 else f"{len(self._plan_ids)} plans"

    def _conditions(self, subject: Subject) -> dict[str, Any]:
        arguments, recorded = self._arguments, subject.recorded
        return {
            "method": arguments.method,
            "explorer": recorded.explorer if recorded else arguments.explorer or "roadmap",
            "recipe": arguments.recipe or "",
        }


@contextmanager
def open_new_dataset(root: Path, arguments: DeformArguments) -> Iterator[DeformedDataset]:
    """A dataset to fill; the folder appears whole at the end, or not at all."""
    with staged_folder(root, arguments.overwrite) as folder:
        yield DeformedDataset(folder, arguments)


@contextmanager
def staged_folder(folder: Path, overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary folder to fill; move it to ``folder`` if the block ends well, else remove it.

    Raises:
        InputFileError: If the folder exists with something in it and ``overwrite`` is not set, or it can't be
            written.
    """
    if folder.exists() and not overwrite and (not folder.is_dir() or any(folder.iterdir())):
        raise InputFileError(folder, "exists already; give --overwrite to replace it")
    part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        part.mkdir(parents=True)
        yield part
        if folder.is_dir():
            shutil.rmtree(folder)
        part.replace(folder)
    except OSError as error:
        raise InputFileError(folder, f"can't be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def displacement_summary(hypothesis: DrawnMap) -> dict[str, float]:
    """How far the map's walls lie from their place: rms, 95th percentile and largest [m]; nothing if not known."""
    if hypothesis.field is None:
        return {}
    length = np.hypot(*hypothesis.field)[hypothesis.grid.cells == 0]
    if len(length) == 0:
        return {"rms": 0.0, "p95": 0.0, "max": 0.0}
    return {
        "rms": float(np.sqrt(np.mean(length**2))),
        "p95": float(np.percentile(length, 95)),
        "max": float(length.max()),
    }


def _summary(slot: Slot, hypothesis: DrawnMap) -> str:
    parts = []
    if "truth" in hypothesis.paths:
        truth = hypothesis.paths["truth"]
        parts.append(f"{truth.length:.1f} m driven, {len(truth)} scans")
    moved = displacement_summary(hypothesis)
    if moved:
        parts.append(f"walls displaced {moved['rms']:.3f} m rms, {moved['max']:.3f} m at most")
    return f"{slot.name}: {', '.join(parts) or 'drawn'}"


def _write_episode(folder: Path, plan: FloorPlan, hypothesis: DrawnMap, frame: GridFrame) -> None:
    """``plan.json`` (world frame), the map and the paths (map frame), and what the hypothesis knows beside.

    ``cad.png``: the plan on the map's frame; ``field.npz``: the displacement field (2, H, W) float32 [m], x and y, true
    minus measured, out(q) = in(q + d(q)); ``parameters.json``: what was drawn, the settings; ``overview.png``.
    """
    write_houseexpo(folder / "plan.json", plan)
    write_ros_map(folder, OccupancyGrid(hypothesis.grid.cells, frame))
    cv2.imwrite(str(folder / "cad.png"), hypothesis.cad.cells)
    offset = np.array([*hypothesis.start[:2], 0.0])
    for name, path in hypothesis.paths.items():
        write_tum(folder / f"{name}.tum", Trajectory(path.stamps, path.poses - offset))
    if hypothesis.field is not None:
        np.savez_compressed(folder / FIELD_FILE, field=hypothesis.field)
    if hypothesis.field is not None and hypothesis.paths:
        truth, estimate = (hypothesis.paths[name].poses for name in ("truth", "estimate"))
        write_picture(
            folder / "overview.png",
            draw_deformation(hypothesis.cad, hypothesis.grid, hypothesis.field, truth, estimate),
        )
    record = {**hypothesis.parameters, "displacement_m": displacement_summary(hypothesis)}
    (folder / "parameters.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def _outcome(hypothesis: DrawnMap) -> Outcome:
    """What a record says of a map that a robot might have drawn."""
    unknown = Trajectory(np.empty(0), np.empty((0, 3)))
    truth, odometry, estimate = (
        hypothesis.paths.get(name, unknown) for name in ("truth", "odometry", "estimate")
    )
    seconds = float(truth.stamps[-1] - truth.stamps[0]) if len(truth) else 0.0
    final = Pose2D(*estimate.poses[-1]) if len(estimate) else Pose2D(0.0, 0.0, 0.0)
    start = Pose2D(*hypothesis.start)
    return Outcome("deformed", hypothesis.coverage, seconds, seconds, start, truth, odometry, estimate, final)


def _moved(frame: GridFrame, start: np.ndarray) -> GridFrame:
    """A frame of the world in the map frame, whose origin is the start."""
    return GridFrame(
        frame.resolution, frame.origin_x - float(start[0]), frame.origin_y - float(start[1]), *frame.shape
    )
