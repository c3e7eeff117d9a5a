"""Observations of a policy: the robot's map, its scan, its believed pose, its measured velocity, the clock.

Everything here comes from the mapper, the scanner and the wheels. Nothing takes a floor plan or a true pose.
"""

import math
from typing import Any, NamedTuple, Protocol

import numpy as np
from gymnasium import spaces

from slamgym.core.jit import kernel
from slamgym.core.types import (
    UNKNOWN,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    Observation,
    OccupancyGrid,
    Pose2D,
    Twist2D,
)
from slamgym.envs.compact import CompactObserver, MapTiles
from slamgym.envs.config import ExploreConfig, ObservationConfig
from slamgym.envs.turned_reading import Tiles, fetch_rows, line_table, read_turned, turned_grid


@kernel
def cut_crop(tiles: Tiles, pose: FloatArray, pitch: float, samples: int, out: ByteArray) -> None:
    """Read a map on a grid that stands on the robot and looks where it looks; unknown beyond the map.

    Each cell of the crop is read at ``samples`` x ``samples`` points; occupied wins over free and free over
    unknown.

    Args:
        tiles: The map: :class:`MapTiles` without names.
        pose: The robot in the map frame, shape (3,) [m, m, rad].
        pitch: Distance of the points [cells].
        samples: Points per side of a crop cell.
        out: Receives the crop, shape (h, w).
    """
    height, width = out.shape
    cols = tiles[0].shape[1]
    flat = tiles[0].reshape(-1)
    known = tiles[3]
    num_points = width * samples
    last = height * samples - 1, num_points - 1
    first, down, right = turned_grid(tiles, pose, pitch, last)
    table = line_table(cols, right, width, samples)
    read = np.empty((samples, num_points), np.uint8)
    # Values less one: of these occupied is the largest, then free.
    best = np.empty(num_points, np.uint8)
    fetch_rows(flat, cols, known, (first, down, right), last, read)
    for i in range(height):
        out[i] = UNKNOWN
        line = i * samples
        begin = first[0] + line * down[0], first[1] + line * down[1]
        if not read_turned(flat, cols, known, (begin, down, right), samples, table, read):
            continue
        best[:] = np.uint8(UNKNOWN - 1)
        for a in range(samples):
            for b in range(num_points):
                best[b] = max(best[b], np.uint8(read[a, b] - np.uint8(1)))
        for k in range(1, samples):
            for j in range(width):
                best[j] = max(best[j], best[np.uint64(k * width + j)])
        for j in range(width):
            out[i, j] = np.uint8(best[j] + np.uint8(1))


FURTHEST = 1000.0
"""Believed positions are cut off here [m], because Gymnasium wants bounds."""


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
        robot = config.robot
        lidar = config.lidar
        extent = np.array([FURTHEST, FURTHEST, math.pi], dtype=np.float32)
        speed = 2.0 * np.array([robot.max_linear, robot.max_angular], dtype=np.float32)
        time_limit: Any = np.finfo(np.float32).max
        if config.max_steps is not None:
            time_limit = config.max_steps * config.control_step
        self.space = spaces.Dict(
            {
                "map": spaces.Box(0, 255, config.observation.shape, np.uint8),
                "scan": spaces.Box(0.0, lidar.range_max, (lidar.num_beams,), np.float32),
                "pose": spaces.Box(-extent, extent, dtype=np.float32),
                "velocity": spaces.Box(-speed, speed, dtype=np.float32),
                "time": spaces.Box(0.0, np.float32(time_limit), (1,), np.float32),
            }
        )
        self._range_max = np.float32(lidar.range_max)
        self._extent = extent
        self._speed = speed

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
        shorter = np.minimum(ranges, self._range_max)
        return {
            "map": cells,
            "scan": np.maximum(shorter, np.float32(0.0)),
            "pose": _within(pose, self._extent),
            "velocity": _within(velocity, self._speed),
            "time": np.array(time, dtype=np.float32),
        }


def _within(values: Any, limits: Float32Array) -> Float32Array:
    """Values in single precision, cut off at plus and minus their limits."""
    single: Float32Array = np.array(values, dtype=np.float32)
    np.maximum(single, -limits, out=single)
    np.minimum(single, limits, out=single)
    return single


class ShownMap(Protocol):
    """What is read of a mapper's map."""

    def lattice(self) -> tuple[ByteArray, tuple[int, int]]:
        """See :meth:`slamgym.slam.Mapper.lattice`."""
        ...

    def occupancy_grid(self) -> OccupancyGrid:
        """See :meth:`slamgym.slam.Mapper.occupancy_grid`."""
        ...

    def render(self, frame: GridFrame) -> ByteArray:
        """See :meth:`slamgym.slam.Mapper.render`."""
        ...


class SensedStep(NamedTuple):
    """Observations at the end of a step."""

    mapper: ShownMap
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
        self._side = config.crop_px
        self._resolution = map_resolution
        self._pitch, self._samples = crop_points(config, map_resolution)
        self._tiles: MapTiles | None = None

    def look(self, now: SensedStep) -> ByteArray:
        """A crop round the robot of the newest map, not of the last published one."""
        if now.is_new or self._tiles is None:
            cells, corner = now.mapper.lattice()
            known = 0, 0, *cells.shape
            cells = np.ascontiguousarray(cells)
            self._tiles = MapTiles(cells, corner, self._resolution, known)
        crop: ByteArray = np.empty((1, self._side, self._side), dtype=np.uint8)
        cut_crop(self._tiles[:], np.array(now.pose), self._pitch, self._samples, crop[0])
        return crop


class CompactView:
    """The compact observation of the newest map, or of the map as last published."""

    def __init__(self, config: ExploreConfig) -> None:
        self._observer = CompactObserver.of(config)
        self._waits_for_publication = config.observation.map == "global"
        self._resolution = config.slam.resolution
        self._tiles: MapTiles | None = None

    def look(self, now: SensedStep) -> Float32Array:
        """The observation."""
        has_changed = now.is_published if self._waits_for_publication else now.is_new
        if self._tiles is None or has_changed:
            cells, corner = now.mapper.lattice()
            self._tiles = MapTiles.of(cells, corner, self._resolution)
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


def crop_points(config: ObservationConfig, map_resolution: float) -> tuple[float, int]:
    """Distance of the points at which a crop is read [cells], and how many are along a cell of the crop."""
    samples = max(1, math.ceil(config.crop_resolution / map_resolution - 1e-9))
    return config.crop_resolution / (samples * map_resolution), samples
