"""Observations of a policy: the robot's map, its scan, its believed pose, its measured velocity, the clock.

Everything here comes from the mapper, the scanner and the wheels. Nothing takes a floor plan or a true pose.
"""

import math
from typing import Any, NamedTuple, Protocol

import numpy as np
from gymnasium import spaces

from slamgym.core.jit import kernel
from slamgym.core.types import (
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    Float32Array,
    GridFrame,
    Observation,
    Pose2D,
    Twist2D,
)
from slamgym.envs.compact import CompactObserver, MapTiles
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
    space = Measurements(config).space
    return space["map"] if config.observation.preset == "map" else space


class Measurements:
    """Observations of the preset ``dict``, of one robot or of many.

    Attributes:
        space: Of one robot's.
    """

    def __init__(self, config: ExploreConfig) -> None:
        extent = np.array([FURTHEST, FURTHEST, math.pi], dtype=np.float32)
        speed = 2.0 * np.array([config.robot.max_linear, config.robot.max_angular], dtype=np.float32)
        steps, longest = config.max_steps, np.finfo(np.float32).max
        limit = longest if steps is None else steps * config.control_step
        range_max, num_beams = config.lidar.range_max, config.lidar.num_beams
        self.space = spaces.Dict(
            {
                "map": spaces.Box(0, 255, config.observation.shape, np.uint8),
                "scan": spaces.Box(0.0, range_max, (num_beams,), np.float32),
                "pose": spaces.Box(-extent, extent, dtype=np.float32),
                "velocity": spaces.Box(-speed, speed, dtype=np.float32),
                "time": spaces.Box(0.0, np.float32(limit), (1,), np.float32),
            }
        )
        self._range_max = np.float32(range_max)
        self._extent, self._speed = extent, speed

    def observe(
        self, cells: ByteArray, ranges: Float32Array, pose: Any, velocity: Any, time: Any
    ) -> Observation:
        """Put observations together; with many robots each argument has a row for each.

        Args:
            cells: The map as observed, shape (1, H, W).
            ranges: The scan, shape (num_beams,). No return becomes the largest range, and too near to measure 0.
            pose: Believed pose, map frame; cut off at :data:`FURTHEST`.
            velocity: Measured velocity; cut off at twice the robot's limits.
            time: Robot time, shape (1,) [s].
        """
        return {
            "map": cells,
            "scan": np.maximum(np.minimum(ranges, self._range_max), np.float32(0.0)),
            "pose": _within(pose, self._extent),
            "velocity": _within(velocity, self._speed),
            "time": np.array(time, dtype=np.float32),
        }


def _within(values: Any, limits: Float32Array) -> Float32Array:
    """Values in single precision, cut off at plus and minus their limits."""
    single: Float32Array = np.array(values, dtype=np.float32)
    return np.minimum(np.maximum(single, -limits, out=single), limits, out=single)


class SensedStep(NamedTuple):
    """Observations at the end of a step."""

    mapper: Mapper
    ranges: Float32Array  # of the scan, shape (num_beams,) [m]
    pose: Pose2D  # believed, map frame
    velocity: Twist2D  # measured
    is_new: bool  # the mapper has processed the scan
    is_published: bool  # the map is to be published again


class MapView(Protocol):
    """One episode's view of the map; what it looks at is the observation's map, or the whole one if it is compact."""

    def look(self, now: SensedStep) -> Any:
        """The map, shape (1, H, W), or a compact observation; to be called at every step."""
        ...


class GlobalView:
    """The whole map on a fixed canvas, as last published."""

    def __init__(self, config: ObservationConfig) -> None:
        self._frame = config.frame()
        self._is_shared = config.shared_map
        self._cells: ByteArray | None = None

    def look(self, now: SensedStep) -> ByteArray:
        """The canvas: if shared the very same array until the next publication, by which explorers know a new one."""
        if now.is_published or self._cells is None:
            self._cells = now.mapper.render(self._frame)[np.newaxis]
            self._cells.flags.writeable = False
        return self._cells if self._is_shared else self._cells.copy()


class EgocentricView:
    """The newest map about the robot, turned into its heading."""

    def __init__(self, config: ObservationConfig, map_resolution: float) -> None:
        self._config = config
        self._resolution = map_resolution
        self._radius_px, self._samples = window_sizes(config, map_resolution)
        self._window: ByteArray | None = None
        self._left, self._bottom, self._centre = 0.0, 0.0, (0.0, 0.0)  # of the window [m]

    def look(self, now: SensedStep) -> ByteArray:
        """A crop round the robot of the newest map, not of the last published one."""
        pose, config = now.pose, self._config
        off = math.hypot(pose.x - self._centre[0], pose.y - self._centre[1])
        if now.is_new or self._window is None or off > WINDOW_MARGIN:
            # The part of the map that the crop can need, on the map's own lattice.
            size, resolution = self._radius_px, self._resolution
            self._left = resolution * (math.floor(pose.x / resolution) - size)
            self._bottom = resolution * (math.floor(pose.y / resolution) - size)
            self._centre, side = (pose.x, pose.y), 2 * size + 1
            self._window = now.mapper.render(GridFrame(resolution, self._left, self._bottom, side, side))
        crop: ByteArray = np.empty((1, config.crop_px, config.crop_px), dtype=np.uint8)
        place, sizes = (self._left, self._bottom, self._resolution), (config.crop_resolution, self._samples)
        cut_crop(self._window, *place, *pose, *sizes, crop[0])
        return crop


class CompactView:
    """The compact observation of the newest map, or of the map as last published."""

    def __init__(self, config: ExploreConfig) -> None:
        self._observer = CompactObserver.of(config)
        self._waits = config.observation.map == "global"
        self._resolution = config.slam.resolution
        self._tiles: MapTiles | None = None

    def look(self, now: SensedStep) -> Float32Array:
        """The observation."""
        if self._tiles is None or (now.is_published if self._waits else now.is_new):
            self._tiles = MapTiles.of(*now.mapper.lattice(), self._resolution)
        if now.is_published:
            self._observer.refresh(self._tiles)
        return self._observer.observe(self._tiles, now.ranges, now.pose, now.velocity)


def make_view(config: ExploreConfig) -> MapView:
    """The view that the settings name, for one episode."""
    if config.observation.is_compact:
        return CompactView(config)
    if config.observation.map == "global":
        return GlobalView(config.observation)
    return EgocentricView(config.observation, config.slam.resolution)


def window_sizes(config: ObservationConfig, map_resolution: float) -> tuple[int, int]:
    """Cells from the middle of the egocentric window to its border, and points read along a cell of the crop."""
    # Half the diagonal of the crop, plus the margin in which the window serves again.
    radius = 0.5 * math.sqrt(2.0) * config.crop_side + WINDOW_MARGIN
    samples = max(1, math.ceil(config.crop_resolution / map_resolution - 1e-9))
    return math.ceil(radius / map_resolution) + 1, samples
