"""The physical world: the robot, the building's obstacles, furniture and people."""

from slamgym.world.clutter import Clutter, ClutterConfig, make_clutter
from slamgym.world.people import Crowd, Person
from slamgym.world.robot import RobotConfig
from slamgym.world.space import Motion, World
from slamgym.world.start import sample_start

__all__ = [
    "Clutter",
    "ClutterConfig",
    "Crowd",
    "Motion",
    "Person",
    "RobotConfig",
    "World",
    "make_clutter",
    "sample_start",
]
