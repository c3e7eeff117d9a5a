"""The scans of the last metres put together by odometry: a view that fewer places share than a single scan."""

import numpy as np

from slamgym.core.geometry import between, compose, transform_points
from slamgym.core.types import FloatArray, Pose2D

THINNING_CELL = 0.1
"""Of the points of all scans one is kept in each such cell [m]."""
MOST_SCANS = 60


class RecentScans:
    """A short memory of scans, each with its pose by odometry."""

    def __init__(self, metres: float) -> None:
        self._metres = metres
        self.restart()

    def restart(self) -> None:
        """Forget all scans: what they showed is not round the robot any more."""
        self._pose = Pose2D(0.0, 0.0, 0.0)
        self._driven = 0.0
        self._scans: list[tuple[float, Pose2D, FloatArray]] = []

    def restart_with_last(self) -> None:
        """Forget all scans but the last."""
        self._scans = self._scans[-1:]

    def append(self, motion: Pose2D, driven: float, points: FloatArray) -> None:
        """Take a scan.

        Args:
            motion: Motion since the one before, in the robot frame of that.
            driven: Its length [m], turns included.
            points: (n, 2) end points in the robot frame [m]; copied.
        """
        self._pose = compose(self._pose, motion)
        self._driven += driven
        self._scans.append((self._driven, self._pose, points.copy()))
        while len(self._scans) > MOST_SCANS or self._driven - self._scans[0][0] > self._metres:
            del self._scans[0]

    def __len__(self) -> int:
        return len(self._scans)

    def points(self) -> FloatArray:
        """All end points in the robot's present frame, thinned, (n, 2) [m]."""
        moved = [transform_points(between(self._pose, pose), points) for _, pose, points in self._scans]
        together = np.concatenate(moved) if moved else np.zeros((0, 2))
        cells = np.floor(together / THINNING_CELL).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        thinned: FloatArray = together[np.sort(first)]
        return thinned
