"""Pictures of floor plans: rooms coloured by their use, doors marked, a scale bar, a sheet of many."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
import shapely

from slamgym.cad.floorplan import FloorPlan, fill_segments, map_values
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, FloatArray, GridFrame

_PAPER = (255, 255, 255)
_WALL = (52, 48, 46)
_INK = (70, 66, 64)
_DOOR = (38, 84, 208)
_FLOOR = (232, 236, 238)

# Pale colours (blue, green, red) for the uses of rooms; related uses share a hue.
_COLOURS: dict[str, tuple[int, int, int]] = {
    "Bedroom": (236, 214, 196),
    "Child_Room": (240, 222, 206),
    "Guest_Room": (228, 206, 190),
    "Living_Room": (192, 222, 250),
    "Dining_Room": (176, 208, 244),
    "Kitchen": (170, 226, 246),
    "Bathroom": (226, 226, 178),
    "Toilet": (216, 216, 160),
    "Washroom": (216, 216, 160),
    "Hallway": (222, 230, 216),
    "Hall": (214, 226, 206),
    "Lobby": (206, 222, 198),
    "Entryway": (222, 230, 216),
    "Entrance": (222, 230, 216),
    "Corridor": (222, 230, 216),
    "Office": (190, 224, 200),
    "Classroom": (206, 232, 232),
    "Room": (214, 208, 226),
    "Gym": (204, 196, 222),
    "Garage": (204, 204, 204),
    "Storage": (206, 214, 222),
    "Closet": (206, 214, 222),
    "Wardrobe": (218, 212, 232),
}
_OVERSAMPLING = 2
_TEXT_HEIGHT_PX = 40
_WALL_THICKNESS = 0.25  # drawn outside the outline [m]


def draw_plan(plan: FloorPlan, size_px: int = 420) -> ByteArray:
    """Draw one plan on a square.

    Convention: the picture shows the plan with y up; colours are in OpenCV's order.

    Args:
        plan: The plan.
        size_px: Width of the picture; below it comes a line of text.

    Returns:
        Shape (size_px + 40, size_px, 3).
    """
    fine = size_px * _OVERSAMPLING
    frame = _square_frame(plan, fine)
    canvas = np.full((fine, fine, 3), _PAPER, dtype=np.uint8)
    inside = fill_segments(plan.segments(), frame)
    values = map_values(inside, frame.resolution, UNKNOWN, _WALL_THICKNESS)
    canvas[(values == OCCUPIED) | _enclosed(values == UNKNOWN)] = _WALL
    canvas[values == FREE] = _FLOOR
    _paint_rooms(canvas, plan, inside, frame)
    _mark_doors(canvas, plan, frame)
    small = cv2.resize(canvas, (size_px, size_px), interpolation=cv2.INTER_AREA)
    picture = np.vstack([small, np.full((_TEXT_HEIGHT_PX, size_px, 3), _PAPER, dtype=np.uint8)])
    _caption(picture, plan, frame.resolution * _OVERSAMPLING)
    drawn: ByteArray = picture
    return drawn


def draw_sheet(plans: Sequence[FloorPlan], columns: int = 6, size_px: int = 360) -> ByteArray:
    """Draw many plans side by side, with a legend of the colours below.

    Args:
        plans: At least one.
        columns: Plans in a row.
        size_px: Width of one plan.
    """
    columns = min(columns, len(plans))
    tiles = [draw_plan(plan, size_px) for plan in plans]
    blank = np.full_like(tiles[0], _PAPER)
    tiles += [blank] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)]
    sheet = np.vstack(rows)
    categories = {room.category for plan in plans for room in plan.rooms}
    drawn: ByteArray = np.vstack([sheet, _legend(sorted(categories), sheet.shape[1])])
    return drawn


def _square_frame(plan: FloorPlan, size_px: int) -> GridFrame:
    """A square grid that holds the plan with a margin, the plan in its middle."""
    min_x, min_y, max_x, max_y = plan.bounds
    side = 1.12 * max(max_x - min_x, max_y - min_y) + 2 * _WALL_THICKNESS
    x, y = 0.5 * (min_x + max_x - side), 0.5 * (min_y + max_y - side)
    return GridFrame(side / size_px, x, y, size_px, size_px)


def _to_px(points: FloatArray, frame: GridFrame) -> np.ndarray:
    x, y = points[:, 0] - frame.origin_x, points[:, 1] - frame.origin_y
    return np.round(np.column_stack([x, frame.height_px * frame.resolution - y]) / frame.resolution).astype(
        np.int32
    )


def _enclosed(mask: BoolArray) -> BoolArray:
    """Patches of a mask that don't touch the picture's edge: the inside of pillars, islands and chimneys."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8))
    at_edge = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    enclosed: BoolArray = mask & ~np.isin(labels, at_edge)
    return enclosed


def _paint_rooms(canvas: np.ndarray, plan: FloorPlan, inside: np.ndarray, frame: GridFrame) -> None:
    """Colour the floor; larger rooms first, because HouseExpo's boxes overlap."""
    floor = canvas.copy()
    for room in sorted(plan.rooms, key=lambda room: -room.area):
        corners = _to_px(shapely.get_coordinates(room.polygon.exterior), frame)
        cv2.fillPoly(floor, [corners], _COLOURS.get(room.category, _FLOOR))
    canvas[inside] = floor[inside]


def _mark_doors(canvas: np.ndarray, plan: FloorPlan, frame: GridFrame) -> None:
    for door in plan.doors:
        start, end = _to_px(np.array([door.start, door.end]), frame).tolist()
        cv2.line(canvas, start, end, _DOOR, max(2, round(0.08 / frame.resolution)), cv2.LINE_AA)


def _caption(picture: np.ndarray, plan: FloorPlan, resolution: float) -> None:
    """Name, size and a scale bar of a round length."""
    height, width = picture.shape[:2]
    name = plan.id if len(plan.id) <= 20 else plan.id[:17] + "..."
    text = f"{name}  {plan.area:.0f} m2, {len(plan.rooms)} rooms"
    _write(picture, text, (12, height - 14))
    wanted = 0.2 * width * resolution
    length = min((1.0, 2.0, 5.0, 10.0, 20.0, 50.0), key=lambda option: abs(math.log(option / wanted)))
    bar = round(length / resolution)
    right, y = width - 12, height - 14
    cv2.rectangle(picture, (right - bar, y - 3), (right, y), _INK, -1)
    _write(picture, f"{length:.0f} m", (right - bar, y - 9))


def _legend(categories: Sequence[str], width: int) -> np.ndarray:
    columns = max(1, width // 150)
    rows = max(1, math.ceil(len(categories) / columns))
    legend = np.full((24 * rows + 16, width, 3), _PAPER, dtype=np.uint8)
    for index, category in enumerate(categories):
        x, y = 12 + 150 * (index % columns), 8 + 24 * (index // columns)
        cv2.rectangle(legend, (x, y), (x + 16, y + 16), _COLOURS.get(category, _FLOOR), -1)
        cv2.rectangle(legend, (x, y), (x + 16, y + 16), _INK, 1)
        _write(legend, category.replace("_", " "), (x + 24, y + 13))
    return legend


def _write(picture: np.ndarray, text: str, place: tuple[int, int]) -> None:
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, _INK, 1, cv2.LINE_AA)
