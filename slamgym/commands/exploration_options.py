"""Options of all commands that let a robot explore."""

from __future__ import annotations

import dataclasses
from dataclasses import field
from typing import TYPE_CHECKING

from slamgym.core.config import Arguments, Count
from slamgym.sim import ClutterConfig, LidarConfig, OdometryLevel, RobotConfig
from slamgym.slam import SlamConfig

if TYPE_CHECKING:
    from slamgym.envs import ExploreConfig


class ExplorationOptions(Arguments):
    """The robot, its sensors, its mapping, and what stands in its way."""

    particles: Count = 30
    """Particles of the SLAM filter."""
    odometry: OdometryLevel = "medium"
    """Errors of the wheel odometry; ``ideal`` is what stock Gazebo has, as in the paper."""
    seed: int = 0
    """Seed of everything random."""
    robot: RobotConfig = field(default_factory=RobotConfig)
    """Measures and limits of the robot."""
    lidar: LidarConfig = field(default_factory=LidarConfig)
    """The scanner and its errors."""
    slam: SlamConfig = field(default_factory=SlamConfig)
    """Localisation and mapping."""
    clutter: ClutterConfig = field(default_factory=ClutterConfig)
    """Furniture and people, which no CAD map shows."""

    def env(self) -> ExploreConfig:
        """Settings of the environment."""
        from slamgym.envs import ExploreConfig
        from slamgym.sim import odometry_level

        return ExploreConfig(
            robot=self.robot,
            lidar=self.lidar,
            odometry=odometry_level(self.odometry),
            slam=dataclasses.replace(self.slam, particles=self.particles),
            clutter=self.clutter,
        )
