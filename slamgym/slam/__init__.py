"""SLAM: a grid-mapping particle filter as GMapping, and simpler modes behind the same protocol."""

from slamgym.slam.config import MotionNoise, SlamConfig
from slamgym.slam.mapper import Mapper, SlamStats
from slamgym.slam.modes import make_mapper
from slamgym.slam.particle_filter import ParticleFilter
from slamgym.slam.pose_tracking import PoseTracker

__all__ = ["Mapper", "MotionNoise", "ParticleFilter", "PoseTracker", "SlamConfig", "SlamStats", "make_mapper"]
