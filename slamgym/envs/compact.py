"""The observation preset ``compact``: a short vector that a perceptron can learn from.

It holds the map about the robot as shares of free and occupied space in blocks, the nearest ranges of the scan, and the
measured velocity, each scaled to [-1, 1]. All of it is belief, as in the other presets.
"""

from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    Pose2D,
    Twist2D,
)
from slamgym.envs.config import ExploreConfig
from slamgym.envs.far_look import BLOCK_SIDE, FAR_SIZE, FarLook
from slamgym.envs.turned_reading import (
    CellBox,
    Tiles,
    fetch_rows,
    line_table,
    read_turned,
    turned_grid,
)

BLOCKS = 21
"""Blocks along a side of the map's crop."""
SCAN_SECTORS = 60
"""Ranges, each the nearest of some neighbouring beams; fewer where the scanner has fewer beams."""
_POINTS = 4  # along a side of a block, at which the map is read
_ONLY = np.zeros(1, dtype=np.int64)


@kernel
def write_compact(
    tiles: Tiles,
    pose: FloatArray,
    side: float,
    ranges: Float32Array,
    velocity: FloatArray,
    limits: FloatArray,
    out: Float32Array,
) -> None:
    """Write the observation.

    Convention: in the crop the robot is in the middle, ahead is up, its left is left.

    Args:
        tiles: The map: :class:`MapTiles` without names.
        pose: The robot in the map frame, shape (3,) [m, m, rad].
        side: Of the crop [m].
        ranges: The scan, shape (num_beams,) [m]; infinite where nothing returned.
        velocity: Measured, shape (2,) [m/s, rad/s].
        limits: Largest speed [m/s], largest turning rate [rad/s] and largest range [m], shape (3,).
        out: Receives the blocks' shares of free space, row by row, those of occupied space, ranges, and velocity.
    """
    _write_shares(tiles, side / (BLOCKS * _POINTS * tiles[2]), pose, out)
    groups = min(SCAN_SECTORS, len(ranges))
    begin = 2 * BLOCKS * BLOCKS
    for g in range(groups):
        nearest = limits[2]
        first = g * len(ranges) // groups
        end = (g + 1) * len(ranges) // groups
        for i in range(first, end):
            nearest = min(nearest, float(ranges[i]))
        out[begin + g] = max(nearest, 0.0) / limits[2]
    for k in range(2):
        out[begin + groups + k] = min(max(velocity[k] / limits[k], -1.0), 1.0)


@kernel
def _write_shares(tiles: Tiles, pitch: float, pose: FloatArray, out: Float32Array) -> None:
    """Write the blocks' shares of free and occupied space, read at points ``pitch`` cells apart."""
    cols = tiles[0].shape[1]
    flat = tiles[0].reshape(-1)
    known = tiles[3]
    size = BLOCKS * _POINTS
    last = size - 1
    first, down, right = turned_grid(tiles, pose, pitch, (last, last))
    table = line_table(cols, right, BLOCKS, _POINTS)
    read = np.empty((_POINTS, size), np.uint8)
    fetch_rows(flat, cols, known, (first, down, right), (last, last), read)
    free = np.empty(size, np.uint8)
    occupied = np.empty(size, np.uint8)
    for i in range(BLOCKS):
        free[:] = 0
        occupied[:] = 0
        line = i * _POINTS
        begin = first[0] + line * down[0], first[1] + line * down[1]
        if read_turned(flat, cols, known, (begin, down, right), _POINTS, table, read):
            for a in range(_POINTS):
                for b in range(size):
                    free[b] += read[a, b] == FREE
                    occupied[b] += read[a, b] == OCCUPIED
        _write_row(free, out[i * BLOCKS :])
        _write_row(occupied, out[(BLOCKS + i) * BLOCKS :])


@kernel
def _write_row(counts: ByteArray, out: Float32Array) -> None:
    """Write the shares of a row of blocks, given how many of its points count, the first of each block first."""
    share = np.float32(1.0 / (_POINTS * _POINTS))
    for j in range(BLOCKS):
        number = 0
        for k in range(_POINTS):
            number += counts[k * BLOCKS + j]
        out[j] = share * np.float32(number)


def compact_size(num_beams: int) -> int:
    """Number of values in the observation."""
    return 2 * BLOCKS * BLOCKS + min(SCAN_SECTORS, num_beams) + 2


class MapTiles(NamedTuple):
    """A map on a lattice through the origin of the map frame, made up of whole blocks of the far look."""

    cells: ByteArray  # (H, W), row 0 at the bottom, multiples of four
    corner: tuple[int, int]  # row and column of the lattice at which they begin, multiples of four
    resolution: float  # [m], of a cell
    known: CellBox  # beyond which all is unknown

    @staticmethod
    def of(cells: ByteArray, corner: tuple[int, int], resolution: float) -> "MapTiles":
        """Take cells, shape (H, W), row 0 at the bottom, that begin at a row and column of the lattice."""
        row, col = corner
        height, width = cells.shape
        below = row % BLOCK_SIDE
        left = col % BLOCK_SIDE
        above = -(below + height) % BLOCK_SIDE
        right = -(left + width) % BLOCK_SIDE
        # np.pad takes three times as long, a tenth of a step.
        shape = (below + height + above, left + width + right)
        whole: ByteArray = np.full(shape, UNKNOWN, dtype=np.uint8)
        whole[below : below + height, left : left + width] = cells
        return MapTiles(whole, (row - below, col - left), resolution, (0, 0, *whole.shape))

    @staticmethod
    def of_grid(cells: ByteArray, frame: GridFrame) -> "MapTiles":
        """Take a map (H, W) whose row 0 is at the top."""
        row = round(frame.origin_y / frame.resolution)
        col = round(frame.origin_x / frame.resolution)
        return MapTiles.of(cells[::-1], (row, col), frame.resolution)


class CompactObserver:
    """Makes observations of the presets ``compact`` and ``compact_far``.

    Args:
        num_beams: Of the scanner.
        limits: Largest speed [m/s], largest turning rate [rad/s] and largest range [m].
        side: Of the map's crop [m].
        robot_radius: Of a robot that looks far (:mod:`slamgym.envs.far_look`) [m]; None for one that doesn't.

    Attributes:
        limits: As given, shape (3,).
        side: As given [m].
        space: Of the observations.
    """

    def __init__(
        self,
        num_beams: int,
        limits: tuple[float, float, float],
        side: float,
        robot_radius: float | None = None,
    ) -> None:
        self.limits = np.array(limits, dtype=np.float64)
        self.side = side
        self._far: FarLook | None = None
        size = compact_size(num_beams)
        if robot_radius is not None:
            self._far = FarLook(1, robot_radius)
            size += FAR_SIZE
        self.space = spaces.Box(-1.0, 1.0, (size,), np.float32)

    @classmethod
    def of(cls, config: ExploreConfig) -> "CompactObserver":
        """The observer that the settings of an environment ask for."""
        lidar = config.lidar
        observation = config.observation
        robot = config.robot
        return cls(
            num_beams=lidar.num_beams,
            limits=(robot.max_linear, robot.max_angular, lidar.range_max),
            side=observation.crop_side,
            robot_radius=robot.radius if observation.preset == "compact_far" else None,
        )

    def refresh(self, published: MapTiles) -> None:
        """Look far, at a map that was published just now."""
        if self._far:
            self._far.refresh(0, published.cells, published.corner, published.resolution)

    def observe(
        self, shown: MapTiles, ranges: Float32Array, pose: Pose2D, velocity: Twist2D
    ) -> Float32Array:
        """The observation.

        Args:
            shown: The map.
            ranges: Of the scan, shape (num_beams,) [m].
            pose: Believed pose, map frame.
            velocity: Measured velocity.
        """
        out = np.empty(self.space.shape, dtype=np.float32)
        where = np.array(pose)
        write_compact(shown[:], where, self.side, ranges, np.array(velocity), self.limits, out)
        if self._far:
            self._far.write(_ONLY, where[np.newaxis], out[np.newaxis])
        return out
