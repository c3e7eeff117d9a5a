"""An exploration as a recording for the rerun viewer (rerun.io): everything on one timeline, to be searched by hand.

Two views stand side by side, the world and what the robot believes, both in the plan's frame in metres; figures over
time stand below. What doesn't change from one moment to the next is logged once.
"""

import importlib.util
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.files import staged
from slamgym.core.types import (
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    LaserScan,
    OccupancyGrid,
    Pose2D,
)
from slamgym.viz.canvas import BELIEVED_COLOUR, TRUE_COLOUR, WALL_TINT, Colour, colour_cells
from slamgym.viz.exploration import (
    BAR_COLOUR,
    BEAM_COLOUR,
    FURNITURE_COLOUR,
    PERSON_COLOUR,
    Scene,
    beam_ends,
)

_OFFERED = np.array((132, 94, 247), np.uint8)
"""Colour of frontiers."""
_CHOSEN = np.array((247, 103, 7), np.uint8)
"""Colour of the frontier to which the robot drives, and of the way there."""
_FLOOR = 0.0
"""Height of areas [m]."""
_LINE = 0.02
"""Height of lines, which lie over areas [m]."""
_MARK = 0.04
"""Height of points and arrows, which lie over lines [m]."""


@dataclass(frozen=True)
class Deliberation:
    """Data that the robot's choice depends on, in the world frame; explorers without frontiers have particles alone."""

    particles: FloatArray  # (N, 3) poses [m, m, rad]
    frontiers: Sequence[FloatArray] = ()  # (size, 2) centres of each one's cells [m]
    chosen: int | None = None  # which of them the robot drives to
    path: FloatArray | None = None  # (N, 2) the way there [m]


def check_recording_name(path: Path) -> None:
    """Refuse a name that no recording can have, or that this installation can't write.

    Raises:
        ConfigError: If it doesn't end in .rrd, or rerun isn't installed.
    """
    if path.suffix.lower() != ".rrd":
        raise ConfigError(f"{path}: a recording's name must end in .rrd")
    if importlib.util.find_spec("rerun") is None:
        raise ConfigError(
            f"{path}: a recording needs rerun; install it with: pip install 'slamgym[viz]'"
        )


class RobotBelief(NamedTuple):
    """Where a robot believes to be, and on what map."""

    grid: OccupancyGrid
    pose: Pose2D
    scan: LaserScan
    path: FloatArray  # (N, 2) [m]
    radius: float  # of the robot [m]


@contextmanager
def open_recording(path: Path) -> Iterator["Recording"]:
    """Give a recording to add moments to; the file appears when the block ends well.

    Raises:
        ConfigError: If the name doesn't end in .rrd, or rerun is missing.
        StorageError: If it can't be written.
    """
    check_recording_name(path)
    import rerun
    from rerun import blueprint

    world = blueprint.Spatial3DView(origin="world", name="world")
    belief = blueprint.Spatial3DView(origin="belief", name="belief")
    views = blueprint.Horizontal(world, belief)
    figures = blueprint.TimeSeriesView(origin="figures", name="figures")
    layout = blueprint.Vertical(views, figures, row_shares=[4, 1])
    stream: Any = rerun.RecordingStream("slamgym")
    with staged(path) as part:
        stream.save(str(part), default_blueprint=blueprint.Blueprint(layout))
        try:
            yield Recording(rerun, stream)
        finally:
            stream.flush()
            stream.disconnect()


class Recording:
    """Writes moments of an exploration; use :func:`open_recording` to get one."""

    def __init__(self, rerun: Any, stream: Any) -> None:
        self._rerun = rerun
        self._stream = stream
        self._plan: FloorPlan | None = None
        self._cells: ByteArray | None = None
        self._deliberation: Deliberation | None = None

    def add(self, scene: Scene, deliberation: Deliberation) -> None:
        """Add a moment; the clock is the robot's."""
        self._stream.set_time("robot time", duration=scene.figures.time)
        if scene.plan is not self._plan:
            self._plan = scene.plan
            walls = scene.plan.segments()
            self._lines("world/plan", walls.reshape(-1, 2, 2), WALL_TINT)
            outlines = [_closed(piece) for piece in scene.furniture]
            self._lines("world/furniture", outlines, FURNITURE_COLOUR)
        people = scene.moving.reshape(-1, 2, 2)
        self._lines("world/people", people, PERSON_COLOUR)
        self._robot("world/robot", scene.true_pose, scene.robot_radius, TRUE_COLOUR)
        ends = _ends(scene.scan, scene.true_pose, scene.true_ranges)
        self._points("world/beams", ends, BEAM_COLOUR)
        if scene.grid.cells is not self._cells:
            self._lines("world/path", [scene.true_path], TRUE_COLOUR)
        belief = RobotBelief(
            grid=scene.grid,
            pose=scene.believed_pose,
            scan=scene.scan,
            path=scene.believed_path,
            radius=scene.robot_radius,
        )
        self.believe(scene.figures.time, belief, deliberation)
        self._figure("coverage", scene.figures.coverage)
        self._figure("pose_error", scene.figures.pose_error)

    def believe(self, time: float, belief: "RobotBelief", deliberation: Deliberation) -> None:
        """Add what a robot believes at a moment of its clock [s]."""
        self._stream.set_time("robot time", duration=time)
        self._robot("belief/robot", belief.pose, belief.radius, BELIEVED_COLOUR)
        ranges = belief.scan.ranges.astype(np.float64)
        ends = _ends(belief.scan, belief.pose, ranges)
        self._points("belief/scan", ends, BEAM_COLOUR)
        if belief.grid.cells is not self._cells:
            self._cells = belief.grid.cells
            colours = colour_cells(self._cells)
            picture = _with_alpha(colours, 255)
            self._grid("belief/map", picture, belief.grid.frame, 0.0)
            self._lines("belief/path", [belief.path], BELIEVED_COLOUR)
        if deliberation is not self._deliberation:
            self._deliberation = deliberation
            self._deliberate(deliberation)

    def _deliberate(self, deliberation: Deliberation) -> None:
        """Particles, frontiers, and the way to the chosen one."""
        particles = deliberation.particles[:, :2]
        self._points("belief/particles", particles, BAR_COLOUR)
        frontiers = deliberation.frontiers
        sizes = [len(frontier) for frontier in frontiers]
        numbers = np.arange(len(frontiers))
        is_chosen = numbers == deliberation.chosen
        is_of_chosen = np.repeat(is_chosen, sizes)
        colours = np.where(is_of_chosen[:, None], _CHOSEN, _OFFERED)
        none = np.empty((0, 2))
        centres = np.vstack([none, *frontiers])
        self._points("belief/frontiers", centres, colours)
        way = [] if deliberation.path is None else [deliberation.path]
        self._lines("belief/way", way, _CHOSEN)

    def _figure(self, name: str, value: float) -> None:
        self._stream.log(f"figures/{name}", self._rerun.Scalars(value))

    def _lines(
        self, name: str, strips: Sequence[FloatArray] | FloatArray, colour: Colour | ByteArray
    ) -> None:
        lifted = [_lifted(strip, _LINE) for strip in strips]
        colours = [colour] * len(lifted)
        lines = self._rerun.LineStrips3D(lifted, colors=colours, radii=0.02)
        self._stream.log(name, lines)

    def _points(
        self, name: str, points: FloatArray, colours: Colour | ByteArray, radius: float = 0.03
    ) -> None:
        lifted = _lifted(points, _MARK)
        marks = self._rerun.Points3D(lifted, colors=colours, radii=radius)
        self._stream.log(name, marks)

    def _robot(self, name: str, pose: Pose2D, radius: float, colour: Colour) -> None:
        length = 2.0 * radius
        x = length * math.cos(pose.theta)
        y = length * math.sin(pose.theta)
        place = np.array([pose[:2]])
        self._points(name, place, colour, radius)
        origin = _lifted(place, _MARK)
        heading = [x, y, 0.0]
        arrow = self._rerun.Arrows3D(origins=origin, vectors=[heading], colors=[colour])
        self._stream.log(f"{name}/heading", arrow)

    def _grid(self, name: str, picture: ByteArray, frame: GridFrame, order: float) -> None:
        """Place an RGBA picture whose pixels are the cells of a frame."""
        layout = self._rerun.components.ImageFormat(
            width=picture.shape[1],
            height=picture.shape[0],
            color_model="RGBA",
            channel_datatype="U8",
        )
        corner = [frame.origin_x, frame.origin_y, _FLOOR]
        grid = self._rerun.GridMap(
            data=picture.tobytes(),
            format=layout,
            cell_size=frame.resolution,
            translation=corner,
            draw_order=order,
        )
        self._stream.log(name, grid)


def _ends(scan: LaserScan, pose: Pose2D, ranges: FloatArray) -> FloatArray:
    """Where the beams that met something ended, (N, 2), in the pose's frame."""
    met = (ranges > 0.0) & (ranges <= scan.geometry.range_max)
    ends = beam_ends(scan, pose, ranges)
    return ends[met]


def _closed(outline: FloatArray) -> FloatArray:
    """An outline that ends where it begins."""
    return np.vstack([outline, outline[:1]])


def _lifted(points: FloatArray, height: float) -> FloatArray:
    """Points of the plane, (N, 2), in space, (N, 3)."""
    heights = np.full(len(points), height)
    return np.column_stack([points, heights])


def _with_alpha(colours: np.ndarray, opacity: float | FloatArray | Float32Array) -> ByteArray:
    """An RGB picture, (H, W, 3), with an opacity from 0 to 255."""
    whole = np.rint(opacity)
    alpha = np.broadcast_to(whole, colours.shape[:2])
    channels = np.dstack([colours, alpha])
    return channels.astype(np.uint8)
