"""The manifest line of an exploration."""

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from slamgym import __version__
from slamgym.core.types import Pose2D
from slamgym.dataset.format import PairRecord
from slamgym.dataset.pair import MapPair
from slamgym.dataset.schedule import Slot
from slamgym.envs.episode import Episode
from slamgym.metrics import absolute_trajectory_error, free_space, squared_error, wall_error

DIGITS = 6
"""Decimals of the figures: more than any of them means, fewer than a float has."""


def make_record(
    slot: Slot,
    episode: Episode,
    pair: MapPair,
    files: Mapping[str, bytes],
    conditions: Mapping[str, Any],
    settings_hash: str,
) -> PairRecord:
    """Judge an exploration against the truth and describe it.

    Args:
        slot: Its place in the schedule.
        episode: The exploration.
        pair: Its images.
        files: Contents of the files that the record vouches for, by name: ``A``, ``B``, ``episode``.
        conditions: The conditions of the exploration.
        settings_hash: Hash of the dataset's settings.
    """
    frame = pair.frame
    return PairRecord(
        name=slot.name,
        index=slot.index,
        plan_id=slot.plan_id,
        plan_source=episode.plan.source.rpartition("/")[2],
        repetition=slot.repetition,
        seed=slot.seed,
        config_hash=settings_hash,
        version=__version__,
        explorer=conditions["explorer"],
        conditions=dict(conditions),
        finished=episode.finished,
        coverage=_rounded(episode.coverage),
        robot_seconds=_rounded(episode.robot_seconds),
        time_limit=_rounded(episode.time_limit),
        path_length=_rounded(episode.truth.length),
        collisions=episode.collisions,
        ate=_rounded(
            absolute_trajectory_error(episode.estimate, episode.truth, align=False).translation.rmse
        ),
        odometry_ate=_rounded(
            absolute_trajectory_error(episode.odometry, episode.truth, align=False).translation.rmse
        ),
        final_position_error=_rounded(
            position_error(episode.final_estimate, Pose2D(*episode.truth.poses[-1]))
        ),
        map_error=_rounded(wall_error(pair.slam, pair.cad, frame.resolution)),
        mse=_rounded(squared_error(free_space(pair.slam), free_space(pair.cad))),
        area=_rounded(episode.plan.area),
        rooms=len(episode.plan.rooms),
        resolution=frame.resolution,
        origin=(_rounded(frame.origin_x), _rounded(frame.origin_y)),
        shape=frame.shape,
        start=(_rounded(episode.start.x), _rounded(episode.start.y), _rounded(episode.start.theta)),
        sha256={side: hashlib.sha256(data).hexdigest() for side, data in files.items()},
    )


def position_error(estimate: Pose2D, truth: Pose2D) -> float:
    """Distance between two positions [m]."""
    return float(np.hypot(estimate.x - truth.x, estimate.y - truth.y))


def _rounded(value: float) -> float:
    return round(float(value), DIGITS)
