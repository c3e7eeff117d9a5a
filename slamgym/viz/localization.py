"""A picture of a robot that finds itself on a map: where it was sure, and where it wasn't."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from slamgym.core.geometry import compose, inverse, transform_poses
from slamgym.core.types import ByteArray, FloatArray, OccupancyGrid, Pose2D
from slamgym.viz.canvas import SHIFT, Colour, fixed_point, frame_pixels
from slamgym.viz.map_pictures import DOUBTFUL, PATH_START, map_picture, page_of

STATE_COLOURS: dict[str, Colour] = {
    "searching": (134, 142, 150),
    "ambiguous": (245, 159, 0),
    "localised": PATH_START,
    "lost": DOUBTFUL,
}
LEGEND = "blue localised, grey searching, orange ambiguous, red lost; arrows: the end"
ARROW = 0.6
"""Length of an arrow [m]."""
ARROW_COLOUR: Colour = (47, 158, 68)


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
        colour = STATE_COLOURS[state]
        if state != "localised":
            cv2.circle(picture, (int(col), int(row)), 2 * width << SHIFT, colour, -1, cv2.LINE_AA, SHIFT)
        elif index > 0 and states[index - 1] == "localised":
            cv2.polylines(
                picture, [pixels[index - 1 : index + 1]], False, colour, 2 * width, cv2.LINE_AA, SHIFT
            )
    for pose in hypotheses:
        x, y, theta = compose(back, pose)
        ends = np.array([[x, y], [x + ARROW * math.cos(theta), y + ARROW * math.sin(theta)]])
        start, end = frame_pixels(ends, grid.frame, factor).round().astype(int).tolist()
        cv2.arrowedLine(picture, start, end, ARROW_COLOUR, 2 * width, cv2.LINE_AA, 0, 0.4)
    return page_of(picture, grid.frame.resolution / factor, f"{caption}   {LEGEND}")
