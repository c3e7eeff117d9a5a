"""Where a disc can go among walls and furniture: distances on a raster, and what a new obstacle would cut off.

The raster holds the exact distance of each cell's centre from the nearest obstacle. A disc can go from one open
cell to its eight neighbours; between them it comes at most 3 mm nearer to a corner, which the robot's radius
gets on top. An obstacle is tried in its own surroundings alone: where every open part of them stays in one piece,
the building does, too.

Convention: rasters have row 0 at the *bottom*, so that row and y grow together. A box is a row of six numbers:
middle x, y, unit vector of its length x, y, half its length, half its width [m].
"""

import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, ByteArray, FloatArray, GridFrame, IntArray

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

PASSAGE_CELL = 0.05
"""Side of a cell [m]."""

ROUNDING = 0.005
"""A path over the raster's cells comes nearer to an obstacle than the cells themselves by this at most [m]."""


class Passages:
    """Distances in one building, which grow smaller as it fills.

    Args:
        plan: The building.
        far: Distances are known up to here; more than the radius of any disc that is asked about [m].

    Attributes:
        frame: Where the cells lie.
        walls: The plan's segments, shape (S, 4) [m].
        clearance: Distance of each cell's centre from the nearest obstacle, 0 inside, at most ``far`` [m].
    """

    def __init__(self, plan: "FloorPlan", far: float) -> None:
        # Here, because help pages read the settings of this package and shapely takes long to import.
        from slamgym.cad.floorplan import fill_segments

        self.frame = GridFrame.covering(plan.bounds, PASSAGE_CELL, margin=4.0 * PASSAGE_CELL)
        self.walls = plan.segments()
        free = fill_segments(self.walls, self.frame)[::-1]
        self.clearance: FloatArray = np.where(free, far, 0.0)
        self.origin = self.frame.origin_x, self.frame.origin_y
        self._far = far
        _draw_segments(self.clearance, *self.origin, self.walls, far)
        self._boxes = np.empty((64, 6))
        self._count = 0

    @property
    def boxes(self) -> FloatArray:
        """All boxes that nothing else may overlap, shape (B, 6)."""
        return self._boxes[: self._count]

    def first_fit(self, boxes: FloatArray, radii: FloatArray, *, reserve: bool = True) -> int:
        """Place the first of some boxes that overlaps nothing and doesn't block the ways of discs of any radius.

        Args:
            boxes: Candidates, shape (N, 6).
            radii: Of the discs [m].
            reserve: Keep later boxes off it.

        Returns:
            The box's index, or -1 if none fits.
        """
        index = self._next_clear(boxes, 0)
        while index >= 0 and not self._leaves_ways(boxes[index], radii):
            index = self._next_clear(boxes, index + 1)
        if index >= 0 and reserve:
            self.reserve(boxes[index])
        return index

    def _next_clear(self, boxes: FloatArray, first: int) -> int:
        return next_clear(self.clearance, *self.origin, self.walls, self.boxes, boxes, first)

    def _leaves_ways(self, box: FloatArray, radii: FloatArray) -> bool:
        """Put a box somewhere unless it cuts the ways of discs; returns True if it stands."""
        around = self._surroundings(box)
        before = self.clearance[around].copy()
        self.block(box)
        after = self.clearance[around]
        for radius in radii + ROUNDING:
            if not _stay_connected(before >= radius, after >= radius):
                self.clearance[around] = before
                return False
        return True

    def _surroundings(self, box: FloatArray) -> tuple[slice, slice]:
        """Rows and columns of the cells that a box can concern, and one more about them."""
        x, y, ux, uy, half_length, half_width = box.tolist()
        half_x = abs(ux) * half_length + abs(uy) * half_width + self._far
        half_y = abs(uy) * half_length + abs(ux) * half_width + self._far
        left, bottom = self.origin
        rows = _cells_between(y - half_y, y + half_y, bottom)
        cols = _cells_between(x - half_x, x + half_x, left)
        return rows, cols

    def is_clear(self, box: FloatArray) -> bool:
        """True if a box lies in the free space and overlaps no other."""
        return self._next_clear(box[None], 0) == 0

    def reserve(self, box: FloatArray) -> None:
        """Keep other boxes off a place, though discs may go there."""
        if self._count == len(self._boxes):
            self._boxes = np.vstack([self._boxes, np.empty_like(self._boxes)])
        self._boxes[self._count] = box
        self._count += 1

    def block(self, box: FloatArray) -> None:
        """Put an obstacle somewhere, even if it cuts something off."""
        rows, cols = self._surroundings(box)
        _draw_box(self.clearance[rows, cols], rows.start, cols.start, *self.origin, box)

    def with_box(self, box: FloatArray) -> "Passages":
        """The same with one obstacle more."""
        other = copy.copy(self)
        other.clearance = self.clearance.copy()
        other.block(box)
        return other

    def parts(self, radius: float) -> tuple[int, IntArray]:
        """The connected parts in which a disc can move.

        Returns:
            The label of the largest (-1 if there is none), and the labels of all cells, 0 where it can't be.
        """
        import cv2

        cells: ByteArray = self.fits(radius).astype(np.uint8)
        count, labels, figures, _ = cv2.connectedComponentsWithStats(cells, connectivity=8)
        if count < 2:
            return -1, labels
        sizes = figures[1:, cv2.CC_STAT_AREA]
        return 1 + int(np.argmax(sizes)), labels

    def fits(self, radius: float) -> BoolArray:
        """Cells where a disc can be."""
        return self.clearance >= radius + ROUNDING

    def largest_part(self, radius: float) -> BoolArray:
        """Cells of the largest part in which a disc can move."""
        largest, labels = self.parts(radius)
        return labels == largest

    def cell(self, x: Any, y: Any) -> tuple[Any, Any]:
        """The cells of a point or of points, cut to the raster: row from the bottom, and column."""
        left, bottom = self.origin
        height, width = self.frame.shape
        return _cells_at(y, bottom, height), _cells_at(x, left, width)

    def floor_about(self, part: BoolArray, reach: float, frame: GridFrame) -> BoolArray:
        """The floor near a part of the cells, as far as no obstacle covers it, on another raster.

        Args:
            part: Where a disc can be, as from :meth:`parts`.
            reach: How near [m].
            frame: Of the result.

        Returns:
            Shape ``frame.shape``, row 0 at the bottom.
        """
        import cv2

        others = (~part).astype(np.uint8)
        distance = cv2.distanceTransform(others, cv2.DIST_L2, cv2.DIST_MASK_5)
        is_near = distance * PASSAGE_CELL <= reach
        floor = is_near & (self.clearance > 0.0)
        x, _ = frame.to_point(0, np.arange(frame.width_px))
        _, y = frame.to_point(np.arange(frame.height_px)[::-1], 0)
        rows, cols = self.cell(x, y)
        return np.ascontiguousarray(floor[np.ix_(rows, cols)])

    def distance_from(self, x: float, y: float) -> FloatArray:
        """Distance of each cell's centre from a point [m]."""
        height, width = self.frame.shape
        left, bottom = self.origin
        across = left + (np.arange(width) + 0.5) * PASSAGE_CELL - x
        up = bottom + (np.arange(height) + 0.5) * PASSAGE_CELL - y
        return np.hypot(across[None, :], up[:, None])

    def sample_point(self, cells: BoolArray, rng: np.random.Generator) -> tuple[float, float]:
        """The middle of a cell drawn evenly from those that are true."""
        rows, cols = np.nonzero(cells)
        index = int(rng.integers(len(rows)))
        left, bottom = self.origin
        x = left + (float(cols[index]) + 0.5) * PASSAGE_CELL
        y = bottom + (float(rows[index]) + 0.5) * PASSAGE_CELL
        return x, y


def _cells_at(values: Any, origin: float, count: int) -> Any:
    """Indices of the cells of coordinates [m], cut to a number of cells."""
    cells = ((np.asarray(values) - origin) / PASSAGE_CELL).astype(np.int64)
    return np.clip(cells, 0, count - 1)


def _cells_between(low: float, high: float, origin: float) -> slice:
    """Indices of the cells between two coordinates [m], and one more on either side."""
    first = int((low - origin) / PASSAGE_CELL) - 1
    end = int((high - origin) / PASSAGE_CELL) + 2
    return slice(max(0, first), max(0, end))


@kernel
def _draw_segments(
    clearance: FloatArray, origin_x: float, origin_y: float, segments: FloatArray, far: float
) -> None:
    """Take the distance from segments into account."""
    height, width = clearance.shape
    for s in range(len(segments)):
        x0, y0, x1, y1 = segments[s]
        ex = x1 - x0
        ey = y1 - y0
        scale = 1.0 / max(ex * ex + ey * ey, 1e-18)
        row0 = max(0, int((min(y0, y1) - far - origin_y) / PASSAGE_CELL))
        row1 = min(height, int((max(y0, y1) + far - origin_y) / PASSAGE_CELL) + 1)
        col0 = max(0, int((min(x0, x1) - far - origin_x) / PASSAGE_CELL))
        col1 = min(width, int((max(x0, x1) + far - origin_x) / PASSAGE_CELL) + 1)
        for row in range(row0, row1):
            y = origin_y + (row + 0.5) * PASSAGE_CELL - y0
            for col in range(col0, col1):
                x = origin_x + (col + 0.5) * PASSAGE_CELL - x0
                share = min(max((x * ex + y * ey) * scale, 0.0), 1.0)
                dx = x - share * ex
                dy = y - share * ey
                square = dx * dx + dy * dy
                if square < clearance[row, col] * clearance[row, col]:
                    clearance[row, col] = np.sqrt(square)


@kernel
def _draw_box(
    clearance: FloatArray, row0: int, col0: int, origin_x: float, origin_y: float, box: FloatArray
) -> None:
    """Take the distance from a box into account, in a part of the raster that begins at a row and a column."""
    x, y, ux, uy, half_length, half_width = box
    height, width = clearance.shape
    for row in range(height):
        for col in range(width):
            dx = origin_x + (col0 + col + 0.5) * PASSAGE_CELL - x
            dy = origin_y + (row0 + row + 0.5) * PASSAGE_CELL - y
            along = max(abs(dx * ux + dy * uy) - half_length, 0.0)
            across = max(abs(dy * ux - dx * uy) - half_width, 0.0)
            distance = np.sqrt(along * along + across * across)
            clearance[row, col] = min(clearance[row, col], distance)


@kernel
def _meets_segment(box: FloatArray, segment: FloatArray) -> bool:
    """True if a segment meets a box, by clipping it to the box (Liang and Barsky)."""
    x, y, ux, uy, half_length, half_width = box
    x0, y0, x1, y1 = segment
    dx = x0 - x
    dy = y0 - y
    ex = x1 - x0
    ey = y1 - y0
    low = 0.0
    high = 1.0
    for axis in range(2):
        # Start and step of the segment along an axis of the box, and half the box's size along it.
        if axis == 0:
            start = dx * ux + dy * uy
            step = ex * ux + ey * uy
            half = half_length
        else:
            start = dx * -uy + dy * ux
            step = ex * -uy + ey * ux
            half = half_width
        if abs(step) < 1e-12:
            if abs(start) > half:
                return False
            continue
        first = (-half - start) / step
        second = (half - start) / step
        low = max(low, min(first, second))
        high = min(high, max(first, second))
    return low <= high


@kernel
def _overlap(first: FloatArray, second: FloatArray) -> bool:
    """True if two boxes overlap, by the separating axis theorem."""
    x, y, ux, uy, half_length, half_width = first
    other_x, other_y, other_ux, other_uy, other_half_length, other_half_width = second
    dx = other_x - x
    dy = other_y - y
    cos = abs(ux * other_ux + uy * other_uy)
    sin = abs(ux * other_uy - uy * other_ux)
    if abs(dx * ux + dy * uy) >= half_length + cos * other_half_length + sin * other_half_width:
        return False
    if abs(dy * ux - dx * uy) >= half_width + sin * other_half_length + cos * other_half_width:
        return False
    along = abs(dx * other_ux + dy * other_uy)
    if along >= other_half_length + cos * half_length + sin * half_width:
        return False
    across = abs(dy * other_ux - dx * other_uy)
    return across < other_half_width + sin * half_length + cos * half_width


@kernel
def next_clear(
    clearance: FloatArray,
    origin_x: float,
    origin_y: float,
    walls: FloatArray,
    boxes: FloatArray,
    candidates: FloatArray,
    first: int,
) -> int:
    """Index of the first candidate, from one on, that lies in the free space and overlaps no box; -1 if none does."""
    height, width = clearance.shape
    for index in range(first, len(candidates)):
        box = candidates[index]
        row = int((box[1] - origin_y) / PASSAGE_CELL)
        col = int((box[0] - origin_x) / PASSAGE_CELL)
        clear = 0 <= row < height and 0 <= col < width and clearance[row, col] > 0.0
        for b in range(len(boxes) if clear else 0):
            clear = clear and not _overlap(box, boxes[b])
        for s in range(len(walls) if clear else 0):
            clear = clear and not _meets_segment(box, walls[s])
        if clear:
            return index
    return -1


def _stay_connected(before: BoolArray, after: BoolArray) -> bool:
    """True if each connected part of the open cells keeps some of them, and those connected; only some may close."""
    import cv2

    if (before == after).all():
        return True
    parts, labels = cv2.connectedComponents(before.view(np.uint8), connectivity=8)
    # As many parts as before, and some of each: none was cut in two.
    count, _ = cv2.connectedComponents(after.view(np.uint8), connectivity=8)
    sizes = np.bincount(labels[after], minlength=parts)
    return count == parts and bool(sizes[1:].all())
