"""The published map: counts of hits and visits over the scans of one path, kept up to date by differences."""

import math

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.geometry import paste
from slamgym.core.jit import plain
from slamgym.core.types import (
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
    cells_of,
    classify_counts,
    draw_scans,
    draw_scans_once,
    regrid,
)

BLOCK = 64
"""The grid grows by blocks of this many cells, so that it seldom grows."""

CELL_BYTES = 9
"""Memory of a cell: two counts of four bytes, and its value."""

LatticeBox = tuple[int, int, int, int]
"""First row, first column, end of the rows and end of the columns of a part of a grid."""


class HitCountMap:
    """A grid of hit and visit counts on the map's lattice that grows with what is drawn.

    The lattice is anchored at the map's origin: cell borders lie at multiples of the resolution.
    """

    def __init__(self, beams: BeamTable, config: SlamConfig) -> None:
        self._beams = plain(beams)
        self.resolution = config.resolution
        """Cell size [m]."""
        self._draw_scans = draw_scans if config.counting == "beams" else draw_scans_once
        self._threshold = config.occupied_threshold
        self._min_passes = config.min_passes
        self._margins = (float(config.occupied_margin), float(config.free_margin))
        self._memory_limit = config.memory_limit_mb * 1e6
        self.corner = (0, 0)
        """Lattice (row, col) of the lower left cell."""
        self.counts: np.ndarray = np.zeros((0, 0, 2), dtype=np.int32)
        """(rows, cols, 2) hits and visits, row 0 at the bottom."""
        self._cells: ByteArray = np.zeros((0, 0), dtype=np.uint8)
        # Poses at which the scans of a path are drawn.
        self._followed: FloatArray = np.zeros((0, 3))
        self._dirty: LatticeBox | None = None  # what was drawn on since cells were last classified

    @property
    def num_bytes(self) -> int:
        """Memory of the grid."""
        return self.counts.nbytes + self._cells.nbytes

    def see_with(self, beams: BeamTable) -> None:
        """Draw scans of another laser from here on."""
        self._beams = plain(beams)

    def draw(self, poses: FloatArray, ranges: Float32Array, sign: int = 1) -> None:
        """Draw scans, or with ``sign`` -1 take out scans drawn before at exactly these poses.

        Args:
            poses: (scans, 3) robot poses in the map frame [m, m, rad].
            ranges: (scans, num_beams) [m].
            sign: 1 or -1.
        """
        if len(poses) == 0:
            return
        bounds = self._draw_on_counts(poses, ranges, sign)
        first_row, first_col, last_row, last_col = cells_of(bounds, (0, 0), self.resolution)
        box = (first_row, first_col, last_row + 1, last_col + 1)
        if self.cover(box):
            self._draw_on_counts(poses, ranges, sign)
        self._dirty = _around(box, self._dirty)

    def follow(self, poses: FloatArray, ranges: Float32Array) -> None:
        """Draw the scans of a path that are new, and again those that have moved.

        Args:
            poses: (scans, 3) as for :meth:`draw`; as many as before, or more.
            ranges: (scans, num_beams) [m].
        """
        before = self._followed
        has_moved = (poses[: len(before)] != before).any(axis=1)
        moved = np.flatnonzero(has_moved)
        self.draw(before[moved], ranges[moved], sign=-1)
        again = np.concatenate([moved, np.arange(len(before), len(poses))])
        self.draw(poses[again], ranges[again])
        self._followed = poses

    def _draw_on_counts(
        self, poses: FloatArray, ranges: Float32Array, sign: int
    ) -> tuple[float, float, float, float]:
        """Draw scans if the counts cover them; returns their bounds (min x, min y, max x, max y) [m]."""
        bounds: tuple[float, float, float, float] = self._draw_scans(
            self.counts, self.corner, self.resolution, poses, ranges, self._beams, sign
        )
        return bounds

    @property
    def box(self) -> LatticeBox:
        """The part of the lattice that is covered."""
        row, col = self.corner
        rows, cols = self._cells.shape
        return (row, col, row + rows, col + cols)

    def cover(self, box: LatticeBox) -> bool:
        """Let the grid grow to cover a box of the lattice; true if it had to."""
        row, col = self.corner
        rows, cols = self._cells.shape
        if rows:
            covered = self.box
            box = _around(box, covered)
            if box == covered:
                return False
        first_row = box[0] // BLOCK * BLOCK
        first_col = box[1] // BLOCK * BLOCK
        height = math.ceil((box[2] - first_row) / BLOCK) * BLOCK
        width = math.ceil((box[3] - first_col) / BLOCK) * BLOCK
        if height * width * CELL_BYTES > self._memory_limit:
            raise SlamgymError(
                f"the map has grown to {width * self.resolution:.0f} x {height * self.resolution:.0f} m, more "
                f"than slam.memory_limit_mb={self._memory_limit / 1e6:.0f} allows; raise it, use a coarser "
                "resolution, or check the log for impossible ranges"
            )
        counts = np.zeros((height, width, 2), dtype=np.int32)
        cells = np.full((height, width), UNKNOWN, dtype=np.uint8)
        above = row - first_row
        beside = col - first_col
        counts[above : above + rows, beside : beside + cols] = self.counts
        cells[above : above + rows, beside : beside + cols] = self._cells
        self.corner = (first_row, first_col)
        self.counts = counts
        self._cells = cells
        return True

    def classified(self) -> ByteArray:
        """Cell values, row 0 at the bottom; only what was drawn on since the last call is computed again, in place."""
        if self._dirty is not None:
            row, col = self.corner
            first_row, first_col, end_row, end_col = self._dirty
            box = (first_row - row, first_col - col, end_row - row, end_col - col)
            self._classify(box, (0.0, 0.0), self._cells)
            self._dirty = None
        return self._cells

    def _classify(self, box: LatticeBox, margins: tuple[float, float], cells: ByteArray) -> None:
        """Read the cells of a box of the counts."""
        classify_counts(self.counts, box, self._threshold, margins, self._min_passes, cells)

    def occupancy_grid(self) -> OccupancyGrid:
        """The map as it is saved, cropped to the cells known."""
        cells = self.classified()
        if any(self._margins):
            cells = np.empty_like(cells)
            rows, cols = cells.shape
            self._classify((0, 0, rows, cols), self._margins, cells)
        return cropped_to_known(cells, self.corner, self.resolution)

    def render(self, frame: GridFrame) -> ByteArray:
        """The map on another grid; see :meth:`slamgym.slam.mapper.Mapper.render`."""
        return rendered(self.classified(), self.corner, self.resolution, frame)


def rendered(cells: ByteArray, corner: tuple[int, int], step: float, frame: GridFrame) -> ByteArray:
    """A map on another grid; see :meth:`slamgym.slam.mapper.Mapper.render`.

    Args:
        cells: Shape (rows, cols), row 0 at the bottom.
        corner: Row and column of the map's lattice at which they begin.
        step: Their size [m].
        frame: The other grid.
    """
    first_row, first_col = corner
    col = frame.origin_x / step
    row = frame.origin_y / step
    is_aligned = abs(col - round(col)) < 1e-6 and abs(row - round(row)) < 1e-6
    if frame.resolution == step and is_aligned:
        out = np.full(frame.shape, UNKNOWN, dtype=np.uint8)
        paste(out[::-1], cells, round(row) - first_row, round(col) - first_col)
        return out
    out = np.empty(frame.shape, dtype=np.uint8)
    left = (frame.origin_x - first_col * step) / step
    bottom = (frame.origin_y - first_row * step) / step
    regrid(cells, left, bottom, frame.resolution / step, out)
    return out


def _around(box: LatticeBox, other: LatticeBox | None) -> LatticeBox:
    """The smallest box that holds two."""
    if other is None:
        return box
    first_row = min(box[0], other[0])
    first_col = min(box[1], other[1])
    end_row = max(box[2], other[2])
    end_col = max(box[3], other[3])
    return (first_row, first_col, end_row, end_col)


def cropped_to_known(cells: ByteArray, corner: tuple[int, int], resolution: float) -> OccupancyGrid:
    """The part of a map that is known; a single unknown cell where nothing is.

    Args:
        cells: Shape (rows, cols), row 0 at the bottom.
        corner: Row and column of the map's lattice at which they begin.
        resolution: Cell size [m].
    """
    is_known = cells != UNKNOWN
    rows = np.flatnonzero(is_known.any(axis=1))
    cols = np.flatnonzero(is_known.any(axis=0))
    if len(rows) == 0:
        unknown = np.full((1, 1), UNKNOWN, dtype=np.uint8)
        return OccupancyGrid(unknown, GridFrame(resolution, 0.0, 0.0, 1, 1))
    crop = cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    x = (corner[1] + int(cols[0])) * resolution
    y = (corner[0] + int(rows[0])) * resolution
    height, width = crop.shape
    frame = GridFrame(resolution, x, y, height, width)
    return OccupancyGrid(np.ascontiguousarray(crop[::-1]), frame)
