from .config import MotionNoise, SlamConfig
from .mapper import Mapper, SlamStats
from .modes import make_mapper
from .particle_filter import ParticleFilter
from .pose_tracking import PoseTracker

__all__ = ["Mapper", "MotionNoise", "ParticleFilter", "PoseTracker", "SlamConfig", "SlamStats", "make_mapper"]
