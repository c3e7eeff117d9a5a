"""Mapping with known poses: dead reckoning, and ground truth for a caller who knows it."""

import numpy as np

from slamgym.core.geometry import compose
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.slam.config import SlamConfig
from slamgym.slam.mapper import GatedMapper


class PoseTracker(GatedMapper):
    """A mapper that believes the odometry it is given; see :class:`slamgym.slam.mapper.Mapper`.

    Every processed scan is drawn into the map at once.
    """

    def __init__(
        self, config: SlamConfig, geometry: LaserGeometry, initial_pose: Pose2D, rng: np.random.Generator
    ) -> None:
        del rng  # nothing is random here
        super().__init__(config, geometry)
        self._last_pose = initial_pose
        self._path: list[tuple[float, Pose2D]] = []

    @property
    def pose(self) -> Pose2D:
        """The pose at the last scan, as it was given."""
        return compose(self._last_pose, self._gate.since_processed)

    def trajectory(self) -> Trajectory:
        """The poses at the processed scans, as they were given."""
        poses = np.array([pose for _, pose in self._path], dtype=np.float64).reshape(-1, 3)
        return Trajectory(np.array([stamp for stamp, _ in self._path], dtype=np.float64), poses)

    def _process(self, scan: LaserScan) -> None:
        self._last_pose = self.pose
        self._gate.take(scan.stamp)
        self._map.draw(np.array([self._last_pose]), scan.ranges[np.newaxis])
        self._path.append((scan.stamp, self._last_pose))

    def _draw_path(self) -> None:
        """Nothing is left to draw."""

    def _num_bytes(self) -> int:
        return 32 * len(self._path)
