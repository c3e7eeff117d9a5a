"""Mapping with known poses: dead reckoning, and ground truth for a caller who knows it."""

import time

import numpy as np

from slamgym.core.geometry import compose
from slamgym.core.types import (
    ByteArray,
    FloatArray,
    GridFrame,
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Trajectory,
)
from slamgym.slam.config import SlamConfig
from slamgym.slam.hit_counts import BeamTable, HitCountMap
from slamgym.slam.mapper import SlamStats
from slamgym.slam.motion_model import OdometryGate


class PoseTracker:
    """A mapper that believes the odometry it is given; see :class:`slamgym.slam.mapper.Mapper`.

    Every processed scan is drawn into the map at once.
    """

    def __init__(
        self, config: SlamConfig, geometry: LaserGeometry, initial_pose: Pose2D, rng: np.random.Generator
    ) -> None:
        del rng  # nothing is random here
        self._gate = OdometryGate(config)
        self._map = HitCountMap(
            BeamTable(geometry, config), config.resolution, config.occupied_threshold, config.memory_limit_mb
        )
        self._last_pose = initial_pose
        self._path: list[tuple[float, Pose2D]] = []
        self._grid: OccupancyGrid | None = None
        self.n_eff = 1.0
        self.covariance: FloatArray = np.zeros((3, 3))
        self._stats = SlamStats()

    @property
    def pose(self) -> Pose2D:
        """See :class:`slamgym.slam.mapper.Mapper`."""
        return compose(self._last_pose, self._gate.since_processed)

    @property
    def stats(self) -> SlamStats:
        """See :class:`slamgym.slam.mapper.Mapper`."""
        self._stats.memory_bytes = self._map.num_bytes + 32 * len(self._path)
        return self._stats

    def update(self, odometry: Pose2D, scan: LaserScan) -> bool:
        """See :class:`slamgym.slam.mapper.Mapper`."""
        self._stats.scans += 1
        if not self._gate.is_due(odometry, scan.stamp):
            return False
        begin = time.process_time()
        self._last_pose = self.pose
        self._gate.take(scan.stamp)
        self._map.draw(np.array([self._last_pose]), scan.ranges[np.newaxis])
        self._path.append((scan.stamp, self._last_pose))
        self._grid = None
        self._stats.processed += 1
        self._stats.cpu_seconds += time.process_time() - begin
        return True

    def occupancy_grid(self) -> OccupancyGrid:
        """See :class:`slamgym.slam.mapper.Mapper`."""
        if self._grid is None:
            self._grid = self._map.occupancy_grid()
        return self._grid

    def render(self, frame: GridFrame) -> ByteArray:
        """See :class:`slamgym.slam.mapper.Mapper`."""
        return self._map.render(frame)

    def trajectory(self) -> Trajectory:
        """See :class:`slamgym.slam.mapper.Mapper`."""
        poses = np.array([pose for _, pose in self._path], dtype=np.float64).reshape(-1, 3)
        return Trajectory(np.array([stamp for stamp, _ in self._path], dtype=np.float64), poses)
