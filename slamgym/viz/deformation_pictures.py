"""Pictures of a deformation: the paths on the plan, the map, and the field, side by side."""

import cv2
import numpy as np

from slamgym.core.types import UNKNOWN, BoolArray, ByteArray, Float32Array, FloatArray, GridFrame
from slamgym.parametric.model import Deformation

TRUE_COLOUR = (60, 140, 30)  # BGR
BELIEVED_COLOUR = (40, 40, 210)
_GAP_PX = 12
_CAPTION_PX = 30
_SHOWN_PX = 420  # height of a panel


def panel(cells: ByteArray, caption: str, height_px: int = _SHOWN_PX) -> ByteArray:
    """A map or picture, enlarged without smoothing to a height, under a caption; (H, W, 3) BGR."""
    colour = cells if cells.ndim == 3 else cv2.cvtColor(cells, cv2.COLOR_GRAY2BGR)
    scale = height_px / colour.shape[0]
    width_px = max(1, round(colour.shape[1] * scale))
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_NEAREST
    image = cv2.resize(colour, (width_px, height_px), interpolation=way)
    head = np.full((_CAPTION_PX, width_px, 3), 255, dtype=np.uint8)
    cv2.putText(head, caption, (2, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    return np.vstack([head, image])


def side_by_side(panels: list[ByteArray]) -> ByteArray:
    """Panels of one height in a row."""
    gap = np.full((panels[0].shape[0], _GAP_PX, 3), 255, dtype=np.uint8)
    row: list[ByteArray] = []
    for image in panels:
        row += [image, gap]
    return np.hstack([gap, *row])


def with_path(
    picture: ByteArray, poses: FloatArray, frame: GridFrame, colour: tuple[int, int, int]
) -> ByteArray:
    """Draw a path (T, 3), in the frame that ``frame`` places, on a picture of any size that covers it."""
    image = picture if picture.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    scale = image.shape[0] / frame.height_px
    x = (poses[:, 0] - frame.origin_x) / frame.resolution * scale
    y = (frame.height_px - (poses[:, 1] - frame.origin_y) / frame.resolution) * scale
    points = np.round(16.0 * np.column_stack([x, y])).astype(np.int32)
    cv2.polylines(image, [points[:, None]], False, colour, 1, cv2.LINE_AA, shift=4)
    cv2.circle(image, tuple(int(v) for v in points[0]), 16 * 4, colour, -1, cv2.LINE_AA, shift=4)
    return image


def field_picture(field: Float32Array, seen: BoolArray, full_scale: float) -> ByteArray:
    """Length of the displacement as a colour, white where the map is unknown.

    Args:
        field: (2, H, W) [m].
        seen: (H, W) bool.
        full_scale: Length that gets the last colour [m].
    """
    length = np.hypot(field[0], field[1])
    grey = np.clip(length / max(full_scale, 1e-9) * 255.0, 0.0, 255.0).astype(np.uint8)
    picture: ByteArray = cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS)
    picture[~seen] = 255
    return picture


def overview(result: Deformation) -> ByteArray:
    """CAD map with the true (green) and believed (red) path, the SLAM-like map, and the field; BGR."""
    frame = result.grid.frame
    enlarged = panel(result.cad.cells, "CAD map; true path green, believed red")
    body = enlarged[_CAPTION_PX:].copy()
    body = with_path(body, result.true.poses, frame, TRUE_COLOUR)
    body = with_path(body, result.believed.poses, frame, BELIEVED_COLOUR)
    first = np.vstack([enlarged[:_CAPTION_PX], body])
    known = result.grid.cells != UNKNOWN
    largest = float(np.hypot(*result.field)[known].max(initial=0.0))
    return side_by_side(
        [
            first,
            panel(result.grid.cells, f"map, {result.config.method}"),
            panel(field_picture(result.field, known, largest), f"displacement, 0 to {largest:.2f} m"),
        ]
    )
