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
        index = -1
        while (index := self._next_clear(boxes, index + 1)) >= 0 and not self._leaves_ways(
            boxes[index], radii
        ):
            pass
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
        if all(
            _stay_connected(before >= radius, self.clearance[around] >= radius)
            for radius in radii + ROUNDING
        ):
            return True
        self.clearance[around] = before
        return False

    def _surroundings(self, box: FloatArray) -> tuple[slice, slice]:
        """Rows and columns of the cells that a box can concern, and one more about them."""
        x, y, ux, uy, half_length, half_width = box.tolist()
        half_x = abs(ux) * half_length + abs(uy) * half_width + self._far
        half_y = abs(uy) * half_length + abs(ux) * half_width + self._far
        rows, cols = (
            slice(
                max(0, int((middle - half - origin) / PASSAGE_CELL) - 1),
                max(0, int((middle + half - origin) / PASSAGE_CELL) + 2),
            )
            for middle, half, origin in ((y, half_y, self.origin[1]), (x, half_x, self.origin[0]))
        )
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

        cells: ByteArray = (self.clearance >= radius + ROUNDING).astype(np.uint8)
        count, labels, figures, _ = cv2.connectedComponentsWithStats(cells, connectivity=8)
        if count < 2:
            return -1, labels
        return 1 + int(np.argmax(figures[1:, cv2.CC_STAT_AREA])), labels

    def fits(self, radius: float) -> BoolArray:
        """Cells where a disc can be."""
        return self.clearance >= radius + ROUNDING

    def largest_part(self, radius: float) -> BoolArray:
        """Cells of the largest part in which a disc can move."""
        largest, labels = self.parts(radius)
        return labels == largest

    def cell(self, x: Any, y: Any) -> tuple[Any, Any]:
        """The cells of a point or of points, cut to the raster: row from the bottom, and column."""
        rows, cols = (
            np.clip(((np.asarray(values) - origin) / PASSAGE_CELL).astype(np.int64), 0, count - 1)
            for values, origin, count in zip(
                (y, x), self.origin[::-1], self.frame.shape, strict=True
            )
        )
        return rows, cols

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

        distance = cv2.distanceTransform((~part).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
        floor = (distance * PASSAGE_CELL <= reach) & (self.clearance > 0.0)
        x, _ = frame.to_point(0, np.arange(frame.width_px))
        _, y = frame.to_point(np.arange(frame.height_px)[::-1], 0)
        return np.ascontiguousarray(floor[np.ix_(*self.cell(x, y))])

    def distance_from(self, x: float, y: float) -> FloatArray:
        """Distance of each cell's centre from a point [m]."""
        height, width = self.frame.shape
        across = self.origin[0] + (np.arange(width) + 0.5) * PASSAGE_CELL - x
        up = self.origin[1] + (np.arange(height) + 0.5) * PASSAGE_CELL - y
        return np.hypot(across[None, :], up[:, None])

    def sample_point(self, cells: BoolArray, rng: np.random.Generator) -> tuple[float, float]:
        """The middle of a cell drawn evenly from those that are true."""
        rows, cols = np.nonzero(cells)
        index = int(rng.integers(len(rows)))
        x, y = self.origin
        return x + (float(cols[index]) + 0.5) * PASSAGE_CELL, y + (
            float(rows[index]) + 0.5
        ) * PASSAGE_CELL


@kernel
def _draw_segments(
    clearance: FloatArray, origin_x: float, origin_y: float, segments: FloatArray, far: float
) -> None:
    """Take the distance from segments into account."""
    height, width = clearance.shape
    for s in range(len(segments)):
        x0, y0, x1, y1 = segments[s]
        ex, ey = x1 - x0, y1 - y0
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
                dx, dy = x - share * ex, y - share * ey
                square = dx * dx + dy * dy
                if square < clearance[row, col] * clearance[row, col]:
                    clearance[row, col] = np.sqrt(square)


@kernel
def _draw_box(
    clearance: FloatArray, row0: int, col0: int, origin_x: float, origin_y: float, box: FloatArray
) -> None:
    """Take the distance from a box into account, in a part of the raster that begins at a row and a column."""
    for row in range(clearance.shape[0]):
        for col in range(clearance.shape[1]):
            dx = origin_x + (col0 + col + 0.5) * PASSAGE_CELL - box[0]
            dy = origin_y + (row0 + row + 0.5) * PASSAGE_CELL - box[1]
            along = max(abs(dx * box[2] + dy * box[3]) - box[4], 0.0)
            across = max(abs(dy * box[2] - dx * box[3]) - box[5], 0.0)
            clearance[row, col] = min(clearance[row, col], np.sqrt(along * along + across * across))


@kernel
def _meets_segment(box: FloatArray, segment: FloatArray) -> bool:
    """True if a segment meets a box, by clipping it to the box (Liang and Barsky)."""
    low, high = 0.0, 1.0
    dx, dy = segment[0] - box[0], segment[1] - box[1]
    ex, ey = segment[2] - segment[0], segment[3] - segment[1]
    for axis in range(2):
        ux, uy = (box[2], box[3]) if axis == 0 else (-box[3], box[2])
        start, step, half = dx * ux + dy * uy, ex * ux + ey * uy, box[4 + axis]
        if abs(step) < 1e-12:
            if abs(start) > half:
                return False
            continue
        first, second = (-half - start) / step, (half - start) / step
        low, high = max(low, min(first, second)), min(high, max(first, second))
    return low <= high


@kernel
def _overlap(a: FloatArray, b: FloatArray) -> bool:
    """True if two boxes overlap, by the separating axis theorem."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    cos, sin = abs(a[2] * b[2] + a[3] * b[3]), abs(a[2] * b[3] - a[3] * b[2])
    return (
        abs(dx * a[2] + dy * a[3]) < a[4] + cos * b[4] + sin * b[5]
        and abs(dy * a[2] - dx * a[3]) < a[5] + sin * b[4] + cos * b[5]
        and abs(dx * b[2] + dy * b[3]) < b[4] + cos * a[4] + sin * a[5]
        and abs(dy * b[2] - dx * b[3]) < b[5] + sin * a[4] + cos * a[5]
    )


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
        row, col = int((box[1] - origin_y) / PASSAGE_CELL), int((box[0] - origin_x) / PASSAGE_CELL)
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
    return count == parts and bool(np.bincount(labels[after], minlength=parts)[1:].all())
