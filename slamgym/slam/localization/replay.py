"""Localising a recorded log on a finished map."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import compose, inverse
from slamgym.core.types import OccupancyGrid, Pose2D, Trajectory
from slamgym.interop.records import Log
from slamgym.slam.config import SlamConfig
from slamgym.slam.localization.config import LocalizationConfig
from slamgym.slam.localization.judge import Belief
from slamgym.slam.localization.localizer import Localizer
from slamgym.slam.path_correction import poses_between


@dataclass(frozen=True)
class LocalizationResult:
    """What came out of a log on a map."""

    beliefs: Sequence[Belief]
    """After each processed scan, in the map's frame."""
    processed: Sequence[int]
    """Which of the log's scans those are."""
    trajectory: Trajectory
    """A pose for every scan from a localised one to the next; nothing in between."""
    searches: int
    cpu_seconds: float


def localize_log(
    log: Log,
    grid: OccupancyGrid,
    placement: Pose2D,
    config: LocalizationConfig,
    rng: np.random.Generator,
    initial_pose: Pose2D | None = None,
) -> LocalizationResult:
    """Localise every scan of a log.

    Args:
        log: The records; at least one.
        grid: The map.
        placement: Of the grid's frame in the map's, for a map that is turned; else zero.
        config: Settings.
        rng: Source of all randomness.
        initial_pose: Where the robot starts in the map's frame, if that is known.
    """
    mapping = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    start = None if initial_pose is None else compose(inverse(placement), initial_pose)
    localizer = Localizer(grid, config, log.geometry, mapping, rng, start)
    beliefs: list[Belief] = []
    processed: list[int] = []
    for index, record in enumerate(log):
        if localizer.update(record.odometry, record.scan):
            beliefs.append(_placed(localizer.belief, placement))
            processed.append(index)
    return LocalizationResult(
        beliefs,
        processed,
        _trajectory(log, beliefs, processed),
        localizer.seeker.searches,
        localizer.cpu_seconds,
    )


def _placed(belief: Belief, placement: Pose2D) -> Belief:
    """A belief in the frame of a map that is turned."""
    if placement == Pose2D(0.0, 0.0, 0.0):
        return belief
    cos, sin = np.cos(placement.theta), np.sin(placement.theta)
    turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return belief._replace(
        pose=compose(placement, belief.pose),
        covariance=turned @ belief.covariance @ turned.T,
        hypotheses=tuple((compose(placement, pose), weight) for pose, weight in belief.hypotheses),
    )


def _trajectory(log: Log, beliefs: Sequence[Belief], processed: Sequence[int]) -> Trajectory:
    """Poses of the scans between successive localised ones, by odometry fitted to both."""
    stamps = np.array([record.stamp for record in log.records])
    odometry = np.array([record.odometry for record in log.records], dtype=np.float64).reshape(-1, 3)
    poses = np.array([belief.pose for belief in beliefs], dtype=np.float64).reshape(-1, 3)
    known = np.array([belief.state == "localised" for belief in beliefs], dtype=bool)
    if not known.any():
        return Trajectory(np.zeros(0), np.zeros((0, 3)))
    filled = poses_between(poses, np.array(processed), odometry)
    after = np.searchsorted(processed, np.arange(len(stamps)), side="right") - 1
    inside = known[np.maximum(after, 0)] & (after >= 0)
    return Trajectory(stamps[inside], filled[inside])
