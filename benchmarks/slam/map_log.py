"""Mapping a log as ``slamgym slam`` does: the one way in which tables of logs, faults and robots map theirs."""

from dataclasses import replace
from typing import Any

import numpy as np

from slamgym.interop import Log
from slamgym.slam import SlamConfig
from slamgym.slam.odometry_check import check_odometry
from slamgym.slam.replay import ReplayResult, replay


def map_log(log: Log, mode: str = "pose_graph", seed: int = 0) -> ReplayResult:
    """Check a log's odometry and map it."""
    return map_checked(check_odometry(log), mode, seed)


def map_checked(log: Log, mode: str = "pose_graph", seed: int = 0) -> ReplayResult:
    """Map a log whose odometry was checked, with the settings that suit its scanner."""
    suited = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    settings: dict[str, Any] = {"mode": mode}
    config = replace(suited, **settings)
    return replay(log, config, np.random.default_rng(seed))
