"""Maps of several mappers as one, over topics: the hub of a team, whoever its mappers are."""

import functools
import math
import time
from typing import Any

from geometry_msgs.msg import Pose, PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid

from slamgym.core.errors import InputFileError
from slamgym.core.files import storage_errors
from slamgym.core.types import Pose2D
from slamgym.interop import write_ros_map
from slamgym.interop.ros_messages import (
    grid_fields,
    pose_fields,
    pose_of,
    stamp_of,
    transform_fields,
)
from slamgym.interop.transforms import clean_frame
from slamgym.ros2.foreign_maps import ForeignMap
from slamgym.ros2.gathered_maps import GatheredMaps
from slamgym.ros2.mapping import SAVE_INTERVAL, TRANSFORM_INTERVAL
from slamgym.ros2.node import LATCHED, SENSOR, RosNode, fill
from slamgym.ros2.parameters import MergeParameters
from slamgym.ros2.topics import KeptTopic

POSE_END = 5.0
"""A robot whose pose isn't heard for so long isn't reckoned with any more [s]; its map is kept."""
_GRID_TYPE = "nav_msgs/msg/OccupancyGrid"


class MergeNode(RosNode):
    """Takes ``NAME/map`` and ``NAME/pose`` of each robot, and publishes ``map`` and the transforms from it to theirs.

    Each robot gets ``NAME/team_map``, the merged map in the frame of its own, and ``NAME/mates``, where the others are.

    Args:
        parameters: What the command line says.
    """

    def __init__(self, parameters: MergeParameters) -> None:
        super().__init__("slamgym_merge", parameters)
        self._options = names = self.read_parameters(parameters)
        self._gathered = GatheredMaps(names.places)
        self._foreign: dict[str, ForeignMap] = {}
        self._frames: dict[str, str] = {}
        self._poses: dict[str, tuple[float, Pose2D]] = {}  # when they were heard here [s]
        self._stamp = 0.0
        self._saved_at = -math.inf
        self._grids = self.offer(OccupancyGrid, "map", LATCHED)
        self._transforms = self.offer_transforms("/tf")
        self._team_maps: dict[str, Any] = {}
        self._mates: dict[str, Any] = {}
        for name in names.robots:
            self._join(name)
        self.serve("save", self.save)
        self.create_timer(TRANSFORM_INTERVAL, self._send_places, clock=self.wall_clock)
        self.create_timer(names.merge_interval, self._go, clock=self.wall_clock)
        if not names.robots:
            self.create_timer(1.0, self._discover, clock=self.wall_clock)

    def _join(self, name: str) -> None:
        """Listen to a robot."""
        self._foreign[name] = ForeignMap(f"/{name}/map")
        self._team_maps[name] = self.offer(OccupancyGrid, f"{name}/team_map", LATCHED)
        self._mates[name] = self.offer(PoseArray, f"{name}/mates")
        KeptTopic(self, OccupancyGrid, f"{name}/map", functools.partial(self._take_map, name))
        take_pose = functools.partial(self._take_pose, name)
        self.listen(PoseWithCovarianceStamped, f"{name}/pose", take_pose, SENSOR)

    def _discover(self) -> None:
        """Let robots join whose maps are published by now."""
        own = self.resolve_topic_name("map")
        for topic, kinds in self.get_topic_names_and_types():
            name = topic.removesuffix("/map").removeprefix(self.get_namespace()).strip("/")
            is_map = topic.endswith("/map") and topic != own and _GRID_TYPE in kinds
            if is_map and name and name not in self._foreign:
                self.get_logger().info(f"{name} joins")
                self._join(name)

    # --- callbacks, which return at once ---

    def _take_map(self, name: str, message: Any) -> None:
        self._frames[name] = clean_frame(message.header.frame_id)
        self._stamp = max(self._stamp, stamp_of(message.header, 0.0))
        self.worker.order(functools.partial(self._read_map, name, message), name, replaces=True)

    def _take_pose(self, name: str, message: Any) -> None:
        self._stamp = max(self._stamp, stamp_of(message.header, 0.0))
        self._poses[name] = (time.monotonic(), pose_of(message.pose.pose, "pose"))

    def _send_places(self) -> None:
        """Publish where maps and robots are."""
        names = self._options
        places = dict(self._gathered.places)
        header = self.header(self._stamp, names.map_frame)
        moved = [
            transform_fields(header, self._frame_below(name), place)
            for name, place in places.items()
            if name in self._frames
        ]
        if moved:
            self._transforms(*moved)
        now = time.monotonic()
        poses = {name: pose for name, (at, pose) in self._poses.items() if now - at < POSE_END}
        for name, send in self._mates.items():
            mates = [pose_fields(pose) for pose in self._gathered.mates(name, poses)]
            at = self.header(self._stamp, self._frames.get(name, name))
            if mates:
                send({"header": at, "poses": [fill(Pose(), fields) for fields in mates]})

    def _frame_below(self, name: str) -> str:
        """The frame of a robot's map; below its name if it is called as that of the merged one."""
        frame = self._frames[name]
        return f"{name}/{frame}" if frame == self._options.map_frame else frame

    def _go(self) -> None:
        self.worker.order(self.merge, "merge", replaces=True)

    # --- the worker ---

    def _read_map(self, name: str, message: Any) -> None:
        try:
            grid = self._foreign[name].take_message(message)
        except (InputFileError, ValueError) as error:
            self.once(f"{name} {error}", f"a map is left out: {error}")
            return
        self._gathered.take(name, grid)

    def merge(self) -> None:
        """Find out more of where maps lie, and publish them as one."""
        news = self._gathered.improve()
        if news:
            self.get_logger().info(news)
        merged = self._gathered.merged()
        if merged is None:
            return
        self._grids(grid_fields(self.header(self._stamp, self._options.map_frame), merged))
        for name, send in self._team_maps.items():
            grid = self._gathered.seen_from(name, merged)
            if grid is not None and name in self._frames:
                send(grid_fields(self.header(self._stamp, self._frames[name]), grid))
        if news or time.monotonic() - self._saved_at > SAVE_INTERVAL:
            self.save()

    def save(self) -> str:
        """Write the merged map into the folder."""
        out = self._options.out
        merged = self._gathered.merged()
        if merged is None:
            return "there is no map yet"
        with storage_errors(out):
            out.mkdir(parents=True, exist_ok=True)
        write_ros_map(out, merged)
        self._saved_at = time.monotonic()
        return f"the map of {', '.join(self._gathered.places)} is in {out}"

    def close(self) -> None:
        """Save the map."""
        self.get_logger().info(self.save())
