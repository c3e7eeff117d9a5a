"""The mapper as a node: a drop-in for slam_toolbox and GMapping, or with a finished map for AMCL."""

import contextlib
import functools
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid

from slamgym.core.errors import SlamgymError
from slamgym.core.files import exclusive_lock, storage_errors
from slamgym.core.types import Pose2D
from slamgym.interop import read_ros_map
from slamgym.interop.records import BrokenMessageError
from slamgym.interop.ros_messages import (
    Fields,
    grid_fields,
    pose_fields,
    pose_of,
    stamp_of,
    transform_fields,
)
from slamgym.ros2.frames import RobotFrames, ScanSync
from slamgym.ros2.managed import ManagedNode
from slamgym.ros2.map_run import Configure, KnownPlace, MapRun
from slamgym.ros2.node import LATCHED
from slamgym.ros2.parameters import MapParameters
from slamgym.ros2.run_files import LOG, OF_A_DRIVE, OF_A_MAP, put_files_aside
from slamgym.ros2.stamps import CLOCK_JUMP
from slamgym.ros2.topics import listen_to_odometry, listen_to_scans
from slamgym.slam import Mapper

TRANSFORM_INTERVAL = 0.05
"""Time between two transforms ``map`` -> ``odom`` [s]."""
TRANSFORM_AHEAD = 0.1
"""A transform is published as true until so much later [s]: others look it up for newer scans."""
SAVE_INTERVAL = 60.0
"""Time between two times that map, path and log are saved unasked [s]: so much is lost of a node that is killed."""


class MapNode(ManagedNode):
    """Maps, or localises on a finished map.

    Args:
        parameters: What the command line says.
        configure: Changes the mapper's settings, which suit the laser.

    Raises:
        InputFileError: If the finished map can't be read, or the folder can't be written.
    """

    def __init__(self, parameters: MapParameters, configure: Configure) -> None:
        super().__init__("slamgym_map", parameters)
        self._options = names = self.read_parameters(parameters)
        self._configure = configure
        self._known = KnownPlace(read_ros_map(names.map)) if names.map else None
        self._is_paused = False
        self._is_new = False
        self._num_dropped = 0
        self._grids = self.offer(OccupancyGrid, "map", LATCHED)
        self._poses = self.offer(PoseWithCovarianceStamped, "pose")
        self._diagnostics = self.offer(DiagnosticArray, "/diagnostics")
        self._transforms = self.offer_transforms("/tf")
        self._files = contextlib.ExitStack()
        with storage_errors(names.out):
            names.out.mkdir(parents=True, exist_ok=True)
        self._files.enter_context(exclusive_lock(names.out / ".lock"))
        self._frames = RobotFrames(names, self.once)
        self._sync = ScanSync(self._frames, self._hand_on, self.once)
        self._saved_at = time.monotonic()
        self._begin(self._put_older_aside())
        self._listen()
        self.create_timer(TRANSFORM_INTERVAL, self._send_transform)
        if self._known is not None:
            self._grids(grid_fields(self._header(0.0), self._known.grid))
        # Users of slam_toolbox know the other names; its serialized graph is our log, from which one maps again.
        self.serve("save", self.save, "save_map", "serialize_map")
        self.serve("draw", self._draw)
        self.serve("reset", self._reset)
        self.serve("pause_new_measurements", self._turn_pause, at_once=True)
        self.serve_switch("pause", self._pause)
        self.create_timer(1.0, self._look, clock=self.wall_clock)
        self.begin_life()

    def _listen(self) -> None:
        self.need("scan")
        if self._options.odometry == "tf":
            self.need("odom")
        listen_to_odometry(self, self._frames, self._sync.flush)
        listen_to_scans(self, self._take_scan)
        if self._known is not None:
            self.listen(PoseWithCovarianceStamped, "initialpose", self._begin_at)

    def _put_older_aside(self) -> Path | None:
        """Put aside what an earlier node left in the folder; returns its log if the map is to go on."""
        names = self._options
        files = OF_A_MAP if self._known is None else OF_A_DRIVE
        aside = put_files_aside(names.out, files)
        if aside is None:
            return None
        self.get_logger().info(f"what was in {names.out} is in {aside}")
        return aside / LOG if names.continue_ else None

    def _begin(self, older: Path | None = None) -> None:
        """Begin a map, or look for the robot, anew, or go on with an older log."""
        self._run = MapRun(
            self._options, self._configure, self._known, self._frames, self.once, older
        )
        self._drawn_at = -np.inf

    def _header(self, stamp: float) -> Fields:
        return self.header(stamp, self._options.map_frame)

    # --- callbacks, which return at once ---

    def _take_scan(self, message: Any) -> None:
        if self._is_paused or not self.is_active:
            return
        if self._options.odometry == "laser":
            self._hand_on(message, stamp_of(message.header, 0.0), None)
        else:
            self._sync.take(message)

    def _hand_on(self, message: Any, stamp: float, odometry: Pose2D | None) -> None:
        self.worker.put(functools.partial(self._add, message, stamp, odometry))

    # --- the worker ---

    def _add(self, message: Any, stamp: float, odometry: Pose2D | None) -> None:
        """Map one scan, and publish what is new."""
        run = self._run
        if stamp < run.stamp - CLOCK_JUMP:
            passed = run.stamp - stamp
            self.get_logger().warning(
                f"the clock jumped back by {passed:.1f} s: begun again; {self._restart()}"
            )
            run = self._run
        if stamp <= run.stamp:
            self.once(
                "order", "scans with the stamp of the last one, or an older one, are left out"
            )
            return
        dropped = self.worker.dropped + self._sync.dropped
        if dropped != self._num_dropped:
            self._num_dropped = dropped
            run.leave_out()
        try:
            self._is_new |= run.add(message, stamp, odometry)
        except BrokenMessageError as error:
            self.once("scan", str(error))
            return
        mapper = run.mapper
        assert mapper is not None, "add makes it"
        self._send_pose(mapper, stamp)
        names = self._options
        if names.odometry == "laser":
            header = self.header(stamp, names.odom_frame)
            self._transforms(transform_fields(header, names.base_frame, run.odometry))
        if self._is_new and self._known is None and stamp - self._drawn_at >= names.map_interval:
            self._is_new = False
            self._drawn_at = stamp
            self._grids(grid_fields(self._header(stamp), mapper.occupancy_grid()))

    def _send_pose(self, mapper: Mapper, stamp: float) -> None:
        """Publish the pose at a scan."""
        covariance = np.zeros((6, 6))
        planar = (0, 1, 5)  # x, y and yaw of x, y, z, roll, pitch, yaw
        covariance[np.ix_(planar, planar)] = mapper.covariance
        pose = {"pose": pose_fields(mapper.pose), "covariance": covariance.ravel()}
        self._poses({"header": self._header(stamp), "pose": pose})

    def _send_transform(self) -> None:
        run = self._run
        if run.map_from_odom is not None and self.is_active:
            # By the robot's clock, whatever this node's is.
            now = max(run.stamp, self._frames.odometry.newest)
            header = self._header(now + TRANSFORM_AHEAD)
            self._transforms(transform_fields(header, self._options.odom_frame, run.map_from_odom))

    # --- services ---

    def save(self) -> str:
        """Write map, path and log into the folder."""
        return self._run.save()

    def _keep(self) -> None:
        """Save what there is, if it can be."""
        if self._run.mapper is not None:
            try:
                self.save()
            except SlamgymError as error:
                self.once("save", f"not saved: {error}")

    def _draw(self) -> str:
        """Write the map, and begin its drawing in a process of its own."""
        saved = self.save()
        threading.Thread(target=draw_saved_map, args=(self._options.out,), daemon=True).start()
        return f"{saved}; the drawing follows in {self._options.out}"

    def _restart(self) -> str:
        """Put aside what was mapped, and begin again; returns what to say."""
        aside = self._run.put_aside()
        self._begin()
        return aside

    def _reset(self) -> str:
        self.worker.forget()  # scans from before it
        return f"begun again; {self._restart()}"

    def _pause(self, is_paused: bool) -> str:
        self._is_paused = is_paused
        self._run.leave_out()
        return "paused: the robot must stay where it is" if is_paused else "mapping"

    def _turn_pause(self) -> str:
        """Pause, or go on, as slam_toolbox's service of that name does."""
        return self._pause(not self._is_paused)

    def sleep(self) -> None:
        """Map nothing; the scans after it don't follow on those before."""
        self._run.leave_out()

    def forget(self) -> None:
        """Put aside what was mapped."""
        self.worker.order(self._reset)

    def _begin_at(self, message: Any) -> None:
        """Localise from a pose that somebody has given."""
        assert self._known is not None, "else the topic isn't listened to"
        if not self.is_on_map(message, "initialpose"):
            return
        place = self._known._replace(start=pose_of(message.pose.pose, "initialpose"))

        def begin_there() -> None:
            self._known = place
            self._reset()

        self.worker.order(begin_there)

    def _look(self) -> None:
        self.worker.order(self._diagnose, "diagnose", replaces=True)
        if time.monotonic() - self._saved_at >= SAVE_INTERVAL:
            self._saved_at = time.monotonic()
            self.worker.order(self._keep, "keep", replaces=True)

    def _diagnose(self) -> None:
        """Say how the mapper does: whether the pose is in doubt, and figures."""
        mapper = self._run.mapper
        if mapper is None:
            return
        stats = mapper.stats
        doubt = self._run.doubt
        level = DiagnosticStatus.WARN if doubt else DiagnosticStatus.OK
        text = f"in doubt: {doubt}" if doubt else "sure"
        figures = {
            "scans": stats.scans,
            "processed": stats.processed,
            "dropped": self.worker.dropped + self._sync.dropped,
            "stretches in doubt": len(stats.spans()),
            "memory [MB]": round(1e-6 * stats.memory_bytes, 1),
            **mapper.report(),
        }
        values = [KeyValue(key=key, value=str(value)) for key, value in figures.items()]
        status = DiagnosticStatus(
            level=level, name="slamgym_map: pose", message=text, values=values
        )
        self._diagnostics({"status": [status]})

    def close(self) -> None:
        """Write map, path and log."""
        with self._files:
            if self._run.mapper is not None:
                self.get_logger().info(f"saved {self.save()}")
            self._run.close()


def draw_saved_map(folder: Any) -> int:
    """Draw a folder's map as `slamgym cad` does, without the network where torch is missing; returns its exit code."""
    import importlib.util

    words = ["cad", "draw", f"{folder}/map.yaml", "-o", f"{folder}/drawing"]
    if not importlib.util.find_spec("torch"):
        words += ["--model", "none"]
    command = [sys.executable, "-P", "-m", "slamgym", *words]
    return subprocess.run(command, check=False).returncode
