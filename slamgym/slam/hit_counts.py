"""The published map: counts of hits and visits over the scans of one path, kept up to date by differences."""

import math

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.geometry import paste
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
from slamgym.slam.hit_count_kernels import (
    BeamTable,
    classify_counts,
    draw_scans,
    draw_scans_once,
    regrid,
)

BLOCK = 64
"""The grid grows by blocks of this many cells, so that it seldom grows."""

KNOWN_COUNT = 10
"""Weight of a cell of an older map, in beams: a wall that is gone takes some thirty beams, a new one four."""


class HitCountMap:
    """A grid of hit and visit counts on the map's lattice that grows with what is drawn.

    The lattice is anchored at the map's origin: cell borders lie at multiples of the resolution.
    """

    def __init__(self, beams: BeamTable, config: SlamConfig) -> None:
        self._beams = plain(beams)
        self._resolution = config.resolution
        self._draw_scans = draw_scans if config.counting == "beams" else draw_scans_once
        self._threshold = config.occupied_threshold
        self._min_passes = config.min_passes
        self._margins = float(config.occupied_margin), float(config.free_margin)
        self._memory_limit = config.memory_limit_mb * 1e6
        self.corner = (0, 0)
        """Lattice (row, col) of the lower left cell."""
        self._counts: np.ndarray = np.zeros(
            (0, 0, 2), dtype=np.int32
        )  # hits and visits, row 0 at the bottom
        self._cells: ByteArray = np.zeros((0, 0), dtype=np.uint8)
        self._dirty: tuple[int, int, int, int] | None = None  # lattice rows and cols, half open

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
        scans = poses, ranges, self._beams, sign
        bounds = self._draw_scans(self._counts, self.corner, self._resolution, *scans)
        first_col, first_row, last_col, last_row = (
            math.floor(value / self._resolution) for value in bounds
        )
        box = (first_row, first_col, last_row + 1, last_col + 1)
        if self._grow_to(box):
            self._draw_scans(self._counts, self.corner, self._resolution, *scans)
        self._dirty = _around(box, self._dirty)

    def add_known(self, grid: OccupancyGrid) -> None:
        """Take what an older map says as so many observations of each of its cells (``KNOWN_COUNT``).

        Args:
            grid: Its cells must lie on this map's lattice.
        """
        step, x, y, rows, cols = grid.frame
        row = round(y / step)
        col = round(x / step)
        box = (row, col, row + rows, col + cols)
        self._grow_to(box)
        row = row - self.corner[0]
        col = col - self.corner[1]
        at = self._counts[row : row + rows, col : col + cols]
        cells = grid.cells[::-1]
        at[..., 0] += KNOWN_COUNT * (cells == OCCUPIED)
        at[..., 1] += KNOWN_COUNT * (cells != UNKNOWN)
        self._dirty = _around(box, self._dirty)

    def _grow_to(self, box: tuple[int, int, int, int]) -> bool:
        """Let the grid grow to cover lattice rows and columns ``box``; true if it had to."""
        row, col = self.corner
        rows, cols = self._cells.shape
        if (
            rows
            and box[0] >= row
            and box[1] >= col
            and box[2] <= row + rows
            and box[3] <= col + cols
        ):
            return False
        box = _around(box, (row, col, row + rows, col + cols) if rows else None)
        low = [math.floor(value / BLOCK) * BLOCK for value in box[:2]]
        shape = [math.ceil((box[2 + axis] - low[axis]) / BLOCK) * BLOCK for axis in range(2)]
        if shape[0] * shape[1] * 9 > self._memory_limit:
            raise SlamgymError(
                f"the map has grown to {shape[1] * self._resolution:.0f} x {shape[0] * self._resolution:.0f} m, more "
                f"than slam.memory_limit_mb={self._memory_limit / 1e6:.0f} allows; raise it, use a coarser "
                "resolution, or check the log for impossible ranges"
            )
        counts = np.zeros((*shape, 2), dtype=np.int32)
        cells = np.full(shape, UNKNOWN, dtype=np.uint8)
        at = (slice(row - low[0], row - low[0] + rows), slice(col - low[1], col - low[1] + cols))
        counts[at] = self._counts
        cells[at] = self._cells
        self.corner = (low[0], low[1])
        self._counts = counts
        self._cells = cells
        return True

    def classified(self) -> ByteArray:
        """Cell values, row 0 at the bottom; only what was drawn on since the last call is computed again, in place."""
        if self._dirty is not None:
            row, col = self.corner
            first_row, first_col, last_row, last_col = self._dirty
            box = first_row - row, first_col - col, last_row - row, last_col - col
            classify_counts(
                self._counts, box, self._threshold, (0.0, 0.0), self._min_passes, self._cells
            )
            self._dirty = None
        return self._cells

    def occupancy_grid(self) -> OccupancyGrid:
        """The map as it is saved, cropped to the cells known."""
        cells = self.classified()
        if any(self._margins):
            cells = np.empty_like(cells)
            box = 0, 0, *cells.shape
            classify_counts(
                self._counts, box, self._threshold, self._margins, self._min_passes, cells
            )
        return cropped_to_known(cells, self.corner, self._resolution)

    def render(self, frame: GridFrame) -> ByteArray:
        """The map on another grid; see :meth:`slamgym.slam.mapper.Mapper.render`."""
        cells = self.classified()
        col = frame.origin_x / self._resolution
        row = frame.origin_y / self._resolution
        aligned = abs(col - round(col)) < 1e-6 and abs(row - round(row)) < 1e-6
        if frame.resolution != self._resolution or not aligned:
            out = np.empty(frame.shape, dtype=np.uint8)
            left = (frame.origin_x - self.corner[1] * self._resolution) / self._resolution
            bottom = (frame.origin_y - self.corner[0] * self._resolution) / self._resolution
            regrid(cells, left, bottom, frame.resolution / self._resolution, out)
            return out
        out = np.full(frame.shape, UNKNOWN, dtype=np.uint8)
        paste(out[::-1], cells, round(row) - self.corner[0], round(col) - self.corner[1])
        return out


def _around(
    box: tuple[int, int, int, int], other: tuple[int, int, int, int] | None
) -> tuple[int, int, int, int]:
    """The smallest box that holds two, each half open."""
    if other is None:
        return box
    return (
        min(box[0], other[0]),
        min(box[1], other[1]),
        max(box[2], other[2]),
        max(box[3], other[3]),
    )


def cropped_to_known(cells: ByteArray, corner: tuple[int, int], resolution: float) -> OccupancyGrid:
    """The part of a map that is known; a single unknown cell where nothing is.

    Args:
        cells: Shape (rows, cols), row 0 at the bottom.
        corner: Row and column of the map's lattice at which they begin.
        resolution: Cell size [m].
    """
    known = cells != UNKNOWN
    rows = np.flatnonzero(known.any(axis=1))
    cols = np.flatnonzero(known.any(axis=0))
    if len(rows) == 0:
        frame = GridFrame(resolution, 0.0, 0.0, 1, 1)
        return OccupancyGrid(np.full((1, 1), UNKNOWN, dtype=np.uint8), frame)
    crop = cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    x = (corner[1] + int(cols[0])) * resolution
    y = (corner[0] + int(rows[0])) * resolution
    return OccupancyGrid(np.ascontiguousarray(crop[::-1]), GridFrame(resolution, x, y, *crop.shape))
