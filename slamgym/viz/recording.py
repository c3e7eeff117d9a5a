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
from typing import Any

import numpy as np

from slamgym.core.errors import ConfigError
from slamgym.core.files import staged
from slamgym.core.types import ByteArray, Float32Array, FloatArray, GridFrame, Pose2D
from slamgym.viz.canvas import BELIEVED_COLOUR, TRUE_COLOUR, WALL_TINT, Colour, colour_cells
from slamgym.viz.exploration import BAR_COLOUR, BEAM_COLOUR, FURNITURE_COLOUR, PERSON_COLOUR, Scene, beam_ends

_FRONTIER_COLOURS: tuple[Colour, Colour] = ((132, 94, 247), (247, 103, 7))  # offered, chosen
_NEEDED = "rerun"
_LEVELS = {"floor": 0.0, "line": 0.02, "mark": 0.04}  # heights, so that lines lie over areas [m]


@dataclass(frozen=True)
class Deliberation:
    """What the robot weighs, in the world frame. Whoever has no such thing leaves it empty."""

    particles: FloatArray  # (N, 3) poses [m, m, rad]
    frontiers: Sequence[FloatArray] = ()  # (size, 2) centres of each one's cells [m]
    chosen: int | None = None  # which of them the robot drives to
    path: FloatArray | None = None  # (N, 2) the way there [m]
    foreseen: tuple[Float32Array, Float32Array, GridFrame] | None = (
        None  # probabilities of unseen floor and of walls
    )


def check_recording_name(path: Path) -> None:
    """Refuse a name that no recording can have, or that this installation can't write.

    Raises:
        ConfigError: If it doesn't end in .rrd, or rerun isn't installed.
    """
    if path.suffix.lower() != ".rrd":
        raise ConfigError(f"{path}: a recording's name must end in .rrd")
    if importlib.util.find_spec(_NEEDED) is None:
        raise ConfigError(f"{path}: a recording needs rerun; install it with: pip install 'slamgym[viz]'")


@contextmanager
def open_recording(path: Path) -> Iterator["Recording"]:
    """Give a recording to add moments to; the file appears when the block ends well.

    Raises:
        ConfigError: If the name doesn't end in .rrd, or rerun is missing.
        StorageError: If it can't be written.
    """
    check_recording_name(path)
    with staged(path) as part:
        recording = Recording(part)
        try:
            yield recording
        finally:
            recording.close()


class Recording:
    """Writes moments of an exploration; use :func:`open_recording` to get one.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        import rerun
        from rerun import blueprint

        self._rerun: Any = rerun
        self._stream: Any = rerun.RecordingStream("slamgym")
        views = [blueprint.Spatial3DView(origin=name, name=name) for name in ("world", "belief")]
        figures = blueprint.TimeSeriesView(origin="figures", name="figures")
        layout = blueprint.Vertical(blueprint.Horizontal(*views), figures, row_shares=[4, 1])
        self._stream.save(str(path), default_blueprint=blueprint.Blueprint(layout))
        self._last: dict[str, Any] = {}

    def add(self, scene: Scene, deliberation: Deliberation) -> None:
        """Add a moment; the clock is the robot's."""
        stream, figures = self._stream, scene.figures
        stream.set_time("robot time", duration=figures.time)
        if self._is_new("plan", scene.plan):
            self._lines("world/plan", scene.plan.segments().reshape(-1, 2, 2), WALL_TINT, 0.03)
        if self._is_new("furniture", scene.furniture):
            outlines = [np.vstack([piece, piece[:1]]) for piece in scene.furniture]
            self._lines("world/furniture", outlines, FURNITURE_COLOUR, 0.02)
        self._lines("world/people", scene.moving.reshape(-1, 2, 2), PERSON_COLOUR, 0.02)
        self._robot("world/robot", scene.true_pose, scene.robot_radius, TRUE_COLOUR)
        self._robot("belief/robot", scene.believed_pose, scene.robot_radius, BELIEVED_COLOUR)
        for name, pose, ranges in (
            ("world/beams", scene.true_pose, scene.true_ranges),
            ("belief/scan", scene.believed_pose, scene.scan.ranges.astype(np.float64)),
        ):
            self._points(name, _ends(scene, pose, ranges), BEAM_COLOUR, 0.03)
        if self._is_new("grid", scene.grid.cells):
            self._grid("belief/map", _opaque(colour_cells(scene.grid.cells)), scene.grid.frame, order=0.0)
            self._lines("world/path", [scene.true_path], TRUE_COLOUR, 0.02)
            self._lines("belief/path", [scene.believed_path], BELIEVED_COLOUR, 0.02)
            self._points("belief/particles", deliberation.particles[:, :2], BAR_COLOUR, 0.04)
        self._deliberate(deliberation)
        for name in ("coverage", "pose_error", "n_eff"):
            stream.log(f"figures/{name}", self._rerun.Scalars(getattr(figures, name)))

    def close(self) -> None:
        """Write what is left."""
        self._stream.flush()
        self._stream.disconnect()

    def _deliberate(self, deliberation: Deliberation) -> None:
        """Frontiers, the way to the chosen one, and what is foreseen behind them."""
        if self._is_new("frontiers", deliberation.frontiers):
            cells = np.vstack([np.empty((0, 2)), *deliberation.frontiers])
            is_chosen = np.repeat(
                np.arange(len(deliberation.frontiers)) == deliberation.chosen,
                [len(frontier) for frontier in deliberation.frontiers],
            )
            self._points(
                "belief/frontiers", cells, np.array(_FRONTIER_COLOURS, np.uint8)[is_chosen.astype(int)], 0.03
            )
        if self._is_new("way", deliberation.path):
            way = [] if deliberation.path is None else [deliberation.path]
            self._lines("belief/way", way, _FRONTIER_COLOURS[1], 0.02)
        if deliberation.foreseen is not None and self._is_new("foreseen", deliberation.foreseen):
            floor, wall, frame = deliberation.foreseen
            picture = np.empty((*floor.shape, 4), np.uint8)
            picture[..., :3] = np.where((wall > floor)[..., None], WALL_TINT, BAR_COLOUR)
            picture[..., 3] = np.rint(200.0 * np.maximum(floor, wall))
            self._grid("belief/foreseen", picture, frame, order=1.0)

    def _is_new(self, name: str, value: Any) -> bool:
        """Whether it is another object than at the moment before."""
        if name in self._last and self._last[name] is value:
            return False
        self._last[name] = value
        return True

    def _lines(
        self, name: str, strips: Sequence[FloatArray] | FloatArray, colour: Colour, radius: float
    ) -> None:
        lifted = [_lifted(strip, "line") for strip in strips]
        self._stream.log(name, self._rerun.LineStrips3D(lifted, colors=[colour] * len(lifted), radii=radius))

    def _points(self, name: str, points: FloatArray, colours: Colour | ByteArray, radius: float) -> None:
        self._stream.log(name, self._rerun.Points3D(_lifted(points, "mark"), colors=colours, radii=radius))

    def _robot(self, name: str, pose: Pose2D, radius: float, colour: Colour) -> None:
        nose = [2.0 * radius * math.cos(pose.theta), 2.0 * radius * math.sin(pose.theta), 0.0]
        origin = _lifted(np.array([pose[:2]]), "mark")
        self._points(name, np.array([pose[:2]]), colour, radius)
        self._stream.log(
            f"{name}/heading", self._rerun.Arrows3D(origins=origin, vectors=[nose], colors=[colour])
        )

    def _grid(self, name: str, picture: ByteArray, frame: GridFrame, order: float) -> None:
        """Place an RGBA picture whose pixels are the cells of a frame."""
        rerun, (height, width) = self._rerun, picture.shape[:2]
        layout = rerun.components.ImageFormat(
            width=width, height=height, color_model="RGBA", channel_datatype="U8"
        )
        corner = [frame.origin_x, frame.origin_y, _LEVELS["floor"]]
        self._stream.log(
            name,
            rerun.GridMap(
                data=picture.tobytes(),
                format=layout,
                cell_size=frame.resolution,
                translation=corner,
                draw_order=order,
            ),
        )


def _ends(scene: Scene, pose: Pose2D, ranges: FloatArray) -> FloatArray:
    """Where the beams that met something ended, (N, 2), world frame."""
    met = (ranges > 0.0) & (ranges <= scene.scan.geometry.range_max)
    return beam_ends(scene.scan, pose, ranges)[met]


def _lifted(points: FloatArray, level: str) -> FloatArray:
    """Points of the plane, (N, 2), in space, (N, 3)."""
    return np.column_stack([points, np.full(len(points), _LEVELS[level])])


def _opaque(picture: ByteArray) -> ByteArray:
    return np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)])
