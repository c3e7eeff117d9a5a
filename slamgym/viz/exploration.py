"""Pictures of an exploration: the world at the left, what the robot believes at the right, figures below."""

import math

import cv2
import numpy as np

from slamgym.core.geometry import compose, transform_points
from slamgym.core.types import FREE, OCCUPIED, ByteArray, FloatArray, GridFrame, Pose2D
from slamgym.envs.assessment import Assessment
from slamgym.envs.episode_log import EpisodeLog
from slamgym.envs.plan_cache import PreparedPlan
from slamgym.envs.simulation import Simulation

WIDTH, HEIGHT = 1280, 720
"""Size of a picture [px]; even, as video encoders want it."""

Colour = tuple[int, int, int]

# RGB.
PAPER: Colour = (241, 243, 245)
UNKNOWN_TINT: Colour = (206, 212, 218)
FLOOR: Colour = (255, 255, 255)
SEEN: Colour = (226, 240, 255)
WALL: Colour = (33, 37, 41)
FURNITURE: Colour = (214, 188, 150)
PERSON: Colour = (190, 75, 219)
TRUTH: Colour = (25, 113, 194)
BELIEF: Colour = (224, 49, 49)
BEAM: Colour = (255, 169, 77)
INK: Colour = (52, 58, 64)
FAINT: Colour = (134, 142, 150)
BAR: Colour = (55, 178, 77)

_FONT = cv2.FONT_HERSHEY_DUPLEX
_SHIFT = 4  # fractional bits of drawing coordinates
_MARGIN, _HEAD, _FOOT = 20, 44, 84
_PANEL_WIDTH = (WIDTH - 3 * _MARGIN) // 2
_PANEL_HEIGHT = HEIGHT - _HEAD - _FOOT
# Room left round the plan [m].
_BORDER = 0.4


class Renderer:
    """Draws the state of an episode.

    Both panels show the same part of the world at the same scale, so errors of the map can be seen by
    comparing them.
    """

    def __init__(self) -> None:
        self._prepared: PreparedPlan | None = None

    def draw(
        self, prepared: PreparedPlan, simulation: Simulation, assessment: Assessment, log: EpisodeLog | None
    ) -> ByteArray:
        """Draw one frame.

        Args:
            prepared: The building.
            simulation: The episode.
            assessment: Its figures.
            log: Its paths, if they are recorded.

        Returns:
            RGB, shape (HEIGHT, WIDTH, 3).
        """
        if prepared is not self._prepared:
            self._prepared, self._view = prepared, _View(prepared)
            self._plan_layer = _draw_plan(prepared, self._view)
        image: ByteArray = np.full((HEIGHT, WIDTH, 3), PAPER, dtype=np.uint8)
        world = _panel(image, 0)
        world[:] = self._plan_layer
        self._draw_world(world, prepared, simulation, assessment, log)
        belief = _panel(image, 1)
        self._draw_belief(belief, simulation, log)
        _frame_panels(image)
        _draw_scale(image, self._view.scale)
        _draw_figures(image, prepared, simulation, assessment)
        return image

    def _draw_world(
        self,
        panel: ByteArray,
        prepared: PreparedPlan,
        simulation: Simulation,
        assessment: Assessment,
        log: EpisodeLog | None,
    ) -> None:
        """What is: seen floor, furniture, people, beams, the true path."""
        view = self._view
        _tint_seen(panel, view, assessment)
        for piece in prepared.clutter.furniture:
            cv2.fillPoly(
                panel, [view.pixels(np.asarray(piece.exterior.coords))], FURNITURE, cv2.LINE_AA, _SHIFT
            )
        pose = simulation.true_pose
        ends = _end_points(simulation, pose, simulation.true_ranges)
        mount = compose(pose, simulation.scan.geometry.mount)
        _draw_beams(panel, view, mount, ends)
        _draw_walls(panel, prepared, view)
        moving = simulation.segments[len(prepared.plan.segments()) + len(prepared.clutter.segments()) :]
        if len(moving):
            lines = view.pixels(moving.reshape(-1, 2)).reshape(-1, 2, 2)
            cv2.polylines(panel, list(lines), False, PERSON, 2, cv2.LINE_AA, _SHIFT)
        if log is not None:
            _draw_path(panel, view.pixels(log.true_poses[:, :2]), TRUTH)
        _draw_robot(panel, view, pose, simulation.radius, TRUTH)

    def _draw_belief(self, panel: ByteArray, simulation: Simulation, log: EpisodeLog | None) -> None:
        """What the robot believes: its map, its path and its scan, and faintly where it truly went."""
        view, origin = self._view, simulation.start
        panel[:] = view.paint(simulation)
        if log is not None:
            estimates = log.estimates[:, :2] + [origin.x, origin.y]
            _draw_path(panel, view.pixels(log.true_poses[:, :2]), TRUTH, thickness=1)
            _draw_path(panel, view.pixels(estimates), BELIEF)
        x, y, theta = simulation.believed_pose
        pose = Pose2D(x + origin.x, y + origin.y, theta)
        hits = simulation.scan.ranges <= simulation.scan.geometry.range_max
        ends = _end_points(simulation, pose, simulation.scan.ranges.astype(np.float64))[hits]
        for col, row in view.pixels(ends):
            cv2.circle(panel, (int(col), int(row)), 2 << _SHIFT, BEAM, -1, cv2.LINE_AA, _SHIFT)
        _draw_robot(panel, view, simulation.true_pose, simulation.radius, TRUTH, filled=False)
        _draw_robot(panel, view, pose, simulation.radius, BELIEF)


class _View:
    """The part of the world that the panels show."""

    def __init__(self, prepared: PreparedPlan) -> None:
        min_x, min_y, max_x, max_y = prepared.plan.bounds
        width, height = max_x - min_x + 2 * _BORDER, max_y - min_y + 2 * _BORDER
        self.scale = min(_PANEL_WIDTH / width, _PANEL_HEIGHT / height)  # [px/m]
        self.left = 0.5 * (min_x + max_x) - 0.5 * _PANEL_WIDTH / self.scale
        self.top = 0.5 * (min_y + max_y) + 0.5 * _PANEL_HEIGHT / self.scale

    def pixels(self, points: FloatArray) -> np.ndarray:
        """World points (N, 2) as fixed-point pixels (column, row) of a panel."""
        pixels = np.column_stack([points[:, 0] - self.left, self.top - points[:, 1]]) * self.scale - 0.5
        fixed: np.ndarray = np.rint(pixels * (1 << _SHIFT)).astype(np.int32)
        return fixed

    def place(self, image: ByteArray, frame: GridFrame, fill: Colour, smooth: bool) -> ByteArray:
        """Bring an image whose pixels are the cells of a world frame onto a panel."""
        factor = frame.resolution * self.scale
        # Maps pixel centres of the source to pixel centres of the panel.
        shift_x = (frame.origin_x - self.left) * self.scale + 0.5 * factor - 0.5
        shift_y = (self.top - frame.bounds[3]) * self.scale + 0.5 * factor - 0.5
        matrix = np.array([[factor, 0.0, shift_x], [0.0, factor, shift_y]])
        placed: ByteArray = cv2.warpAffine(
            image, matrix, (_PANEL_WIDTH, _PANEL_HEIGHT),
            flags=cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST, borderValue=fill,
        )  # fmt: skip
        return placed

    def paint(self, simulation: Simulation) -> ByteArray:
        """The robot's map."""
        grid = simulation.mapper.occupancy_grid()
        frame, origin = grid.frame, simulation.start
        colours = np.full((*grid.cells.shape, 3), UNKNOWN_TINT, dtype=np.uint8)
        colours[grid.cells == FREE] = FLOOR
        colours[grid.cells == OCCUPIED] = WALL
        # Large plans have several cells to a pixel: average them, or thin walls would fall through.
        shrink = max(1, math.ceil(1.0 / (frame.resolution * self.scale)))
        if shrink > 1:
            rows, cols = (math.ceil(side / shrink) * shrink for side in grid.cells.shape)
            padded = np.full((rows, cols, 3), UNKNOWN_TINT, dtype=np.uint8)
            padded[rows - colours.shape[0] :, : colours.shape[1]] = colours
            colours = cv2.resize(padded, (cols // shrink, rows // shrink), interpolation=cv2.INTER_AREA)
        in_world = GridFrame(
            frame.resolution * shrink,
            frame.origin_x + origin.x,
            frame.origin_y + origin.y,
            *colours.shape[:2],
        )
        return self.place(colours, in_world, UNKNOWN_TINT, smooth=shrink > 1)


def _panel(image: ByteArray, index: int) -> ByteArray:
    left = _MARGIN + index * (_PANEL_WIDTH + _MARGIN)
    return image[_HEAD : _HEAD + _PANEL_HEIGHT, left : left + _PANEL_WIDTH]


def _draw_plan(prepared: PreparedPlan, view: _View) -> ByteArray:
    """The building: what never changes during an episode."""
    layer: ByteArray = np.full((_PANEL_HEIGHT, _PANEL_WIDTH, 3), UNKNOWN_TINT, dtype=np.uint8)
    space = prepared.plan.free_space
    cv2.fillPoly(layer, [view.pixels(np.asarray(space.exterior.coords))], FLOOR, cv2.LINE_AA, _SHIFT)
    for ring in space.interiors:
        cv2.fillPoly(layer, [view.pixels(np.asarray(ring.coords))], UNKNOWN_TINT, cv2.LINE_AA, _SHIFT)
    return layer


def _draw_walls(panel: ByteArray, prepared: PreparedPlan, view: _View) -> None:
    lines = view.pixels(prepared.plan.segments().reshape(-1, 2)).reshape(-1, 2, 2)
    thickness = 2 if view.scale > 15 else 1
    cv2.polylines(panel, list(lines), False, WALL, thickness, cv2.LINE_AA, _SHIFT)


def _tint_seen(panel: ByteArray, view: _View, assessment: Assessment) -> None:
    """Colour the floor that was truly seen."""
    seen = assessment.coverage.seen.astype(np.uint8) * 255
    mask = view.place(seen, assessment.coverage.frame, (0, 0, 0), smooth=False) > 0
    panel[mask & (panel == FLOOR).all(axis=2)] = SEEN


def _end_points(simulation: Simulation, pose: Pose2D, ranges: FloatArray) -> FloatArray:
    """Ends of the beams, at most at the range limit, (num_beams, 2), in the parent frame of ``pose``."""
    geometry = simulation.scan.geometry
    lengths = np.clip(ranges, 0.0, geometry.range_max)
    local = np.column_stack([lengths * np.cos(geometry.angles), lengths * np.sin(geometry.angles)])
    return transform_points(compose(pose, geometry.mount), local)


def _draw_beams(panel: ByteArray, view: _View, mount: Pose2D, ends: FloatArray) -> None:
    """The area that the scanner overlooks, see-through."""
    outline = view.pixels(np.vstack([[mount.x, mount.y], ends]))
    low = np.maximum(outline.min(axis=0) // (1 << _SHIFT) - 2, 0)
    high = outline.max(axis=0) // (1 << _SHIFT) + 3
    patch = panel[low[1] : high[1], low[0] : high[0]]
    fan = patch.copy()
    cv2.fillPoly(fan, [outline - (low << _SHIFT)], BEAM, cv2.LINE_AA, _SHIFT)
    cv2.addWeighted(fan, 0.35, patch, 0.65, 0.0, dst=patch)


def _draw_path(panel: ByteArray, pixels: np.ndarray, colour: Colour, thickness: int = 2) -> None:
    cv2.polylines(panel, [pixels], False, colour, thickness, cv2.LINE_AA, _SHIFT)
    start = int(pixels[0, 0]), int(pixels[0, 1])
    cv2.circle(panel, start, 4 << _SHIFT, colour, -1, cv2.LINE_AA, _SHIFT)


def _draw_robot(
    panel: ByteArray, view: _View, pose: Pose2D, radius: float, colour: Colour, filled: bool = True
) -> None:
    """A disc with a line to where it looks."""
    nose = pose.x + radius * math.cos(pose.theta), pose.y + radius * math.sin(pose.theta)
    (col, row), tip = view.pixels(np.array([[pose.x, pose.y], nose])).tolist()
    size = round(max(radius * view.scale, 7.0) * (1 << _SHIFT))
    if filled:
        cv2.circle(panel, (col, row), size, colour, -1, cv2.LINE_AA, _SHIFT)
    cv2.circle(panel, (col, row), size, FLOOR if filled else colour, 1 if filled else 2, cv2.LINE_AA, _SHIFT)
    cv2.line(panel, (col, row), tip, FLOOR if filled else colour, 2, cv2.LINE_AA, _SHIFT)


def _frame_panels(image: ByteArray) -> None:
    """Borders and titles."""
    titles = (("World", "true pose", TRUTH), ("SLAM map", "believed pose", BELIEF))
    for index, (title, pose, colour) in enumerate(titles):
        left = _MARGIN + index * (_PANEL_WIDTH + _MARGIN)
        corner = (left + _PANEL_WIDTH, _HEAD + _PANEL_HEIGHT)
        cv2.rectangle(image, (left - 1, _HEAD - 1), corner, FAINT, 1)
        _text(image, title, left, 30, 0.7, INK)
        end = left + _PANEL_WIDTH - _text_width(pose, 0.5)
        _text(image, pose, end, 29, 0.5, FAINT)
        cv2.circle(image, (end - 14, 24), 6, colour, -1, cv2.LINE_AA)
        if index == 1:
            end -= 40 + _text_width("true pose", 0.5)
            _text(image, "true pose", end, 29, 0.5, FAINT)
            cv2.circle(image, (end - 14, 24), 6, TRUTH, 2, cv2.LINE_AA)


def _draw_scale(image: ByteArray, scale: float) -> None:
    """A bar of a round length in the corner of the left panel."""
    length = max(
        step for step in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if step * scale <= 130 or step == 0.5
    )
    width = round(length * scale)
    label = f"{length:g} m"
    left, bottom = _MARGIN + 12, _HEAD + _PANEL_HEIGHT - 14
    box = image[bottom - 12 : bottom + 10, left - 6 : left + width + 14 + _text_width(label, 0.45)]
    cv2.addWeighted(box, 0.2, np.full_like(box, 255), 0.8, 0.0, dst=box)
    cv2.line(image, (left, bottom), (left + width, bottom), INK, 2)
    for end in (left, left + width):
        cv2.line(image, (end, bottom - 5), (end, bottom + 5), INK, 2)
    _text(image, label, left + width + 8, bottom + 5, 0.45, INK)


def _draw_figures(
    image: ByteArray, prepared: PreparedPlan, simulation: Simulation, assessment: Assessment
) -> None:
    """Time, coverage and errors in the foot of the picture."""
    latest, top = assessment.latest, _HEAD + _PANEL_HEIGHT
    minutes, seconds = divmod(int(latest.time), 60)
    figures = [
        ("time", f"{minutes}:{seconds:02d}"),
        ("coverage", f"{100.0 * latest.coverage:.1f} %"),
        ("path", f"{simulation.path_length:.1f} m"),
        ("pose error", f"{100.0 * latest.pose_error:.1f} cm"),
        ("N_eff", f"{latest.n_eff:.1f}"),
        ("contacts", f"{simulation.collisions}"),
        ("plan", prepared.plan.id if len(prepared.plan.id) <= 15 else prepared.plan.id[:13] + ".."),
    ]
    step = (WIDTH - 2 * _MARGIN - 40) // len(figures)
    for index, (name, value) in enumerate(figures):
        left = _MARGIN + index * step
        _text(image, name, left, top + 28, 0.45, FAINT)
        _text(image, value, left, top + 54, 0.65, INK)
    bar = image[top + 68 : top + 74, _MARGIN : WIDTH - _MARGIN]
    bar[:] = UNKNOWN_TINT
    bar[:, : round(latest.coverage * bar.shape[1])] = BAR


def _text(image: ByteArray, text: str, left: int, baseline: int, size: float, colour: Colour) -> None:
    cv2.putText(image, text, (left, baseline), _FONT, size, colour, 1, cv2.LINE_AA)


def _text_width(text: str, size: float) -> int:
    return int(cv2.getTextSize(text, _FONT, size, 1)[0][0])
