"""The published map: counts of hits and visits over the scans of one path, kept up to date by differences."""

import math

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.jit import plain
from slamgym.core.types import (
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    OccupancyGrid,
)
from slamgym.slam.config import SlamConfig
from slamgym.slam.hit_count_kernels import BeamTable, classify_counts, draw_scans, draw_scans_once, regrid

BLOCK = 64
"""The grid grows by blocks of this many cells, so that it seldom grows."""

KNOWN_COUNT = 10
"""What a cell of an older map counts, in beams: a wall that is gone takes some thirty beams, a new one four."""


class HitCountMap:
    """A grid of hit and visit counts on the map's lattice that grows with what is drawn.

    The lattice is anchored at the map's origin: cell borders lie at multiples of the resolution.
    """

    def __init__(self, beams: BeamTable, config: SlamConfig) -> None:
        self._beams = plain(beams)
        self._resolution = config.resolution
        self._draw_scans = draw_scans if config.counting == "beams" else draw_scans_once
        self._threshold, self._min_passes = config.occupied_threshold, config.min_passes
        self._margins = float(config.occupied_margin), float(config.free_margin)
        self._memory_limit = config.memory_limit_mb * 1e6
        self._corner = (0, 0)  # lattice (row, col) of the lower left cell
        self._counts = np.zeros((0, 0, 2), dtype=np.int32)
        self._cells: ByteArray = np.zeros((0, 0), dtype=np.uint8)
        self._dirty: tuple[int, int, int, int] | None = None  # lattice rows and cols, half open

    @property
    def counts(self) -> np.ndarray:
        """(rows, cols, 2) int32 hits and visits, row 0 at the bottom."""
        return self._counts

    @property
    def corner(self) -> tuple[int, int]:
        """Lattice (row, col) of the counts' lower left cell."""
        return self._corner

    @property
    def num_bytes(self) -> int:
        """Memory of the grid."""
        return self._counts.nbytes + self._cells.nbytes

    def draw(self, poses: FloatArray, ranges: Float32Array, sign: int = 1) -> None:
        """Draw scans, or with ``sign`` -1 take out scans drawn before at exactly these poses.

        Args:
            poses: (scans, 3) robot poses in the map frame [m, m, rad].
            ranges: (scans, num_beams) [m].
            sign: 1 or -1.
        """
        if len(poses) == 0:
            return
        bounds = self._draw_scans(
            self._counts, self._corner, self._resolution, poses, ranges, self._beams, sign
        )
        first_col, first_row, last_col, last_row = (math.floor(value / self._resolution) for value in bounds)
        box = (first_row, first_col, last_row + 1, last_col + 1)
        if self._grow_to(box):
            self._draw_scans(self._counts, self._corner, self._resolution, poses, ranges, self._beams, sign)
        self._mark(box)

    def add_known(self, grid: OccupancyGrid) -> None:
        """Take what an older map says as so many observations of each of its cells (``KNOWN_COUNT``).

        Args:
            grid: Its cells must lie on this map's lattice.
        """
        frame = grid.frame
        row, col = round(frame.origin_y / frame.resolution), round(frame.origin_x / frame.resolution)
        box = (row, col, row + frame.height_px, col + frame.width_px)
        self._grow_to(box)
        cells = grid.cells[::-1]
        at = self._counts[box[0] - self._corner[0] :, box[1] - self._corner[1] :][
            : cells.shape[0], : cells.shape[1]
        ]
        at[..., 0] += KNOWN_COUNT * (cells == OCCUPIED)
        at[..., 1] += KNOWN_COUNT * (cells != UNKNOWN)
        self._mark(box)

    def _mark(self, box: tuple[int, int, int, int]) -> None:
        """Note that what lies in the lattice's rows and columns ``box`` may have changed."""
        if self._dirty is not None:
            old = self._dirty
            box = (min(box[0], old[0]), min(box[1], old[1]), max(box[2], old[2]), max(box[3], old[3]))
        self._dirty = box

    def _grow_to(self, box: tuple[int, int, int, int]) -> bool:
        """Let the grid grow to cover lattice rows and columns ``box``; whether it had to."""
        row, col = self._corner
        rows, cols = self._cells.shape
        if rows and box[0] >= row and box[1] >= col and box[2] <= row + rows and box[3] <= col + cols:
            return False
        if rows:
            box = (min(box[0], row), min(box[1], col), max(box[2], row + rows), max(box[3], col + cols))
        low = [math.floor(value / BLOCK) * BLOCK for value in box[:2]]
        shape = [math.ceil((box[2 + axis] - low[axis]) / BLOCK) * BLOCK for axis in range(2)]
        if shape[0] * shape[1] * 9 > self._memory_limit:
            raise SlamgymError(
                f"the map has grown to {shape[1] * self._resolution:.0f} x {shape[0] * self._resolution:.0f} m, more "
                f"than slam.memory_limit_mb={self._memory_limit / 1e6:.0f} allows; raise it, use a coarser "
                "resolution, or check the log for impossible ranges"
            )
        counts = np.zeros((shape[0], shape[1], 2), dtype=np.int32)
        cells = np.full((shape[0], shape[1]), UNKNOWN, dtype=np.uint8)
        at = (slice(row - low[0], row - low[0] + rows), slice(col - low[1], col - low[1] + cols))
        counts[at] = self._counts
        cells[at] = self._cells
        self._corner, self._counts, self._cells = (low[0], low[1]), counts, cells
        return True

    def classified(self) -> ByteArray:
        """Cell values, row 0 at the bottom; only what was drawn on since the last call is computed again, in place."""
        if self._dirty is not None:
            row, col = self._corner
            first_row, first_col, last_row, last_col = self._dirty
            box = first_row - row, first_col - col, last_row - row, last_col - col
            classify_counts(self._counts, box, self._threshold, (0.0, 0.0), self._min_passes, self._cells)
            self._dirty = None
        return self._cells

    def occupancy_grid(self) -> OccupancyGrid:
        """The map as it is saved, cropped to the cells known."""
        cells = self.classified()
        if any(self._margins):
            cells = np.empty_like(cells)
            box = 0, 0, *cells.shape
            classify_counts(self._counts, box, self._threshold, self._margins, self._min_passes, cells)
        return cropped_to_known(cells, self._corner, self._resolution)

    def render(self, frame: GridFrame) -> ByteArray:
        """The map on another grid; see :meth:`slamgym.slam.mapper.Mapper.render`."""
        cells = self.classified()
        col, row = frame.origin_x / self._resolution, frame.origin_y / self._resolution
        aligned = abs(col - round(col)) < 1e-6 and abs(row - round(row)) < 1e-6
        if frame.resolution != self._resolution or not aligned:
            out = np.empty(frame.shape, dtype=np.uint8)
            left = (frame.origin_x - self._corner[1] * self._resolution) / self._resolution
            bottom = (frame.origin_y - self._corner[0] * self._resolution) / self._resolution
            regrid(cells, left, bottom, frame.resolution / self._resolution, out)
            return out
        out = np.full(frame.shape, UNKNOWN, dtype=np.uint8)
        first_row, first_col = round(row) - self._corner[0], round(col) - self._corner[1]
        source, target = [], []
        for first, size, length in (
            (first_row, frame.height_px, cells.shape[0]),
            (first_col, frame.width_px, cells.shape[1]),
        ):
            begin, end = max(first, 0), max(min(first + size, length), 0)
            source.append(slice(begin, max(end, begin)))
            target.append(slice(begin - first, max(end, begin) - first))
        out[::-1][tuple(target)] = cells[tuple(source)]
        return out


def cropped_to_known(cells: ByteArray, corner: tuple[int, int], resolution: float) -> OccupancyGrid:
    """The part of a map that is known; a single unknown cell where nothing is.

    Args:
        cells: Shape (rows, cols), row 0 at the bottom.
        corner: Row and column of the map's lattice at which they begin.
        resolution: Cell size [m].
    """
    rows, cols = (
        np.flatnonzero((cells != UNKNOWN).any(axis=1)),
        np.flatnonzero((cells != UNKNOWN).any(axis=0)),
    )
    if len(rows) == 0:
        frame = GridFrame(resolution, 0.0, 0.0, 1, 1)
        return OccupancyGrid(np.full((1, 1), UNKNOWN, dtype=np.uint8), frame)
    first_row, last_row, first_col, last_col = int(rows[0]), int(rows[-1]), int(cols[0]), int(cols[-1])
    frame = GridFrame(
        resolution=resolution,
        origin_x=(corner[1] + first_col) * resolution,
        origin_y=(corner[0] + first_row) * resolution,
        height_px=last_row - first_row + 1,
        width_px=last_col - first_col + 1,
    )
    crop = cells[first_row : last_row + 1, first_col : last_col + 1]
    return OccupancyGrid(np.ascontiguousarray(crop[::-1]), frame)
