"""The log of an episode: one entry for each scan."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from slamgym.core.types import Float32Array, FloatArray, LaserScan, Pose2D, Trajectory

_FIRST_CAPACITY = 512

_Array = TypeVar("_Array", bound=NDArray[np.generic])


class EpisodeLog:
    """Truth, odometry, estimate and ranges over time, in arrays that grow by doubling.

    The first entry is the scan of the robot at rest at its start. The arrays handed out are read-only views
    of what is recorded so far.

    Args:
        num_beams: Beams of a scan.
    """

    def __init__(self, num_beams: int) -> None:
        self._size = 0
        # Stamp, true world-frame pose, odometry pose, estimated map-frame pose.
        self._rows = np.empty((_FIRST_CAPACITY, 10))
        self._ranges = np.empty((_FIRST_CAPACITY, num_beams), dtype=np.float32)

    def __len__(self) -> int:
        return self._size

    def append(self, scan: LaserScan, true_pose: Pose2D, odometry: Pose2D, estimate: Pose2D) -> None:
        """Add the state at the time of a scan.

        Args:
            scan: What the scanner measured.
            true_pose: World frame.
            odometry: As the wheels' encoders have it; starts in the map frame and drifts off.
            estimate: What SLAM believed then, map frame.
        """
        i = self._size
        if i == len(self._rows):
            self._rows, self._ranges = (
                np.concatenate([table, np.empty_like(table)]) for table in (self._rows, self._ranges)
            )
        self._rows[i] = (scan.stamp, *true_pose, *odometry, *estimate)
        self._ranges[i] = scan.ranges
        self._size += 1

    @property
    def stamps(self) -> FloatArray:
        """Times since the start of the episode, shape (N,) [s]."""
        return _read_only(self._rows[: self._size, 0])

    @property
    def true_poses(self) -> FloatArray:
        """True poses in the world frame, shape (N, 3) [m, m, rad]."""
        return _read_only(self._rows[: self._size, 1:4])

    @property
    def odometry(self) -> FloatArray:
        """Poses by wheel odometry alone, shape (N, 3) [m, m, rad]; they begin in the map frame."""
        return _read_only(self._rows[: self._size, 4:7])

    @property
    def estimates(self) -> FloatArray:
        """What SLAM believed at the time, shape (N, 3) [m, m, rad], map frame.

        It is what the observations said: later corrections of the path, which ``mapper.trajectory()`` has,
        are not in it.
        """
        return _read_only(self._rows[: self._size, 7:])

    @property
    def ranges(self) -> Float32Array:
        """Measured ranges as REP 117 has them, shape (N, num_beams) [m]."""
        return _read_only(self._ranges[: self._size])

    def true_trajectory(self, start: Pose2D) -> Trajectory:
        """The true path in the map frame.

        Convention: ``start`` is the pose in the world at which the episode began; its position is the origin
        of the map frame, whose axes are the world's.
        """
        return Trajectory(self.stamps.copy(), self.true_poses - np.array([start.x, start.y, 0.0]))


def _read_only(view: _Array) -> _Array:
    view.flags.writeable = False
    return view
