"""The interface of all SLAM modes with what they share, and mapping with known poses."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

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
from slamgym.slam.columns import Columns
from slamgym.slam.config import SlamConfig
from slamgym.slam.deskew import deskewed
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import HitCountMap
from slamgym.slam.motion_model import OdometryGate, update_thresholds


class DoubtSpan(NamedTuple):
    """A stretch of time in which the path may be wrong."""

    begin: float  # [s]
    end: float  # [s]
    kind: str  # "doubtful", or "broken" where the map contradicts itself


@dataclass
class SlamStats:
    """Statistics of the mapper so far."""

    scans: int = 0
    """Scans received."""

    processed: int = 0
    """Scans processed."""

    refused_matches: int = 0
    """Particle matches below the minimum score, where odometry stood."""

    recovered_matches: int = 0
    """Scans that fitted poorly where odometry led, and were found by a wider search."""

    doubtful: list[float] = field(default_factory=list)
    """Times of the scans that are in doubt [s]: the path may be wrong there."""

    broken: list[float] = field(default_factory=list)
    """Those among them at which the map contradicts itself [s]."""

    doubted: Sequence[tuple[float, float]] = ()
    """Stretches of time over which the scans are wrong or missing, by checks of the log [s]."""

    last_stamp: float = -math.inf
    """Time of the last processed scan [s]."""

    resamplings: int = 0
    """Number of times that the particles were resampled."""

    cpu_seconds: float = 0.0
    """CPU time of all updates, without the drawing of maps on request [s]."""

    memory_bytes: int = 0
    """Memory of maps, trajectories and stored scans."""

    n_eff: list[float] = field(default_factory=list)
    """N_eff at each processed scan, before resampling."""

    @property
    def is_doubtful(self) -> bool:
        """True if the last processed scan is in doubt, and with it the pose."""
        return bool(self.doubtful) and self.doubtful[-1] == self.last_stamp

    def spans(self, gap: float = 5.0) -> list[DoubtSpan]:
        """What is doubtful or broken as stretches, in which scans in doubt follow each other within a gap [s]."""
        broken = set(self.broken)
        ends = [*self.doubted, *((stamp, stamp) for stamp in self.doubtful)]
        parts = [
            DoubtSpan(begin, end, "broken" if begin == end in broken else "doubtful")
            for begin, end in ends
        ]
        spans: list[DoubtSpan] = []
        for part in sorted(parts):
            last = spans[-1] if spans else None
            if last is not None and last.kind == part.kind and part.begin - last.end < gap:
                spans[-1] = last._replace(end=max(last.end, part.end))
            else:
                spans.append(part)
        return spans

    @property
    def cpu_ms_per_processed_scan(self) -> float:
        """CPU time per processed scan [ms]."""
        return 1e3 * self.cpu_seconds / max(self.processed, 1)


class Mapper(ABC):
    """A SLAM method that is fed scan by scan: which scans are processed, counters, and a map drawn when asked for.

    Poses and maps are in the ``map`` frame (see :mod:`slamgym.core.types`), in which the robot starts at the
    initial pose. Odometry may be in any frame: only its increments count.

    Args:
        config: Settings of the map.
        geometry: The scanner.
        initial_pose: Where the robot starts in the map frame.
        rng: Source of all randomness, of which only ``rbpf`` has any.
        thresholds: Distance [m], turn [rad] and time [s] after which a scan is processed; by default the settings'.
    """

    _clock = staticmethod(time.process_time)

    def __init__(
        self,
        config: SlamConfig,
        geometry: LaserGeometry,
        initial_pose: Pose2D,
        rng: np.random.Generator,
        thresholds: tuple[float, float, float] | None = None,
    ) -> None:
        self._config = config
        self._rng = rng
        self._last_pose = initial_pose  # at the last processed scan
        self._beams = BeamTable.of(geometry, config)
        self._gate = OdometryGate(thresholds or update_thresholds(config))
        self._map = HitCountMap(self._beams, config)
        self._grid: OccupancyGrid | None = None
        self._stats = SlamStats()
        self._path = Columns(stamps=(), poses=(3,))

    @property
    def pose(self) -> Pose2D:
        """The estimate at the last scan's stamp: best pose at the last processed scan plus odometry since."""
        return compose(self._last_pose, self._gate.since_processed)

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) of x, y [m] and theta [rad] at the last processed scan; zero if not known."""
        return np.zeros((3, 3))

    @property
    def stats(self) -> SlamStats:
        """Counters."""
        return self._stats

    def update(self, odometry: Pose2D, scan: LaserScan) -> bool:
        """Take a scan and the odometry pose at its stamp; to be called for every scan.

        One that took its time is processed as if it had been taken at once.

        Returns:
            True if the scan was processed, i.e. was past the update thresholds.
        """
        self._stats.scans += 1
        if not self._gate.must_process(odometry, scan.stamp):
            return False  # and no look at the clock: it would cost more than the gate
        begin = self._clock()
        self._process(deskewed(scan, self._sweep_motion(scan)))
        self._grid = None
        self._stats.processed += 1
        self._stats.memory_bytes = self._map.num_bytes + self._num_bytes()
        self._stats.last_stamp = scan.stamp
        self._stats.cpu_seconds += self._clock() - begin
        return True

    def finish(self) -> None:  # noqa: B027 - most modes have nothing to do
        """Improve map and path once the log is complete; to be called after the last scan."""

    def graph(self) -> MapGraph | None:
        """What was measured, with the scans; None in a mode without a graph."""
        return None

    def report(self) -> Mapping[str, Any]:
        """Entries that this mode adds to a summary, e.g. its loop closures."""
        return {}

    def particle_paths(self, most: int) -> list[FloatArray]:
        """Paths of at most ``most`` hypotheses, each (processed scans, 3); empty if there is one path only."""
        del most
        return []

    def occupancy_grid(self) -> OccupancyGrid:
        """The map, cropped to what is known. The same object comes back until another scan is processed."""
        if self._grid is None:
            self._draw_path()
            self._grid = self._map.occupancy_grid()
        return self._grid

    def render(self, frame: GridFrame) -> ByteArray:
        """The map on another grid.

        Args:
            frame: Any axis-parallel grid of the map frame. On the map's own lattice the cells are copied; on
                a coarser one, or one that is offset, occupied wins over free and free over unknown among the
                cells that overlap.

        Returns:
            Values as ROS map_server, shape ``frame.shape``, row 0 at the top.
        """
        self._draw_path()
        return self._map.render(frame)

    def lattice(self) -> tuple[ByteArray, tuple[int, int]]:
        """The map on its own lattice: values of cells, row 0 at the bottom, and the row and column they begin at.

        They are not copied: later calls may change them.
        """
        self._draw_path()
        return self._map.classified(), self._map.corner

    def trajectory(self) -> Trajectory:
        """The path: poses at the processed scans, corrected by what was learned since."""
        return Trajectory(self._path["stamps"].copy(), self._path["poses"].copy())

    def _sweep_motion(self, scan: LaserScan) -> Pose2D:
        """How far the robot moved from a scan's first beam to its last, seen from where it was at the first."""
        return scan.motion

    @abstractmethod
    def _process(self, scan: LaserScan) -> None:
        """Take a scan that is due, as a laser would have taken it at once at its stamp, and find the pose there."""

    def _draw_path(self) -> None:  # noqa: B027 - where scans are drawn at once
        """Bring the map up to date with the path."""

    def _num_bytes(self) -> int:
        """Memory without the map's."""
        return self._path.num_bytes


class PoseTracker(Mapper):
    """Mapping with known poses: dead reckoning, and ground truth for a caller who knows it.

    Every processed scan is drawn into the map at once.
    """

    # Drawing a scan takes less than asking for the process's time.
    _clock = staticmethod(time.perf_counter)

    def _process(self, scan: LaserScan) -> None:
        self._last_pose = self.pose
        self._gate.take(scan.stamp)
        self._map.draw(np.array([self._last_pose]), scan.ranges[np.newaxis])
        self._path.append(stamps=scan.stamp, poses=self._last_pose)
