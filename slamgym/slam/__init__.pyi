from .config import MotionNoise, SlamConfig
from .mapper import Mapper, PoseTracker, SlamStats
from .modes import make_mapper
from .particle_filter import ParticleFilter

__all__ = [
    "Mapper",
    "MotionNoise",
    "ParticleFilter",
    "PoseTracker",
    "SlamConfig",
    "SlamStats",
    "make_mapper",
]
