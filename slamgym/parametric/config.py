"""Settings of the parametric CAD -> SLAM model with the sources of their default magnitudes, and presets.

"OptiOdom" is the public data set of that name (a differential drive robot tracked by cameras; MIT licence), from which
the odometry magnitudes were computed. Magnitudes that nothing changes but the severity stand next to their formulas.
"""

import dataclasses
import math
from dataclasses import field
from typing import Annotated, Literal, NamedTuple, TypeVar

from slamgym.core.config import NonNegative, Positive, Settings, Share, Within, suggest
from slamgym.core.errors import ConfigError
from slamgym.sim.clutter import ClutterConfig
from slamgym.sim.lidar import Lidar, LidarConfig, lidar_level
from slamgym.sim.robot import RobotConfig
from slamgym.sim.wheel_odometry import OdometryConfig
from slamgym.slam.config import MotionNoise, SlamConfig

_SettingsT = TypeVar("_SettingsT", bound=Settings)
ConversionMethod = Literal["ekf_schur", "two_phase", "scan_matching"]


class MotionConfig(Settings, section="motion"):
    """Where the robot takes a scan on its way."""

    scan_spacing: float = 0.15
    """[m] of driving between two scans that enter the map."""
    scan_angle: float = 0.2
    """[rad] of turning between two scans that enter the map; GMapping's angularUpdate on a TurtleBot3."""
    scan_interval: Annotated[float, Within(gt=0.0, infinite=True)] = math.inf
    """[s] between two scans that enter the map at the latest; GMapping's temporalUpdate is 0.5 s on a
    TurtleBot3."""


class ScannerView(NamedTuple):
    """Field of view and ranges of the LIDAR whose beams say what the robot saw, and so where a map is displaced."""

    field_of_view: float = 2.0 * math.pi  # [rad] centred on the robot's heading
    range_min: float = LidarConfig.range_min  # [m]
    range_max: float = LidarConfig.range_max  # [m]
    num_beams: int = 0  # 0 takes as many as let neighbours hit neighbouring cells at full range
    mount_x: float = LidarConfig.mount[0]  # [m] ahead of the axle


class TwoPhaseConfig(Settings, section="two_phase"):
    """Empirical method after Souza et al. 2008: errors of straight lines and of turns in place.

    k: systematic, drawn once per robot; s: random, per square root of the distance. Defaults: OptiOdom.
    :func:`realistic` takes those of the simulated robot.
    """

    k_l: NonNegative = 0.003
    """[-] distance error per metre driven."""
    k_lt: NonNegative = 0.006
    """[rad/m] heading error per metre driven."""
    k_t: NonNegative = 0.010
    """[-] heading error per radian turned."""
    s_l: NonNegative = 0.0005
    """[m/sqrt(m)] random distance error."""
    s_lt: NonNegative = 0.004
    """[rad/sqrt(m)] random heading error of driving."""
    s_t: NonNegative = 0.0035
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
    landmarks_per_scan: int = 10
    """At most so many landmarks update the filter per scan; 0 takes all."""


class MatchingConfig(Settings, section="matching"):
    """Odometry error that a particle filter's scan matcher doesn't remove (conversion ``scan_matching``).

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
    minimumScore, as beams next to known cells score, too."""
    usable_range: Positive = 3.0
    """[m] Longer beams are not matched."""


class SensingConfig(Settings, section="sensing"):
    """The simulator's laser and furniture, and how SLAM draws (``renderer: scans``, conversion ``scan_matching``)."""

    lidar: LidarConfig = field(default_factory=LidarConfig)
    clutter: ClutterConfig = field(default_factory=ClutterConfig)
    slam: SlamConfig = field(default_factory=lambda: SlamConfig(mode="pose_graph"))
    """Rules that turn hits and visits into cells."""


class ParametricConfig(Settings):
    """The whole model."""

    method: ConversionMethod = "ekf_schur"
    """Conversion of odometry errors to map errors. ekf_schur: the answer of EKF-SLAM as one least-squares problem, at
    any size; two_phase: dead reckoning; scan_matching: the error that a particle filter doesn't remove."""
    resolution: Positive = 0.05
    """[m/px]"""
    severity: NonNegative = 1.0
    """[-] multiplies every magnitude; 0 gives the CAD map back where the robot looked."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    two_phase: TwoPhaseConfig = field(default_factory=TwoPhaseConfig)
    ekf: EkfConfig = field(default_factory=EkfConfig)
    matching: MatchingConfig = field(default_factory=MatchingConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    renderer: Literal["warp", "scans"] = "warp"
    """Rendering of the displaced map. warp: the CAD map pulled through the displacement field, unknown where no beam
    went; scans: the simulator's scans drawn at their believed poses by the mapper's own counts (``sensing``)."""

    @property
    def scanner(self) -> ScannerView:
        """The LIDAR of ``sensing``; a warped map is seen all around, as the paper's scanner does."""
        lidar = self.sensing.lidar
        if self.renderer == "warp":
            return ScannerView(range_min=lidar.range_min, range_max=lidar.range_max, mount_x=lidar.mount[0])
        view, num_beams = math.radians(lidar.field_of_view_deg), min(lidar.num_beams, _FIELD_BEAMS)
        range_max = min(lidar.range_max, self.sensing.slam.max_usable_range)
        return ScannerView(view, lidar.range_min, range_max, num_beams, lidar.mount[0])


def scaled(config: ParametricConfig) -> ParametricConfig:
    """The same settings with the severity multiplied into every magnitude among them."""
    s, matching = config.severity, config.matching
    return dataclasses.replace(
        config,
        two_phase=_times(config.two_phase, s, "k_l k_lt k_t s_l s_lt s_t"),
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


PRESET_NAMES = ("faithful", "realistic")
_FIELD_BEAMS = 180  # say where a map of scans is displaced; all beams draw it


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
    slam = sensing.slam
    return ParametricConfig(
        method="scan_matching",
        resolution=slam.resolution,
        motion=MotionConfig(
            slam.linear_update,
            slam.angular_update,
            math.inf if slam.temporal_update is None else slam.temporal_update,
        ),
        two_phase=TwoPhaseConfig(
            k_l=odometry.scale_std,
            k_lt=odometry.diameter_ratio_std / RobotConfig().wheel_separation,
            k_t=odometry.wheelbase_ratio_std,
            s_l=odometry.slip_distance,
            s_lt=odometry.slip_drift,
            s_t=odometry.slip_turn,
        ),
        matching=_matching_of(sensing, odometry),
        sensing=sensing,
        renderer="scans",
    )


def _matching_of(sensing: SensingConfig, odometry: OdometryConfig) -> MatchingConfig:
    """The matcher that stands for a mapper whose robot has such wheels."""
    slam, fitted = sensing.slam, MatchingConfig()
    motion = slam.motion
    if slam.mode != "rbpf":
        fitted = MatchingConfig(
            gain=0.9, prior=26.0, lag=0.04, wander=0.0, scatter=0.02, thin_wall=0.1, least_beams=10
        )
        # What it takes the noise for, at steps of a decimetre and a decirad.
        slips = (odometry.slip_distance, odometry.slip_drift, 0.0, odometry.slip_turn)
        motion = MotionNoise(*(slip / math.sqrt(0.1) for slip in slips))
    elif Lidar(sensing.lidar).depends_on_place:
        fitted = MatchingConfig(wander=0.0, scatter=0.17)
    return dataclasses.replace(
        fitted,
        noise=0.0 if slam.particles == 1 else fitted.noise,
        motion=motion,
        least_beams=round(0.6 * slam.minimum_score) or fitted.least_beams,
        usable_range=slam.max_usable_range,
    )
