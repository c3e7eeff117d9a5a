"""One map laid over another, paths on maps, and displacements: what shows errors."""

import cv2
import numpy as np

from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    OccupancyGrid,
)
from slamgym.metrics.map_error import wall_faces
from slamgym.metrics.maps import distance_to
from slamgym.viz.canvas import WHITE, Colour, blank, draw_path, fitted, fixed_point, frame_pixels

ERROR_SCALE = 0.3
"""Distance to the nearest CAD wall that is drawn in full red [m]."""

_OUTSIDE, _UNSEEN, _BEYOND = (238, 240, 243), (205, 221, 242), (250, 226, 222)
_WALL_LINE, _ESTIMATE = (150, 156, 164), (74, 124, 190)
_BOTH, _MISSING, _EXTRA = WHITE, (60, 130, 220), (220, 60, 50)
# Green - yellow - red in equal steps of lightness, readable on white.
_ERROR_COLOURS = np.array(
    [(0, 128, 70), (166, 190, 40), (244, 165, 30), (225, 87, 40), (190, 18, 38)], dtype=np.float64
)


def draw_wall_errors(cad: ByteArray, slam: ByteArray, frame: GridFrame, path: FloatArray) -> ByteArray:
    """Draw a SLAM map over the CAD map, at twice the maps' size.

    Occupied cells are coloured by their distance to the nearest CAD wall, space that the robot never saw is blue,
    and free space seen beyond the walls is pink.

    Args:
        cad: (rows, cols).
        slam: (rows, cols).
        frame: Of both.
        path: The estimated path (N, 2 or more), in the frame [m].

    Returns:
        RGB, shape (2 rows, 2 cols, 3).
    """
    inside = cad == FREE
    picture = blank(cad.shape, _OUTSIDE)
    picture[inside] = WHITE
    picture[inside & (slam == UNKNOWN)] = _UNSEEN
    picture[~inside & (slam == FREE)] = _BEYOND
    faces = wall_faces(cad == FREE)
    picture[faces] = _WALL_LINE
    occupied = slam == OCCUPIED
    picture[occupied] = error_colour((distance_to(faces) * frame.resolution)[occupied])
    picture = np.repeat(np.repeat(picture, 2, axis=0), 2, axis=1)
    draw_frame_path(picture, path, frame, _ESTIMATE)
    return picture


def draw_agreement(free: BoolArray, truth: BoolArray) -> ByteArray:
    """The agreement of two masks: white free in both, red only in the map, blue only in the CAD map.

    Args:
        free: (H, W), placed on the truth.
        truth: (H, W).

    Returns:
        RGB, shape (H, W, 3).
    """
    picture = blank(truth.shape, (0, 0, 0))
    picture[free & truth] = _BOTH
    picture[truth & ~free] = _MISSING
    picture[free & ~truth] = _EXTRA
    return picture


def draw_frame_path(picture: ByteArray, poses: FloatArray, frame: GridFrame, colour: Colour) -> None:
    """Draw a path (N, 2 or more), in the frame's coordinates [m], into a picture of any size that shows the frame."""
    if len(poses):
        pixels = frame_pixels(poses, frame, picture.shape[0] / frame.height_px)
        draw_path(picture, fixed_point(pixels), colour, thickness=1)


def draw_paths(grid: OccupancyGrid, paths: dict[Colour, FloatArray], side: int) -> ByteArray:
    """A map that fits a square of so many pixels, with paths by their colour."""
    picture = fitted(grid.cells, side)
    for colour, poses in paths.items():
        draw_frame_path(picture, poses, grid.frame, colour)
    return picture


def draw_displacements(field: Float32Array, seen: BoolArray, full_scale: float) -> ByteArray:
    """Length of the displacement as a colour, white where the map is unknown.

    Args:
        field: (2, H, W) [m].
        seen: (H, W) bool.
        full_scale: Length that gets the last colour [m].
    """
    length = np.hypot(field[0], field[1])
    grey = np.clip(length / max(full_scale, 1e-9) * 255.0, 0.0, 255.0).astype(np.uint8)
    picture: ByteArray = cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS)[:, :, ::-1].copy()
    picture[~seen] = WHITE
    return picture


def error_colour(distance: FloatArray) -> ByteArray:
    """The colour of a wall error, shape (N, 3), for distances [m], shape (N,)."""
    place = np.clip(distance / ERROR_SCALE, 0.0, 1.0) * (len(_ERROR_COLOURS) - 1)
    steps = np.arange(len(_ERROR_COLOURS))
    channels = [np.interp(place, steps, channel) for channel in _ERROR_COLOURS.T]
    return np.stack(channels, axis=-1).astype(np.uint8)
