"""The observation preset ``compact``: a short vector that a perceptron can learn from.

It holds the map about the robot as shares of free and occupied space in blocks, the nearest ranges of the scan, and the
measured velocity, each scaled to [-1, 1]. All of it is belief, as in the other presets.
"""

import math
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

BLOCKS = 21
"""Blocks along a side of the map's crop."""
SCAN_SECTORS = 60
"""Ranges, each the nearest of some neighbouring beams; fewer where the scanner has fewer beams."""
_POINTS = 4  # along a side of a block, at which the map is read
_ONLY = np.zeros(1, dtype=np.int64)

_FRACTION = 32
_ONE = float(1 << _FRACTION)


@kernel
def write_compact(
    tiles: tuple[ByteArray, tuple[int, int], float],
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
        for i in range(g * len(ranges) // groups, (g + 1) * len(ranges) // groups):
            nearest = min(nearest, float(ranges[i]))
        out[begin + g] = max(nearest, 0.0) / limits[2]
    for k in range(2):
        out[begin + groups + k] = min(max(velocity[k] / limits[k], -1.0), 1.0)


@kernel
def _write_shares(
    tiles: tuple[ByteArray, tuple[int, int], float], pitch: float, pose: FloatArray, out: Float32Array
) -> None:
    """Write the blocks' shares of free and occupied space, read at points ``pitch`` cells apart."""
    cells, corner, resolution = tiles
    rows, cols = cells.shape
    flat = cells.reshape(-1)
    # Positions in 1 / 2^32 of a cell, exact to the lattice for any given part of the map. From point to point:
    # (sin, -cos) to the right, (-cos, -sin) down.
    cos, sin = round(pitch * _ONE * math.cos(pose[2])), round(pitch * _ONE * math.sin(pose[2]))
    last = BLOCKS * _POINTS - 1
    left = round(pose[0] / resolution * _ONE) + (last * cos - last * sin) // 2 - (corner[1] << _FRACTION)
    top = round(pose[1] / resolution * _ONE) + (last * sin + last * cos) // 2 - (corner[0] << _FRACTION)
    share = np.float32(1.0 / (_POINTS * _POINTS))
    places, read = np.empty(last + 1, np.uint32), np.empty(last + 1, np.uint8)
    is_inside = True
    for a, b in ((0, 0), (0, last), (last, 0), (last, last)):
        row, col = (top - a * sin - b * cos) >> _FRACTION, (left - a * cos + b * sin) >> _FRACTION
        is_inside &= 0 <= row < rows and 0 <= col < cols
    free, occupied = np.empty(last + 1, np.uint8), np.empty(last + 1, np.uint8)
    for i in range(BLOCKS):
        free[:], occupied[:] = 0, 0
        for a in range(i * _POINTS, (i + 1) * _POINTS):
            row, col = top - a * sin, left - a * cos
            # All loops but the one that reads become vector instructions.
            if is_inside:
                for b in range(last + 1):
                    r, c = _whole(row - b * cos), _whole(col + b * sin)
                    places[b] = r * np.uint32(cols) + c
                for b in range(last + 1):
                    read[b] = flat[places[b]]
            else:
                for b in range(last + 1):
                    r, c = _whole(row - b * cos), _whole(col + b * sin)
                    is_there = r < np.uint32(rows) and c < np.uint32(cols)
                    read[b] = flat[r * np.uint32(cols) + c] if is_there else np.uint8(UNKNOWN)
            for b in range(last + 1):
                free[b] += read[b] == FREE
                occupied[b] += read[b] == OCCUPIED
        for j in range(BLOCKS):
            num_free = num_occupied = 0
            for b in range(j * _POINTS, (j + 1) * _POINTS):
                num_free += free[b]
                num_occupied += occupied[b]
            out[i * BLOCKS + j] = share * np.float32(num_free)
            out[(BLOCKS + i) * BLOCKS + j] = share * np.float32(num_occupied)


@kernel
def _whole(position: int) -> np.uint32:
    """The cell of a position; without a sign what lies before the first cell is beyond the last."""
    return np.uint32(np.uint64(position) >> np.uint64(_FRACTION))


def compact_size(num_beams: int) -> int:
    """Number of values in the observation."""
    return 2 * BLOCKS * BLOCKS + min(SCAN_SECTORS, num_beams) + 2


class MapTiles(NamedTuple):
    """A map on a lattice through the origin of the map frame, made up of whole blocks of the far look."""

    cells: ByteArray  # (H, W), row 0 at the bottom, multiples of four
    corner: tuple[int, int]  # row and column of the lattice at which they begin, multiples of four
    resolution: float  # [m], of a cell

    @staticmethod
    def of(cells: ByteArray, corner: tuple[int, int], resolution: float) -> "MapTiles":
        """Take cells, shape (H, W), row 0 at the bottom, that begin at a row and column of the lattice."""
        below, left = corner[0] % BLOCK_SIDE, corner[1] % BLOCK_SIDE
        above, right = (-(below + cells.shape[0]) % BLOCK_SIDE, -(left + cells.shape[1]) % BLOCK_SIDE)
        whole = np.pad(cells, ((below, above), (left, right)), constant_values=UNKNOWN)
        return MapTiles(whole, (corner[0] - below, corner[1] - left), resolution)

    @staticmethod
    def of_grid(cells: ByteArray, frame: GridFrame) -> "MapTiles":
        """Take a map (H, W) whose row 0 is at the top."""
        corner = round(frame.origin_y / frame.resolution), round(frame.origin_x / frame.resolution)
        return MapTiles.of(cells[::-1], corner, frame.resolution)


class CompactObserver:
    """Makes observations of the presets ``compact`` and ``compact_far``.

    Args:
        num_beams: Of the scanner.
        limits: Largest speed [m/s], largest turning rate [rad/s] and largest range [m].
        side: Of the map's crop [m].
        looks_far: True if the far look follows (:mod:`slamgym.envs.far_look`).

    Attributes:
        limits: As given, shape (3,).
        side: As given [m].
        space: Of the observations.
    """

    def __init__(
        self, num_beams: int, limits: tuple[float, float, float], side: float, looks_far: bool = False
    ) -> None:
        self.limits = np.array(limits, dtype=np.float64)
        self.side = side
        self._far = FarLook(1) if looks_far else None
        size = compact_size(num_beams) + (FAR_SIZE if looks_far else 0)
        self.space = spaces.Box(-1.0, 1.0, (size,), np.float32)

    @classmethod
    def of(cls, config: ExploreConfig) -> "CompactObserver":
        """The observer that the settings of an environment ask for."""
        robot, lidar = config.robot, config.lidar
        limits = robot.max_linear, robot.max_angular, lidar.range_max
        observation = config.observation
        return cls(lidar.num_beams, limits, observation.crop_side, observation.preset == "compact_far")

    def refresh(self, published: MapTiles) -> None:
        """Look far, at a map that was published just now."""
        if self._far:
            self._far.refresh(0, *published)

    def observe(self, shown: MapTiles, ranges: Float32Array, pose: Pose2D, velocity: Twist2D) -> Float32Array:
        """The observation.

        Args:
            shown: The map.
            ranges: Of the scan, shape (num_beams,) [m].
            pose: Believed pose, map frame.
            velocity: Measured velocity.
        """
        out, where = np.empty(self.space.shape, dtype=np.float32), np.array(pose)
        write_compact(shown[:], where, self.side, ranges, np.array(velocity), self.limits, out)
        if self._far:
            self._far.write(_ONLY, where[np.newaxis], out[np.newaxis])
        return out
