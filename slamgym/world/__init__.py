"""The physical world: the robot, the building's obstacles, furniture and people."""

from slamgym.world.robot import RobotConfig
from slamgym.world.space import Motion, World

__all__ = ["Motion", "RobotConfig", "World"]
