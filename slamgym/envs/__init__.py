"""The Gymnasium environments."""

from slamgym.envs.config import ExploreConfig, ObservationConfig
from slamgym.envs.coverage import Coverage, ReachableFloor
from slamgym.envs.episode_log import EpisodeLog
from slamgym.envs.explore_env import ExploreEnv
from slamgym.envs.explore_frontiers_env import DiscountByTermination, ExploreFrontiersEnv
from slamgym.envs.rewards import RewardConfig, RewardFunction, StepRecord

__all__ = [
    "Coverage",
    "DiscountByTermination",
    "EpisodeLog",
    "ExploreConfig",
    "ExploreEnv",
    "ExploreFrontiersEnv",
    "ObservationConfig",
    "ReachableFloor",
    "RewardConfig",
    "RewardFunction",
    "StepRecord",
]
