"""Where the robot is, by transforms, odometry and poses as they arrive; and scans held until it is known.

Works on anything with the attributes of the messages: tf2_msgs comes with a ROS installation, not as a wheel.
"""

import bisect
import math
from collections import deque
from collections.abc import Callable
from typing import Any

from slamgym.core.geometry import between, compose, inverse
from slamgym.core.types import AT_REST, Pose2D
from slamgym.interop.records import BrokenMessageError
from slamgym.interop.ros_messages import matrix_of, pose_of, stamp_of
from slamgym.interop.transforms import TransformTree, clean_frame, planar
from slamgym.ros2.parameters import FrameNames
from slamgym.ros2.stamps import CLOCK_JUMP, StampGate, Warn

KEPT = 500
"""So many of the latest odometry poses are kept: 10 s at 50 Hz."""
OLDEST = 1.0
"""Odometry that is so much older or newer than a scan says nothing of it [s]."""
MOST_WAITING = 10
"""So many scans wait for their odometry; more are dropped, the oldest first."""
POSES_END = 5.0
"""A mapper that has given no pose, and no transform, for so long gives none any more [s]."""
MOUNT_WAIT = 2.0
"""Where there are transforms, that of the laser is waited for so long [s]: it may come after the first scan."""


class PoseHistory:
    """The latest poses of a frame, in the order of their stamps."""

    def __init__(self) -> None:
        self.stamps: deque[float] = deque(maxlen=KEPT)
        self.poses: deque[Pose2D] = deque(maxlen=KEPT)

    @property
    def newest(self) -> float:
        """The latest stamp [s]; -inf if there is none."""
        return self.stamps[-1] if self.stamps else -math.inf

    def add(self, stamp: float, pose: Pose2D) -> bool:
        """Take a pose; one out of order is left out.

        Returns:
            True if the clock has jumped back: all poses before are forgotten then.
        """
        jumped = stamp < self.newest - CLOCK_JUMP
        if jumped:
            self.stamps.clear()
            self.poses.clear()
        if stamp > self.newest:
            self.stamps.append(stamp)
            self.poses.append(pose)
        return jumped

    def at(self, stamp: float) -> Pose2D | None:
        """The pose at a moment, interpolated; None before the first and after the last, or where none is near."""
        after = bisect.bisect_left(self.stamps, stamp)
        if after == len(self.stamps):
            return self.poses[-1] if stamp - self.newest < 1e-6 else None
        later = self.stamps[after]
        if after == 0 or later == stamp:
            return self.poses[after] if later - stamp < 1e-6 else None
        earlier = self.stamps[after - 1]
        if later - earlier > OLDEST:
            return None
        share = (stamp - earlier) / (later - earlier)
        before = self.poses[after - 1]
        moved = between(before, self.poses[after])
        part = Pose2D(share * moved.x, share * moved.y, share * moved.theta)
        return compose(before, part)

    def motion(self, stamp: float, seconds: float) -> Pose2D:
        """The motion from a moment on for some time; where that isn't known yet, the last one known of that length."""
        for begin in (stamp, self.newest - seconds):
            first = self.at(begin)
            last = self.at(begin + seconds)
            if first is not None and last is not None:
                return between(first, last)
        return AT_REST


class RobotFrames:
    """The robot in the odometry frame and on the map.

    The transform ``odom`` to ``base`` of /tf is taken, or /odom as long as /tf has none; for ``map`` to ``odom`` that
    of /tf, or a pose on the map together with the odometry at its moment.

    Args:
        names: Of the frames.
        warn: Told what is wrong.
    """

    def __init__(self, names: FrameNames, warn: Warn) -> None:
        self._names = names
        self._warn = warn
        self._gate: StampGate[Pose2D] = StampGate("odometry", warn)
        self._tree = TransformTree(keeps_history=False)
        self.has_tf = False  # it gives the odometry
        self.odometry = PoseHistory()
        self.map_from_odom: Pose2D | None = None
        self.pose_stamp = -math.inf  # of the latest pose on the map [s]
        self.map_stamp = (
            -math.inf
        )  # of the newest odometry when the map's place was last heard of [s]

    def take_odometry(self, message: Any) -> None:
        """Take an Odometry message.

        Raises:
            BrokenMessageError: If its quaternion is zero.
            ValueError: If a value is no number.
        """
        if not self.has_tf:
            self._move(message, pose_of(message.pose.pose, "odometry"))

    def _move(self, message: Any, pose: Pose2D) -> None:
        """Take a pose by odometry; on a clock that has jumped back the map's place isn't known any more."""
        usable = self._gate.take(stamp_of(message.header, 0.0), pose)
        jumps = [self.odometry.add(one.stamp, one.item) for one in usable]
        if any(jumps) and self.map_stamp < math.inf:
            self.map_from_odom = None
            self.pose_stamp = -math.inf
            self.map_stamp = -math.inf

    def take_transforms(self, message: Any, *, static: bool) -> bool:
        """Take a TFMessage; a transform with broken numbers is left out.

        Returns:
            True if it had odometry.
        """
        names = self._names
        moved = False
        for entry in message.transforms:
            parent = clean_frame(entry.header.frame_id)
            child = clean_frame(entry.child_frame_id)
            transform = entry.transform
            try:
                matrix = matrix_of(transform.translation, transform.rotation, "transform")
            except (BrokenMessageError, ValueError):
                continue
            self._tree.add(parent, child, 0.0, matrix, static=static)
            if parent == names.odom_frame:
                if not self.has_tf:
                    self.odometry = PoseHistory()
                    self._gate = StampGate("odometry", self._warn)
                    self.has_tf = True
                self._move(entry, planar(matrix))
                moved = True
            elif (parent, child) == (names.map_frame, names.odom_frame):
                self.map_from_odom = planar(matrix)
                self.map_stamp = math.inf if static else self.odometry.newest
        return moved

    def take_pose(self, message: Any) -> None:
        """Take a PoseWithCovarianceStamped on the map; raises as :meth:`take_odometry`."""
        stamp = stamp_of(message.header, 0.0)
        pose = pose_of(message.pose.pose, "pose")
        odometry = self.odometry.at(stamp)
        if odometry is not None:
            self.map_from_odom = compose(pose, inverse(odometry))
            self.pose_stamp = stamp
            self.map_stamp = max(self.map_stamp, self.odometry.newest)

    def on_map(self, odometry: Pose2D) -> Pose2D | None:
        """A pose of the odometry frame on the map; None until the map's place is known."""
        return None if self.map_from_odom is None else compose(self.map_from_odom, odometry)

    def mount(self, laser_frame: str) -> tuple[Pose2D, bool] | None:
        """The laser on the robot, and true if it hangs upside down; None where no transform says it."""
        matrix = self._tree.lookup(laser_frame, self._names.base_frame)
        if matrix is None:
            return None
        hangs = bool(matrix[2, 2] < 0.0)
        return planar(matrix), hangs


class ScanSync:
    """Hands on each scan with the odometry at its moment, as soon as that has come.

    Args:
        frames: Receives the odometry.
        deliver: Called with the message, its stamp [s] and the odometry pose.
        warn: Told what is wrong.
    """

    def __init__(
        self, frames: RobotFrames, deliver: Callable[[Any, float, Pose2D], None], warn: Warn
    ) -> None:
        self._frames = frames
        self._deliver = deliver
        self._warn = warn
        self._waiting: deque[tuple[float, Any]] = deque()
        self._first = math.inf  # [s]
        self.dropped = 0

    def take(self, message: Any) -> None:
        """Take a LaserScan."""
        stamp = stamp_of(message.header, 0.0)
        if self._waiting and stamp < self._waiting[-1][0] - CLOCK_JUMP:
            self._waiting.clear()
        self._waiting.append((stamp, message))
        if len(self._waiting) > MOST_WAITING:
            self._drop()
        self.flush()

    def _drop(self) -> None:
        """Leave out the first scan; that some come before the first odometry is no fault."""
        stamp, _ = self._waiting.popleft()
        self.dropped += 1
        stamps = self._frames.odometry.stamps
        if stamps and not stamps[0] - OLDEST < stamp < stamps[-1] + OLDEST:
            self._warn(
                "stamps",
                f"scans are left out: one is of {stamp:.1f} s, but the odometry of {stamps[0]:.1f} to "
                f"{stamps[-1]:.1f} s; let both drivers stamp by one clock",
            )

    def _is_placed(self, stamp: float, laser_frame: str) -> bool:
        """True if transforms say where the laser is, or aren't waited for."""
        self._first = min(self._first, stamp)
        is_early = self._frames.has_tf and stamp - self._first < MOUNT_WAIT
        return not is_early or self._frames.mount(laser_frame) is not None

    def flush(self) -> None:
        """Hand on what can be; to be called when odometry has come."""
        while self._waiting:
            stamp, message = self._waiting[0]
            odometry = self._frames.odometry.at(stamp)
            laser_frame = clean_frame(message.header.frame_id)
            if odometry is not None and self._is_placed(stamp, laser_frame):
                self._waiting.popleft()
                self._deliver(message, stamp, odometry)
            elif stamp > self._frames.odometry.newest:
                return
            else:
                self._drop()
