"""Pictures of a map that are good to look at: walls, free space, paths, a scale bar."""

import itertools
import math
from collections.abc import Sequence

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, ByteArray, FloatArray, GridFrame, OccupancyGrid

# RGB colours.
PAPER = (233, 236, 239)
FLOOR = (255, 255, 255)
WALL = (33, 37, 41)
INK = (52, 58, 64)
PATH_START, PATH_END = (66, 133, 244), (234, 67, 53)
PARTICLE = (0, 150, 136)

MIN_SIDE_PX, MAX_SIDE_PX = 1000, 2400
MARGIN_PX = 36
FOOTER_PX = 64
FONT = cv2.FONT_HERSHEY_DUPLEX


def map_picture(grid: OccupancyGrid, path: FloatArray, caption: str = "") -> ByteArray:
    """Draw a map with the path travelled.

    Args:
        grid: The map.
        path: Poses or points in the map frame, shape (N, 2) or (N, 3); blue at the start, red at the end.
        caption: One line below the map.

    Returns:
        RGB image, shape (height, width, 3) uint8.
    """
    rows, cols = grid.cells.shape
    longest = max(rows, cols)
    # Whole factors keep the cells sharp where the map is small; larger maps are averaged down.
    factor: float = max(1, MIN_SIDE_PX // longest) if longest < MAX_SIDE_PX else MAX_SIDE_PX / longest
    image = _paint_cells(grid, factor)
    to_pixel = _Projection(grid.frame, factor)
    draw_path(image, to_pixel(path), max(1, round(image.shape[1] / 800)))
    return _with_footer(image, grid.frame.resolution / factor, caption)


def view_picture(
    grid: OccupancyGrid, frame: GridFrame, size: tuple[int, int], paths: Sequence[FloatArray], caption: str
) -> ByteArray:
    """Draw one frame of a growing map on a canvas of fixed size.

    Args:
        grid: The map so far.
        frame: What part of the map frame the canvas shows (its resolution is ignored).
        size: Width and height of the canvas [px].
        paths: The best path first, then those of other particles; each (N, 2) or (N, 3).
        caption: One line at the bottom.

    Returns:
        RGB image, shape (height, width, 3).
    """
    width, height = size
    min_x, min_y, max_x, max_y = frame.bounds
    scale = min(width / (max_x - min_x), (height - FOOTER_PX) / (max_y - min_y))  # [px/m]
    factor = scale * grid.frame.resolution
    painted = _paint_cells(grid, factor)
    image = np.full((height, width, 3), PAPER, dtype=np.uint8)
    left = round((grid.frame.bounds[0] - min_x) * scale)
    top = round((max_y - grid.frame.bounds[3]) * scale)
    _paste(image[: height - FOOTER_PX], painted, top, left)
    to_pixel = _Projection(frame, scale * frame.resolution)
    for path in paths[1:]:
        cv2.polylines(image, [_subpixel(to_pixel(path))], False, PARTICLE, 1, cv2.LINE_AA, 4)
    draw_path(image, to_pixel(paths[0]), 2)
    image[height - FOOTER_PX :] = PAPER
    _draw_footer(image, 1.0 / scale, caption)
    return image


def draw_path(image: ByteArray, points: FloatArray, thickness: int) -> None:
    """Draw a polyline whose colour runs from blue to red, with its end points, into the image.

    Args:
        image: RGB, changed in place.
        points: Pixel coordinates (column, row), shape (N, 2).
        thickness: [px].
    """
    if len(points) == 0:
        return
    fixed = _subpixel(points)
    start, end = np.array(PATH_START, float), np.array(PATH_END, float)
    pieces = min(64, max(1, len(points) - 1))
    bounds = np.linspace(0, len(points) - 1, pieces + 1).round().astype(int)
    for piece, (first, last) in enumerate(itertools.pairwise(bounds)):
        share = piece / max(pieces - 1, 1)
        colour = tuple(float(value) for value in (1 - share) * start + share * end)
        cv2.polylines(image, [fixed[first : last + 1]], False, colour, thickness, cv2.LINE_AA, 4)
    for point, colour in ((fixed[0, 0], PATH_START), (fixed[-1, 0], PATH_END)):
        cv2.circle(image, (int(point[0]), int(point[1])), 16 * (3 * thickness), colour, -1, cv2.LINE_AA, 4)


class _Projection:
    """Points of the map frame [m] to pixels (column, row)."""

    def __init__(self, frame: GridFrame, factor: float) -> None:
        self._left, _, _, self._top = frame.bounds
        self._scale = factor / frame.resolution

    def __call__(self, points: FloatArray) -> FloatArray:
        x, y = np.asarray(points, dtype=np.float64).reshape(len(points), -1).T[:2]
        return np.column_stack([(x - self._left) * self._scale, (self._top - y) * self._scale])


def _subpixel(points: FloatArray) -> np.ndarray:
    """Fixed-point pixels with 4 fractional bits, as OpenCV's drawing takes them; shape (N, 1, 2)."""
    fixed: np.ndarray = np.rint(np.clip(points, -1e6, 1e6) * 16.0).astype(np.int32).reshape(-1, 1, 2)
    return fixed


def _paint_cells(grid: OccupancyGrid, factor: float) -> ByteArray:
    colours = np.full((*grid.cells.shape, 3), PAPER, dtype=np.uint8)
    colours[grid.cells == FREE] = FLOOR
    colours[grid.cells == OCCUPIED] = WALL
    if factor == 1.0:
        return colours
    rows, cols = grid.cells.shape
    size = (max(1, round(cols * factor)), max(1, round(rows * factor)))
    way = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(colours, size, interpolation=way), dtype=np.uint8)


def _paste(image: ByteArray, patch: ByteArray, top: int, left: int) -> None:
    height, width = image.shape[:2]
    rows = slice(max(top, 0), min(top + patch.shape[0], height))
    cols = slice(max(left, 0), min(left + patch.shape[1], width))
    if rows.start < rows.stop and cols.start < cols.stop:
        image[rows, cols] = patch[rows.start - top : rows.stop - top, cols.start - left : cols.stop - left]


def _with_footer(image: ByteArray, metres_per_px: float, caption: str) -> ByteArray:
    rows, cols = image.shape[:2]
    width = max(cols + 2 * MARGIN_PX, 640)
    canvas = np.full((rows + MARGIN_PX + FOOTER_PX, width, 3), PAPER, dtype=np.uint8)
    left = (width - cols) // 2
    canvas[MARGIN_PX : MARGIN_PX + rows, left : left + cols] = image
    _draw_footer(canvas, metres_per_px, caption)
    return canvas


def _draw_footer(canvas: ByteArray, metres_per_px: float, caption: str) -> None:
    """Scale bar at the left, caption beside it."""
    height, width = canvas.shape[:2]
    length = _round_length(metres_per_px * width / 6.0)
    bar = round(length / metres_per_px)
    y = height - FOOTER_PX // 2
    x = MARGIN_PX
    cv2.line(canvas, (x, y), (x + bar, y), INK, 2, cv2.LINE_AA)
    for end in (x, x + bar):
        cv2.line(canvas, (end, y - 6), (end, y + 6), INK, 2, cv2.LINE_AA)
    cv2.putText(canvas, f"{length:g} m", (x + bar + 12, y + 6), FONT, 0.55, INK, 1, cv2.LINE_AA)
    if caption:
        free = width - (x + bar + 110) - MARGIN_PX
        scale = 0.55
        while scale > 0.3 and cv2.getTextSize(caption, FONT, scale, 1)[0][0] > free:
            scale -= 0.03
        text_width = cv2.getTextSize(caption, FONT, scale, 1)[0][0]
        cv2.putText(
            canvas, caption, (width - MARGIN_PX - text_width, y + 6), FONT, scale, INK, 1, cv2.LINE_AA
        )


def _round_length(metres: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above."""
    power = 10.0 ** math.floor(math.log10(max(metres, 1e-6)))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= metres * (1 + 1e-9))
