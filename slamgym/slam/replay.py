"""Replaying a recorded log through a mapper."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slamgym.core.types import BoolArray, FloatArray, OccupancyGrid, Pose2D, Trajectory
from slamgym.interop.records import Log
from slamgym.slam.config import SlamConfig
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.laser_check import blind_scans
from slamgym.slam.laser_odometry import with_laser_odometry
from slamgym.slam.mapper import Mapper, SlamStats
from slamgym.slam.modes import make_mapper
from slamgym.slam.motion_model import poses_between

OnScan = Callable[[int, Mapper, bool], None]
"""Function that is called after each scan with its index, the mapper, and true if the scan was processed."""


@dataclass(frozen=True)
class ReplayResult:
    """Result of a log."""

    grid: OccupancyGrid
    processed: Trajectory
    """The poses that the mapper estimated, one per processed scan."""
    trajectory: Trajectory
    """A pose for every scan: between processed ones, the odometry's motion fitted to both neighbours."""
    moments: Trajectory
    """The same for every moment of which the log holds the odometry, in the order of time."""
    doubtful: BoolArray
    """True where the last processed scan before each scan is in doubt, shape (N,): the pose may be wrong there."""
    covariances: FloatArray
    """Covariances of the scans' poses by the mapper at the time, shape (N, 3, 3); zero where it doesn't know."""
    stats: SlamStats
    graph: MapGraph | None = None
    """What was measured, with the scans; None in a mode without a graph."""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Other entries that the mapper reports, e.g. its loop closures."""


def replay(
    log: Log, config: SlamConfig, rng: np.random.Generator, on_scan: OnScan | None = None
) -> ReplayResult:
    """Feed a log to a mapper, scan by scan.

    Args:
        log: The records; at least one.
        config: Settings of the mapper.
        rng: Source of all randomness.
        on_scan: Called after each scan.

    Returns:
        The map, the trajectories and the counters. The map frame has its origin at the first scan's pose and
        the axes of the odometry frame.
    """
    log = with_laser_odometry(log)
    start = Pose2D(0.0, 0.0, log.records[0].odometry.theta)
    mapper = make_mapper(config, log.geometry, start, rng)
    processed: list[int] = []
    last = np.zeros(len(log))
    covariances = np.zeros((len(log), 3, 3))
    for index, record in enumerate(log):
        is_processed = mapper.update(record.odometry, record.scan)
        if is_processed:
            processed.append(index)
            covariances[index] = mapper.covariance
        elif index > 0:
            covariances[index] = covariances[index - 1]
        last[index] = mapper.stats.last_stamp
        if on_scan is not None:
            on_scan(index, mapper, is_processed)
    mapper.finish()
    unsure = blind_scans(log) | log.within(log.doubted)
    unseen = [log.records[index].stamp for index in processed if unsure[index]]
    mapper.stats.doubtful = sorted({*mapper.stats.doubtful, *unseen})
    mapper.stats.doubted = log.doubted
    path = mapper.trajectory()
    track = log.track
    poses = poses_between(path.poses, track.scans[processed], track.poses)
    in_time = np.argsort(track.stamps, kind="stable")
    return ReplayResult(
        grid=mapper.occupancy_grid(),
        processed=path,
        trajectory=Trajectory(track.stamps[track.scans], poses[track.scans]),
        moments=Trajectory(track.stamps[in_time], poses[in_time]),
        doubtful=unsure | np.isin(last, mapper.stats.doubtful),
        covariances=covariances,
        stats=mapper.stats,
        graph=mapper.graph(),
        extra=mapper.report(),
    )
