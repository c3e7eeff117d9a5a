"""LaserScan messages as scans of one geometry, whatever the driver sends."""

import math
from typing import Any

import numpy as np

from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.interop.ranges import range_limit
from slamgym.interop.records import BrokenMessageError, LogFinding
from slamgym.interop.ros_messages import check_scan, geometry_of, ranges_of
from slamgym.interop.scan_times import believed_scan_time
from slamgym.interop.transforms import clean_frame
from slamgym.ros2.frames import RobotFrames
from slamgym.ros2.parameters import FrameNames
from slamgym.ros2.stamps import Warn
from slamgym.slam.laser_check import Repetition

OTHER_BEAMS = 0.1
"""A rotating scanner's number of beams varies by less than this share."""


class LaserReader:
    """Reads scans; all have the geometry of the first.

    Args:
        frames: Say where the laser is on the robot.
        names: The laser's mount where they don't, and how long a scan takes if the messages are wrong about it.
        warn: Told what is wrong.

    Attributes:
        geometry: None before the first scan.
    """

    def __init__(self, frames: RobotFrames, names: FrameNames, warn: Warn) -> None:
        self._frames = frames
        self._names = names
        self._warn = warn
        self.geometry: LaserGeometry | None = None
        self._flipped = False
        self._repetition = Repetition()

    def read(self, message: Any, stamp: float, odometry: Pose2D | None) -> LaserScan:
        """The scan of a message, with the robot's motion until its last beam if it takes its time.

        Args:
            message: A LaserScan.
            stamp: Its time [s].
            odometry: The robot's pose by the odometry then, if there is any.

        Raises:
            BrokenMessageError: If no laser sends such a message, or it sends the same one again while the robot moves.
        """
        check_scan(message)
        if self.geometry is None:
            self.geometry = self._first(message)
        beams = len(message.ranges)
        usual = self.geometry.num_beams
        if abs(beams - usual) > OTHER_BEAMS * usual:
            self._warn(
                "beams",
                f"a scan has {beams} beams where the first had {usual}: what the first didn't see is left out; "
                "call the service reset if the laser was changed",
            )
        ranges = ranges_of(message, self.geometry, self._flipped)
        if odometry is not None and self._repetition.is_stuck(stamp, ranges, odometry):
            raise BrokenMessageError(
                "the laser repeats one reading while the robot moves: such scans are left out; restart its driver"
            )
        scan_time = self.geometry.scan_time
        if odometry is None or scan_time == 0.0:
            return LaserScan(stamp, ranges, self.geometry)
        motion = self._frames.odometry.motion(stamp, scan_time)
        return LaserScan(stamp, ranges, self.geometry, motion)

    def _first(self, message: Any) -> LaserGeometry:
        frame = clean_frame(message.header.frame_id)
        found = self._frames.mount(frame)
        if found is None:
            self._warn(
                "mount",
                f"no transform leads from the laser's frame {frame!r} to the robot's (parameter base_frame): "
                f"laser_mount is taken, {self._names.laser_mount}",
            )
        mount, self._flipped = found or (self._names.mount, False)
        ranges = np.array(message.ranges, np.float32)
        limit, findings = range_limit([ranges], float(message.range_max), None)
        seconds = self._names.scan_time
        faults: tuple[LogFinding, ...] = ()
        if seconds < 0.0:
            gap = float(message.scan_time) or math.nan
            seconds, faults = believed_scan_time([message.time_increment], len(ranges), gap)
        for finding in (*findings, *faults):
            self._warn(finding.kind, finding.sentence)
        return geometry_of(message, mount, self._flipped, limit).taking(seconds)
