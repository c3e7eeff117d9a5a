"""What a SLAM mode offers, whatever its method."""

from dataclasses import dataclass, field
from typing import Protocol

from slamgym.core.types import (
    ByteArray,
    FloatArray,
    GridFrame,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Trajectory,
)


@dataclass
class SlamStats:
    """What the mapper did so far."""

    scans: int = 0
    """Scans received."""

    processed: int = 0
    """Scans processed."""

    refused_matches: int = 0
    """Particle matches below the minimum score, where odometry stood."""

    resamplings: int = 0
    """How often the particles were resampled."""

    cpu_seconds: float = 0.0
    """CPU time of all updates, without the drawing of maps on request [s]."""

    memory_bytes: int = 0
    """Memory of maps, trajectories and stored scans."""

    n_eff: list[float] = field(default_factory=list)
    """N_eff at each processed scan, before resampling."""

    @property
    def cpu_ms_per_processed_scan(self) -> float:
        """CPU time per processed scan [ms]."""
        return 1e3 * self.cpu_seconds / max(self.processed, 1)


class Mapper(Protocol):
    """A SLAM method that is fed scan by scan.

    Poses and maps are in the ``map`` frame (see :mod:`slamgym.core.types`), in which the robot starts at the
    initial pose. Odometry may be in any frame: only its increments count.
    """

    @property
    def pose(self) -> Pose2D:
        """The estimate at the last scan: best pose at the last processed scan plus odometry since."""
        ...

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) of x, y [m] and theta [rad] at the last processed scan; zero if not known."""
        ...

    @property
    def n_eff(self) -> float:
        """Effective sample size at the last processed scan, before resampling."""
        ...

    @property
    def stats(self) -> SlamStats:
        """Counters."""
        ...

    def update(self, odometry: Pose2D, scan: LaserScan) -> bool:
        """Take a scan and the odometry pose at its time; to be called for every scan.

        Returns:
            Whether the scan was processed, i.e. was past the update thresholds.
        """
        ...

    def occupancy_grid(self) -> OccupancyGrid:
        """The map, cropped to what is known. The same object comes back until another scan is processed."""
        ...

    def render(self, frame: GridFrame) -> ByteArray:
        """The map on another grid.

        Args:
            frame: Any axis-parallel grid of the map frame. On the map's own lattice the cells are copied; on
                a coarser one, or one that is offset, occupied wins over free and free over unknown among the
                cells that overlap.

        Returns:
            Values as ROS map_server, shape ``frame.shape``, row 0 at the top.
        """
        ...

    def trajectory(self) -> Trajectory:
        """The path: poses at the processed scans, corrected by what was learned since."""
        ...
