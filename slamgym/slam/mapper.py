"""What a SLAM mode offers, whatever its method, and what the modes share."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

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
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import HitCountMap
from slamgym.slam.motion_model import OdometryGate


@dataclass
class SlamStats:
    """What the mapper did so far."""

    scans: int = 0
    """Scans received."""

    processed: int = 0
    """Scans processed."""

    refused_matches: int = 0
    """Particle matches below the minimum score, where odometry stood."""

    recovered_matches: int = 0
    """Scans that fitted poorly where odometry led, and were found by a wider search."""

    doubtful: list[float] = field(default_factory=list)
    """Times of the scans that fitted poorly whatever was tried [s]: the path may be wrong there."""

    last_stamp: float = -math.inf
    """Time of the last processed scan [s]."""

    resamplings: int = 0
    """How often the particles were resampled."""

    cpu_seconds: float = 0.0
    """CPU time of all updates, without the drawing of maps on request [s]."""

    memory_bytes: int = 0
    """Memory of maps, trajectories and stored scans."""

    n_eff: list[float] = field(default_factory=list)
    """N_eff at each processed scan, before resampling."""

    particles: list[int] = field(default_factory=list)
    """Number of particles at each of those scans."""

    @property
    def is_doubtful(self) -> bool:
        """Whether the last processed scan is in doubt, and with it the pose."""
        return bool(self.doubtful) and self.doubtful[-1] == self.last_stamp

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

    def know(self, grid: OccupancyGrid) -> None:
        """Begin with an older map, before the first scan; its cells lie on the lattice of this one."""
        ...

    def finish(self) -> None:
        """Improve map and path once the log is complete; to be called after the last scan."""
        ...

    def report(self) -> Mapping[str, Any]:
        """What this mode adds to a summary, e.g. its loop closures."""
        ...

    def particle_paths(self, most: int) -> list[FloatArray]:
        """Paths of at most so many hypotheses, each (processed scans, 3); empty if there is one path only."""
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

    def lattice(self) -> tuple[ByteArray, tuple[int, int]]:
        """The map on its own lattice: values of cells, row 0 at the bottom, and the row and column they begin at.

        They are not copied: later calls may change them.
        """
        ...

    def trajectory(self) -> Trajectory:
        """The path: poses at the processed scans, corrected by what was learned since."""
        ...


class GatedMapper(ABC):
    """What the modes share: which scans are processed, counters, and a map drawn when it is asked for.

    See :class:`Mapper` for the methods.

    Args:
        config: Settings of the map.
        geometry: The scanner.
        gate: Settings of the update thresholds, if they are not those of ``config``.
    """

    def __init__(self, config: SlamConfig, geometry: LaserGeometry, gate: SlamConfig | None = None) -> None:
        self._config = config
        self._beams = BeamTable.of(geometry, config)
        self._gate = OdometryGate(gate or config)
        self._map = HitCountMap(self._beams, config)
        self._grid: OccupancyGrid | None = None
        self._stats = SlamStats()
        self._known: OccupancyGrid | None = None

    @property
    def covariance(self) -> FloatArray:
        """Not known."""
        return np.zeros((3, 3))

    @property
    def n_eff(self) -> float:
        """Of one path."""
        return 1.0

    @property
    def stats(self) -> SlamStats:
        """Counters."""
        self._stats.memory_bytes = self._map.num_bytes + self._num_bytes()
        return self._stats

    def update(self, odometry: Pose2D, scan: LaserScan) -> bool:
        """Take a scan; returns whether it was processed."""
        self._stats.scans += 1
        if not self._gate.is_due(odometry, scan.stamp):
            return False  # and no look at the clock: it would cost more than the gate
        begin = time.process_time()
        self._process(scan)
        self._grid = None
        self._stats.processed += 1
        self._stats.last_stamp = scan.stamp
        self._stats.cpu_seconds += time.process_time() - begin
        return True

    def know(self, grid: OccupancyGrid) -> None:
        """Begin with an older map."""
        self._known, self._grid = grid, None
        self._new_map()

    def _new_map(self) -> None:
        """Begin drawing anew, on what was known before."""
        self._map = HitCountMap(self._beams, self._config)
        if self._known is not None:
            self._map.add_known(self._known)

    def finish(self) -> None:  # noqa: B027 - most modes have nothing to do
        """Nothing is left to do."""

    def report(self) -> Mapping[str, Any]:
        """Nothing is added."""
        return {}

    def particle_paths(self, most: int) -> list[FloatArray]:
        """There is one path only."""
        del most
        return []

    def occupancy_grid(self) -> OccupancyGrid:
        """The map, cropped to what is known."""
        if self._grid is None:
            self._draw_path()
            self._grid = self._map.occupancy_grid()
        return self._grid

    def render(self, frame: GridFrame) -> ByteArray:
        """The map on another grid."""
        self._draw_path()
        return self._map.render(frame)

    def lattice(self) -> tuple[ByteArray, tuple[int, int]]:
        """The map on its own lattice."""
        self._draw_path()
        return self._map.classified(), self._map.corner

    @abstractmethod
    def _process(self, scan: LaserScan) -> None:
        """Take a scan that is due."""

    @abstractmethod
    def _draw_path(self) -> None:
        """Bring the map up to date with the path."""

    @abstractmethod
    def _num_bytes(self) -> int:
        """Memory beside the map."""
