"""A 2D laser scanner: exact geometry, and the ways in which a measured range differs from it."""

import math
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np

from slamgym.core.config import NonNegative, Positive, Settings, Share, Within, suggest
from slamgym.core.errors import ConfigError
from slamgym.core.geometry import compose
from slamgym.core.types import Float32Array, FloatArray, LaserGeometry, LaserScan, Pose2D
from slamgym.sim.raycast import cast_rays


class LidarConfig(Settings, section="lidar"):
    """A scanner's beams and its errors.

    The geometry is the LDS-01's of a TurtleBot3 Waffle Pi, with the 180 degrees of view ahead that Daher et
    al. use. A beam ends in one of four ways, drawn again for each (Thrun, Burgard and Fox, Probabilistic
    Robotics, 2005, section 6.3, eq. 6.4 to 6.12): it hits, something unexpected is nearer, it gets no return,
    or it reads at random. The default errors lie between the two named levels of :func:`lidar_level`: the
    range noise of ROBOTIS's Gazebo model, and 2 % of all beams failing.
    """

    num_beams: Annotated[int, Within(ge=2)] = 180
    """Beams in a scan; the LDS-01 has one a degree."""

    field_of_view_deg: Annotated[float, Within(gt=0.0, le=360.0)] = 180.0
    """Angle that the beams share evenly, centred ahead; 360 for the full turn of the LDS-01 [deg]."""

    range_min: NonNegative = 0.12
    """Nearest distance that is measured (LDS-01 data sheet) [m]."""

    range_max: float = 3.5
    """Furthest distance that is measured (LDS-01 data sheet) [m]."""

    rate: Positive = 5.0
    """Scans per second (LDS-01 data sheet: 300 rpm) [Hz]."""

    mount: tuple[float, float, float] = (-0.064, 0.0, 0.0)
    """Sensor in the robot's base frame (x, y, theta), from the Waffle Pi's ``base_scan`` joint [m, m,
    rad]."""

    sigma: NonNegative = 0.01
    """Least standard deviation of a range (``turtlebot3_waffle_pi.gazebo.xacro``: 0.01) [m]."""

    sigma_relative: NonNegative = 0.0
    """Standard deviation as a share of the range, where that is more than ``sigma``."""

    z_hit: Share = 0.98
    """Share of beams that measure what is there, with Gaussian noise along the beam (eq. 6.4)."""

    z_short: Share = 0.005
    """Share of beams stopped before it: dust, a fly, a cable; exponential (eq. 6.7)."""

    z_max: Share = 0.01
    """Share of beams without a return: black, glass, mirrors (eq. 6.10)."""

    z_rand: Share = 0.005
    """Share of beams that read anything: cross-talk, phantom echoes; uniform (eq. 6.11)."""

    lambda_short: Positive = 1.0
    """Decay of the short readings; their mean distance in open space is 1 / lambda_short [1/m]."""

    def _check(self) -> None:
        if self.range_min >= self.range_max:
            raise ConfigError(
                f"lidar.range_min must be less than lidar.range_max, not {self.range_min} and {self.range_max}"
            )
        if abs(sum(self.mixture) - 1.0) > 1e-6:
            raise ConfigError(f"lidar z_hit, z_short, z_max, z_rand must sum to 1, not {self.mixture}")

    @property
    def mixture(self) -> tuple[float, float, float, float]:
        """Shares of hit, short, max and rand."""
        return self.z_hit, self.z_short, self.z_max, self.z_rand

    @property
    def geometry(self) -> LaserGeometry:
        """The beams.

        Convention: beam 0 is the rightmost. A full turn has its last beam one increment before its first; a
        part of a turn has a beam at either end, so 180 beams over 180 degrees are 180/179 degrees apart.
        """
        full_turn = self.field_of_view_deg == 360.0
        view = math.radians(self.field_of_view_deg)
        increment = view / (self.num_beams if full_turn else self.num_beams - 1)
        return LaserGeometry(
            num_beams=self.num_beams,
            angle_min=-0.5 * view,
            angle_increment=increment,
            range_min=self.range_min,
            range_max=self.range_max,
            mount=Pose2D(*self.mount),
        )


LidarLevel = Literal["exact", "gazebo", "lds01"]

_EXACT: dict[str, Any] = {
    "sigma": 0.0, "sigma_relative": 0.0, "z_hit": 1.0, "z_short": 0.0, "z_max": 0.0, "z_rand": 0.0,
}  # fmt: skip
_LEVELS: dict[LidarLevel, dict[str, Any]] = {
    "exact": _EXACT,
    "gazebo": {**_EXACT, "sigma": 0.01},
    # The data sheet's limits are taken for three standard deviations: +-15 mm below 0.5 m, a precision of 3.5
    # % beyond. (Its accuracy of 5 % holds a constant part too, which isn't noise.) The data sheet is silent
    # on failing beams; 5 % is AMCL's own share of them (laser_z_hit 0.95), mostly short as in its weights.
    "lds01": {
        "sigma": 0.005, "sigma_relative": 0.035 / 3.0, "z_hit": 0.95, "z_short": 0.03, "z_max": 0.01, "z_rand": 0.01,
    },
}  # fmt: skip


def lidar_level(name: str, geometry: LidarConfig | None = None) -> LidarConfig:
    """A scanner with one of the named error levels.

    ``exact`` has no error. ``gazebo`` is ROBOTIS's Gazebo model of the LDS-01: every beam hits, sigma 0.01 m.
    ``lds01`` follows the LDS-01's data sheet: sigma 5 mm near and 1.2 % of the range beyond, 5 % of all beams
    failing.

    Args:
        name: The level.
        geometry: Settings whose beams and ranges are kept; the default LDS-01 where left out.

    Raises:
        ConfigError: If there is no such level.
    """
    for level, errors in _LEVELS.items():
        if level == name:
            return replace(geometry or LidarConfig(), **errors)
    raise ConfigError(f"unknown lidar level {name!r}; {suggest(name, _LEVELS)}")


class Lidar:
    """A scanner on a robot."""

    def __init__(self, config: LidarConfig) -> None:
        self.config = config
        self.geometry = config.geometry

    @cached_property
    def _perfect(self) -> bool:
        config = self.config
        return config.z_hit == 1.0 and config.sigma == 0.0 and config.sigma_relative == 0.0

    def true_ranges(self, pose: Pose2D, segments: FloatArray) -> FloatArray:
        """The distance to what each beam meets first.

        Convention: ``pose`` is the robot's *base* in the frame of the segments; the mount is applied here.

        Args:
            pose: The robot's base.
            segments: What can be seen, shape (S, 4) as x0, y0, x1, y1 [m].

        Returns:
            Ranges, shape (num_beams,) float64 [m]; ``inf`` where nothing is within ``range_max``.
        """
        geometry = self.geometry
        sensor = compose(pose, geometry.mount)
        if segments.flags.writeable:
            # Always the read-only type, so that the kernel is compiled once.
            segments = segments.view()
            segments.flags.writeable = False
        ranges = np.empty(geometry.num_beams)
        angle_min, increment = geometry.angle_min, geometry.angle_increment
        cast_rays(*sensor, angle_min, increment, segments, geometry.range_max, ranges)
        return ranges

    def scan(self, pose: Pose2D, segments: FloatArray, rng: np.random.Generator, stamp: float) -> LaserScan:
        """Measure.

        Convention: as :meth:`true_ranges`. Errors lie along the beam: a beam's direction is always exact.

        Args:
            pose: The robot's base.
            segments: What can be seen, shape (S, 4) [m].
            rng: Source of the errors.
            stamp: Time of the scan [s].

        Returns:
            The scan, with ranges as REP 117 wants them.
        """
        return self.measure(self.true_ranges(pose, segments), rng, stamp)

    def measure(self, true_ranges: FloatArray, rng: np.random.Generator, stamp: float) -> LaserScan:
        """Make a scan of ranges known already, for a caller who needs both.

        Args:
            true_ranges: From :meth:`true_ranges`, shape (num_beams,) [m].
            rng: Source of the errors.
            stamp: Time of the scan [s].
        """
        ranges = true_ranges if self._perfect else self._draw_errors(true_ranges, rng)
        return LaserScan(stamp, self._as_rep117(ranges), self.geometry)

    def _draw_errors(self, true: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw a measurement for each beam from the mixture of Probabilistic Robotics, section 6.3."""
        config = self.config
        sigma = np.maximum(config.sigma, config.sigma_relative * np.minimum(true, config.range_max))
        measured = true + sigma * rng.standard_normal(true.shape)  # eq. 6.4
        fate = rng.random(true.shape)
        failed = np.flatnonzero(fate >= config.z_hit)
        if len(failed) == 0:
            return measured
        fate = fate[failed]
        ends = np.cumsum(config.mixture)
        draws = rng.random(len(failed))
        # Eq. 6.7, an exponential cut off at the true range, by inversion of its distribution function.
        mass = -np.expm1(-config.lambda_short * np.minimum(true[failed], config.range_max))
        short = -np.log1p(-draws * mass) / config.lambda_short
        anything = draws * config.range_max  # eq. 6.11
        measured[failed] = np.where(fate < ends[1], short, np.where(fate < ends[2], np.inf, anything))
        return measured

    def _as_rep117(self, ranges: FloatArray) -> Float32Array:
        """Too near to measure is -inf, nothing in range is +inf."""
        out = ranges.astype(np.float32)
        out[ranges < self.config.range_min] = -np.inf
        out[ranges > self.config.range_max] = np.inf
        return out
