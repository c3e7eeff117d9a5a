"""Decides which scans are processed: GMapping's update thresholds."""

import math

import numpy as np

from slamgym.core.geometry import between
from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.config import SlamConfig


class OdometryGate:
    """Collects the motion between scans until one is due.

    Distance and turn add up along the way, as in GMapping: there and back again is motion too.
    """

    def __init__(self, config: SlamConfig) -> None:
        self._linear = config.linear_update
        self._angular = config.angular_update
        self._temporal = math.inf if config.temporal_update is None else config.temporal_update
        self._last: Pose2D | None = None
        self._last_processed = Pose2D(0.0, 0.0, 0.0)
        self._last_stamp = 0.0
        self._distance = 0.0
        self._turn = 0.0
        self._increments: list[Pose2D] = []

    @property
    def since_processed(self) -> Pose2D:
        """Motion since the last processed scan, in the robot frame of that time."""
        return Pose2D(0.0, 0.0, 0.0) if self._last is None else between(self._last_processed, self._last)

    def is_due(self, odometry: Pose2D, stamp: float) -> bool:
        """Take the odometry pose of a scan; True if the scan must be processed. The first one must."""
        if self._last is None:
            self._last = self._last_processed = odometry
            return True
        increment = between(self._last, odometry)
        self._increments.append(increment)
        self._last = odometry
        self._distance += math.hypot(increment.x, increment.y)
        self._turn += abs(increment.theta)
        return (
            self._distance >= self._linear
            or self._turn >= self._angular
            or stamp - self._last_stamp > self._temporal
        )

    def take(self, stamp: float) -> FloatArray:
        """Begin anew from here; returns the increments (scans, 3) since the last processed scan."""
        increments = np.array(self._increments, dtype=np.float64).reshape(-1, 3)
        if self._last is not None:
            self._last_processed = self._last
        self._last_stamp = stamp
        self._distance = self._turn = 0.0
        self._increments.clear()
        return increments
