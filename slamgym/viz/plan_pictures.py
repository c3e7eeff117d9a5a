"""Pictures of floor plans: rooms coloured by their use, doors marked, a scale bar, a sheet of many."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
import shapely
from scipy import ndimage

from slamgym.cad.floorplan import FloorPlan, fill_segments, map_values
from slamgym.core.progress import counted
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, FloatArray, GridFrame
from slamgym.viz.canvas import (
    INK,
    PAPER,
    WALL_TINT,
    Colour,
    blank,
    draw_scale_bar,
    draw_text,
    frame_pixels,
)
from slamgym.viz.sheets import Card, draw_sheet

_WALL_THICKNESS = 0.25
"""Thickness of walls, which are drawn outside the outline [m]."""
_DOOR: Colour = (208, 84, 38)
"""Colour of doors."""

# Pale colours for the uses of rooms; related uses share one.
_HUES: dict[Colour, str] = {
    (196, 214, 236): "Bedroom Child_Room Guest_Room",
    (250, 222, 192): "Living_Room Dining_Room",
    (246, 226, 170): "Kitchen",
    (178, 226, 226): "Bathroom Toilet Washroom",
    (206, 226, 214): "Hallway Hall Lobby Entryway Entrance Corridor",
    (200, 224, 190): "Office Classroom",
    (226, 208, 214): "Room Gym",
    (222, 214, 206): "Storage Closet Wardrobe Garage",
}
_COLOURS = {
    category: colour for colour, categories in _HUES.items() for category in categories.split()
}
_OVERSAMPLING = 2
"""Pictures are drawn larger by this, and shrunk."""


def draw_floor_plan(plan: FloorPlan, size_px: int = 420) -> ByteArray:
    """Draw one plan on a square, y up, with a scale bar in a corner.

    Args:
        plan: The plan.
        size_px: Side of the picture.

    Returns:
        RGB, shape (size_px, size_px, 3).
    """
    fine = size_px * _OVERSAMPLING
    frame = _square_frame(plan, fine)
    picture = blank((fine, fine))
    inside = fill_segments(plan.segments(), frame)
    values = map_values(inside, frame.resolution, UNKNOWN, _WALL_THICKNESS)
    enclosed = _enclosed(values == UNKNOWN)
    is_wall = (values == OCCUPIED) | enclosed
    picture[is_wall] = WALL_TINT
    picture[values == FREE] = PAPER
    _paint_rooms(picture, plan, inside, frame)
    door_px = max(2, round(0.08 / frame.resolution))
    for door in plan.doors:
        ends = np.array([door.start, door.end])
        pixels = _to_px(ends, frame)
        start, end = pixels.tolist()
        cv2.line(picture, start, end, _DOOR, door_px, cv2.LINE_AA)
    resized = cv2.resize(picture, (size_px, size_px), interpolation=cv2.INTER_AREA)
    small = np.asarray(resized, dtype=np.uint8)
    metres_per_px = frame.resolution * _OVERSAMPLING
    draw_scale_bar(small, (10, size_px - 12), metres_per_px, 0.2 * size_px)
    return small


def draw_plan_sheet(plans: Sequence[FloorPlan], columns: int = 6, size_px: int = 360) -> ByteArray:
    """Draw many plans side by side with their names and sizes, with a legend of the colours below.

    Args:
        plans: At least one.
        columns: Plans in a row.
        size_px: Width of one plan.
    """
    cards = []
    categories = set[str]()
    for plan in plans:
        picture = draw_floor_plan(plan, size_px)
        card = Card([picture], [_caption(plan)])
        cards.append(card)
        categories.update(room.category for room in plan.rooms)
    sheet = draw_sheet(cards, columns, size_px)
    legend = _legend(sorted(categories), sheet.shape[1])
    return np.vstack([sheet, legend])


def _square_frame(plan: FloorPlan, size_px: int) -> GridFrame:
    """A square grid that holds the plan with a margin, the wider one below for the scale bar."""
    min_x, min_y, max_x, max_y = plan.bounds
    longer = max(max_x - min_x, max_y - min_y)
    side = 1.12 * longer + 2 * _WALL_THICKNESS
    x = 0.5 * (min_x + max_x - side)
    y = 0.5 * (min_y + max_y - side) - 0.03 * side
    return GridFrame(side / size_px, x, y, size_px, size_px)


def _to_px(points: FloatArray, frame: GridFrame) -> np.ndarray:
    pixels = frame_pixels(points, frame, 1.0)
    return np.round(pixels).astype(np.int32)


def _enclosed(mask: BoolArray) -> BoolArray:
    """Patches of a mask that don't touch the picture's edge: the inside of pillars, islands and chimneys."""
    around = np.ones((3, 3), np.bool_)
    return mask & ndimage.binary_fill_holes(~mask, around)


def _paint_rooms(picture: ByteArray, plan: FloorPlan, inside: np.ndarray, frame: GridFrame) -> None:
    """Colour the floor; larger rooms first, because HouseExpo's boxes overlap."""
    floor = picture.copy()
    largest_first = sorted(plan.rooms, key=lambda room: -room.area)
    for room in largest_first:
        outline = shapely.get_coordinates(room.polygon.exterior)
        pixels = _to_px(outline, frame)
        colour = _COLOURS.get(room.category, PAPER)
        cv2.fillPoly(floor, [pixels], colour)
    picture[inside] = floor[inside]


def _caption(plan: FloorPlan) -> str:
    name = plan.id
    if len(name) > 20:
        name = name[:17] + "..."
    rooms = counted(len(plan.rooms), "room")
    return f"{name}  {plan.area:.0f} m2, {rooms}"


def _legend(categories: Sequence[str], width: int) -> ByteArray:
    columns = max(1, width // 150)
    rows = math.ceil(len(categories) / columns)
    height = 24 * max(1, rows) + 16
    legend = blank((height, width))
    for index, category in enumerate(categories):
        row, column = divmod(index, columns)
        x = 12 + 150 * column
        y = 8 + 24 * row
        corner = (x, y)
        opposite = (x + 16, y + 16)
        colour = _COLOURS.get(category, PAPER)
        words = category.replace("_", " ")
        cv2.rectangle(legend, corner, opposite, colour, -1)
        cv2.rectangle(legend, corner, opposite, INK, 1)
        draw_text(legend, words, x + 24, y + 13, 0.42)
    return legend
