"""The Gymnasium environments."""

from slamgym.envs.config import ExploreConfig, ObservationConfig
from slamgym.envs.coverage import Coverage, ReachableFloor
from slamgym.envs.explore import ExploreEnv
from slamgym.envs.recording import EpisodeLog
from slamgym.envs.rewards import RewardConfig, RewardFunction, StepRecord

__all__ = [
    "Coverage",
    "EpisodeLog",
    "ExploreConfig",
    "ExploreEnv",
    "ObservationConfig",
    "ReachableFloor",
    "RewardConfig",
    "RewardFunction",
    "StepRecord",
]
