"""The explorers as a node: a drop-in for explore_lite on anybody's map, driving itself or by another navigation."""

import functools
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Bool

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import storage_errors
from slamgym.core.limits import shown
from slamgym.core.names import is_own_explorer
from slamgym.core.types import UNKNOWN, FloatArray, LaserScan, Pose2D
from slamgym.core.types import OccupancyGrid as Grid
from slamgym.interop import write_ros_map
from slamgym.interop.records import BrokenMessageError
from slamgym.interop.ros_messages import pose_of, stamp_of
from slamgym.planning.promise import split_promise
from slamgym.ros2.driving import Driver
from slamgym.ros2.exploration import ALONE, Exploration, ExplorationState
from slamgym.ros2.foreign_maps import ForeignMap
from slamgym.ros2.frames import POSES_END, RobotFrames, ScanSync
from slamgym.ros2.gathered_maps import laid_under
from slamgym.ros2.laser import LaserReader
from slamgym.ros2.managed import ManagedNode
from slamgym.ros2.mapping import draw_saved_map
from slamgym.ros2.node import SENSOR
from slamgym.ros2.parameters import ExploreParameters
from slamgym.ros2.stamps import CLOCK_JUMP
from slamgym.ros2.topics import KeptTopic, listen_to_odometry, listen_to_scans
from slamgym.ros2.viewing import Display
from slamgym.slam.deskew import deskewed

try:
    from map_msgs.msg import OccupancyGridUpdate
except ImportError:  # no wheel has it: it comes with a ROS installation
    OccupancyGridUpdate = None

POSE_WAIT = 0.3
"""A step waits so long for the mapper's pose at its scan [s], if the mapper gives poses; then the last one serves."""
MATES_END = 6.0
"""A robot that doesn't hear others for so long is alone [s]."""
STOP_AFTER = 1.0
"""Without a scan for so long the robot is stopped; another navigation drives without scans [s]."""


class _Due(NamedTuple):
    """A scan that is to be acted on."""

    message: Any
    stamp: float
    odometry: Pose2D
    since: float


class _Team(NamedTuple):
    """What is heard of other robots."""

    grid: Grid | None = None  # what all have mapped
    poses: FloatArray = ALONE  # (K, 3) where they are, map frame
    heard_at: float = -math.inf  # here [s]


class _Map(NamedTuple):
    """The newest map, if there is one."""

    grid: Grid | None = None
    stamp: float = 0.0


class ExploreNode(ManagedNode):
    """Explores, and saves the map and its drawing at the end.

    Args:
        parameters: What the command line says.

    Raises:
        ConfigError: If there is no such explorer, or a parameter makes no sense.
    """

    def __init__(self, parameters: ExploreParameters) -> None:
        super().__init__("slamgym_explore", parameters)
        self._options = names = self.read_parameters(parameters)
        base, _ = split_promise(names.explorer)
        if is_own_explorer(base) and names.explorer != parameters.explorer:
            raise ConfigError(
                f"explorer {shown(names.explorer)} runs code of yours: name it on the command line (--explorer), "
                "not as a parameter, which a file may hold"
            )
        self._exploration = exploration = Exploration(names)
        if names.wait or not names.autostart:
            exploration.pause()
        self._frames = RobotFrames(names, self.once)
        self._sync = ScanSync(self._frames, self._hand_on, self.once)
        self._laser = LaserReader(self._frames, names, self.once)
        self._foreign = ForeignMap("map")
        self._map = _Map()
        self._team = _Team()
        self._due: _Due | None = None
        self._stamp = 0.0
        self._stepped_at = time.monotonic()
        self._is_saved = False
        self.worker.most_pending = 1  # an older scan is of no use to a robot that drives
        self._driver = Driver(self, names, self._end_goal)
        self._display = Display(self, names)
        self._listen()
        self._orders = {
            "start": self._start,
            "stop": self._stop,
            "return_to_start": self._return_to_start,
        }
        for name, action in self._orders.items():
            self.serve(name, action, at_once=True)
        self.create_timer(0.1, self._look, clock=self.wall_clock)
        self.begin_life()

    def _listen(self) -> None:
        self.need("odom")
        self.need("map")
        if self._options.drive == "wheels":
            self.need("scan")
        KeptTopic(self, OccupancyGrid, "map", self._take_map)
        if OccupancyGridUpdate:
            self.listen(OccupancyGridUpdate, "map_updates", self._take_update)
        KeptTopic(self, OccupancyGrid, "team_map", self._take_team_map)
        self.listen(PoseArray, "mates", self._take_mates)
        self.listen(PoseWithCovarianceStamped, "pose", self._take_pose, SENSOR)
        listen_to_odometry(self, self._frames, self._sync.flush)
        listen_to_scans(self, self._sync.take)
        self.listen(Bool, "explore/resume", self._switch)

    # --- callbacks, which return at once ---

    def _take_map(self, message: Any) -> None:
        self.heard("map", for_good=True)  # a map that stays as it is isn't sent again
        if self.is_on_map(message, "map"):
            read = functools.partial(self._read_map, message)
            self.worker.order(read, "map", replaces=True)

    def _take_team_map(self, message: Any) -> None:
        if self.is_on_map(message, "team_map"):
            read = functools.partial(self._read_team_map, message)
            self.worker.order(read, "team_map", replaces=True)

    def _take_mates(self, message: Any) -> None:
        poses = [pose_of(pose, "mates") for pose in message.poses]
        rows = np.array(poses, dtype=np.float64).reshape(-1, 3)
        self._team = self._team._replace(poses=rows, heard_at=time.monotonic())

    def _take_update(self, message: Any) -> None:
        self.worker.order(functools.partial(self._patch_map, message), "map")

    def _take_pose(self, message: Any) -> None:
        if not self.is_on_map(message, "pose"):
            return
        self._frames.take_pose(message)
        if self._due is not None and self._frames.pose_stamp >= self._due.stamp:
            self._go()

    def _hand_on(self, message: Any, stamp: float, odometry: Pose2D) -> None:
        """Act on a scan once the mapper has placed it, if it says so of each."""
        self._go()
        self._due = _Due(message, stamp, odometry, time.monotonic())
        if not 0.0 < stamp - self._frames.pose_stamp < POSES_END:
            self._go()

    def _go(self) -> None:
        due = self._due
        self._due = None
        if due is not None:
            self.worker.put(functools.partial(self._step, due))

    def _look(self) -> None:
        """Go on without the mapper's pose, and stop a robot that sees nothing."""
        for order in self._display.orders():
            self._orders[order]()
        now = time.monotonic()
        if self._due is not None and now - self._due.since > POSE_WAIT:
            self._go()
        if now - self._stepped_at > STOP_AFTER:
            self._stepped_at = now
            self._driver.rest()  # the worker may be busy
            self.worker.put(functools.partial(self._step, None))

    def _switch(self, message: Any) -> None:
        """Start or stop, as explore_lite's users do."""
        if message.data:
            self._start()
        else:
            self._stop()

    def _start(self) -> str:
        self._driver.release()
        self.worker.order(self._exploration.resume)
        return "exploring"

    def _stop(self) -> str:
        self.halt()
        self.worker.order(self._exploration.pause)
        return "the robot stands"

    def _return_to_start(self) -> str:
        self._driver.release()
        self.worker.order(self._exploration.return_to_start)
        return "returning to the start"

    def wake(self) -> None:
        """Explore, unless the service `start` is waited for."""
        if not self._options.wait:
            self._start()

    def sleep(self) -> None:
        """Have the robot stand."""
        self._stop()

    def halt(self) -> None:
        """Stop the robot at once; what is being computed now doesn't drive it any more."""
        self._driver.halt()

    def _end_goal(self, number: int, reached: bool) -> None:
        self.worker.order(functools.partial(self._exploration.goal_ended, number, reached))

    # --- the worker ---

    def _read_map(self, message: Any) -> None:
        read = functools.partial(self._foreign.take_message, message)
        self._use_map(read, stamp_of(message.header, 0.0))

    def _read_team_map(self, message: Any) -> None:
        try:
            grid = ForeignMap("team_map").take_message(message)
        except (InputFileError, ValueError) as error:
            self.once(f"team_map {error}", f"a map is left out: {error}")
            return
        self._team = self._team._replace(grid=grid)
        if self._map.grid is not None:
            self._exploration.take_map(laid_under(self._map.grid, self._team.grid))

    def _patch_map(self, message: Any) -> None:
        def read() -> Grid | None:
            return self._foreign.patch(
                message.data, message.x, message.y, message.width, message.height
            )

        self._use_map(read, self._map.stamp)

    def _use_map(self, read: Callable[[], Grid | None], stamp: float) -> None:
        try:
            grid = read()
        except (InputFileError, ValueError) as error:
            self.once(f"map {error}", f"a map is left out: {error}")
        else:
            if grid is not None:
                self._map = _Map(grid, stamp)
                self._exploration.take_map(laid_under(grid, self._team.grid))

    def _forget_map(self) -> None:
        """Wait for the next map: the last one is of a run that has ended."""
        self._foreign = ForeignMap("map")
        grid = self._map.grid
        if grid is not None:
            unknown = np.full_like(grid.cells, UNKNOWN)
            self._exploration.take_map(Grid(unknown, grid.frame))
        self._map = _Map()

    def _step(self, due: _Due | None) -> None:
        """Do what the exploration asks for now; without a scan it knows the robot's place at most."""
        frames = self._frames
        pose = None
        scan = None
        if due is not None:
            try:
                scan = deskewed(self._laser.read(due.message, due.stamp, due.odometry))
            except BrokenMessageError as error:
                self.once("scan", str(error))
                return
            if due.stamp < min(self._stamp, self._map.stamp) - CLOCK_JUMP:
                self._forget_map()
            self._stamp = due.stamp
            self._stepped_at = time.monotonic()
            pose = frames.on_map(due.odometry)
        elif frames.odometry.newest > self._stamp:
            self._stamp = frames.odometry.newest
            pose = frames.on_map(frames.odometry.poses[-1])
        if self._stamp - frames.map_stamp > POSES_END:
            pose = None  # the mapper has ended
        self._act(pose, scan)
        self._display.show(self._exploration, self._map.grid, pose, scan)
        state = self._exploration.state
        if state is ExplorationState.DONE and not self._is_saved:
            self._finish()
        if state is ExplorationState.EXPLORING:
            self._is_saved = False

    def _act(self, pose: Pose2D | None, scan: LaserScan | None) -> None:
        """Ask what is to be done now, and send it, unless the robot was stopped meanwhile."""
        is_heard = time.monotonic() - self._team.heard_at < MATES_END
        mates = self._team.poses if is_heard else ALONE
        order = self._exploration.step(pose, scan, self._stamp, mates)
        self._driver.send(order, pose, self._exploration.state, self._stamp)

    def _finish(self) -> None:
        """Save the map, and begin its drawing."""
        self._is_saved = True
        out = self._options.out
        grid = self._map.grid
        if grid is not None:
            with storage_errors(out):
                out.mkdir(parents=True, exist_ok=True)
            write_ros_map(out, grid)
            self.get_logger().info(f"the map is in {out}; its drawing follows")
            self.worker.start(self._draw)

    def _draw(self) -> None:
        draw_saved_map(self._options.out)
        if self._options.exit:
            self.worker.end()

    def close(self) -> None:
        """Stop the robot, and complete the files."""
        self.halt()
        self._display.close()
