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
from slamgym.dataset.record import MapPair, Outcome, Slot, make_record
from slamgym.interop import write_ros_map, write_tum
from slamgym.viz.canvas import write_picture
from slamgym.viz.sheets import draw_deformation

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.commands.deforming.arguments import DeformArguments
    from slamgym.commands.deforming.hypotheses import DrawnMap, Subject


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
            if name not in ("out", "overwrite")
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
    """A dataset to fill; the folder appears whole if the block ends well, or not at all.

    Raises:
        InputFileError: If the folder exists with something in it and is not to be overwritten, or can't be written.
    """
    if root.exists() and not arguments.overwrite and (not root.is_dir() or any(root.iterdir())):
        raise InputFileError(root, "exists already; give --overwrite to replace it")
    part = root.with_name(f".{root.name}.{os.getpid()}.part")
    try:
        part.mkdir(parents=True)
        yield DeformedDataset(part, arguments)
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
    if "truth" in hypothesis.paths:
        truth, method = hypothesis.paths["truth"], hypothesis.parameters["config"]["method"]
        parts = [
            f"{truth.length:.1f} m driven, {len(truth)} scans",
            f"{method} took {hypothesis.cpu_seconds:.3f} s",
        ]
    if moved := _displacement(hypothesis):
        parts.append(f"walls displaced {moved['rms']:.3f} m rms, {moved['max']:.3f} m at most")
    return f"{slot.name}: {', '.join(parts)}"


def _write_episode(folder: Path, plan: FloorPlan, hypothesis: DrawnMap, frame: GridFrame) -> None:
    """``plan.json`` (world frame), the map and the paths (map frame), and what else the hypothesis knows.

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
    record = {**hypothesis.parameters, "displacement_m": _displacement(hypothesis)}
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
