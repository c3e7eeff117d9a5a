from .batch.env import BatchExploreEnv
from .config import ExploreConfig, ObservationConfig
from .coverage import Coverage, ReachableFloor
from .episode import Episode, EpisodeConfig, run_episode
from .explore_env import ExploreEnv
from .explore_frontiers_env import ExploreFrontiersEnv
from .records import StepRecord
from .rewards import RewardConfig, RewardFunction
from .simulation import EpisodeLog

__all__ = [
    "BatchExploreEnv",
    "Episode",
    "EpisodeConfig",
    "run_episode",
    "Coverage",
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
