"""Pictures of a map for people: walls, free space, paths, a scale bar; one map, one that grows, a localisation."""

import itertools
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
    draw_scale_bar,
    draw_text,
    fitting_size,
    fixed_point,
    frame_pixels,
    rescaled,
    text_width,
)

PARTICLE: Colour = (0, 150, 136)

MIN_SIDE_PX, MAX_SIDE_PX = 1000, 2400
PAGE_MARGIN_PX = 36
FOOTER_PX = 64
UNSURE: Colour = (245, 159, 0)
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
    grid: OccupancyGrid, path: FloatArray, caption: str = "", doubtful: BoolArray | None = None
) -> ByteArray:
    """Draw a map with the path travelled.

    Args:
        grid: The map.
        path: Poses or points in the map frame, shape (N, 2) or (N, 3); blue at the start, red at the end.
        caption: One line below the map.
        doubtful: True where the path may be wrong, shape (N,); it is orange and wide there.

    Returns:
        RGB, shape (height, width, 3).
    """
    picture, factor = map_picture(grid)
    pixels, thickness = (
        frame_pixels(path, grid.frame, factor),
        max(1, round(picture.shape[1] / 800)),
    )
    for run in np.split(
        np.arange(len(path)), [] if doubtful is None else np.flatnonzero(np.diff(doubtful)) + 1
    ):
        if doubtful is not None and doubtful[run[0]]:
            fixed = fixed_point(pixels[run])
            cv2.polylines(picture, [fixed], False, UNSURE, 4 * thickness, cv2.LINE_AA, SHIFT)
    _draw_gradient_path(picture, pixels, thickness)
    return page_of(picture, grid.frame.resolution / factor, caption)


def map_picture(grid: OccupancyGrid) -> tuple[ByteArray, float]:
    """A map alone, RGB, and how many pixels a cell has."""
    longest = max(grid.cells.shape)
    # Whole factors keep the cells sharp where the map is small; larger maps are averaged down.
    factor: float = (
        max(1, MIN_SIDE_PX // longest) if longest < MAX_SIDE_PX else MAX_SIDE_PX / longest
    )
    return rescaled(colour_cells(grid.cells), factor), factor


def page_of(picture: ByteArray, metres_per_px: float, caption: str) -> ByteArray:
    """A picture of a map on a page with a scale bar and a caption."""
    rows, cols = picture.shape[:2]
    page = blank((PAGE_MARGIN_PX + rows + FOOTER_PX, max(cols + 2 * PAGE_MARGIN_PX, 640)), PAPER)
    left = (page.shape[1] - cols) // 2
    page[PAGE_MARGIN_PX : PAGE_MARGIN_PX + rows, left : left + cols] = picture
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
    width = max(1, round(picture.shape[1] / 800))
    pixels = fixed_point(frame_pixels(transform_poses(back, poses), grid.frame, factor))
    for index, (state, (col, row)) in enumerate(zip(states, pixels, strict=True)):
        colour, step = STATE_COLOURS[state], pixels[index - 1 : index + 1]
        if state != "localised":
            cv2.circle(
                picture, (int(col), int(row)), 2 * width << SHIFT, colour, -1, cv2.LINE_AA, SHIFT
            )
        elif index > 0 and states[index - 1] == "localised":
            cv2.polylines(picture, [step], False, colour, 2 * width, cv2.LINE_AA, SHIFT)
    for pose in hypotheses:
        x, y, theta = compose(back, pose)
        ends = np.array([[x, y], [x + ARROW * math.cos(theta), y + ARROW * math.sin(theta)]])
        start, end = frame_pixels(ends, grid.frame, factor).round().astype(int).tolist()
        cv2.arrowedLine(picture, start, end, SURE_COLOUR, 2 * width, cv2.LINE_AA, 0, 0.4)
    return page_of(picture, grid.frame.resolution / factor, f"{caption}   {LEGEND}")


class GrowingView:
    """Draws a map as it grows on pictures of one size, whose scale only ever shrinks."""

    def __init__(self) -> None:
        self._bounds: tuple[float, float, float, float] | None = None

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
        scale = min(
            FRAME_WIDTH / (max_x - min_x), (FRAME_HEIGHT - FOOTER_PX) / (max_y - min_y)
        )  # [px/m]
        min_x -= 0.5 * (FRAME_WIDTH / scale - (max_x - min_x))
        frame = frame._replace(origin_x=min_x)
        page = blank((FRAME_HEIGHT, FRAME_WIDTH), PAPER)
        view = page[: FRAME_HEIGHT - FOOTER_PX]
        view[:] = UNKNOWN_TINT
        left, top = (grid.frame.bounds[0] - min_x) * scale, (max_y - grid.frame.bounds[3]) * scale
        cells = rescaled(colour_cells(grid.cells), scale * grid.frame.resolution)
        paste(np.moveaxis(view, 2, 0), np.moveaxis(cells, 2, 0), -round(top), -round(left))
        best, *others = (frame_pixels(path, frame, scale * frame.resolution) for path in paths)
        for pixels in others:
            cv2.polylines(view, [fixed_point(pixels)], False, PARTICLE, 1, cv2.LINE_AA, SHIFT)
        _draw_gradient_path(view, best, 2)
        _draw_footer(page, 1.0 / scale, caption)
        return page

    def _frame(self, grid: GridFrame) -> GridFrame:
        """A frame that holds the grid; grown by a quarter at a time, so that the picture seldom jumps."""
        min_x, min_y, max_x, max_y = grid.bounds
        old = self._bounds
        if old is None or min_x < old[0] or min_y < old[1] or max_x > old[2] or max_y > old[3]:
            spare = 0.125 * max(max_x - min_x, max_y - min_y, 4.0)
            new = (min_x - spare, min_y - spare, max_x + spare, max_y + spare)
            if old is not None:
                new = (
                    min(new[0], old[0]),
                    min(new[1], old[1]),
                    max(new[2], old[2]),
                    max(new[3], old[3]),
                )
            self._bounds = new
        assert self._bounds is not None
        return GridFrame.covering(self._bounds, grid.resolution)


def _draw_gradient_path(picture: ByteArray, pixels: FloatArray, thickness: int) -> None:
    """Draw a path of pixels (N, 2) whose colour runs from blue to red, with its end points."""
    if len(pixels) == 0:
        return
    fixed = fixed_point(pixels)
    pieces = min(64, max(1, len(fixed) - 1))
    bounds = np.linspace(0, len(fixed) - 1, pieces + 1).round().astype(int)
    colours = np.linspace(TRUE_COLOUR, BELIEVED_COLOUR, pieces).tolist()
    for (first, last), colour in zip(itertools.pairwise(bounds), colours, strict=True):
        cv2.polylines(
            picture, [fixed[first : last + 1]], False, colour, thickness, cv2.LINE_AA, SHIFT
        )
    for (col, row), colour in ((fixed[0], TRUE_COLOUR), (fixed[-1], BELIEVED_COLOUR)):
        size = (3 * thickness) << SHIFT
        cv2.circle(picture, (int(col), int(row)), size, colour, -1, cv2.LINE_AA, SHIFT)


def _draw_footer(page: ByteArray, metres_per_px: float, caption: str) -> None:
    """Scale bar at the left, caption at the right."""
    height, width = page.shape[:2]
    end = draw_scale_bar(
        page, (PAGE_MARGIN_PX, height - FOOTER_PX // 2), metres_per_px, width / 6.0
    )
    size = fitting_size(caption, 0.55, width - PAGE_MARGIN_PX - end - 24)
    left = width - PAGE_MARGIN_PX - text_width(caption, size)
    draw_text(page, caption, left, height - FOOTER_PX // 2 + 6, size)
