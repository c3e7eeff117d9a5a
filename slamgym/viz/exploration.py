"""Pictures of an exploration: the world at the left, what the robot believes at the right, figures below."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.geometry import compose, transform_points
from slamgym.core.types import (
    BoolArray,
    ByteArray,
    FloatArray,
    GridFrame,
    LaserScan,
    OccupancyGrid,
    Pose2D,
)
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    FAINT,
    FRAME_HEIGHT,
    FRAME_WIDTH,
    INK,
    PAPER,
    SHIFT,
    TRUE_COLOUR,
    UNKNOWN_TINT,
    WALL_TINT,
    WHITE,
    Colour,
    blank,
    colour_cells,
    draw_dot,
    draw_path,
    draw_scale_bar,
    draw_text,
    fixed_point,
    text_width,
)

SEEN_TINT: Colour = (226, 240, 255)
FURNITURE_COLOUR: Colour = (214, 188, 150)
PERSON_COLOUR: Colour = (190, 75, 219)
BEAM_COLOUR: Colour = (255, 169, 77)
BAR_COLOUR: Colour = (55, 178, 77)

_MARGIN = 20
"""Beside the panels, and between them [px]."""
_HEAD = 44
"""Height of the strip with the titles [px]."""
_FOOT = 84
"""Height of the strip with the figures [px]."""
_PANEL_WIDTH = (FRAME_WIDTH - 3 * _MARGIN) // 2
_PANEL_HEIGHT = FRAME_HEIGHT - _HEAD - _FOOT
_BORDER = 0.4
"""Room left round the plan [m]."""


class SceneFigures(NamedTuple):
    """Figures that are written below the panels."""

    time: float  # [s]
    coverage: float  # share
    path_length: float  # [m]
    pose_error: float  # [m]
    contacts: int


@dataclass(frozen=True)
class Scene:
    """The state of an episode; everything is in the world frame."""

    plan: FloorPlan
    furniture: Sequence[FloatArray]  # corners of each solid, shape (K, 2) [m]
    moving: FloatArray  # (S, 4) segments of people [m]
    robot_radius: float  # [m]
    true_pose: Pose2D
    believed_pose: Pose2D
    scan: LaserScan
    true_ranges: FloatArray  # (num_beams,) [m]
    grid: OccupancyGrid  # the robot's map
    seen: BoolArray  # (rows, cols) floor that was truly seen
    seen_frame: GridFrame
    true_path: FloatArray  # (N, 2) [m]
    believed_path: FloatArray  # (N, 2) [m]
    figures: SceneFigures


class Renderer:
    """Draws the state of an episode.

    Both panels show the same part of the world at the same scale, so errors of the map can be seen by
    comparing them.
    """

    def __init__(self) -> None:
        self._plan: FloorPlan | None = None

    def draw(self, scene: Scene) -> ByteArray:
        """Draw one frame, RGB, shape (FRAME_HEIGHT, FRAME_WIDTH, 3)."""
        if scene.plan is not self._plan:
            self._plan = scene.plan
            self._view = _View(scene.plan)
            self._floor_layer = _draw_floor(scene.plan, self._view)
        picture = blank((FRAME_HEIGHT, FRAME_WIDTH), PAPER)
        world = panel_of(picture, 0)
        world[:] = self._floor_layer
        _draw_world(world, scene, self._view)
        _draw_belief(panel_of(picture, 1), scene, self._view)
        _frame_panels(picture)
        corner = _MARGIN + 12, _HEAD + _PANEL_HEIGHT - 14  # of the left panel
        draw_scale_bar(picture, corner, 1.0 / self._view.scale, 130, backed=True)
        _draw_figures(picture, scene)
        return picture


class _View:
    """The part of the world that the panels show."""

    def __init__(self, plan: FloorPlan) -> None:
        min_x, min_y, max_x, max_y = plan.bounds
        width = max_x - min_x + 2 * _BORDER
        height = max_y - min_y + 2 * _BORDER
        self.scale = min(_PANEL_WIDTH / width, _PANEL_HEIGHT / height)  # [px/m]
        half_width = 0.5 * _PANEL_WIDTH / self.scale
        half_height = 0.5 * _PANEL_HEIGHT / self.scale
        self.left = 0.5 * (min_x + max_x) - half_width
        self.top = 0.5 * (min_y + max_y) + half_height

    def pixels(self, points: FloatArray) -> np.ndarray:
        """World points (N, 2) as fixed-point pixels (column, row) of a panel."""
        right = points[:, 0] - self.left
        down = self.top - points[:, 1]
        pixels = np.column_stack([right, down]) * self.scale - 0.5
        return fixed_point(pixels)

    def draw_segments(
        self, panel: ByteArray, segments: FloatArray, colour: Colour, thickness: int
    ) -> None:
        """Draw world segments (S, 4)."""
        ends = self.pixels(segments.reshape(-1, 2))
        lines = list(ends.reshape(-1, 2, 2))
        cv2.polylines(panel, lines, False, colour, thickness, cv2.LINE_AA, SHIFT)

    def place(self, image: ByteArray, frame: GridFrame, fill: Colour, smooth: bool) -> ByteArray:
        """Bring an image whose pixels are the cells of a world frame onto a panel."""
        factor = frame.resolution * self.scale
        # Maps pixel centres of the source to pixel centres of the panel.
        _, _, _, frame_top = frame.bounds
        shift_x = (frame.origin_x - self.left) * self.scale + 0.5 * factor - 0.5
        shift_y = (self.top - frame_top) * self.scale + 0.5 * factor - 0.5
        matrix = np.array([[factor, 0.0, shift_x], [0.0, factor, shift_y]])
        method = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        size = (_PANEL_WIDTH, _PANEL_HEIGHT)
        placed = cv2.warpAffine(image, matrix, size, flags=method, borderValue=fill)
        return np.asarray(placed)

    def paint(self, grid: OccupancyGrid) -> ByteArray:
        """The robot's map."""
        frame = grid.frame
        colours = colour_cells(grid.cells)
        # Large plans have several cells to a pixel: average them, or thin walls would fall through.
        shrink = max(1, math.ceil(1.0 / (frame.resolution * self.scale)))
        if shrink > 1:
            colours = _averaged(colours, shrink)
        height, width = colours.shape[:2]
        coarse = GridFrame(frame.resolution * shrink, frame.origin_x, frame.origin_y, height, width)
        return self.place(colours, coarse, UNKNOWN_TINT, smooth=shrink > 1)


def _averaged(colours: ByteArray, shrink: int) -> ByteArray:
    """A map with so many cells to a pixel; what is missing of whole pixels, at the top and the right, is unknown."""
    height, width = colours.shape[:2]
    rows = math.ceil(height / shrink)
    cols = math.ceil(width / shrink)
    padded = blank((rows * shrink, cols * shrink), UNKNOWN_TINT)
    padded[rows * shrink - height :, :width] = colours
    averaged = cv2.resize(padded, (cols, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(averaged)


def panel_of(picture: ByteArray, index: int) -> ByteArray:
    """The left (0) or the right (1) panel of a picture, as a view."""
    left = _MARGIN + index * (_PANEL_WIDTH + _MARGIN)
    return picture[_HEAD : _HEAD + _PANEL_HEIGHT, left : left + _PANEL_WIDTH]


def _draw_floor(plan: FloorPlan, view: _View) -> ByteArray:
    """The building: what never changes during an episode."""
    layer = blank((_PANEL_HEIGHT, _PANEL_WIDTH), UNKNOWN_TINT)
    _fill(layer, view, np.asarray(plan.free_space.exterior.coords), WHITE)
    for ring in plan.free_space.interiors:
        _fill(layer, view, np.asarray(ring.coords), UNKNOWN_TINT)
    return layer


def _draw_world(panel: ByteArray, scene: Scene, view: _View) -> None:
    """Draw the true state: seen floor, furniture, people, beams, the true path."""
    seen = scene.seen.astype(np.uint8) * 255
    is_seen = view.place(seen, scene.seen_frame, (0, 0, 0), smooth=False) > 0
    is_floor = (panel == WHITE).all(axis=2)
    panel[is_seen & is_floor] = SEEN_TINT
    for piece in scene.furniture:
        _fill(panel, view, piece, FURNITURE_COLOUR)
    _draw_beams(panel, scene, view)
    thickness = 2 if view.scale > 15 else 1
    view.draw_segments(panel, scene.plan.segments(), WALL_TINT, thickness)
    view.draw_segments(panel, scene.moving, PERSON_COLOUR, 2)
    draw_path(panel, view.pixels(scene.true_path), TRUE_COLOUR)
    _draw_robot(panel, view, scene.true_pose, scene.robot_radius, TRUE_COLOUR)


def _draw_belief(panel: ByteArray, scene: Scene, view: _View) -> None:
    """Draw the robot's belief: its map, its path and its scan, and its true path as a thin line."""
    panel[:] = view.paint(scene.grid)
    draw_path(panel, view.pixels(scene.true_path), TRUE_COLOUR, thickness=1)
    draw_path(panel, view.pixels(scene.believed_path), BELIEVED_COLOUR)
    scan = scene.scan
    pose = scene.believed_pose
    hits = scan.ranges <= scan.geometry.range_max
    ends = beam_ends(scan, pose, scan.ranges.astype(np.float64))
    for pixel in view.pixels(ends[hits]):
        draw_dot(panel, pixel, 2, BEAM_COLOUR)
    _draw_robot(panel, view, scene.true_pose, scene.robot_radius, TRUE_COLOUR, filled=False)
    _draw_robot(panel, view, pose, scene.robot_radius, BELIEVED_COLOUR)


def _fill(panel: ByteArray, view: _View, outline: FloatArray, colour: Colour) -> None:
    cv2.fillPoly(panel, [view.pixels(outline)], colour, cv2.LINE_AA, SHIFT)


def beam_ends(scan: LaserScan, pose: Pose2D, ranges: FloatArray) -> FloatArray:
    """Ends of the beams, at most at the range limit, (num_beams, 2), in the parent frame of ``pose``."""
    geometry = scan.geometry
    lengths = np.clip(ranges, 0.0, geometry.range_max)
    x = lengths * np.cos(geometry.angles)
    y = lengths * np.sin(geometry.angles)
    local = np.column_stack([x, y])
    return transform_points(compose(pose, geometry.mount), local)


def _draw_beams(panel: ByteArray, scene: Scene, view: _View) -> None:
    """The area that the scanner overlooks, see-through."""
    mount = compose(scene.true_pose, scene.scan.geometry.mount)
    ends = beam_ends(scene.scan, scene.true_pose, scene.true_ranges)
    corners = np.vstack([[mount.x, mount.y], ends])
    outline = view.pixels(corners)
    whole = outline >> SHIFT
    low = np.maximum(whole.min(axis=0) - 2, 0)
    high = whole.max(axis=0) + 3
    left, top = low
    right, bottom = high
    patch = panel[top:bottom, left:right]
    fan = patch.copy()
    cv2.fillPoly(fan, [outline - (low << SHIFT)], BEAM_COLOUR, cv2.LINE_AA, SHIFT)
    cv2.addWeighted(fan, 0.35, patch, 0.65, 0.0, dst=patch)


def _draw_robot(
    panel: ByteArray, view: _View, pose: Pose2D, radius: float, colour: Colour, filled: bool = True
) -> None:
    """A disc with a line to where it looks."""
    nose_x = pose.x + radius * math.cos(pose.theta)
    nose_y = pose.y + radius * math.sin(pose.theta)
    ends = np.array([[pose.x, pose.y], [nose_x, nose_y]])
    middle, tip = view.pixels(ends).tolist()
    size = round(max(radius * view.scale, 7.0) * (1 << SHIFT))
    if filled:
        cv2.circle(panel, middle, size, colour, -1, cv2.LINE_AA, SHIFT)
    line = WHITE if filled else colour
    thickness = 1 if filled else 2
    cv2.circle(panel, middle, size, line, thickness, cv2.LINE_AA, SHIFT)
    cv2.line(panel, middle, tip, line, 2, cv2.LINE_AA, SHIFT)


def _frame_panels(picture: ByteArray) -> None:
    """Borders and titles."""
    true = _LegendEntry("true pose", TRUE_COLOUR, -1)
    believed = _LegendEntry("believed pose", BELIEVED_COLOUR, -1)
    thin_true = _LegendEntry("true pose", TRUE_COLOUR, 2)
    _frame_panel(picture, 0, "World", [true])
    _frame_panel(picture, 1, "SLAM map", [believed, thin_true])


class _LegendEntry(NamedTuple):
    """A pose in the legend of a panel."""

    words: str
    colour: Colour
    thickness: int
    """Of its circle [px]; -1 fills it."""


def _frame_panel(
    picture: ByteArray, index: int, title: str, legend: Sequence[_LegendEntry]
) -> None:
    """Border, title and legend of a panel; the legend from the right."""
    left = _MARGIN + index * (_PANEL_WIDTH + _MARGIN)
    end = left + _PANEL_WIDTH
    corner = (left - 1, _HEAD - 1)
    cv2.rectangle(picture, corner, (end, _HEAD + _PANEL_HEIGHT), FAINT, 1)
    draw_text(picture, title, left, 30, 0.7)
    for entry in legend:
        end -= text_width(entry.words, 0.5)
        draw_text(picture, entry.words, end, 29, 0.5, FAINT)
        cv2.circle(picture, (end - 14, 24), 6, entry.colour, entry.thickness, cv2.LINE_AA)
        end -= 40


def _draw_figures(picture: ByteArray, scene: Scene) -> None:
    """Time, coverage and errors in the foot of the picture."""
    figures = scene.figures
    plan_id = scene.plan.id
    top = _HEAD + _PANEL_HEIGHT
    minutes, seconds = divmod(int(figures.time), 60)
    shown = {
        "time": f"{minutes}:{seconds:02d}",
        "coverage": f"{100.0 * figures.coverage:.1f} %",
        "path": f"{figures.path_length:.1f} m",
        "pose error": f"{100.0 * figures.pose_error:.1f} cm",
        "contacts": f"{figures.contacts}",
        "plan": plan_id if len(plan_id) <= 15 else plan_id[:13] + "..",
    }
    step = (FRAME_WIDTH - 2 * _MARGIN - 40) // len(shown)
    for index, (name, value) in enumerate(shown.items()):
        left = _MARGIN + index * step
        draw_text(picture, name, left, top + 28, 0.45, FAINT)
        draw_text(picture, value, left, top + 54, 0.65, INK)
    bar = picture[top + 68 : top + 74, _MARGIN : FRAME_WIDTH - _MARGIN]
    covered_px = round(figures.coverage * bar.shape[1])
    bar[:] = UNKNOWN_TINT
    bar[:, :covered_px] = BAR_COLOUR
