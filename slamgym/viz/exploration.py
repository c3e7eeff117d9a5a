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
    draw_lines,
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
MATE_COLOURS: tuple[Colour, ...] = ((230, 119, 0), (12, 133, 153), (156, 54, 181))
"""Of other robots: the second, the third and the fourth."""

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
    mates: Sequence["Scene"] = ()  # other robots of the building


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
        fits_width = _PANEL_WIDTH / width
        fits_height = _PANEL_HEIGHT / height
        self.scale = min(fits_width, fits_height)  # [px/m]
        half_width = 0.5 * _PANEL_WIDTH / self.scale
        half_height = 0.5 * _PANEL_HEIGHT / self.scale
        middle_x = 0.5 * (min_x + max_x)
        middle_y = 0.5 * (min_y + max_y)
        self.left = middle_x - half_width
        self.top = middle_y + half_height

    def pixels(self, points: FloatArray) -> np.ndarray:
        """World points (N, 2) as fixed-point pixels (column, row) of a panel."""
        right = points[:, 0] - self.left
        down = self.top - points[:, 1]
        metres = np.column_stack([right, down])
        return fixed_point(metres * self.scale - 0.5)

    def draw_segments(
        self, panel: ByteArray, segments: FloatArray, colour: Colour, thickness: int
    ) -> None:
        """Draw world segments (S, 4)."""
        points = segments.reshape(-1, 2)
        ends = self.pixels(points)
        lines = list(ends.reshape(-1, 2, 2))
        draw_lines(panel, lines, colour, thickness)

    def place(self, image: ByteArray, frame: GridFrame, fill: Colour, smooth: bool) -> ByteArray:
        """Bring an image whose pixels are the cells of a world frame onto a panel."""
        factor = frame.resolution * self.scale
        # Maps pixel centres of the source to pixel centres of the panel.
        _, _, _, frame_top = frame.bounds
        right = frame.origin_x - self.left
        down = self.top - frame_top
        shift_x = right * self.scale + 0.5 * factor - 0.5
        shift_y = down * self.scale + 0.5 * factor - 0.5
        x_row = [factor, 0.0, shift_x]
        y_row = [0.0, factor, shift_y]
        matrix = np.array([x_row, y_row])
        method = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        size = (_PANEL_WIDTH, _PANEL_HEIGHT)
        placed = cv2.warpAffine(image, matrix, size, flags=method, borderValue=fill)
        return np.asarray(placed)

    def paint(self, grid: OccupancyGrid) -> ByteArray:
        """The robot's map."""
        frame = grid.frame
        colours = colour_cells(grid.cells)
        # Large plans have several cells to a pixel: average them, or thin walls would fall through.
        pixels_per_cell = frame.resolution * self.scale
        cells_per_pixel = math.ceil(1.0 / pixels_per_cell)
        shrink = max(1, cells_per_pixel)
        if shrink > 1:
            colours = _averaged(colours, shrink)
        height, width = colours.shape[:2]
        resolution = frame.resolution * shrink
        coarse = GridFrame(resolution, frame.origin_x, frame.origin_y, height, width)
        return self.place(colours, coarse, UNKNOWN_TINT, smooth=shrink > 1)


def _averaged(colours: ByteArray, shrink: int) -> ByteArray:
    """A map with so many cells to a pixel; what is missing of whole pixels, at the top and the right, is unknown."""
    height, width = colours.shape[:2]
    rows = math.ceil(height / shrink)
    cols = math.ceil(width / shrink)
    full_height = rows * shrink
    full_width = cols * shrink
    padded = blank((full_height, full_width), UNKNOWN_TINT)
    padded[full_height - height :, :width] = colours
    averaged = cv2.resize(padded, (cols, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(averaged)


def panel_of(picture: ByteArray, index: int) -> ByteArray:
    """The left (0) or the right (1) panel of a picture, as a view."""
    left = _panel_left(index)
    right = left + _PANEL_WIDTH
    bottom = _HEAD + _PANEL_HEIGHT
    return picture[_HEAD:bottom, left:right]


def _panel_left(index: int) -> int:
    """The first column of a panel."""
    return _MARGIN + index * (_PANEL_WIDTH + _MARGIN)


def _draw_floor(plan: FloorPlan, view: _View) -> ByteArray:
    """The building: what never changes during an episode."""
    layer = blank((_PANEL_HEIGHT, _PANEL_WIDTH), UNKNOWN_TINT)
    exterior = np.asarray(plan.free_space.exterior.coords)
    _fill(layer, view, exterior, WHITE)
    for ring in plan.free_space.interiors:
        interior = np.asarray(ring.coords)
        _fill(layer, view, interior, UNKNOWN_TINT)
    return layer


def _draw_world(panel: ByteArray, scene: Scene, view: _View) -> None:
    """Draw the true state: seen floor, furniture, people, beams, the true path."""
    seen = scene.seen.astype(np.uint8) * 255
    placed = view.place(seen, scene.seen_frame, (0, 0, 0), smooth=False)
    is_white = panel == WHITE
    is_floor = is_white.all(axis=2)
    panel[(placed > 0) & is_floor] = SEEN_TINT
    for piece in scene.furniture:
        _fill(panel, view, piece, FURNITURE_COLOUR)
    for one in (scene, *scene.mates):
        _draw_beams(panel, one, view)
    thickness = 2 if view.scale > 15 else 1
    walls = scene.plan.segments()
    view.draw_segments(panel, walls, WALL_TINT, thickness)
    view.draw_segments(panel, scene.moving, PERSON_COLOUR, 2)
    robots = zip((scene, *scene.mates), (TRUE_COLOUR, *MATE_COLOURS), strict=False)
    for one, colour in robots:
        path = view.pixels(one.true_path)
        draw_path(panel, path, colour)
        _draw_robot(panel, view, one.true_pose, one.robot_radius, colour)


def _draw_belief(panel: ByteArray, scene: Scene, view: _View) -> None:
    """Draw the robot's belief: its map, its path and its scan, and its true path as a thin line."""
    panel[:] = view.paint(scene.grid)
    true_path = view.pixels(scene.true_path)
    believed_path = view.pixels(scene.believed_path)
    draw_path(panel, true_path, TRUE_COLOUR, thickness=1)
    draw_path(panel, believed_path, BELIEVED_COLOUR)
    scan = scene.scan
    pose = scene.believed_pose
    hits = scan.ranges <= scan.geometry.range_max
    ranges = scan.ranges.astype(np.float64)
    ends = beam_ends(scan, pose, ranges)
    for pixel in view.pixels(ends[hits]):
        draw_dot(panel, pixel, 2, BEAM_COLOUR)
    for mate, colour in zip(scene.mates, MATE_COLOURS, strict=False):
        draw_path(panel, view.pixels(mate.believed_path), colour)
        _draw_robot(panel, view, mate.believed_pose, mate.robot_radius, colour)
    _draw_robot(panel, view, scene.true_pose, scene.robot_radius, TRUE_COLOUR, filled=False)
    _draw_robot(panel, view, pose, scene.robot_radius, BELIEVED_COLOUR)


def _fill(panel: ByteArray, view: _View, outline: FloatArray, colour: Colour) -> None:
    pixels = view.pixels(outline)
    cv2.fillPoly(panel, [pixels], colour, cv2.LINE_AA, SHIFT)


def beam_ends(scan: LaserScan, pose: Pose2D, ranges: FloatArray) -> FloatArray:
    """Ends of the beams, at most at the range limit, (num_beams, 2), in the parent frame of ``pose``."""
    geometry = scan.geometry
    lengths = np.clip(ranges, 0.0, geometry.range_max)
    x = lengths * np.cos(geometry.angles)
    y = lengths * np.sin(geometry.angles)
    local = np.column_stack([x, y])
    sensor = compose(pose, geometry.mount)
    return transform_points(sensor, local)


def _draw_beams(panel: ByteArray, scene: Scene, view: _View) -> None:
    """The area that the scanner overlooks, see-through."""
    mount = compose(scene.true_pose, scene.scan.geometry.mount)
    ends = beam_ends(scene.scan, scene.true_pose, scene.true_ranges)
    middle = [mount.x, mount.y]
    corners = np.vstack([middle, ends])
    outline = view.pixels(corners)
    whole = outline >> SHIFT
    least = whole.min(axis=0)
    low = np.maximum(least - 2, 0)
    high = whole.max(axis=0) + 3
    left, top = low
    right, bottom = high
    patch = panel[top:bottom, left:right]
    fan = patch.copy()
    outline_on_patch = outline - (low << SHIFT)
    cv2.fillPoly(fan, [outline_on_patch], BEAM_COLOUR, cv2.LINE_AA, SHIFT)
    cv2.addWeighted(fan, 0.35, patch, 0.65, 0.0, dst=patch)


def _draw_robot(
    panel: ByteArray, view: _View, pose: Pose2D, radius: float, colour: Colour, filled: bool = True
) -> None:
    """A disc with a line to where it looks."""
    nose_x = pose.x + radius * math.cos(pose.theta)
    nose_y = pose.y + radius * math.sin(pose.theta)
    centre = [pose.x, pose.y]
    nose = [nose_x, nose_y]
    ends = np.array([centre, nose])
    middle, tip = view.pixels(ends).tolist()
    radius_px = max(radius * view.scale, 7.0)
    size = round(radius_px * (1 << SHIFT))
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
    left = _panel_left(index)
    end = left + _PANEL_WIDTH
    corner = (left - 1, _HEAD - 1)
    opposite = (end, _HEAD + _PANEL_HEIGHT)
    cv2.rectangle(picture, corner, opposite, FAINT, 1)
    draw_text(picture, title, left, 30, 0.7)
    for entry in legend:
        end -= text_width(entry.words, 0.5)
        draw_text(picture, entry.words, end, 29, 0.5, FAINT)
        middle = (end - 14, 24)
        cv2.circle(picture, middle, 6, entry.colour, entry.thickness, cv2.LINE_AA)
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
    strip = picture[top + 68 : top + 74]
    bar = strip[:, _MARGIN : FRAME_WIDTH - _MARGIN]
    covered_px = round(figures.coverage * bar.shape[1])
    bar[:] = UNKNOWN_TINT
    bar[:, :covered_px] = BAR_COLOUR
