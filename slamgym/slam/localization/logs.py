"""Recorded logs on a finished map: localised, or going on with it."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.geometry import between, compose, inverse
from slamgym.core.types import OccupancyGrid, Pose2D, Trajectory
from slamgym.interop.records import Log
from slamgym.slam.config import LocalizationConfig, SlamConfig
from slamgym.slam.graph.solver import turned_covariance
from slamgym.slam.localization.hypothesis import Belief
from slamgym.slam.localization.localizer import MapLocalizer
from slamgym.slam.motion_model import poses_between
from slamgym.slam.replay import OlderMap, OnScan, ReplayResult, replay

KNOWN_SPREAD, KNOWN_TURN = 0.1, 0.05
"""Spread round the place at which the robot was sure of itself, when it is followed back from there [m], [rad]."""
SURE_DISTANCE, SURE_FIT = 4.0, 0.7
"""Before an old map is drawn on, the robot must have driven so far with one place certain [m], and so much of its scans
must be explained: a mistake would spoil the map."""


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
    start = None if initial_pose is None else compose(inverse(placement), initial_pose)
    localizer = _localizer(log, grid, config, rng, start)
    beliefs: list[Belief] = []
    processed: list[int] = []
    for index, record in enumerate(log):
        if localizer.update(record.odometry, record.scan):
            beliefs.append(_placed(localizer.belief, placement))
            processed.append(index)
    trajectory = _trajectory(log, beliefs, processed)
    return LocalizationResult(beliefs, processed, trajectory, localizer.searches, localizer.stats.cpu_seconds)


def _localizer(
    log: Log,
    grid: OccupancyGrid,
    config: LocalizationConfig,
    rng: np.random.Generator,
    start: Pose2D | None = None,
) -> MapLocalizer:
    """A localizer for a log, from a known start or none."""
    config = dataclasses.replace(config, start="global" if start is None else "known")
    mapping = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    mapping = dataclasses.replace(mapping, localization=config)
    return MapLocalizer(mapping, log.geometry, start or Pose2D(0.0, 0.0, 0.0), rng, grid)


def _placed(belief: Belief, placement: Pose2D) -> Belief:
    """A belief in the frame of a map that is turned."""
    if placement == Pose2D(0.0, 0.0, 0.0):
        return belief
    return belief._replace(
        pose=compose(placement, belief.pose),
        covariance=turned_covariance(belief.covariance, placement.theta),
        hypotheses=tuple((compose(placement, pose), weight) for pose, weight in belief.hypotheses),
    )


def _trajectory(log: Log, beliefs: Sequence[Belief], processed: Sequence[int]) -> Trajectory:
    """Poses of the scans between successive localised ones, by odometry fitted to both."""
    stamps, odometry, _ = dataclasses.replace(log, recorded_track=None).track
    poses = np.array([belief.pose for belief in beliefs], dtype=np.float64).reshape(-1, 3)
    known = np.array([belief.state == "localised" for belief in beliefs], dtype=bool)
    if not known.any():
        return Trajectory(np.zeros(0), np.zeros((0, 3)))
    filled = poses_between(poses, np.array(processed), odometry)
    after = np.searchsorted(processed, np.arange(len(stamps)), side="right") - 1
    inside = known[np.maximum(after, 0)] & (after >= 0)
    return Trajectory(stamps[inside], filled[inside])


def continue_map(
    log: Log, grid: OccupancyGrid, config: SlamConfig, rng: np.random.Generator, on_scan: OnScan | None = None
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
    start = first_pose(log, grid, config.localization, rng)
    # Maps of others may lie between the cells of our lattice: mapping is done on it, and what comes out moved back.
    columns, rows = round(grid.frame.origin_x / step), round(grid.frame.origin_y / step)
    away_x, away_y = grid.frame.origin_x - columns * step, grid.frame.origin_y - rows * step
    frame = grid.frame._replace(origin_x=columns * step, origin_y=rows * step)
    shifted = Pose2D(start.x - away_x, start.y - away_y, start.theta)
    older = OlderMap(OccupancyGrid(grid.cells, frame), shifted)
    result = replay(log, config, rng, on_scan, older)
    new, away = result.grid.frame, np.array([away_x, away_y, 0.0])
    kept = new._replace(origin_x=new.origin_x + away_x, origin_y=new.origin_y + away_y)
    paths = result.processed, result.trajectory, result.moments
    processed, trajectory, moments = (Trajectory(path.stamps, path.poses + away) for path in paths)
    moved = OccupancyGrid(result.grid.cells, kept)
    return dataclasses.replace(
        result, grid=moved, processed=processed, trajectory=trajectory, moments=moments
    )


def first_pose(log: Log, grid: OccupancyGrid, config: LocalizationConfig, rng: np.random.Generator) -> Pose2D:
    """Find where on a map the first scan of a log was taken.

    The log is followed until the robot is sure of itself, and from there back to its beginning.

    Raises:
        SlamgymError: If it never is.
    """
    strict = dataclasses.replace(
        config,
        confirm_distance=max(config.confirm_distance, SURE_DISTANCE),
        minimum_fit=max(config.minimum_fit, SURE_FIT),
    )
    ahead = _localizer(log, grid, strict, rng)
    processed = (i for i, record in enumerate(log.records) if ahead.update(record.odometry, record.scan))
    found = next((index for index in processed if ahead.belief.state == "localised"), None)
    if found is None:
        raise SlamgymError(
            f"{log.source}: never finds itself on the map to continue (at the end: {ahead.belief.state}, "
            f"{ahead.belief.fit:.0%} of the beams explained); drive at least {SURE_DISTANCE:g} m in the "
            "mapped part of the same building, or map the log anew without --continue"
        )
    near = dataclasses.replace(config, initial_spread=KNOWN_SPREAD, initial_turn=KNOWN_TURN)
    back = _localizer(log, grid, near, rng, ahead.pose)
    place, pose = found, ahead.pose
    for earlier in range(found, -1, -1):
        record = log.records[earlier]
        back.update(record.odometry, record.scan)
        if back.belief.state == "localised":
            place, pose = earlier, back.pose
    return compose(pose, between(log.records[place].odometry, log.records[0].odometry))
