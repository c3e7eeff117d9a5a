"""What an exploration shows: status, frontiers and path on topics, a recording for rerun, a film."""

import contextlib
import math
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
from slamgym.ros2.node import LATCHED, RosNode, fill
from slamgym.ros2.parameters import ExploreParameters
from slamgym.viz.films import open_film
from slamgym.viz.map_pictures import GrowingView
from slamgym.viz.recording import Deliberation, RobotBelief, open_recording

FRAMES_PER_SECOND, FRAME_INTERVAL = 20.0, 1.0
"""The film shows so much robot time [s] in each picture."""


class Display:
    """Shows one exploration.

    Args:
        node: Publishes.
        parameters: Name the files.

    Raises:
        ConfigError: If a file has a name that it can't have, or needs a package that isn't installed.
    """

    def __init__(self, node: RosNode, parameters: ExploreParameters) -> None:
        self._node, self._parameters = node, parameters
        self._status = node.offer(String, "explore/status", LATCHED)
        self._markers = node.offer(MarkerArray, "explore/frontiers")
        self._paths = node.offer(Path, "explore/path")
        self._text, self._filmed_at = "", -np.inf
        self._driven: list[Pose2D] = []
        self._files = contextlib.ExitStack()
        rerun, video = FilePath(parameters.rerun), FilePath(parameters.video)
        film = open_film(video, FRAMES_PER_SECOND) if parameters.video else contextlib.nullcontext()
        self._film = self._files.enter_context(film)
        recording = open_recording(rerun) if parameters.rerun else contextlib.nullcontext()
        self._recording = self._files.enter_context(recording)
        self._view = GrowingView()

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
            self._node.get_logger().info(self._text)
            self._status({"data": self._text})
            self._publish(exploration, self._node.header(stamp, self._parameters.map_frame))
        if pose is None or grid is None or scan is None:
            return
        if (
            not self._driven
            or math.dist(pose[:2], self._driven[-1][:2]) > self._parameters.robot_radius
        ):
            self._driven.append(pose)
        if self._recording is not None:
            view = exploration.view()
            shown, chosen = view.frontiers, None
            if view.chosen is not None:
                shown, chosen = (*shown, view.chosen), len(shown)
            weighed = Deliberation(np.array([pose]), shown, chosen, view.path)
            driven, radius = np.array(self._driven)[:, :2], self._parameters.robot_radius
            self._recording.believe(stamp, RobotBelief(grid, pose, scan, driven, radius), weighed)
        if self._film is not None and abs(stamp - self._filmed_at) >= FRAME_INTERVAL:
            self._filmed_at, path = stamp, exploration.view().path
            self._film(
                self._view.draw(grid, [np.array(self._driven), *[path][: len(path)]], self._text)
            )

    def _publish(self, exploration: Exploration, header: Fields) -> None:
        """Publish frontiers and the path."""
        view = exploration.view()
        markers = [Marker(action=Marker.DELETEALL)]
        markers += [
            _marker(number, points, False) for number, points in enumerate(view.frontiers, 1)
        ]
        if view.chosen is not None:
            markers.append(_marker(0, view.chosen, True))
        self._markers({"markers": [fill(marker, {"header": header}) for marker in markers]})
        way = [pose_fields(Pose2D(x, y, 0.0)) for x, y in view.path[:, :2].tolist()]
        poses = [fill(PoseStamped(), {"header": header, "pose": pose}) for pose in way]
        self._paths({"header": header, "poses": poses})

    def close(self) -> None:
        """Complete the files."""
        self._files.close()


def _marker(number: int, points: FloatArray, is_chosen: bool) -> Any:
    """A frontier as points: green if the robot drives to it, else blue."""
    marker = Marker(ns="frontiers", id=number, type=Marker.POINTS, action=Marker.ADD)
    marker.points = [Point(x=x, y=y, z=0.0) for x, y in points.tolist()]
    colour = {"r": 0.1, "g": 0.8 if is_chosen else 0.4, "b": 0.2 if is_chosen else 1.0, "a": 1.0}
    scale = {"x": 0.05, "y": 0.05, "z": 0.05}
    return fill(
        marker, {"color": colour, "scale": scale, "pose": pose_fields(Pose2D(0.0, 0.0, 0.0))}
    )
