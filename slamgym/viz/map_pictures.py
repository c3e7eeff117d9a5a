"""Pictures of a map for people: walls, free space, paths, a scale bar; one map, one that grows, a localisation."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from slamgym.core.geometry import compose, inverse, paste, transform_poses
from slamgym.core.types import BoolArray, ByteArray, FloatArray, GridFrame, OccupancyGrid, Pose2D
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    FAINT,
    FRAME_HEIGHT,
    FRAME_WIDTH,
    PAPER,
    SHIFT,
    SURE_COLOUR,
    TRUE_COLOUR,
    UNKNOWN_TINT,
    Colour,
    blank,
    colour_cells,
    draw_dot,
    draw_lines,
    draw_scale_bar,
    draw_text,
    fitting_size,
    fixed_point,
    frame_pixels,
    rescaled,
    text_width,
)

PARTICLE: Colour = (0, 150, 136)

MIN_SIDE_PX = 1000
"""Maps are enlarged up to a longer side of this."""
MAX_SIDE_PX = 2400
"""Larger maps are shrunk to a longer side of this."""
PAGE_MARGIN_PX = 36
"""Round a map on its page."""
FOOTER_PX = 64
"""Height of the strip with scale bar and caption."""
UNSURE: Colour = (245, 159, 0)
"""Colour of what may be wrong."""
STATE_COLOURS: dict[str, Colour] = {
    "searching": FAINT,
    "ambiguous": UNSURE,
    "localised": TRUE_COLOUR,
    "lost": BELIEVED_COLOUR,
}
LEGEND = "blue localised, grey searching, orange ambiguous, red lost; arrows: the end"
ARROW = 0.6
"""Length of an arrow [m]."""


def draw_map(
    grid: OccupancyGrid,
    paths: Sequence[FloatArray],
    caption: str = "",
    doubtful: BoolArray | None = None,
) -> ByteArray:
    """Draw a map with the paths travelled.

    Args:
        grid: The map.
        paths: Of each drive poses or points in the map frame, shape (N, 2) or (N, 3); blue at the start, red at the
            end.
        caption: One line below the map.
        doubtful: True where the first path may be wrong, shape (N,); it is orange and wide there.

    Returns:
        RGB, shape (height, width, 3).
    """
    picture, factor = map_picture(grid)
    drives = [frame_pixels(path, grid.frame, factor) for path in paths]
    thickness = _line_thickness(picture)
    if doubtful is not None:
        _draw_doubtful(picture, drives[0], doubtful, 4 * thickness)
    for pixels in drives:
        _draw_gradient_path(picture, pixels, thickness)
    return page_of(picture, grid.frame.resolution / factor, caption)


def _draw_doubtful(
    picture: ByteArray, pixels: FloatArray, doubtful: BoolArray, thickness: int
) -> None:
    """Draw the doubtful stretches of a path of pixels (N, 2)."""
    changes = np.flatnonzero(np.diff(doubtful)) + 1
    numbers = np.arange(len(pixels))
    for run in np.split(numbers, changes):
        if doubtful[run[0]]:
            fixed = fixed_point(pixels[run])
            draw_lines(picture, [fixed], UNSURE, thickness)


def map_picture(grid: OccupancyGrid) -> tuple[ByteArray, float]:
    """A map alone, RGB, and how many pixels a cell has."""
    longest = max(grid.cells.shape)
    # Whole factors keep the cells sharp where the map is small; larger maps are averaged down.
    factor: float = max(1, MIN_SIDE_PX // longest)
    if longest >= MAX_SIDE_PX:
        factor = MAX_SIDE_PX / longest
    return rescaled(colour_cells(grid.cells), factor), factor


def page_of(picture: ByteArray, metres_per_px: float, caption: str) -> ByteArray:
    """A picture of a map on a page with a scale bar and a caption."""
    rows, cols = picture.shape[:2]
    height = PAGE_MARGIN_PX + rows + FOOTER_PX
    width = max(cols + 2 * PAGE_MARGIN_PX, 640)
    page = blank((height, width), PAPER)
    left = (width - cols) // 2
    right = left + cols
    bottom = PAGE_MARGIN_PX + rows
    page[PAGE_MARGIN_PX:bottom, left:right] = picture
    _draw_footer(page, metres_per_px, caption)
    return page


def draw_localization(
    grid: OccupancyGrid,
    placement: Pose2D,
    poses: FloatArray,
    states: Sequence[str],
    hypotheses: Sequence[Pose2D],
    caption: str,
) -> ByteArray:
    """Draw a drive over the map that it was localised on.

    Args:
        grid: The map.
        placement: Of the grid's frame in the map's.
        poses: (n, 3) best hypothesis at each processed scan, in the map's frame.
        states: (n,) what was believed of it.
        hypotheses: What is possible at the end; drawn as arrows.
        caption: One line below the map.

    Returns:
        RGB, shape (height, width, 3).
    """
    picture, factor = map_picture(grid)
    back = inverse(placement)
    thickness = 2 * _line_thickness(picture)
    on_grid = transform_poses(back, poses)
    places = frame_pixels(on_grid, grid.frame, factor)
    pixels = fixed_point(places)
    _draw_states(picture, pixels, states, thickness)
    for pose in hypotheses:
        x, y, theta = compose(back, pose)
        tip_x = x + ARROW * math.cos(theta)
        tip_y = y + ARROW * math.sin(theta)
        points = np.array([[x, y], [tip_x, tip_y]])
        ends = frame_pixels(points, grid.frame, factor)
        whole = ends.round().astype(int)
        start, end = whole.tolist()
        cv2.arrowedLine(picture, start, end, SURE_COLOUR, thickness, cv2.LINE_AA, 0, 0.4)
    return page_of(picture, grid.frame.resolution / factor, f"{caption}   {LEGEND}")


def _draw_states(
    picture: ByteArray, pixels: np.ndarray, states: Sequence[str], thickness: int
) -> None:
    """Draw a drive through fixed-point pixels (n, 2): a line where it was localised, else dots."""
    before = ""
    for index, state in enumerate(states):
        colour = STATE_COLOURS[state]
        if state != "localised":
            draw_dot(picture, pixels[index], thickness, colour)
        elif before == "localised":
            step = pixels[index - 1 : index + 1]
            cv2.polylines(picture, [step], False, colour, thickness, cv2.LINE_AA, SHIFT)
        before = state


_Bounds = tuple[float, float, float, float]
"""min x, min y, max x, max y [m]."""


class GrowingView:
    """Draws a map as it grows on pictures of one size, whose scale only ever shrinks."""

    def __init__(self) -> None:
        self._bounds: _Bounds | None = None

    def draw(self, grid: OccupancyGrid, paths: Sequence[FloatArray], caption: str) -> ByteArray:
        """Draw the map so far.

        Args:
            grid: The map.
            paths: The best path first, then those of other particles; each (N, 2) or (N, 3), map frame.
            caption: One line at the bottom.

        Returns:
            RGB, shape (FRAME_HEIGHT, FRAME_WIDTH, 3).
        """
        frame = self._frame(grid.frame)
        min_x, min_y, max_x, max_y = frame.bounds
        view_height = FRAME_HEIGHT - FOOTER_PX
        width = max_x - min_x
        height = max_y - min_y
        scale = min(FRAME_WIDTH / width, view_height / height)  # [px/m]
        shown_width = FRAME_WIDTH / scale
        min_x -= 0.5 * (shown_width - width)
        frame = frame._replace(origin_x=min_x)
        page = blank((FRAME_HEIGHT, FRAME_WIDTH), PAPER)
        view = page[:view_height]
        view[:] = UNKNOWN_TINT
        grid_left, _, _, grid_top = grid.frame.bounds
        left = round((grid_left - min_x) * scale)
        top = round((max_y - grid_top) * scale)
        colours = colour_cells(grid.cells)
        cell_px = scale * frame.resolution
        cells = rescaled(colours, cell_px)
        view_channels = np.moveaxis(view, 2, 0)
        cell_channels = np.moveaxis(cells, 2, 0)
        paste(view_channels, cell_channels, -top, -left)
        for path in paths[1:]:
            pixels = frame_pixels(path, frame, cell_px)
            draw_lines(view, [fixed_point(pixels)], PARTICLE, 1)
        best = frame_pixels(paths[0], frame, cell_px)
        _draw_gradient_path(view, best, 2)
        _draw_footer(page, 1.0 / scale, caption)
        return page

    def _frame(self, grid: GridFrame) -> GridFrame:
        """A frame that holds the grid; grown by a quarter at a time, so that the picture seldom jumps."""
        shown = self._bounds
        if shown is None or _united(shown, grid.bounds) != shown:
            min_x, min_y, max_x, max_y = grid.bounds
            spare = 0.125 * max(max_x - min_x, max_y - min_y, 4.0)
            wider = (min_x - spare, min_y - spare, max_x + spare, max_y + spare)
            shown = wider if shown is None else _united(shown, wider)
            self._bounds = shown
        return GridFrame.covering(shown, grid.resolution)


def _line_thickness(picture: ByteArray) -> int:
    """Of lines on a picture [px]."""
    width = picture.shape[1]
    return max(1, round(width / 800))


def _united(bounds: _Bounds, other: _Bounds) -> _Bounds:
    """The box around two boxes."""
    return (
        min(bounds[0], other[0]),
        min(bounds[1], other[1]),
        max(bounds[2], other[2]),
        max(bounds[3], other[3]),
    )


def _draw_gradient_path(picture: ByteArray, pixels: FloatArray, thickness: int) -> None:
    """Draw a path of pixels (N, 2) whose colour runs from blue to red, with its end points."""
    if len(pixels) == 0:
        return
    fixed = fixed_point(pixels)
    end = len(fixed) - 1
    pieces = min(64, max(1, end))
    places = np.linspace(0, end, pieces + 1)
    bounds = places.round().astype(int)
    colours = np.linspace(TRUE_COLOUR, BELIEVED_COLOUR, pieces)
    for number, colour in enumerate(colours.tolist()):
        first = bounds[number]
        last = bounds[number + 1]
        piece = fixed[first : last + 1]
        draw_lines(picture, [piece], colour, thickness)
    draw_dot(picture, fixed[0], 3 * thickness, TRUE_COLOUR)
    draw_dot(picture, fixed[-1], 3 * thickness, BELIEVED_COLOUR)


def _draw_footer(page: ByteArray, metres_per_px: float, caption: str) -> None:
    """Scale bar at the left, caption at the right."""
    height, width = page.shape[:2]
    middle = height - FOOTER_PX // 2
    bar_end = draw_scale_bar(page, (PAGE_MARGIN_PX, middle), metres_per_px, width / 6.0)
    right = width - PAGE_MARGIN_PX
    size = fitting_size(caption, 0.55, right - bar_end - 24)
    left = right - text_width(caption, size)
    draw_text(page, caption, left, middle + 6, size)
