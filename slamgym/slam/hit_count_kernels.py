"""Drawing scans into counts of hits and visits, and reading a map from them: numba kernels.

Convention: grids of this module have row 0 at the bottom (smallest y), so that row and y grow together; only
what leaves the package (:class:`slamgym.core.types.OccupancyGrid`) has row 0 at the top.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import unit_vectors
from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    ByteArray,
    Float32Array,
    FloatArray,
    LaserGeometry,
)
from slamgym.slam.config import SlamConfig

_FRACTION = 32
"""Binary digits behind the point of a line's offset in cells."""
_WIDEST_GAP = math.radians(90.0)
"""A gap without return that the scan cuts off may be a pane or a dark wall up to this angle [rad]."""


class BeamTable(NamedTuple):
    """Properties of a scanner that the kernels need."""

    directions: FloatArray  # (num_beams, 2) unit vectors of the beams in the robot frame
    mount: FloatArray  # (2,) sensor position in the robot frame [m]
    range_min: float  # shorter ranges are left out [m]
    range_max: float  # a range of this or more is no return [m]
    usable: float  # longest ray drawn [m]
    no_return_clears: bool  # whether beams without return clear
    widest_gap: int  # beams; a wider gap without return at the end of a scan is open space

    @property
    def spacing(self) -> float:
        """How far neighbouring beams are apart at a distance of 1 m [m]; 0 for a single beam."""
        ahead = self.directions[:2]
        return math.dist(ahead[0].tolist(), ahead[-1].tolist())

    @staticmethod
    def of(geometry: LaserGeometry, config: SlamConfig) -> "BeamTable":
        """The table of a scanner."""
        angles = geometry.angles + geometry.mount.theta
        return BeamTable(
            directions=unit_vectors(angles),
            mount=np.array([geometry.mount.x, geometry.mount.y]),
            range_min=float(geometry.range_min),
            range_max=float(geometry.range_max),
            usable=float(config.max_usable_range),
            no_return_clears=config.no_return == "clear",
            widest_gap=round(_WIDEST_GAP / geometry.angle_increment),
        )


@kernel
def drawn_lengths(ranges: Float32Array, beams: BeamTable, out: FloatArray) -> None:
    """Length to which each beam of a scan is drawn [m]; 0 for a beam that is left out, and at most ``usable``.

    A beam that returned from within ``usable`` is a hit. A longer one is cut and clears only; so does a beam
    without return (``+inf``) if ``no_return_clears``, as far as :func:`_open_length` says. nan, ``-inf`` and
    ranges below ``range_min`` are left out.

    Args:
        ranges: Shape (num_beams,) [m].
        beams: The scanner.
        out: Receives the lengths, shape (num_beams,) [m].
    """
    num_beams = len(ranges)
    # The returns next to a gap.
    low = -1
    high = 0
    for i in range(num_beams):
        r = ranges[i]
        if r >= beams.range_max:
            length = 0.0
            if beams.no_return_clears:
                high = max(high, i + 1)
                while high < num_beams and not beams.range_min <= ranges[high] < beams.range_max:
                    high += 1
                length = _open_length(ranges, i, low, high, beams)
            out[i] = length
        elif r >= beams.range_min:
            low = i
            out[i] = r if r < beams.usable else beams.usable
        else:
            out[i] = 0.0


@kernel
def _open_length(ranges: Float32Array, i: int, low: int, high: int, beams: BeamTable) -> float:
    """Length to which a beam without return is taken as free [m]: up to the line between the returns next to its gap.

    Behind that line may be a window, a mirror or a dark wall as well as open space. Open to the usable range is a
    gap that no two returns bound from either side: half a turn or more, or one that reaches the end of the scan and
    is wider than windows and dark walls are. ``low`` and ``high`` are the returns, -1 and the number of beams
    where there is none.
    """
    longest = min(beams.usable, beams.range_max)
    if low < 0 or high >= len(ranges):
        return longest if high - low - 1 > beams.widest_gap else 0.0
    ax = ranges[low] * beams.directions[low, 0]
    ay = ranges[low] * beams.directions[low, 1]
    bx = ranges[high] * beams.directions[high, 0]
    by = ranges[high] * beams.directions[high, 1]
    ex = bx - ax
    ey = by - ay
    offset = ax * ey - ay * ex
    slant = beams.directions[i, 0] * ey - beams.directions[i, 1] * ex
    if offset <= 0.0 or slant <= 0.0:
        return longest
    return min(longest, offset / slant)


@kernel
def laser_at(pose: FloatArray, beams: BeamTable) -> tuple[float, float, float, float]:
    """Place of the laser of a robot at a pose (3,) [m], and cosine and sine of the robot's heading."""
    cos = math.cos(pose[2])
    sin = math.sin(pose[2])
    x = pose[0] + cos * beams.mount[0] - sin * beams.mount[1]
    y = pose[1] + sin * beams.mount[0] + cos * beams.mount[1]
    return x, y, cos, sin


@kernel
def scan_bounds(
    poses: FloatArray, ranges: Float32Array, beams: BeamTable, lengths: FloatArray
) -> tuple[float, float, float, float]:
    """Bounds (min x, min y, max x, max y) [m] of all that :func:`draw_scans` draws.

    Args:
        poses: (scans, 3) robot poses [m, m, rad].
        ranges: (scans, num_beams) [m].
        beams: The scanner.
        lengths: (scans, num_beams) receives how far each beam is drawn [m].
    """
    directions = beams.directions
    min_x = min_y = math.inf
    max_x = max_y = -math.inf
    for k in range(len(poses)):
        drawn_lengths(ranges[k], beams, lengths[k])
        x0, y0, cos, sin = laser_at(poses[k], beams)
        min_x = min(min_x, x0)
        max_x = max(max_x, x0)
        min_y = min(min_y, y0)
        max_y = max(max_y, y0)
        for i in range(ranges.shape[1]):
            length = lengths[k, i]
            across = cos * directions[i, 0] - sin * directions[i, 1]
            up = sin * directions[i, 0] + cos * directions[i, 1]
            x = x0 + length * across
            y = y0 + length * up
            # min and max would ask each number whether it is one.
            min_x = x if x < min_x else min_x
            max_x = x if x > max_x else max_x
            min_y = y if y < min_y else min_y
            max_y = y if y > max_y else max_y
    return min_x, min_y, max_x, max_y


@kernel
def cells_of(
    bounds: tuple[float, float, float, float], corner: tuple[int, int], resolution: float
) -> tuple[int, int, int, int]:
    """First row and column and last row and column that bounds [m] touch in a grid that begins at ``corner``."""
    min_x, min_y, max_x, max_y = bounds
    first_row = math.floor(min_y / resolution) - corner[0]
    first_col = math.floor(min_x / resolution) - corner[1]
    last_row = math.floor(max_y / resolution) - corner[0]
    last_col = math.floor(max_x / resolution) - corner[1]
    return first_row, first_col, last_row, last_col


@kernel
def draw_scans(
    counts: np.ndarray,
    corner: tuple[int, int],
    resolution: float,
    poses: FloatArray,
    ranges: Float32Array,
    beams: BeamTable,
    sign: int,
) -> tuple[float, float, float, float]:
    """Draw scans into the counts, or take them out again; nothing is drawn if the counts don't cover them.

    Each beam visits the cells from the sensor to its end (Bresenham's line, in fixed point) and hits the last
    one, as GMapping's ``registerScan`` does.

    Args:
        counts: (rows, cols, 2) int32 hits and visits.
        corner: Row and column of the lattice that ``counts`` begins at.
        resolution: Cell size [m].
        poses: (scans, 3) robot poses [m, m, rad].
        ranges: (scans, num_beams) [m].
        beams: The scanner.
        sign: 1 draws, -1 takes out.

    Returns:
        Bounds (min x, min y, max x, max y) of the scans [m].
    """
    beams = BeamTable(*beams)
    corner_row, corner_col = corner
    lengths = np.empty(ranges.shape)
    bounds = scan_bounds(poses, ranges, beams, lengths)
    first_row, first_col, last_row, last_col = cells_of(bounds, corner, resolution)
    if first_row < 0 or first_col < 0 or last_row >= counts.shape[0] or last_col >= counts.shape[1]:
        return bounds
    directions = beams.directions
    cols = counts.shape[1]
    flat = counts.reshape(-1)
    scale = 1.0 / resolution
    for k in range(len(poses)):
        x0, y0, cos, sin = laser_at(poses[k], beams)
        start_col = math.floor(x0 * scale) - corner_col
        start_row = math.floor(y0 * scale) - corner_row
        start = start_row * cols + start_col
        for i in range(ranges.shape[1]):
            r = ranges[k, i]
            length = lengths[k, i]
            if length == 0.0:
                continue
            across = cos * directions[i, 0] - sin * directions[i, 1]
            up = sin * directions[i, 0] + cos * directions[i, 1]
            x = x0 + length * across
            y = y0 + length * up
            d_col = math.floor(x * scale) - corner_col - start_col
            d_row = math.floor(y * scale) - corner_row - start_row
            major_stride = 1 if d_col >= 0 else -1
            minor_stride = cols if d_row >= 0 else -cols
            major = abs(d_col)
            minor = abs(d_row)
            if minor > major:
                major, minor = minor, major
                major_stride, minor_stride = minor_stride, major_stride
            slope = (minor << _FRACTION) // max(major, 1)
            offset = 1 << (_FRACTION - 1)
            cell = start
            for _ in range(major):
                # An unsigned index isn't asked whether it counts from the end.
                flat[np.uint64(2 * (cell + (offset >> _FRACTION) * minor_stride) + 1)] += sign
                cell += major_stride
                offset += slope
            if r <= beams.usable and r < beams.range_max:
                end = 2 * (start + d_row * cols + d_col)
                flat[end] += sign
                flat[end + 1] += sign
    return bounds


@kernel
def draw_scans_once(
    counts: np.ndarray,
    corner: tuple[int, int],
    resolution: float,
    poses: FloatArray,
    ranges: Float32Array,
    beams: BeamTable,
    sign: int,
) -> tuple[float, float, float, float]:
    """As :func:`draw_scans`, but a scan counts a cell once: as a hit if a beam ends there, else as a visit."""
    beams = BeamTable(*beams)
    bounds = scan_bounds(poses, ranges, beams, np.empty(ranges.shape))
    first_row, first_col, last_row, last_col = cells_of(bounds, corner, resolution)
    if first_row < 0 or first_col < 0 or last_row >= counts.shape[0] or last_col >= counts.shape[1]:
        return bounds
    drawn = counts[first_row : last_row + 1, first_col : last_col + 1]
    of_scan = np.zeros((drawn.shape[0], drawn.shape[1], 2), counts.dtype)
    begin = (corner[0] + first_row, corner[1] + first_col)
    for k in range(len(poses)):
        pose = poses[k : k + 1]
        scan = ranges[k : k + 1]
        box = draw_scans(of_scan, begin, resolution, pose, scan, beams, 1)
        first_row, first_col, last_row, last_col = cells_of(box, begin, resolution)
        for row in range(first_row, last_row + 1):
            for col in range(first_col, last_col + 1):
                if of_scan[row, col, 1] > 0:
                    drawn[row, col, 0] += sign * min(of_scan[row, col, 0], 1)
                    drawn[row, col, 1] += sign
                    of_scan[row, col] = 0
    return bounds


@kernel
def classify_counts(
    counts: np.ndarray,
    box: tuple[int, int, int, int],
    threshold: float,
    margins: tuple[float, float],
    min_passes: int,
    out: ByteArray,
) -> None:
    """Cell values from counts.

    Args:
        counts: (rows, cols, 2) hits and visits, contiguous.
        box: First row and column and end of the rows and columns that are classified.
        threshold: A cell is occupied where hits exceed this share of the visits, free where they fall short of it.
        margins: By how many hits it must be exceeded, and missed; unknown between.
        min_passes: Unknown below so many visits.
        out: (rows, cols) receives the values, contiguous.
    """
    # Eight cells fit into a vector of these numbers; counts below 2^24 are exact.
    share = np.float32(threshold)
    above = np.float32(margins[0])
    below = np.float32(margins[1])
    pairs = counts.reshape(-1)
    values = out.reshape(-1)
    cols = counts.shape[1]
    for row in range(box[0], box[2]):
        # Unsigned indices of contiguous arrays let the compiler classify them at once.
        first = np.uint64(row * cols + box[1])
        end = np.uint64(row * cols + box[3])
        for cell in range(first, end):
            hits = pairs[np.uint64(2) * cell]
            visits = pairs[np.uint64(2) * cell + np.uint64(1)]
            excess = np.float32(hits) - share * np.float32(visits)
            value = np.uint8(FREE) if -excess >= below else np.uint8(UNKNOWN)
            value = np.uint8(OCCUPIED) if excess > above else value
            values[cell] = value if visits >= np.int32(min_passes) else np.uint8(UNKNOWN)


@kernel
def regrid(cells: ByteArray, left: float, bottom: float, ratio: float, out: ByteArray) -> None:
    """Read the map on another grid: of the cells that overlap a coarse one occupied wins, then free.

    Args:
        cells: (rows, cols) values, row 0 at the bottom.
        left: Where ``out`` begins, from the lower left corner of ``cells`` [cells].
        bottom: The same upwards.
        ratio: Size of a cell of ``out`` over that of ``cells``.
        out: (rows, cols) receives the values, row 0 at the top.
    """
    rows, cols = out.shape
    slack = 1e-6  # a border that coincides up to rounding overlaps nothing
    for row in range(rows):
        below = bottom + (rows - 1 - row) * ratio
        first_row = max(math.floor(below + slack), 0)
        last_row = min(math.ceil(below + ratio - slack), cells.shape[0])
        for col in range(cols):
            beside = left + col * ratio
            first_col = max(math.floor(beside + slack), 0)
            last_col = min(math.ceil(beside + ratio - slack), cells.shape[1])
            value = UNKNOWN
            for r in range(first_row, last_row):
                for c in range(first_col, last_col):
                    if cells[r, c] == OCCUPIED:
                        value = OCCUPIED
                    elif cells[r, c] == FREE and value == UNKNOWN:
                        value = FREE
            out[row, col] = value
