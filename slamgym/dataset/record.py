"""A pair of maps: its images, and its record, where each column of the manifest is declared, filled, and written.

A new column is a field of :class:`PairRecord` and its value in :func:`make_record`, which describes simulated and
deformed maps alike; files of lines, tables and Parquet follow from the two. Rendered images take over some columns in
:meth:`~slamgym.dataset.images.format.ImageRecord.of_pair`.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from typing_extensions import Self

from slamgym import __version__
from slamgym.core.config import (
    Counted,
    Measured,
    Positive,
    Settings,
    Share,
    Within,
    from_dict,
    to_dict,
)
from slamgym.core.documents import parse_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.names import FileName, as_file_name
from slamgym.core.types import UNKNOWN, ByteArray, GridFrame, OccupancyGrid, Pose2D, Trajectory

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan
    from slamgym.envs.episode import Episode

GOOD_COVERAGE = 0.95
"""Share of the reachable floor from which an exploration counts as complete."""
MAX_SLOTS = 10**8
"""Explorations of a dataset; a set of slots takes a byte each."""
_DIGITS = 6
"""Decimals of the figures: more than any of them means, fewer than a float has."""


class PairConfig(Settings, section="pair"):
    """Settings for making the images."""

    margin: Annotated[float, Within(ge=0.0, lt=100.0)] = 0.5
    """Free border around plan and SLAM map [m]."""


@dataclass(frozen=True)
class MapPair:
    """Two aligned images of one place."""

    cad: ByteArray  # (rows, cols): 0 walls and outside, 254 inside
    slam: ByteArray  # (rows, cols): 0 occupied, 205 unknown, 254 free
    frame: GridFrame  # of both, map frame


def make_pair(
    plan: FloorPlan, start: Pose2D, slam_map: OccupancyGrid, config: PairConfig
) -> MapPair:
    """Draw the plan and place the SLAM map in the smallest common frame.

    The SLAM map's cells are copied, never resampled: the plan is drawn onto the SLAM map's own lattice.

    Args:
        plan: The floor plan, world frame.
        start: Where the robot began, world frame: the origin of the map frame.
        slam_map: The robot's map, map frame.
        config: The border.

    Convention: a world point is ``(start.x, start.y) + map point``; both images share ``frame``, row 0 is at
    the top (largest y).
    """
    min_x, min_y, max_x, max_y = plan.bounds
    in_map = (min_x - start.x, min_y - start.y, max_x - start.x, max_y - start.y)
    frame = common_frame(in_map, slam_map.frame, config.margin)
    cad = plan.raster(frame.resolution, frame=frame, offset=(start.x, start.y))
    return MapPair(cad=cad.cells, slam=place(slam_map, frame), frame=frame)


def common_frame(
    bounds: tuple[float, float, float, float], grid: GridFrame, margin: float
) -> GridFrame:
    """The smallest frame on the lattice of ``grid`` that covers bounds [m], the grid and a margin [m]."""
    min_x, min_y, max_x, max_y = bounds
    grid_min_x, grid_min_y, grid_max_x, grid_max_y = grid.bounds
    step = grid.resolution
    # The small number keeps a border that lies on the lattice from being pushed out by rounding.
    left = math.floor((min(min_x, grid_min_x) - margin - grid.origin_x) / step + 1e-6)
    below = math.floor((min(min_y, grid_min_y) - margin - grid.origin_y) / step + 1e-6)
    right = math.ceil((max(max_x, grid_max_x) + margin - grid.origin_x) / step - 1e-6)
    above = math.ceil((max(max_y, grid_max_y) + margin - grid.origin_y) / step - 1e-6)
    return GridFrame(
        resolution=step,
        origin_x=grid.origin_x + left * step,
        origin_y=grid.origin_y + below * step,
        height_px=above - below,
        width_px=right - left,
    )


def place(grid: OccupancyGrid, frame: GridFrame) -> ByteArray:
    """Copy a grid into a frame that covers it and shares its lattice; cells around it are unknown."""
    height, width = grid.frame.shape
    left = round((grid.frame.origin_x - frame.origin_x) / frame.resolution)
    bottom = round((grid.frame.origin_y - frame.origin_y) / frame.resolution)
    top = frame.height_px - bottom - height
    cells = np.full(frame.shape, UNKNOWN, dtype=np.uint8)
    cells[top : top + height, left : left + width] = grid.cells
    return cells


@dataclass(frozen=True)
class Slot:
    """One place in the sequence of explorations."""

    index: int
    plan_id: str
    repetition: int
    """Number of slots of the same plan before this one."""
    seed: int

    @property
    def name(self) -> str:
        """Name of the pair's files; sorts by index."""
        return as_file_name(f"{self.index:06d}_{self.plan_id}")


class ManifestLine:
    """A record that is one line of a manifest."""

    noun: ClassVar[str]
    """Name of such a record in errors."""

    def to_line(self) -> str:
        """The record as one line of JSON, with its newline."""
        return json.dumps(to_dict(self)) + "\n"

    @classmethod
    def from_line(cls, line: str, where: str = "manifest line") -> Self:
        """Read what :meth:`to_line` has made.

        Args:
            line: The line.
            where: File and number of the line, for errors.

        Raises:
            InputFileError: If the line is no such record.
        """
        try:
            return from_dict(cls, parse_json(line, where))
        except ConfigError as error:
            raise InputFileError(where, f"is not {cls.noun} ({error})") from error


@dataclass(frozen=True)
class PairRecord(ManifestLine):
    """One line of the manifest: where a pair comes from and how good it is."""

    noun = "a record of a pair"
    name: FileName
    """Stem of the files in ``A`` and ``B`` and name of the folder in ``episodes``."""
    index: Annotated[int, Within(ge=0, lt=MAX_SLOTS)]
    """Place in the sequence of explorations; places of rejected plans are missing."""
    plan_id: str
    plan_source: str
    """File that the plan came from, without its folder, or the generator."""
    repetition: Counted
    """Number of explorations of the same plan before this one."""
    seed: int
    """Seed of the exploration, derived from the dataset's seed, the plan id and the repetition."""
    config_hash: str
    version: str
    """Version of slamgym that made the pair."""
    explorer: str
    conditions: dict[str, Any]
    """Settings of the exploration by name (:mod:`slamgym.dataset.generate.recipe`): the usual ones and all that
    vary within the dataset."""
    finished: str
    """Why the exploration ended: ``explored``, ``stuck``, ``time_limit``, ..."""
    coverage: Share
    """Share of the reachable floor that was truly seen, 0 to 1."""
    robot_seconds: Measured
    """Time on the robot's clock [s]."""
    time_limit: Measured
    """[s]"""
    path_length: Measured
    """Metres truly driven."""
    collisions: Counted
    """Contacts with walls, furniture or people."""
    ate: Measured
    """Absolute trajectory error of the estimate: RMSE of the position against the truth, not aligned [m]."""
    odometry_ate: Measured
    """The same of the wheels' dead reckoning [m]."""
    final_position_error: Measured
    """[m]"""
    map_error: Measured
    """Mean distance of the SLAM map's occupied cells to the nearest face of a CAD wall [m]."""
    mse: Measured
    """Mean squared error of B against A, free 1 and all else 0: the paper's MSE2 of Table I, not aligned."""
    area: Measured
    """Free area of the plan [m2]."""
    rooms: Counted
    resolution: Positive
    """[m/pixel]"""
    origin: tuple[float, float]
    """Outer corner of the images' bottom-left pixel, map frame [m]."""
    shape: tuple[int, int]
    """(rows, cols) of the images."""
    start: tuple[float, float, float]
    """Where the robot began, world frame: x [m], y [m], theta [rad]."""
    sha256: dict[str, str]
    """Digests of ``A`` and ``B`` (the PNG files) and ``episode`` (the episode's ``SHA256SUMS``)."""

    @property
    def frame(self) -> GridFrame:
        """Where the images' pixels lie, map frame."""
        x, y = self.origin
        height, width = self.shape
        return GridFrame(self.resolution, x, y, height, width)

    @property
    def slot(self) -> Slot:
        """Its place in the schedule."""
        return Slot(self.index, self.plan_id, self.repetition, self.seed)


@dataclass(frozen=True)
class Outcome:
    """Origin of a map that wasn't explored: the fields of an :class:`~slamgym.envs.episode.Episode` that records use.

    Trajectories are in the map frame; without poses they aren't known.
    """

    finished: str
    coverage: float
    robot_seconds: float
    time_limit: float
    start: Pose2D  # world frame
    truth: Trajectory
    odometry: Trajectory
    estimate: Trajectory
    final_estimate: Pose2D
    collisions: int = 0


def make_record(
    slot: Slot,
    plan: FloorPlan,
    pair: MapPair,
    outcome: Outcome | Episode,
    files: Mapping[str, bytes],
    conditions: Mapping[str, Any],
    settings_hash: str,
) -> PairRecord:
    """Judge a map against the truth and describe it.

    Args:
        slot: Its place in the schedule.
        plan: The building.
        pair: Its images.
        outcome: How the map came about.
        files: Contents of the files that the record vouches for, by name: ``A``, ``B``, ``episode``.
        conditions: The conditions of the exploration.
        settings_hash: Hash of the dataset's settings.
    """
    from slamgym.metrics import absolute_trajectory_error, free_space, squared_error, wall_error

    frame = pair.frame
    start = outcome.start
    truth = outcome.truth

    def error_of(path: Trajectory) -> float:
        if len(truth) == 0:
            return 0.0
        return _rounded(absolute_trajectory_error(path, truth, align=False).translation.rmse)

    believed = outcome.final_estimate
    last = truth.poses[-1] if len(truth) else believed
    final_error = np.hypot(believed[0] - last[0], believed[1] - last[1])
    origin = (_rounded(frame.origin_x), _rounded(frame.origin_y))
    return PairRecord(
        name=slot.name,
        index=slot.index,
        plan_id=slot.plan_id,
        repetition=slot.repetition,
        seed=slot.seed,
        plan_source=plan.source.rpartition("/")[2],
        config_hash=settings_hash,
        version=__version__,
        explorer=conditions["explorer"],
        conditions=dict(conditions),
        finished=outcome.finished,
        coverage=_rounded(outcome.coverage),
        robot_seconds=_rounded(outcome.robot_seconds),
        time_limit=_rounded(outcome.time_limit),
        path_length=_rounded(truth.length),
        collisions=outcome.collisions,
        ate=error_of(outcome.estimate),
        odometry_ate=error_of(outcome.odometry),
        final_position_error=_rounded(final_error),
        map_error=_rounded(wall_error(pair.slam, pair.cad, frame.resolution)),
        mse=_rounded(squared_error(free_space(pair.slam), free_space(pair.cad))),
        area=_rounded(plan.area),
        rooms=len(plan.rooms),
        resolution=frame.resolution,
        origin=origin,
        shape=frame.shape,
        start=(_rounded(start.x), _rounded(start.y), _rounded(start.theta)),
        sha256={side: hashlib.sha256(data).hexdigest() for side, data in files.items()},
    )


def _rounded(value: float) -> float:
    return round(float(value), _DIGITS)
