"""What an episode leaves behind: a log, one entry for each scan."""

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
        self._stamps = np.empty(_FIRST_CAPACITY)
        # True world-frame pose, odometry pose, estimated map-frame pose.
        self._poses = np.empty((_FIRST_CAPACITY, 3, 3))
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
        if self._size == len(self._stamps):
            self._grow()
        i = self._size
        self._stamps[i] = scan.stamp
        self._poses[i, 0] = true_pose
        self._poses[i, 1] = odometry
        self._poses[i, 2] = estimate
        self._ranges[i] = scan.ranges
        self._size += 1

    @property
    def stamps(self) -> FloatArray:
        """Times since the start of the episode, shape (N,) [s]."""
        return _so_far(self._stamps, self._size)

    @property
    def true_poses(self) -> FloatArray:
        """True poses in the world frame, shape (N, 3) [m, m, rad]."""
        return _so_far(self._poses, self._size)[:, 0]

    @property
    def odometry(self) -> FloatArray:
        """Poses by wheel odometry alone, shape (N, 3) [m, m, rad]; they begin in the map frame."""
        return _so_far(self._poses, self._size)[:, 1]

    @property
    def estimates(self) -> FloatArray:
        """What SLAM believed at the time, shape (N, 3) [m, m, rad], map frame.

        It is what the observations said: later corrections of the path, which ``mapper.trajectory()`` has,
        are not in it.
        """
        return _so_far(self._poses, self._size)[:, 2]

    @property
    def ranges(self) -> Float32Array:
        """Measured ranges as REP 117 has them, shape (N, num_beams) [m]."""
        return _so_far(self._ranges, self._size)

    def true_trajectory(self, start: Pose2D) -> Trajectory:
        """The true path in the map frame.

        Convention: ``start`` is the pose in the world at which the episode began; its position is the origin
        of the map frame, whose axes are the world's.
        """
        return Trajectory(self.stamps.copy(), self.true_poses - np.array([start.x, start.y, 0.0]))

    def _grow(self) -> None:
        for name in ("_stamps", "_poses", "_ranges"):
            old = getattr(self, name)
            new = np.empty((2 * len(old), *old.shape[1:]), dtype=old.dtype)
            new[: len(old)] = old
            setattr(self, name, new)


def _so_far(array: _Array, size: int) -> _Array:
    view: _Array = array[:size]  # type: ignore[assignment]
    view.flags.writeable = False
    return view
