"""What a policy sees: the robot's map, its scan, its believed pose, its measured velocity, the clock.

Everything here comes from the mapper, the scanner and the wheels. Nothing takes a floor plan or a true pose.
"""

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from slamgym.core.jit import kernel
from slamgym.core.types import (
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    Float32Array,
    GridFrame,
    LaserScan,
    Observation,
    Pose2D,
    Twist2D,
)
from slamgym.envs.compact import CompactObserver, Lattice
from slamgym.envs.config import ExploreConfig, ObservationConfig
from slamgym.slam import Mapper

_FRACTION = 32
_ONE = float(1 << _FRACTION)


@kernel
def _cell(position: int) -> np.uint32:
    """The cell of a position; without a sign what lies before the first cell is beyond the last."""
    return np.uint32(np.uint64(position) >> np.uint64(_FRACTION))


@kernel
def cut_crop(
    cells: ByteArray,
    origin_x: float,
    origin_y: float,
    resolution: float,
    x: float,
    y: float,
    theta: float,
    crop_resolution: float,
    samples: int,
    out: ByteArray,
) -> None:
    """Read a map on a grid that stands on the robot and looks where it looks.

    Each cell of the crop is read at ``samples`` x ``samples`` points; occupied wins over free and free over
    unknown.

    Convention: ``cells`` has row 0 at the top, its origin is the lower left corner; ``x, y, theta`` is the
    robot in the frame of the cells. In the crop the robot is in the middle, ahead is up, its left is left.

    Args:
        cells: The map, shape (H, W).
        origin_x: Of the map [m].
        origin_y: Of the map [m].
        resolution: Cell size of the map [m].
        x: The robot [m].
        y: The robot [m].
        theta: Its heading [rad].
        crop_resolution: Cell size of the crop [m].
        samples: Points per side of a crop cell.
        out: Receives the crop, shape (h, w).
    """
    rows, cols = cells.shape
    flat = cells.reshape(-1)
    height, width = out.shape
    # Positions in the map in 1 / 2^32 of a cell. From sample to sample: (sin, cos) to the right in the crop,
    # (-cos, sin) down.
    step = crop_resolution / (samples * resolution) * _ONE
    cos, sin = round(step * math.cos(theta)), round(step * math.sin(theta))
    ahead, left = height * samples - 1, width * samples - 1
    first_col = round((x - origin_x) / resolution * _ONE) + (ahead * cos - left * sin) // 2
    first_row = round((rows - (y - origin_y) / resolution) * _ONE) - (ahead * sin + left * cos) // 2
    is_inside = True
    for a, b in ((0, 0), (0, left), (ahead, 0), (ahead, left)):
        col, row = first_col - a * cos + b * sin, first_row + a * sin + b * cos
        is_inside &= 0 <= row >> _FRACTION < rows and 0 <= col >> _FRACTION < cols
    places, read = np.empty(width, np.uint32), np.empty(width, np.uint8)
    least, most = np.empty(width, np.uint8), np.empty(width, np.uint8)
    for i in range(height):
        least[:], most[:] = UNKNOWN, UNKNOWN  # occupied is less than that, free is more
        for a in range(i * samples, (i + 1) * samples):
            for b in range(samples):
                col, row = first_col - a * cos + b * sin, first_row + a * sin + b * cos
                # One sample of every cell of the line: all loops but the one that reads become vector instructions.
                if is_inside:
                    for j in range(width):
                        r, c = _cell(row + j * samples * cos), _cell(col + j * samples * sin)
                        places[j] = r * np.uint32(cols) + c
                    for j in range(width):
                        read[j] = flat[places[j]]
                else:
                    for j in range(width):
                        r, c = _cell(row + j * samples * cos), _cell(col + j * samples * sin)
                        is_there = r < np.uint32(rows) and c < np.uint32(cols)
                        read[j] = flat[r * np.uint32(cols) + c] if is_there else np.uint8(UNKNOWN)
                for j in range(width):
                    least[j], most[j] = min(least[j], read[j]), max(most[j], read[j])
        for j in range(width):
            out[i, j] = least[j] if least[j] == OCCUPIED else most[j]


FURTHEST = 1000.0
"""Believed positions are cut off here [m], because Gymnasium wants bounds."""

WINDOW_MARGIN = 0.5
"""Spare width of the egocentric window, so that it is cut from the map again only every few steps [m]."""


def observation_space(config: ExploreConfig) -> spaces.Space[Any]:
    """The space of the observations of the preset."""
    if config.observation.is_compact:
        return CompactObserver.of(config).space
    space = dict_space(config)
    return space["map"] if config.observation.preset == "map" else space


def dict_space(config: ExploreConfig) -> spaces.Dict:
    """The space of the preset ``dict``."""
    extent = np.array([FURTHEST, FURTHEST, math.pi], dtype=np.float32)
    speed = 2.0 * np.array([config.robot.max_linear, config.robot.max_angular], dtype=np.float32)
    limit = np.finfo(np.float32).max if config.max_steps is None else config.max_steps * config.control_step
    return spaces.Dict(
        {
            "map": spaces.Box(0, 255, config.observation.shape, np.uint8),
            "scan": spaces.Box(0.0, config.lidar.range_max, (config.lidar.num_beams,), np.float32),
            "pose": spaces.Box(-extent, extent, dtype=np.float32),
            "velocity": spaces.Box(-speed, speed, dtype=np.float32),
            "time": spaces.Box(0.0, np.float32(limit), (1,), np.float32),
        }
    )


class Observer:
    """Makes observations that lie in :func:`dict_space`."""

    def __init__(self, config: ExploreConfig) -> None:
        space = dict_space(config)
        self._range_max = np.float32(config.lidar.range_max)
        self._pose_limit: list[float] = space["pose"].high.tolist()  # type: ignore[attr-defined]
        self._speed_limit: list[float] = space["velocity"].high.tolist()  # type: ignore[attr-defined]

    def observe(self, cells: ByteArray, scan: LaserScan, pose: Pose2D, velocity: Twist2D) -> Observation:
        """Put an observation together.

        Args:
            cells: The map as observed, shape (1, H, W).
            scan: The scan. No return becomes the largest range, and too near to measure becomes 0.
            pose: Believed pose, map frame; cut off at :data:`FURTHEST`.
            velocity: Measured velocity; cut off at twice the robot's limits.
        """
        ranges = np.minimum(scan.ranges, self._range_max)
        np.maximum(ranges, np.float32(0.0), out=ranges)
        return {
            "map": cells,
            "scan": ranges,
            "pose": _within(pose, self._pose_limit),
            "velocity": _within(velocity, self._speed_limit),
            "time": np.array([scan.stamp], dtype=np.float32),
        }


class MapView(Protocol):
    """How the map is shown."""

    def view(self, mapper: Mapper, pose: Pose2D, is_new: bool, is_publication_due: bool) -> ByteArray:
        """The observation's map, shape (1, H, W).

        Args:
            mapper: The map's source.
            pose: Believed pose, map frame.
            is_new: Whether the mapper processed a scan since the last call.
            is_publication_due: Whether the map is to be published again.
        """
        ...

    def lattice(self, mapper: Mapper, is_new: bool, is_publication_due: bool) -> Lattice:
        """The map from which compact observations are made; arguments as above."""
        ...


class GlobalView:
    """The whole map on a fixed canvas, as last published."""

    def __init__(self, config: ObservationConfig) -> None:
        self._frame = config.frame()
        self._shared = config.shared_map
        self._cells: ByteArray | None = None

    def view(self, mapper: Mapper, pose: Pose2D, is_new: bool, is_publication_due: bool) -> ByteArray:
        """The canvas as it was last published."""
        del pose, is_new  # what was processed shows at the next publication
        cells = self._published(mapper, is_publication_due)
        return cells if self._shared else cells.copy()

    def lattice(self, mapper: Mapper, is_new: bool, is_publication_due: bool) -> Lattice:
        """The canvas."""
        del is_new
        return Lattice.of(self._published(mapper, is_publication_due)[0], self._frame)

    def _published(self, mapper: Mapper, is_due: bool) -> ByteArray:
        """The very same array until the next publication, by which explorers know a new one."""
        if is_due or self._cells is None:
            cells = mapper.render(self._frame)
            cells.flags.writeable = False
            self._cells = cells[np.newaxis]
        return self._cells


class EgocentricView:
    """The map about the robot, turned into its heading."""

    def __init__(self, config: ObservationConfig, map_resolution: float) -> None:
        self._config = config
        self._resolution = map_resolution
        self._radius_px, self._samples = window_sizes(config, map_resolution)
        self._lattice: Lattice | None = None
        self._window: ByteArray | None = None
        self._window_frame = GridFrame(map_resolution, 0.0, 0.0, 1, 1)
        self._window_centre = (0.0, 0.0)

    def view(self, mapper: Mapper, pose: Pose2D, is_new: bool, is_publication_due: bool) -> ByteArray:
        """A crop round the robot of the newest map, not of the last published one."""
        del is_publication_due
        off = math.hypot(pose.x - self._window_centre[0], pose.y - self._window_centre[1])
        if is_new or self._window is None or off > WINDOW_MARGIN:
            self._window = self._cut_window(mapper, pose)
        window, frame, config = self._window, self._window_frame, self._config
        crop: ByteArray = np.empty((1, config.crop_px, config.crop_px), dtype=np.uint8)
        cut_crop(
            window, frame.origin_x, frame.origin_y, frame.resolution, pose.x, pose.y, pose.theta,
            config.crop_resolution, self._samples, crop[0],
        )  # fmt: skip
        return crop

    def lattice(self, mapper: Mapper, is_new: bool, is_publication_due: bool) -> Lattice:
        """The newest map."""
        del is_publication_due
        if is_new or self._lattice is None:
            self._lattice = Lattice(*mapper.lattice(), self._resolution, True)
        return self._lattice

    def _cut_window(self, mapper: Mapper, pose: Pose2D) -> ByteArray:
        """The part of the map that the crop can need, on the map's own lattice."""
        size, resolution = self._radius_px, self._resolution
        col, row = math.floor(pose.x / resolution) - size, math.floor(pose.y / resolution) - size
        self._window_centre = (pose.x, pose.y)
        self._window_frame = GridFrame(
            resolution, col * resolution, row * resolution, 2 * size + 1, 2 * size + 1
        )
        return mapper.render(self._window_frame)


def window_sizes(config: ObservationConfig, map_resolution: float) -> tuple[int, int]:
    """Cells from the middle of the egocentric window to its border, and points read along a cell of the crop."""
    # Half the diagonal of the crop, plus the margin in which the window serves again.
    radius = 0.5 * math.sqrt(2.0) * config.crop_side + WINDOW_MARGIN
    samples = max(1, math.ceil(config.crop_resolution / map_resolution - 1e-9))
    return math.ceil(radius / map_resolution) + 1, samples


def make_view(config: ExploreConfig) -> MapView:
    """The view that the settings name, for one episode."""
    if config.observation.map == "global":
        return GlobalView(config.observation)
    return EgocentricView(config.observation, config.slam.resolution)


def _within(values: Sequence[float], limits: Sequence[float]) -> Float32Array:
    """Values cut off at plus and minus their limits, which single precision holds exactly."""
    cut = [min(max(value, -limit), limit) for value, limit in zip(values, limits, strict=True)]
    return np.array(cut, dtype=np.float32)
