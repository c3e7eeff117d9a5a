"""What an exploration shows: status, frontiers and path on topics, a recording for rerun, a film, a live view."""

import contextlib
import math
import re
import time
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from slamgym.core.types import FloatArray, LaserScan, OccupancyGrid, Pose2D
from slamgym.interop.ros_messages import Fields, pose_fields
from slamgym.ros2.exploration import Exploration
from slamgym.ros2.live_view import LiveState, LiveView
from slamgym.ros2.node import LATCHED, RosNode, fill
from slamgym.ros2.parameters import ExploreParameters
from slamgym.viz.films import open_film
from slamgym.viz.map_pictures import GrowingView
from slamgym.viz.recording import Deliberation, RobotBelief, open_recording

FRAMES_PER_SECOND = 20.0
"""Pictures of the film in a second."""
FRAME_INTERVAL = 1.0
"""Robot time between two pictures of the film [s]."""
LOG_INTERVAL = 5.0
"""Time between two lines of the log in which figures alone differ [s]: the demo's robot sees some twenty a second."""

_GREEN = {"r": 0.1, "g": 0.8, "b": 0.2, "a": 1.0}
"""Colour of the frontier that the robot drives to."""
_BLUE = {"r": 0.1, "g": 0.4, "b": 1.0, "a": 1.0}
"""Colour of the other frontiers."""


class Display:
    """Shows one exploration.

    Args:
        node: Publishes.
        parameters: Name the files.

    Raises:
        ConfigError: If a file has a name that it can't have, or needs a package that isn't installed.
    """

    def __init__(self, node: RosNode, parameters: ExploreParameters) -> None:
        self._node = node
        self._parameters = parameters
        self._status = node.offer(String, "explore/status", LATCHED)
        self._markers = node.offer(MarkerArray, "explore/frontiers", LATCHED)
        self._paths = node.offer(Path, "explore/path", LATCHED)
        self._text = ""
        self._logged = ("", -np.inf)
        self._filmed_at = -np.inf  # [s]
        self._driven: list[Pose2D] = []
        self._files = contextlib.ExitStack()
        self._film = None
        if parameters.video:
            film = open_film(FilePath(parameters.video), FRAMES_PER_SECOND)
            self._film = self._files.enter_context(film)
        self._recording = None
        if parameters.rerun:
            recording = open_recording(FilePath(parameters.rerun))
            self._recording = self._files.enter_context(recording)
        self._view = GrowingView()
        self._live = None
        if parameters.view:
            self._live = LiveView(parameters.view)
            node.get_logger().info(f"live view: {self._live.address}")

    def _log(self, text: str) -> None:
        """Log a status: new words at once, new figures alone now and then."""
        words = re.sub(r"\d+", "", text)
        now = time.monotonic()
        last, logged_at = self._logged
        if words != last or now - logged_at >= LOG_INTERVAL:
            self._logged = (words, now)
            self._node.get_logger().info(text)

    def orders(self) -> Iterator[str]:
        """What a person at the live view has asked for since the last call."""
        while self._live is not None and not self._live.orders.empty():
            yield self._live.orders.get()

    def show(
        self,
        exploration: Exploration,
        grid: OccupancyGrid | None,
        pose: Pose2D | None,
        scan: LaserScan | None,
    ) -> None:
        """Show a step: topics where the text has changed, files as robot time goes on."""
        stamp = 0.0 if scan is None else scan.stamp
        if exploration.text != self._text:
            self._text = exploration.text
            self._log(self._text)
            self._status({"data": self._text})
            self._publish(exploration, self._node.header(stamp, self._parameters.map_frame))
        if pose is not None:
            self._note_pose(pose)
        if self._live is not None:
            view = exploration.view()
            way = tuple((x, y) for x, y, _ in self._driven)
            self._live.show(
                LiveState(self._text, grid, pose, way, view.frontiers, view.chosen, view.path)
            )
        if pose is None or grid is None or scan is None:
            return
        if self._recording is not None:
            driven = np.array(self._driven)[:, :2]
            belief = RobotBelief(grid, pose, scan, driven, self._parameters.robot_radius)
            self._recording.believe(stamp, belief, _deliberation(exploration, pose))
        if self._film is not None and abs(stamp - self._filmed_at) >= FRAME_INTERVAL:
            self._filmed_at = stamp
            lines = [np.array(self._driven)]
            path = exploration.view().path
            if len(path) > 0:
                lines.append(path)
            self._film(self._view.draw(grid, lines, self._text))

    def _note_pose(self, pose: Pose2D) -> None:
        """Add a pose to the way driven, if it isn't where the last one was."""
        if self._driven:
            moved = math.dist(pose[:2], self._driven[-1][:2])
            if moved <= self._parameters.robot_radius:
                return
        self._driven.append(pose)

    def _publish(self, exploration: Exploration, header: Fields) -> None:
        """Publish frontiers and the path."""
        view = exploration.view()
        markers = [Marker(action=Marker.DELETEALL)]
        for number, points in enumerate(view.frontiers, 1):
            markers.append(_marker(number, points, is_chosen=False))
        if view.chosen is not None:
            markers.append(_marker(0, view.chosen, is_chosen=True))
        self._markers({"markers": [fill(marker, {"header": header}) for marker in markers]})
        poses = []
        for x, y in view.path[:, :2].tolist():
            pose = pose_fields(Pose2D(x, y, 0.0))
            poses.append(fill(PoseStamped(), {"header": header, "pose": pose}))
        self._paths({"header": header, "poses": poses})

    def close(self) -> None:
        """Complete the files, and end the live view."""
        if self._live is not None:
            self._live.close()
        self._files.close()


def _marker(number: int, points: FloatArray, is_chosen: bool) -> Any:
    """A frontier as points: green if the robot drives to it, else blue."""
    marker = Marker(ns="frontiers", id=number, type=Marker.POINTS, action=Marker.ADD)
    marker.points = [Point(x=x, y=y, z=0.0) for x, y in points.tolist()]
    fields = {
        "color": _GREEN if is_chosen else _BLUE,
        "scale": {"x": 0.05, "y": 0.05, "z": 0.05},
        "pose": pose_fields(Pose2D(0.0, 0.0, 0.0)),
    }
    return fill(marker, fields)


def _deliberation(exploration: Exploration, pose: Pose2D) -> Deliberation:
    """Frontiers, the chosen one among them, and the path, as recordings take them."""
    view = exploration.view()
    shown = view.frontiers
    chosen = None
    if view.chosen is not None:
        chosen = len(shown)
        shown = (*shown, view.chosen)
    return Deliberation(np.array([pose]), shown, chosen, view.path)
