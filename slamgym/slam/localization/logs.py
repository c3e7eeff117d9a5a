"""Recorded logs on a finished map: localised, or going on with it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.geometry import compose, inverse
from slamgym.core.types import FloatArray, OccupancyGrid, Pose2D, Trajectory
from slamgym.interop.records import Log
from slamgym.slam.config import LocalizationConfig, SlamConfig
from slamgym.slam.graph.relative import turned_matrix
from slamgym.slam.localization.hypothesis import Belief
from slamgym.slam.localization.localizer import MapLocalizer
from slamgym.slam.replay import OlderMap, OnScan, ReplayResult, replay

SURE_DISTANCE = 4.0
"""Before an old map is drawn on, a place must have led for so long [m]: a mistake would spoil the map."""


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
    start = None if initial_pose is None else compose(inverse(placement), initial_pose)
    localizer = _localizer(log, grid, config, start)
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


def _localizer(
    log: Log, grid: OccupancyGrid, config: LocalizationConfig, start: Pose2D | None = None
) -> MapLocalizer:
    """A localizer for a log, from a known start or none."""
    geometry = log.geometry
    config = replace(config, start="global" if start is None else "known")
    mapping = SlamConfig.for_log(geometry.range_max, geometry.num_beams)
    mapping = replace(mapping, localization=config)
    unused = np.random.default_rng(0)
    return MapLocalizer(mapping, geometry, start or Pose2D(0.0, 0.0, 0.0), unused, grid)


def _placed(belief: Belief, placement: Pose2D) -> Belief:
    """A belief in the frame of a map that is turned."""
    hypotheses = [(compose(placement, pose), weight) for pose, weight in belief.hypotheses]
    return belief._replace(
        pose=compose(placement, belief.pose),
        covariance=turned_matrix(belief.covariance, placement.theta),
        hypotheses=tuple(hypotheses),
    )


def continue_map(
    log: Log,
    grid: OccupancyGrid,
    config: SlamConfig,
    rng: np.random.Generator,
    on_scan: OnScan | None = None,
) -> ReplayResult:
    """Localise a log on a map, then map on with it; see :func:`slamgym.slam.replay.replay`.

    Args:
        log: The records.
        grid: The finished map, not turned.
        config: Settings of the mapper; the resolution must be the map's.
        rng: Source of all randomness.
        on_scan: As of ``replay``.

    Raises:
        ConfigError: If the resolutions differ.
        SlamgymError: If the log never finds itself on the map.
    """
    step = grid.frame.resolution
    if config.resolution != step:
        raise ConfigError(
            f"--resolution is {config.resolution} m, but the map to continue has cells of {step} m; leave it out"
        )
    start = first_pose(log, grid, config.localization)
    # Maps of others may lie between the cells of our lattice: mapping is done on it, and what comes out moved back.
    corner = np.array([grid.frame.origin_x, grid.frame.origin_y, 0.0])
    away = corner - step * np.round(corner / step)
    on_lattice = Pose2D(*(np.array(start) - away).tolist())
    older = OlderMap(_moved_map(grid, -away), on_lattice)
    result = replay(log, config, rng, on_scan, older)
    return replace(
        result,
        grid=_moved_map(result.grid, away),
        processed=_moved_path(result.processed, away),
        trajectory=_moved_path(result.trajectory, away),
        moments=_moved_path(result.moments, away),
    )


def _moved_map(grid: OccupancyGrid, by: FloatArray) -> OccupancyGrid:
    """A map that lies elsewhere, by (3,) [m]."""
    frame = grid.frame
    x = frame.origin_x + float(by[0])
    y = frame.origin_y + float(by[1])
    return OccupancyGrid(grid.cells, frame._replace(origin_x=x, origin_y=y))


def _moved_path(path: Trajectory, by: FloatArray) -> Trajectory:
    """A path that lies elsewhere, by (3,) [m]."""
    return Trajectory(path.stamps, path.poses + by)


def first_pose(log: Log, grid: OccupancyGrid, config: LocalizationConfig) -> Pose2D:
    """Find where on a map the first scan of a log was taken.

    The log is followed until the robot is sure of itself, and from there back to its beginning.

    Raises:
        SlamgymError: If it never is.
    """
    strict = replace(config, confirm_distance=max(config.confirm_distance, SURE_DISTANCE))
    ahead = _localizer(log, grid, strict)
    found: int | None = None
    for index, record in enumerate(log.records):
        if ahead.update(record.odometry, record.scan) and ahead.belief.state == "localised":
            found = index
            break
    if found is None:
        raise SlamgymError(
            f"{log.source}: never finds itself on the map to continue (at the end: {ahead.belief.state}, "
            f"{ahead.belief.fit:.0%} of the beams explained); drive at least {strict.confirm_distance:g} m in the "
            "mapped part of the same building, or map the log anew without --continue"
        )
    back = _localizer(log, grid, config, ahead.pose)
    for record in log.records[found::-1]:
        back.update(record.odometry, record.scan)
    return back.pose
