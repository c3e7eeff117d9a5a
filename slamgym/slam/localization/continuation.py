"""Going on with a finished map: the robot finds itself on it first, then maps on."""

import dataclasses
from collections.abc import Callable

import numpy as np

from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.geometry import between, compose
from slamgym.core.types import OccupancyGrid, Pose2D, Trajectory
from slamgym.interop.records import Log, LogRecord
from slamgym.slam.config import SlamConfig
from slamgym.slam.localization.config import LocalizationConfig
from slamgym.slam.localization.localizer import Localizer
from slamgym.slam.mapper import Mapper
from slamgym.slam.replay import OlderMap, ReplayResult, replay

KNOWN_SPREAD, KNOWN_TURN = 0.1, 0.05
"""Spread round the place at which the robot was sure of itself, when it is followed back from there [m], [rad]."""
SURE_DISTANCE, SURE_FIT = 4.0, 0.7
"""Before an old map is drawn on, the robot must have driven so far with one place certain [m], and so much of its scans
must be explained: a mistake would spoil the map."""


def continue_map(
    log: Log,
    grid: OccupancyGrid,
    config: SlamConfig,
    rng: np.random.Generator,
    on_scan: Callable[[int, Mapper, bool], None] | None = None,
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
    older = OlderMap(
        OccupancyGrid(grid.cells, frame), Pose2D(start.x - away_x, start.y - away_y, start.theta)
    )
    result = replay(log, config, rng, on_scan, older)
    new = result.grid.frame
    kept = new._replace(origin_x=new.origin_x + away_x, origin_y=new.origin_y + away_y)
    return dataclasses.replace(
        result,
        grid=OccupancyGrid(result.grid.cells, kept),
        processed=_moved(result.processed, away_x, away_y),
        trajectory=_moved(result.trajectory, away_x, away_y),
        moments=_moved(result.moments, away_x, away_y),
    )


def first_pose(log: Log, grid: OccupancyGrid, config: LocalizationConfig, rng: np.random.Generator) -> Pose2D:
    """Where on a map the first scan of a log was taken.

    The log is followed until the robot is sure of itself, and from there back to its beginning.

    Raises:
        SlamgymError: If it never is.
    """
    mapping = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    strict = dataclasses.replace(
        config,
        confirm_distance=max(config.confirm_distance, SURE_DISTANCE),
        minimum_fit=max(config.minimum_fit, SURE_FIT),
    )
    ahead = Localizer(grid, strict, log.geometry, mapping, rng)
    found = next((index for index, record in enumerate(log.records) if _is_found(ahead, record)), None)
    if found is None:
        raise SlamgymError(
            f"{log.source}: never finds itself on the map to continue (at the end: {ahead.belief.state}, "
            f"{ahead.belief.fit:.0%} of the beams explained); drive at least {SURE_DISTANCE:g} m in the "
            "mapped part of the same building, or map the log anew without --continue"
        )
    near = dataclasses.replace(config, initial_spread=KNOWN_SPREAD, initial_turn=KNOWN_TURN)
    back = Localizer(grid, near, log.geometry, mapping, rng, ahead.pose)
    place, pose = found, ahead.pose
    for earlier in range(found, -1, -1):
        record = log.records[earlier]
        back.update(record.odometry, record.scan)
        if back.belief.state == "localised":
            place, pose = earlier, back.pose
    return compose(pose, between(log.records[place].odometry, log.records[0].odometry))


def _is_found(localizer: Localizer, record: LogRecord) -> bool:
    """Whether the robot is sure of its place with one record more."""
    return localizer.update(record.odometry, record.scan) and localizer.belief.state == "localised"


def _moved(path: Trajectory, x: float, y: float) -> Trajectory:
    return Trajectory(path.stamps, path.poses + np.array([x, y, 0.0]))
