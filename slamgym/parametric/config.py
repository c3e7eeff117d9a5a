"""Settings of the parametric CAD -> SLAM model, with the sources of their default magnitudes.

Every magnitude that no source settles is a named field, so that a reader who has the missing table can put
the real number in. "OptiOdom" is the public data set of that name (a differential drive robot tracked by
cameras; MIT licence), from which the odometry magnitudes were computed.
"""

import dataclasses
import math
from dataclasses import field
from typing import Annotated, Literal, TypeVar

from slamgym.core.config import NonNegative, Positive, Settings, Share, Within
from slamgym.core.errors import ConfigError
from slamgym.sim.clutter import ClutterConfig
from slamgym.sim.lidar import LidarConfig, lidar_level
from slamgym.sim.robot import RobotConfig
from slamgym.slam.config import MotionNoise, SlamConfig

_SettingsT = TypeVar("_SettingsT", bound=Settings)
ConversionMethod = Literal["ekf_schur", "ekf", "two_phase", "scan_matching"]

_ROBOT, _SCANNER = RobotConfig(), LidarConfig()
"""What the simulator drives, with the sources of its figures."""


class MotionConfig(Settings, section="motion"):
    """How the robot drives along its waypoints, and where it takes a scan."""

    max_linear: float = _ROBOT.max_linear
    """[m/s]"""
    max_angular: float = _ROBOT.max_angular
    """[rad/s]"""
    linear_acceleration: float = _ROBOT.linear_acceleration
    """[m/s^2]"""
    angular_acceleration: float = _ROBOT.angular_acceleration
    """[rad/s^2]"""
    scan_spacing: float = 0.15
    """[m] of driving between two scans that enter the map."""
    scan_angle: float = 0.2
    """[rad] of turning between two scans that enter the map; GMapping's angularUpdate on a TurtleBot3."""
    scan_interval: Annotated[float, Within(gt=0.0, infinite=True)] = math.inf
    """[s] between two scans that enter the map at the latest; GMapping's temporalUpdate is 0.5 s on a
    TurtleBot3."""
    clearance: float = _ROBOT.radius + 0.03
    """[m] that a planned path keeps from walls: the robot's radius and a margin."""


class ScannerConfig(Settings, section="scanner"):
    """What the LIDAR can see."""

    field_of_view: float = 2.0 * math.pi
    """[rad] centred on the robot's heading."""
    range_min: float = _SCANNER.range_min
    """[m]"""
    range_max: float = _SCANNER.range_max
    """[m]"""
    num_beams: int = 0
    """Beams per scan; 0 takes as many as let neighbours hit neighbouring cells at full range."""
    mount_x: float = _SCANNER.mount[0]
    """[m] of the scanner ahead of the axle."""


class LidarErrorConfig(Settings, section="lidar"):
    """Exteroceptive model: systematic range and bearing errors, noise, and Thrun's beam mixture.

    The systematic coefficients are drawn once per robot from zero-mean normals with these standard
    deviations: dD = a0 + a1 D, da = b1 a + b2 sin a + b3 cos a + b4 sin 2a + b5 cos 2a + b6 / D (the terms of
    Mader, Westfeld and Maas 2014). Their table was not available; the defaults keep within the 0.2 % of range
    and 0.2 deg that its abstract reports.
    """

    a0: float = 0.005
    """[m] constant range error."""
    a1: float = 0.002
    """[-] range scale error."""
    b1: float = 0.0003
    """[-] bearing scale error."""
    b2: float = math.radians(0.1)
    """[rad] sin a."""
    b3: float = math.radians(0.1)
    """[rad] cos a."""
    b4: float = math.radians(0.05)
    """[rad] sin 2a."""
    b5: float = math.radians(0.05)
    """[rad] cos 2a."""
    b6: float = math.radians(0.01)
    """[rad m] over D."""
    sigma_range: float = 0.01
    """[m] noise of a range."""
    sigma_bearing: float = math.radians(0.2)
    """[rad] noise of a bearing."""
    weight_hit: Share = 0.95
    """[-] share of beams that measure the wall; the others lose it."""
    weight_short: Share = 0.03
    """[-] share of beams that meet something in front of it."""
    weight_max: Share = 0.01
    """[-] share of beams without return."""
    weight_rand: Share = 0.01
    """[-] share of beams with any range."""
    median_px: int = 5
    """[px] window of the median filter over the hits; 0 leaves it out."""


class OdometryErrorConfig(Settings, section="odometry"):
    """Proprioceptive model: the wheel errors of UMBmark, drawn once per robot (standard deviations)."""

    wheel_base: float = _ROBOT.wheel_separation
    """[m]"""
    wheel_diameter: float = 2.0 * _ROBOT.wheel_radius
    """[m]"""
    alpha_eb_deg: float = 1.0
    """[deg] error of a quarter turn through the wheel base; rms 0.98 over 8 OptiOdom sets."""
    kappa_deg: float = 0.23
    """[deg/m] curvature of a straight line through unequal wheels; rms 0.23 over the same sets."""
    scale: float = 0.002
    """[-] error of the mean wheel diameter."""


class TwoPhaseConfig(Settings, section="two_phase"):
    """Empirical method after Souza et al. 2008: errors of straight lines and of turns in place.

    k: systematic, drawn once per robot; s: random, per square root of the distance. Defaults: OptiOdom.
    ``slamgym.parametric.calibration`` measures them on the simulated robot instead.
    """

    k_l: float = 0.003
    """[-] distance error per metre driven."""
    k_lt: float = 0.006
    """[rad/m] heading error per metre driven."""
    k_t: float = 0.010
    """[-] heading error per radian turned."""
    s_l: float = 0.0005
    """[m/sqrt(m)] random distance error."""
    s_lt: float = 0.004
    """[rad/sqrt(m)] random heading error of driving."""
    s_t: float = 0.0035
    """[rad/sqrt(rad)] random heading error of turning."""


class EkfConfig(Settings, section="ekf"):
    """EKF-SLAM with wall cells as landmarks and known association.

    With fine measurements EKF-SLAM removes nearly all of the odometry's error; few landmarks per scan with
    coarse noise leave distortions of the size that real maps show.
    """

    sigma_range: float = 0.05
    """[m] noise of a measured range; never below the cell's own r/sqrt(12)."""
    sigma_bearing_deg: float = 1.0
    """[deg] noise of a measured bearing."""
    noise: float = 1.0
    """[-] noise that the measurements really have, as a share of what the filter assumes."""
    landmarks_per_scan: int = 10
    """At most so many landmarks update the filter per scan; 0 takes all."""
    sigma_distance_floor: float = 0.002
    """[m] floor of an increment's standard deviation (its systematic part is the paper's)."""
    sigma_lateral: float = 0.0005
    """[m] sideways slip per increment; small, it only keeps the increments' covariance regular."""
    sigma_heading_floor_deg: float = 0.1
    """[deg] floor of an increment's heading standard deviation."""
    max_landmarks: int = 4000
    """The batched filter's covariance grows with the square of this; more landmarks are refused."""
    iterations: int = 2
    """Linearisations of the Schur solution; the first is about the true path."""


class MatchingConfig(Settings, section="matching"):
    """What a particle filter's scan matcher leaves of the odometry's error (conversion ``scan_matching``).

    Defaults: GMapping's search with Gazebo's laser, chosen on simulated explorations of the recipe ``paper``.
    """

    gain: Share = 1.0
    """[0-1] share of the pose error against the map drawn so far that one match removes."""
    prior: Positive = 4.0
    """[beams] weight of the pose that the matcher tends to by itself: it holds where walls leave a direction open."""
    lag: Share = 0.55
    """[-] share of the motion lost in such directions: a scan overlaps the known map more the less it has moved."""
    wander: NonNegative = 0.05
    """[m] random error in such directions; as much of the heading in radians."""
    scatter: NonNegative = 0.03
    """[m] error of one beam against the map, independent of the others': a match errs less the more walls it sees."""
    thin_wall: NonNegative = 0.0
    """[m] Up to this thickness matching takes a wall's new face for the known one; 0 distinguishes them."""
    noise: NonNegative = 0.4
    """Share of the motion noise that the path of the best particle keeps: others with more of it died out."""
    motion: MotionNoise = field(default_factory=MotionNoise)
    """The filter's motion noise."""
    least_beams: int = 30
    """Scans with fewer beams on known walls are not matched and odometry stands: six tenths of GMapping's
    minimumScore, as beams beside known cells score, too."""
    beam_skip: int = 0
    """Beams left out between two that are matched."""
    usable_range: Positive = 3.0
    """[m] Longer beams are not matched."""


class SensingConfig(Settings, section="sensing"):
    """The simulator's laser and furniture, and how SLAM draws (renderer ``scans``, conversion ``scan_matching``)."""

    lidar: LidarConfig = field(default_factory=LidarConfig)
    clutter: ClutterConfig = field(default_factory=ClutterConfig)
    slam: SlamConfig = field(default_factory=SlamConfig)
    """How hits and visits become cells."""


class RenderConfig(Settings, section="render"):
    """How the displaced map is drawn."""

    renderer: Literal["warp", "scans"] = "warp"
    """warp: the CAD map pulled through the displacement field, unknown where nobody looked; scans: the
    simulator's scans drawn at their believed poses by the mapper's own counts (``sensing``)."""
    smoothing: float = 0.1
    """[m] Gaussian over the densified field; 2 px of a 256 px map at 0.05 m."""
    inversions: int = 6
    """Fixed-point iterations from true to output pixels."""


class ParametricConfig(Settings):
    """The whole model."""

    method: ConversionMethod = "ekf_schur"
    """Conversion of odometry errors to map errors. ekf: batched EKF-SLAM, as printed; ekf_schur: its answer as
    one least-squares problem, at any size; two_phase: dead reckoning; scan_matching: what a particle filter
    leaves of it."""
    resolution: Positive = 0.05
    """[m/px]"""
    margin: float = 0.5
    """[m] of unknown round the plan, room for the drift."""
    severity: NonNegative = 1.0
    """[-] multiplies every magnitude; 0 gives the CAD map back where the robot looked."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    scanner: ScannerConfig = field(default_factory=ScannerConfig)
    lidar: LidarErrorConfig = field(default_factory=LidarErrorConfig)
    odometry: OdometryErrorConfig = field(default_factory=OdometryErrorConfig)
    two_phase: TwoPhaseConfig = field(default_factory=TwoPhaseConfig)
    ekf: EkfConfig = field(default_factory=EkfConfig)
    matching: MatchingConfig = field(default_factory=MatchingConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    render: RenderConfig = field(default_factory=RenderConfig)

    def _check(self) -> None:
        lidar = self.lidar
        weights = (lidar.weight_hit, lidar.weight_short, lidar.weight_max, lidar.weight_rand)
        if not math.isclose(sum(weights), 1.0, abs_tol=1e-6):
            raise ConfigError(f"the four beam weights must sum to 1, not {weights}")


def scaled(config: ParametricConfig) -> ParametricConfig:
    """The same settings with the severity multiplied into every magnitude, and severity 1.

    Shares of stray beams grow with the severity until none hits; variances, not means, of the draws scale.
    """
    s, lidar, matching = config.severity, config.lidar, config.matching
    stray = lidar.weight_short + lidar.weight_max + lidar.weight_rand
    factor = min(s, 1.0 / stray) if stray > 0.0 else 0.0
    short, long, rand = (w * factor for w in (lidar.weight_short, lidar.weight_max, lidar.weight_rand))
    return dataclasses.replace(
        config,
        severity=1.0,
        lidar=dataclasses.replace(
            _times(lidar, s, "a0 a1 b1 b2 b3 b4 b5 b6 sigma_range sigma_bearing"),
            weight_hit=1.0 - short - long - rand,
            weight_short=short,
            weight_max=long,
            weight_rand=rand,
        ),
        odometry=_times(config.odometry, s, "alpha_eb_deg kappa_deg scale"),
        two_phase=_times(config.two_phase, s, "k_l k_lt k_t s_l s_lt s_t"),
        ekf=_times(config.ekf, s, "noise"),
        matching=dataclasses.replace(
            _times(matching, s, "wander scatter noise"), lag=min(1.0, s * matching.lag)
        ),
        sensing=dataclasses.replace(config.sensing, lidar=_scaled_lidar(config.sensing.lidar, s)),
    )


def _times(settings: _SettingsT, factor: float, names: str) -> _SettingsT:
    """Settings with these of them, separated by blanks, multiplied."""
    return dataclasses.replace(settings, **{name: factor * getattr(settings, name) for name in names.split()})


def _scaled_lidar(lidar: LidarConfig, s: float) -> LidarConfig:
    """The simulator's laser with its errors multiplied; exact at 0."""
    if s == 0.0:
        return lidar_level("exact", lidar)
    shares = {name: min(1.0, s * getattr(lidar, name)) for name in ("lost", "stray", "bursts")}
    return dataclasses.replace(
        lidar, sigma=s * lidar.sigma, sigma_relative=s * lidar.sigma_relative, bias=s * lidar.bias, **shares
    )
