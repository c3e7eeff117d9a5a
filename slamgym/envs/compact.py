"""The observation preset ``compact``: a short vector that a perceptron can learn from.

It holds the map about the robot as shares of free and occupied space in blocks, the nearest ranges of the scan, and the
measured velocity, each scaled to [-1, 1]. All of it is belief, as in the other presets.
"""

import math

import numpy as np
from gymnasium import spaces

from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    UNKNOWN,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    IntArray,
    Pose2D,
    Twist2D,
)
from slamgym.envs.config import ExploreConfig

BLOCKS = 21
"""Blocks along a side of the map's crop."""
SCAN_SECTORS = 60
"""Ranges, each the nearest of some neighbouring beams; fewer where the scanner has fewer beams."""
_POINTS = 4  # along a side of a block, at which the map is read

_TILE_BITS = 3
TILE = 1 << _TILE_BITS
"""Cells along a side of the tiles of :func:`note_uniform`."""
_ALL_UNKNOWN, _ALL_FREE, _MIXED = 1, 2, 3  # joined by "or"

_NO_TILES = np.zeros((0, 0), dtype=np.uint8)

_FRACTION = 32
_ONE = float(1 << _FRACTION)


@kernel
def write_compact(
    cells: ByteArray,
    tiles: ByteArray,
    grows_upward: bool,
    corner: tuple[int, int],
    resolution: float,
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
        cells: The map, shape (H, W), contiguous.
        tiles: What :func:`note_uniform` noted of a map that grows upward; nothing, shape (0, 0), looks at each cell.
        grows_upward: Whether its row 0 is at the bottom, else at the top.
        corner: Row, counted upwards, and column of the map's lattice at which ``cells`` begins at its lower left.
        resolution: Cell size [m].
        pose: The robot in the map frame, shape (3,) [m, m, rad].
        side: Of the crop [m].
        ranges: The scan, shape (num_beams,) [m]; infinite where nothing returned.
        velocity: Measured, shape (2,) [m/s, rad/s].
        limits: Largest speed [m/s], largest turning rate [rad/s] and largest range [m], shape (3,).
        out: Receives the blocks' shares of free space, row by row, those of occupied space, ranges, and velocity.
    """
    pitch = side / (BLOCKS * _POINTS * resolution)
    _write_shares(cells, tiles, grows_upward, corner, pitch, resolution, pose, out)
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
    cells: ByteArray,
    tiles: ByteArray,
    grows_upward: bool,
    corner: tuple[int, int],
    pitch: float,
    resolution: float,
    pose: FloatArray,
    out: Float32Array,
) -> None:
    """Write the blocks' shares of free and occupied space, read at points ``pitch`` cells apart."""
    rows, cols = cells.shape
    flat = cells.reshape(-1)
    first, stride = (0, cols) if grows_upward else ((rows - 1) * cols, -cols)
    # Positions in 1 / 2^32 of a cell, exact to the lattice whatever part of the map is given. From point to point:
    # (sin, -cos) to the right, (-cos, -sin) down.
    cos, sin = round(pitch * _ONE * math.cos(pose[2])), round(pitch * _ONE * math.sin(pose[2]))
    last = BLOCKS * _POINTS - 1
    left = round(pose[0] / resolution * _ONE) + (last * cos - last * sin) // 2 - (corner[1] << _FRACTION)
    top = round(pose[1] / resolution * _ONE) + (last * sin + last * cos) // 2 - (corner[0] << _FRACTION)
    is_inside = True
    for a in (0, last):
        for b in (0, last):
            r, c = (top - a * sin - b * cos) >> _FRACTION, (left - a * cos + b * sin) >> _FRACTION
            is_inside = is_inside and 0 <= r < rows and 0 <= c < cols
    share = np.float32(1.0 / (_POINTS * _POINTS))
    # How far a block's points lie from its first.
    low = (_POINTS - 1) * (min(0, -sin) + min(0, -cos)), (_POINTS - 1) * (min(0, -cos) + min(0, sin))
    high = (_POINTS - 1) * (max(0, -sin) + max(0, -cos)), (_POINTS - 1) * (max(0, -cos) + max(0, sin))
    for i in range(BLOCKS):
        for j in range(BLOCKS):
            if tiles.size > 0:
                # Most blocks are unknown or free all over.
                row, col = top - _POINTS * (i * sin + j * cos), left - _POINTS * (i * cos - j * sin)
                kind = _kind_of(tiles, row + low[0], row + high[0], col + low[1], col + high[1])
                if kind != _MIXED:
                    out[i * BLOCKS + j] = np.float32(1.0) if kind == _ALL_FREE else np.float32(0.0)
                    out[(BLOCKS + i) * BLOCKS + j] = np.float32(0.0)
                    continue
            free, clear = np.int64(0), np.int64(0)
            for a in range(i * _POINTS, (i + 1) * _POINTS):
                col = left - a * cos + j * _POINTS * sin
                row = top - a * sin - j * _POINTS * cos
                for _ in range(_POINTS):
                    r, c = row >> _FRACTION, col >> _FRACTION
                    if is_inside or (0 <= r < rows and 0 <= c < cols):
                        value = np.int64(flat[np.uint64(first + r * stride + c)])
                        # Bits that tell 254, 205 and 0 apart, without a branch.
                        free += (value >> 1) & 1
                        clear += value >> 7
                    else:
                        clear += 1
                    col += sin
                    row -= cos
            out[i * BLOCKS + j] = share * np.float32(free)
            out[(BLOCKS + i) * BLOCKS + j] = share * np.float32(_POINTS * _POINTS - clear)


@kernel
def _kind_of(tiles: ByteArray, bottom: int, top: int, left: int, right: int) -> int:
    """What all the tiles are that hold these positions, in 1 / 2^32 of a cell."""
    shift = _FRACTION + _TILE_BITS
    kind = 0
    for r in range(bottom >> shift, (top >> shift) + 1):
        for c in range(left >> shift, (right >> shift) + 1):
            if 0 <= r < tiles.shape[0] and 0 <= c < tiles.shape[1]:
                kind |= tiles[np.uint64(r), np.uint64(c)]
            else:
                kind |= _ALL_UNKNOWN
    return kind


@kernel
def note_uniform(cells: ByteArray, box: IntArray, tiles: ByteArray) -> None:
    """Note which tiles of a map are unknown or free all over.

    Args:
        cells: The map, shape (H, W), row 0 at the bottom.
        box: Rows and columns (top, left, bottom, right), half open, that changed.
        tiles: One number for every 8 x 8 cells from the corner on, shape (H / 8, W / 8) rounded up; of a map without a
            known cell all 1.
    """
    for r in range(box[0] >> _TILE_BITS, (box[2] - 1 >> _TILE_BITS) + 1):
        for c in range(box[1] >> _TILE_BITS, (box[3] - 1 >> _TILE_BITS) + 1):
            tile = cells[r * TILE : (r + 1) * TILE, c * TILE : (c + 1) * TILE]
            first, differs = tile[0, 0], np.uint8(0)
            for i in range(tile.shape[0]):
                for j in range(tile.shape[1]):
                    differs |= tile[i, j] ^ first
            kind = _ALL_UNKNOWN if first == UNKNOWN else _ALL_FREE if first == FREE else _MIXED
            # Beyond the map all is unknown.
            is_cut = tile.shape[0] < TILE or tile.shape[1] < TILE
            tiles[r, c] = _MIXED if differs else kind | (_ALL_UNKNOWN if is_cut else 0)


def compact_size(num_beams: int) -> int:
    """How many numbers the observation has."""
    return 2 * BLOCKS * BLOCKS + min(SCAN_SECTORS, num_beams) + 2


class CompactObserver:
    """Makes observations of the preset ``compact``.

    Args:
        num_beams: Of the scanner.
        limits: Largest speed [m/s], largest turning rate [rad/s] and largest range [m].
        side: Of the map's crop [m].

    Attributes:
        limits: As given, shape (3,).
        side: As given [m].
        space: Of the observations.
    """

    def __init__(self, num_beams: int, limits: tuple[float, float, float], side: float) -> None:
        self._size = compact_size(num_beams)
        self.limits = np.array(limits, dtype=np.float64)
        self.side = side
        self.space = spaces.Box(-1.0, 1.0, (self._size,), np.float32)

    @classmethod
    def of(cls, config: ExploreConfig) -> "CompactObserver":
        """The observer that the settings of an environment ask for."""
        robot, lidar = config.robot, config.lidar
        limits = robot.max_linear, robot.max_angular, lidar.range_max
        return cls(lidar.num_beams, limits, config.observation.crop_side)

    def observe(
        self, cells: ByteArray, frame: GridFrame, ranges: Float32Array, pose: Pose2D, velocity: Twist2D
    ) -> Float32Array:
        """The observation.

        Args:
            cells: The map, row 0 at the top; its cells lie on a lattice through the origin of the map frame.
            frame: Where they lie.
            ranges: Of the scan, shape (num_beams,) [m].
            pose: Believed pose, map frame.
            velocity: Measured velocity.
        """
        out = np.empty(self._size, dtype=np.float32)
        corner = round(frame.origin_y / frame.resolution), round(frame.origin_x / frame.resolution)
        write_compact(
            cells, _NO_TILES, False, corner, frame.resolution, np.array(pose), self.side, ranges, np.array(velocity),
            self.limits, out,
        )  # fmt: skip
        return out
