"""Ready settings: the paper's model, and one whose maps look like those of the simulator's robot."""

import dataclasses
import math

from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.parametric.config import (
    MatchingConfig,
    MotionConfig,
    ParametricConfig,
    RenderConfig,
    ScannerConfig,
    SensingConfig,
    TwoPhaseConfig,
)
from slamgym.sim import Lidar
from slamgym.sim.robot import RobotConfig
from slamgym.sim.wheel_odometry import OdometryConfig
from slamgym.slam.config import MotionNoise

PRESET_NAMES = ("faithful", "realistic")
_FIELD_BEAMS = 180  # tell where a map of scans is displaced; all beams draw it


def preset(name: str) -> ParametricConfig:
    """The settings of a named preset.

    Args:
        name: ``faithful``: the paper's model with its misprints corrected; ``realistic``: :func:`realistic` with
            the simulator's default robot.

    Raises:
        ConfigError: If the name is unknown.
    """
    if name == "faithful":
        return ParametricConfig()
    if name == "realistic":
        return realistic(SensingConfig(), OdometryConfig())
    raise ConfigError(f"unknown preset {name!r}; {suggest(name, PRESET_NAMES)}")


def realistic(sensing: SensingConfig, odometry: OdometryConfig) -> ParametricConfig:
    """Maps that look like those of a simulated robot: its sensors and mapper, but for the search of the match.

    Args:
        sensing: Laser, furniture and mapper.
        odometry: The robot's wheels.
    """
    slam, lidar = sensing.slam, sensing.lidar
    return ParametricConfig(
        method="scan_matching",
        resolution=slam.resolution,
        motion=MotionConfig(
            scan_spacing=slam.linear_update,
            scan_angle=slam.angular_update,
            scan_interval=math.inf if slam.temporal_update is None else slam.temporal_update,
        ),
        scanner=ScannerConfig(
            field_of_view=math.radians(lidar.field_of_view_deg),
            range_min=lidar.range_min,
            range_max=min(lidar.range_max, slam.max_usable_range),
            num_beams=min(lidar.num_beams, _FIELD_BEAMS),
            mount_x=lidar.mount[0],
        ),
        two_phase=TwoPhaseConfig(
            k_l=odometry.scale_std,
            k_lt=odometry.diameter_ratio_std / RobotConfig().wheel_separation,
            k_t=odometry.wheelbase_ratio_std,
            s_l=odometry.slip_distance,
            s_lt=odometry.slip_drift,
            s_t=odometry.slip_turn,
        ),
        matching=matching_of(sensing, odometry),
        sensing=sensing,
        render=RenderConfig(renderer="scans"),
    )


def matching_of(sensing: SensingConfig, odometry: OdometryConfig) -> MatchingConfig:
    """The matcher that stands for a mapper whose robot has such wheels."""
    slam, fitted = sensing.slam, MatchingConfig()
    if Lidar(sensing.lidar).depends_on_place:
        fitted = MatchingConfig(wander=0.0, scatter=0.17)
    if slam.matcher == "coarse_to_fine":
        fitted = MatchingConfig(
            gain=0.9, prior=26.0, lag=0.04, wander=0.0, scatter=0.02, thin_wall=0.1, least_beams=10
        )
    drawn = 1.0 if slam.learn_odometry else slam.drawn_noise
    return dataclasses.replace(
        fitted,
        noise=0.0 if slam.mode == "scan_matching" else fitted.noise * drawn,
        motion=_learned_noise(odometry) if slam.learn_odometry else slam.motion,
        least_beams=round(0.6 * slam.minimum_score) or fitted.least_beams,
        beam_skip=slam.beam_skip,
        usable_range=slam.max_usable_range,
    )


def _learned_noise(odometry: OdometryConfig) -> MotionNoise:
    """What a mapper that learns its odometry takes the motion noise for, at steps of a decimetre and a decirad."""
    root = math.sqrt(0.1)
    return MotionNoise(
        srr=odometry.slip_distance / root,
        srt=odometry.slip_drift / root,
        str=0.0,
        stt=odometry.slip_turn / root,
    )
