"""The observation preset ``compact``: a short vector that a perceptron can learn from.

It holds the map about the robot as shares of free and occupied space in blocks, the nearest ranges of the scan, and the
measured velocity, each scaled to [-1, 1]. All of it is belief, as in the other presets.
"""

import math

import numpy as np
from gymnasium import spaces

from slamgym.core.jit import kernel
from slamgym.core.types import (
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
MAP_TILE = 1 << _TILE_BITS
"""Cells along a side of the tiles of :func:`pack_tiles`."""
_MOST_TILES = 3  # along a side, for a block to be looked at as a whole
_NO_TILES = np.zeros((0, 0, 2), dtype=np.uint64)
_ALL_UNKNOWN, _ALL_FREE, _MIXED = range(3)
_LOW_BITS, _TO_TOP_BYTE = np.uint64(0x0101010101010101), np.uint64(0x0102040810204080)
_NONE, _EVERY = np.uint64(0), np.uint64(0xFFFFFFFFFFFFFFFF)

_FRACTION = 32
_ONE = float(1 << _FRACTION)


@kernel
def write_compact(
    cells: ByteArray,
    tiles: np.ndarray,
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
        tiles: The same map from :func:`pack_tiles`, if it grows upward; or of shape (0, 0, 2).
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
    tiles: np.ndarray,
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
    is_inside, is_packed = True, tiles.size > 0
    for a in (0, last):
        for b in (0, last):
            r, c = (top - a * sin - b * cos) >> _FRACTION, (left - a * cos + b * sin) >> _FRACTION
            is_inside = is_inside and 0 <= r < rows and 0 <= c < cols
    share = np.float32(1.0 / (_POINTS * _POINTS))
    # How far a block's points lie from its first.
    low = (_POINTS - 1) * (min(0, -sin) + min(0, -cos)), (_POINTS - 1) * (min(0, -cos) + min(0, sin))
    high = (_POINTS - 1) * (max(0, -sin) + max(0, -cos)), (_POINTS - 1) * (max(0, -cos) + max(0, sin))
    is_small = max(high[0] - low[0], high[1] - low[1]) < _MOST_TILES - 1 << _FRACTION + _TILE_BITS
    for i in range(BLOCKS):
        for j in range(BLOCKS):
            if is_packed and is_small:
                # Most blocks are unknown or free all over.
                row, col = top - _POINTS * (i * sin + j * cos), left - _POINTS * (i * cos - j * sin)
                kind = _kind_of(tiles, is_inside, row + low[0], row + high[0], col + low[1], col + high[1])
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
                    if not (is_inside or (0 <= r < rows and 0 <= c < cols)):
                        clear += 1
                    elif is_packed:
                        bit = np.uint64(MAP_TILE * (r % MAP_TILE) + c % MAP_TILE)
                        tile = tiles[np.uint64(r >> _TILE_BITS), np.uint64(c >> _TILE_BITS)]
                        free += np.int64((tile[0] >> bit) & np.uint64(1))
                        clear += 1 - np.int64((tile[1] >> bit) & np.uint64(1))
                    else:
                        value = np.int64(flat[np.uint64(first + r * stride + c)])
                        # Bits that tell 254, 205 and 0 apart, without a branch.
                        free += (value >> 1) & 1
                        clear += value >> 7
                    col += sin
                    row -= cos
            out[i * BLOCKS + j] = share * np.float32(free)
            out[(BLOCKS + i) * BLOCKS + j] = share * np.float32(_POINTS * _POINTS - clear)


@kernel
def _kind_of(tiles: np.ndarray, is_inside: bool, bottom: int, top: int, left: int, right: int) -> int:
    """What all the tiles are that hold these positions, in 1 / 2^32 of a cell; three tiles a side at most."""
    shift = _FRACTION + _TILE_BITS
    bottom, top, left, right = bottom >> shift, top >> shift, left >> shift, right >> shift
    known, free = _NONE, _EVERY
    if not is_inside and (bottom < 0 or left < 0 or top >= tiles.shape[0] or right >= tiles.shape[1]):
        free = _NONE
        bottom, left = max(bottom, 0), max(left, 0)
        top, right = min(top, tiles.shape[0] - 1), min(right, tiles.shape[1] - 1)
        if bottom > top or left > right:
            return _ALL_UNKNOWN
    # Always three looks a side are faster than a loop of unknown length.
    for r in (bottom, min(bottom + 1, top), top):
        for c in (left, min(left + 1, right), right):
            tile = tiles[np.uint64(r), np.uint64(c)]
            known, free = known | tile[0] | tile[1], free & tile[0]
    return _ALL_UNKNOWN if known == _NONE else _ALL_FREE if free == _EVERY else _MIXED


@kernel
def pack_tiles(cells: ByteArray, box: IntArray, tiles: np.ndarray) -> None:
    """Pack a part of a map into bits: a cache line holds four tiles of 8 x 8 cells, and one look tells what a tile is.

    Args:
        cells: The map, shape (H, W), both multiples of 8, contiguous, row 0 at the bottom.
        box: Rows and columns (top, left, bottom, right), half open, that changed.
        tiles: Receives the free and the occupied cells of every tile, shape (H / 8, W / 8, 2), row by row from the
            lowest bit on.
    """
    words = cells.reshape(-1).view(np.uint64).reshape(cells.shape[0], cells.shape[1] // MAP_TILE)
    for r in range(box[0] >> _TILE_BITS, (box[2] - 1 >> _TILE_BITS) + 1):
        for c in range(box[1] >> _TILE_BITS, (box[3] - 1 >> _TILE_BITS) + 1):
            free = occupied = _NONE
            for k in range(MAP_TILE):
                # Eight cells, the lowest bit but one of which tells 254 from the others, and the highest 0.
                word = words[np.uint64(MAP_TILE * r + k), np.uint64(c)]
                is_free = (word >> np.uint64(1)) & _LOW_BITS
                is_occupied = (~word >> np.uint64(7)) & _LOW_BITS
                place = np.uint64(MAP_TILE * k)
                # The product gathers the lowest bits of eight bytes in the highest byte.
                free |= ((is_free * _TO_TOP_BYTE) >> np.uint64(56)) << place
                occupied |= ((is_occupied * _TO_TOP_BYTE) >> np.uint64(56)) << place
            tiles[r, c, 0], tiles[r, c, 1] = free, occupied


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
