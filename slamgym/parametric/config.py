"""Settings of the parametric CAD -> SLAM model with the sources of their default magnitudes.

"OptiOdom" is the public data set of that name (a differential drive robot tracked by cameras; MIT licence), from which
the odometry magnitudes were computed. Magnitudes that nothing changes but the severity stand next to their formulas.
"""

import math
from dataclasses import field
from typing import Literal, NamedTuple

from slamgym.core.config import NonNegative, Positive, Settings
from slamgym.sim.lidar import LidarConfig

ConversionMethod = Literal["ekf_schur", "ekf", "two_phase"]
Equations = Literal["corrected", "printed"]


class MotionConfig(Settings, section="motion"):
    """Where the robot takes a scan on its way."""

    scan_spacing: float = 0.15
    """[m] of driving between two scans that enter the map."""
    scan_angle: float = 0.2
    """[rad] of turning between two scans that enter the map; GMapping's angularUpdate on a TurtleBot3."""


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

    def times(self, severity: float) -> "TwoPhaseConfig":
        """The same robot with all errors multiplied."""
        return TwoPhaseConfig(
            k_l=severity * self.k_l,
            k_lt=severity * self.k_lt,
            k_t=severity * self.k_t,
            s_l=severity * self.s_l,
            s_lt=severity * self.s_lt,
            s_t=severity * self.s_t,
        )


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


class ParametricConfig(Settings):
    """The whole model."""

    method: ConversionMethod = "ekf_schur"
    """Conversion of odometry errors to map errors. ekf: the paper's EKF-SLAM, up to 128 px a side; ekf_schur: our own,
    its answer as one least-squares problem, at any size; two_phase: the paper's other, dead reckoning."""
    equations: Equations = "corrected"
    """corrected: each beam is one kind of a mixture; printed: the paper's LIDAR model with its misprints, as far as it
    can be computed."""
    resolution: Positive = 0.05
    """[m/px]"""
    severity: NonNegative = 1.0
    """[-] multiplies every magnitude; 0 gives the CAD map back where the robot looked."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    two_phase: TwoPhaseConfig = field(default_factory=TwoPhaseConfig)
    ekf: EkfConfig = field(default_factory=EkfConfig)
