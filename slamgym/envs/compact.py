"""The observation preset ``compact``: a short vector that a perceptron can learn from.

It holds the map about the robot as shares of free and occupied space in blocks, the nearest ranges of the scan, and the
measured velocity, each scaled to [-1, 1]. All of it is belief, as in the other presets.
"""

import math
from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from slamgym.core.jit import kernel
from slamgym.core.types import UNKNOWN, ByteArray, Float32Array, FloatArray, GridFrame, Pose2D, Twist2D
from slamgym.envs.config import ExploreConfig
from slamgym.envs.far_look import FAR_SIZE, FarLook

BLOCKS = 21
"""Blocks along a side of the map's crop."""
SCAN_SECTORS = 60
"""Ranges, each the nearest of some neighbouring beams; fewer where the scanner has fewer beams."""
_POINTS = 4  # along a side of a block, at which the map is read

_TILE_BITS = 2
MAP_TILE = 1 << _TILE_BITS
"""Cells along a side of the tiles of :func:`pack_tiles`."""
_WINDOW = 3  # tiles along a side, about which a tile knows whether they are alike
_ALL_UNKNOWN, _ALL_FREE, _MIXED = range(3)
_FREE_BITS, _PAIR, _OCCUPIED_SHIFT = np.uint64(0xFFFF), np.uint64(0x10001), np.uint64(16)
_NONE, _ALL = np.uint64(0), np.uint64(_POINTS * _POINTS)
_IN_TILE = MAP_TILE - 1
_LOW_BITS, _TO_FOURTH_BYTE = np.uint64(0x01010101), np.uint64(0x01020408)

_ONLY = np.zeros(1, dtype=np.int64)

_FRACTION = 32
_ONE = float(1 << _FRACTION)


@kernel
def write_compact(
    tiles: tuple[np.ndarray, ByteArray, tuple[int, int], float],
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
    _write_shares(tiles, side / (BLOCKS * _POINTS * tiles[3]), pose, out)
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
    tiles: tuple[np.ndarray, ByteArray, tuple[int, int], float],
    pitch: float,
    pose: FloatArray,
    out: Float32Array,
) -> None:
    """Write the blocks' shares of free and occupied space, read at points ``pitch`` cells apart."""
    packed, kinds, corner, resolution = tiles
    tile_cols, shift = packed.shape[1], _FRACTION + _TILE_BITS
    rows, cols = MAP_TILE * packed.shape[0], MAP_TILE * tile_cols
    packed, kinds = packed.reshape(-1), kinds.reshape(-1)
    # Positions in 1 / 2^32 of a cell, exact to the lattice for any given part of the map. From point to point:
    # (sin, -cos) to the right, (-cos, -sin) down.
    cos, sin = round(pitch * _ONE * math.cos(pose[2])), round(pitch * _ONE * math.sin(pose[2]))
    last = BLOCKS * _POINTS - 1
    left = round(pose[0] / resolution * _ONE) + (last * cos - last * sin) // 2 - (corner[1] << _FRACTION)
    top = round(pose[1] / resolution * _ONE) + (last * sin + last * cos) // 2 - (corner[0] << _FRACTION)
    share = np.float32(1.0 / (_POINTS * _POINTS))
    # How far a block's points lie from its first.
    low = (_POINTS - 1) * (min(0, -sin) + min(0, -cos)), (_POINTS - 1) * (min(0, -cos) + min(0, sin))
    high = (_POINTS - 1) * (max(0, -sin) + max(0, -cos)), (_POINTS - 1) * (max(0, -cos) + max(0, sin))
    for i in range(BLOCKS):
        for j in range(BLOCKS):
            row, col = top - _POINTS * (i * sin + j * cos), left - _POINTS * (i * cos - j * sin)
            bottom, begin = row + low[0], col + low[1]
            is_inside = bottom >= 0 and begin >= 0
            is_inside &= (row + high[0]) >> _FRACTION < rows and (col + high[1]) >> _FRACTION < cols
            found = _NONE  # free cells in the lower bits, occupied ones from the 16th on
            if is_inside:
                # Most blocks are unknown or free all over.
                first_row, first_col = bottom >> shift, begin >> shift
                kind = kinds[np.uint64(first_row * tile_cols + first_col)]
                is_within = (row + high[0]) >> shift < first_row + _WINDOW
                if kind != _MIXED and is_within and (col + high[1]) >> shift < first_col + _WINDOW:
                    found = _ALL if kind == _ALL_FREE else _NONE
                else:
                    for a in range(_POINTS):
                        for b in range(_POINTS):
                            r, c = row - a * sin - b * cos, col - a * cos + b * sin
                            found += _packed_cell(packed, tile_cols, r, c)
            else:
                for a in range(_POINTS):
                    for b in range(_POINTS):
                        r, c = row - a * sin - b * cos, col - a * cos + b * sin
                        if 0 <= r >> _FRACTION < rows and 0 <= c >> _FRACTION < cols:
                            found += _packed_cell(packed, tile_cols, r, c)
            out[i * BLOCKS + j] = share * np.float32(found & _FREE_BITS)
            out[(BLOCKS + i) * BLOCKS + j] = share * np.float32(found >> _OCCUPIED_SHIFT)


@kernel
def _packed_cell(packed: np.ndarray, tile_cols: int, row: int, col: int) -> np.uint64:
    """1 if a place, in 1 / 2^32 of a cell, is free, 2^16 if it is occupied, else 0."""
    r, c = row >> _FRACTION, col >> _FRACTION
    tile = np.uint64(packed[np.uint64((r >> _TILE_BITS) * tile_cols + (c >> _TILE_BITS))])
    return (tile >> np.uint64(MAP_TILE * (r & _IN_TILE) + (c & _IN_TILE))) & _PAIR


@kernel
def pack_tiles(cells: ByteArray, box: tuple[int, int, int, int], tiles: tuple[np.ndarray, ByteArray]) -> None:
    """Pack a part of a map: few bytes tell a cell, and what a tile and those after it are.

    Args:
        cells: The map, shape (H, W), both multiples of 4, contiguous, row 0 at the bottom.
        box: Rows and columns (top, left, bottom, right), half open, that changed.
        tiles: Receives of each 4 x 4 cells, shape (H / 4, W / 4): as uint32 the free ones in the lower half of the
            bits and the occupied ones in the upper, row by row; and what the window of three tiles a side that begins
            there is: 0 unknown all over, 1 free, 2 neither.
    """
    packed, kinds = tiles
    rows, cols = packed.shape
    words = cells.reshape(-1).view(np.uint32).reshape(cells.shape[0], cols)
    first_row, end_row = box[0] >> _TILE_BITS, (box[2] - 1 >> _TILE_BITS) + 1
    first_col, end_col = box[1] >> _TILE_BITS, (box[3] - 1 >> _TILE_BITS) + 1
    for r in range(first_row, end_row):
        for c in range(first_col, end_col):
            bits = _NONE
            for k in range(MAP_TILE):
                # Four cells, the lowest bit but one of which tells 254 from the others, and the highest 0. The products
                # gather the lowest bits of four bytes.
                word = np.uint64(words[np.uint64(MAP_TILE * r + k), np.uint64(c)])
                is_free, is_occupied = (word >> np.uint64(1)) & _LOW_BITS, (~word >> np.uint64(7)) & _LOW_BITS
                free, occupied = is_free * _TO_FOURTH_BYTE, is_occupied * _TO_FOURTH_BYTE
                four = (free >> np.uint64(24)) & np.uint64(15) | (
                    (occupied >> np.uint64(8)) & np.uint64(15 << 16)
                )
                bits |= four << np.uint64(MAP_TILE * k)
            packed[np.uint64(r), np.uint64(c)] = np.uint32(bits)
    for r in range(max(first_row - _WINDOW + 1, 0), end_row):
        # Columns of the window, from the right: what is known in any, and free in all, of their tiles.
        known, known_after, free, free_after = _NONE, _NONE, _NONE, _NONE
        for c in range(end_col + _WINDOW - 2, max(first_col - _WINDOW, -1), -1):
            known_here, free_here = _NONE, _FREE_BITS
            for k in range(r, r + _WINDOW):
                bits = np.uint64(packed[np.uint64(k), np.uint64(c)]) if k < rows and c < cols else _NONE
                known_here, free_here = known_here | bits, free_here & bits
            if c < end_col:
                is_free = free_here & free & free_after == _FREE_BITS
                kind = _ALL_FREE if is_free else _MIXED
                is_known = known_here | known | known_after != _NONE
                kinds[np.uint64(r), np.uint64(c)] = kind if is_known else _ALL_UNKNOWN
            known, known_after, free, free_after = known_here, known, free_here, free


def compact_size(num_beams: int) -> int:
    """Number of values in the observation."""
    return 2 * BLOCKS * BLOCKS + min(SCAN_SECTORS, num_beams) + 2


class MapTiles(NamedTuple):
    """A map whose cells lie on a lattice through the origin of the map frame, packed as :func:`pack_tiles` does."""

    packed: np.ndarray  # (h, w) uint32, row 0 at the bottom
    kinds: ByteArray  # (h, w)
    corner: tuple[int, int]  # row and column of the lattice at which they begin, multiples of four
    resolution: float  # [m], of a cell

    @staticmethod
    def of(cells: ByteArray, corner: tuple[int, int], resolution: float) -> "MapTiles":
        """Pack cells, shape (H, W), row 0 at the bottom, that begin at a row and column of the lattice."""
        below, left = corner[0] % MAP_TILE, corner[1] % MAP_TILE
        shape = -(-(below + cells.shape[0]) // MAP_TILE), -(-(left + cells.shape[1]) // MAP_TILE)
        padded = np.full((MAP_TILE * shape[0], MAP_TILE * shape[1]), UNKNOWN, dtype=np.uint8)
        padded[below : below + cells.shape[0], left : left + cells.shape[1]] = cells
        tiles = np.empty(shape, dtype=np.uint32), np.empty(shape, dtype=np.uint8)
        pack_tiles(padded, (0, 0, *padded.shape), tiles)
        return MapTiles(*tiles, (corner[0] - below, corner[1] - left), resolution)

    @staticmethod
    def of_grid(cells: ByteArray, frame: GridFrame) -> "MapTiles":
        """Pack a map (H, W) whose row 0 is at the top."""
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
            self._far.refresh(0, published.packed, published.corner, published.resolution)

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
