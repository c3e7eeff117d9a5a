"""Recorded logs on a finished map."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slamgym.core.geometry import compose, inverse
from slamgym.core.types import AT_REST, OccupancyGrid, Pose2D, Trajectory
from slamgym.interop.records import Log
from slamgym.slam.config import LocalizationConfig, SlamConfig
from slamgym.slam.graph.relative import turned_matrix
from slamgym.slam.localization.hypothesis import Belief
from slamgym.slam.localization.localizer import MapLocalizer


@dataclass(frozen=True)
class LocalizationResult:
    """Result of localisation with a log on a map."""

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
    initial_pose: Pose2D | None = None,
) -> LocalizationResult:
    """Localise every scan of a log.

    Args:
        log: The records; at least one.
        grid: The map.
        placement: Of the grid's frame in the map's, for a map that is turned; else zero.
        config: Settings.
        initial_pose: Where the robot starts in the map's frame, if that is known.
    """
    geometry = log.geometry
    start = compose(inverse(placement), initial_pose or AT_REST)
    config = replace(config, start="global" if initial_pose is None else "known")
    mapping = SlamConfig.for_log(geometry.range_max, geometry.num_beams)
    mapping = replace(mapping, localization=config)
    localizer = MapLocalizer(mapping, geometry, start, np.random.default_rng(0), grid)
    beliefs: list[Belief] = []
    processed: list[int] = []
    path: list[list[float]] = []
    for index, record in enumerate(log):
        if localizer.update(record.odometry, record.scan):
            beliefs.append(_placed(localizer.belief, placement))
            processed.append(index)
        if localizer.belief.state == "localised":
            path.append([record.stamp, *compose(placement, localizer.pose)])
    rows = np.array(path).reshape(-1, 4)
    return LocalizationResult(
        beliefs=beliefs,
        processed=processed,
        trajectory=Trajectory(rows[:, 0], rows[:, 1:]),
        searches=localizer.report()["searches"],
        cpu_seconds=localizer.stats.cpu_seconds,
    )


def _placed(belief: Belief, placement: Pose2D) -> Belief:
    """A belief in the frame of a map that is turned."""
    hypotheses = [(compose(placement, pose), weight) for pose, weight in belief.hypotheses]
    return belief._replace(
        pose=compose(placement, belief.pose),
        covariance=turned_matrix(belief.covariance, placement.theta),
        hypotheses=tuple(hypotheses),
    )
