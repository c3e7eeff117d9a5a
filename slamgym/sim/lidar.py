"""A 2D laser scanner: exact geometry, and the ways in which a measured range differs from it."""

import math
from dataclasses import replace
from typing import Annotated, Literal, NamedTuple

import numpy as np

from slamgym.core.config import NonNegative, Settings, Share, Within, suggest
from slamgym.core.errors import ConfigError
from slamgym.core.jit import plain
from slamgym.core.types import (
    AT_REST,
    FloatArray,
    IntArray,
    LaserGeometry,
    LaserScan,
    Pose2D,
    Twist2D,
)
from slamgym.sim.beams import BeamModel, fail_beams, measure_beams, write_rep117
from slamgym.sim.surfaces import SurfaceConfig, Surfaces, no_surfaces
from slamgym.sim.sweep import look_along

OPAQUE_SURFACES = SurfaceConfig(dark=0.1, roughness=0.005, frames=0.02)
"""A building without glass and mirrors, in which an exploration can be completed: the default."""

REAL_SURFACES = replace(OPAQUE_SURFACES, glazing=0.06, inner_glazing=0.01, mirrors=0.005)
"""The materials of the level ``real``."""

SHORTEST_BURST = 3
"""Least number of beams in a row that a burst of cross-talk hits."""
LONGEST_BURST = 12
"""Largest number of beams in a row that a burst of cross-talk hits."""


class LidarConfig(Settings, section="lidar"):
    """A scanner's beams and its errors.

    The geometry is the LDS-01's of a TurtleBot3 Waffle Pi, with the 180 degrees of view ahead that Daher et
    al. use. What fails belongs to the place (:mod:`slamgym.sim.surfaces`) and follows from how the beam meets
    it (:mod:`slamgym.sim.beams`); only a small share of the beams fails by itself. The default is the level
    ``real`` of :func:`lidar_level` without glass and mirrors; docs/sensor.md says which recorded logs its
    figures come from.
    """

    num_beams: Annotated[int, Within(ge=2, le=20_000)] = 180
    """Beams in a scan; the LDS-01 has one a degree."""

    field_of_view_deg: Annotated[float, Within(gt=0.0, le=360.0)] = 180.0
    """Angle that the beams share evenly, centred ahead; 360 for the full turn of the LDS-01 [deg]."""

    range_min: Annotated[float, Within(ge=0.0, le=1000.0)] = 0.12
    """Nearest distance that is measured (LDS-01 data sheet) [m]."""

    range_max: Annotated[float, Within(gt=0.0, le=1000.0)] = 3.5
    """Furthest distance that is measured (LDS-01 data sheet) [m]."""

    rate: Annotated[float, Within(ge=0.1, le=1000.0)] = 5.0
    """Scans per second (LDS-01 data sheet: 300 rpm) [Hz]."""

    mount: Annotated[tuple[float, float, float], Within(ge=-100.0, le=100.0)] = (-0.064, 0.0, 0.0)
    """Sensor in the robot's base frame (x, y, theta), from the Waffle Pi's ``base_scan`` joint [m, m,
    rad]."""

    sweep: NonNegative | None = None
    """Time from the first beam of a scan, whose stamp it has, to its last, which is now [s]; at most ``1 / rate``.
    None: as of a mirror that turns once from a scan to the next, 0.1 s for 180 degrees at 5 Hz. A robot that turns at
    1.8 rad/s skews such a scan by 0.18 rad, which mappers take out by odometry. 0: all at once, as in Gazebo and by the
    levels ``exact`` and ``gazebo``."""

    sigma: NonNegative = 0.0033
    """Least standard deviation of a range; the LDS-01 data sheet's precision of 10 mm below 0.5 m, taken for
    three standard deviations [m]."""

    sigma_relative: NonNegative = 0.035 / 3.0
    """Standard deviation as a share of the range, where that is more than ``sigma``; data sheet: 3.5 %."""

    bias: NonNegative = 1.0
    """The part of the error that stays the same at a place, as a multiple of the standard deviation. The data
    sheet's accuracy of 15 mm and 5 % holds both parts: without the precision 11 mm and 3.6 % are left."""

    beam_width_deg: NonNegative = 0.3
    """Width of a beam's footprint; over an edge it measures a range in between [deg]."""

    attenuation: NonNegative = 0.1
    """Share of the echo of a matt white wall straight ahead at ``range_max`` that is needed to hear it; farther,
    darker and flatter surfaces are lost. 0: every echo is heard."""

    lost: Share = 0.001
    """Share of the beams without a return for no reason of the place."""

    stray: Share = 0.001
    """Share of the beams that read anything up to the true range: dust, cross-talk of a single beam."""

    bursts: Share = 0.002
    """Probability of a burst of cross-talk in a scan: some neighbouring beams read short."""

    surfaces: SurfaceConfig = OPAQUE_SURFACES
    """Materials of the building."""

    def _check(self) -> None:
        if self.range_min >= self.range_max:
            raise ConfigError(
                f"lidar.range_min must be less than lidar.range_max, not {self.range_min} and {self.range_max}"
            )
        if (self.sweep or 0.0) > 1.0 / self.rate:
            raise ConfigError(
                f"lidar.sweep must not exceed the time between scans, {1.0 / self.rate:g} s, not {self.sweep}"
            )
        if self.lost + self.stray > 1.0:
            raise ConfigError(
                f"lidar.lost and stray must not exceed 1 together, not {self.lost} + {self.stray}"
            )

    @property
    def _increment(self) -> float:
        """From a beam to the next [rad]."""
        gaps = self.num_beams if self.field_of_view_deg == 360.0 else self.num_beams - 1
        return math.radians(self.field_of_view_deg) / gaps

    @property
    def scan_time(self) -> float:
        """Time from the first beam of a scan to its last [s]."""
        if self.sweep is not None:
            return float(self.sweep)
        return (self.num_beams - 1) * self._increment / (2.0 * math.pi * self.rate)

    @property
    def geometry(self) -> LaserGeometry:
        """The beams.

        Convention: beam 0 is the rightmost. A full turn has its last beam one increment before its first; a
        part of a turn has a beam at either end, so 180 beams over 180 degrees are 180/179 degrees apart.
        """
        return LaserGeometry(
            num_beams=self.num_beams,
            angle_min=-0.5 * math.radians(self.field_of_view_deg),
            angle_increment=self._increment,
            range_min=self.range_min,
            range_max=self.range_max,
            mount=Pose2D(*self.mount),
            time_increment=self.scan_time / (self.num_beams - 1),
        )


LidarLevel = Literal["exact", "gazebo", "lds01", "real"]

_EXACT = LidarConfig(
    sigma=0.0,
    sigma_relative=0.0,
    bias=0.0,
    beam_width_deg=0.0,
    attenuation=0.0,
    lost=0.0,
    stray=0.0,
    bursts=0.0,
    surfaces=SurfaceConfig(),
    sweep=0.0,
)
"""A scanner without errors that measures all at once, in a building of matt white walls."""

_LEVELS: dict[LidarLevel, LidarConfig] = {
    "exact": _EXACT,
    "gazebo": replace(_EXACT, sigma=0.01),
    "lds01": replace(_EXACT, sigma=0.0033, sigma_relative=0.035 / 3.0, bias=1.0, sweep=None),
    "real": LidarConfig(surfaces=REAL_SURFACES),
}
"""The errors of each level, with the beams and ranges of the LDS-01."""


def lidar_level(name: str, geometry: LidarConfig | None = None) -> LidarConfig:
    """A scanner with one of the named error levels.

    ``exact`` has no error. ``gazebo`` is ROBOTIS's Gazebo model of the LDS-01: every beam hits, sigma 0.01 m.
    ``lds01`` is the LDS-01's data sheet: a constant and a random part of each range's error, no beam failing.
    ``real`` adds what recorded logs show: glass, mirrors, dark surfaces, edges, lost and stray beams.

    Args:
        name: The level.
        geometry: Settings whose beams and ranges are kept, and the time of its scans if it names one; the default
            LDS-01 where left out.

    Raises:
        ConfigError: If there is no such level.
    """
    beams = geometry or LidarConfig()
    for level, errors in _LEVELS.items():
        if level == name:
            return replace(
                errors,
                num_beams=beams.num_beams,
                field_of_view_deg=beams.field_of_view_deg,
                range_min=beams.range_min,
                range_max=beams.range_max,
                rate=beams.rate,
                mount=beams.mount,
                sweep=errors.sweep if beams.sweep is None else beams.sweep,
            )
    raise ConfigError(f"unknown lidar level {name!r}; {suggest(name, _LEVELS)}")


class Sighting(NamedTuple):
    """Surfaces that the beams of a scanner meet, without errors."""

    sensors: FloatArray
    """Poses of the sensor in the frame of the segments, shape (K, 3) [m, m, rad]: of each part of the beams."""

    segments: FloatArray
    """Segments that can be seen, shape (S, 4) [m]."""

    ranges: FloatArray
    """Distances along the beams, shape (num_beams,) [m]; ``inf`` where nothing is within the range."""

    hits: IntArray
    """The segments met, shape (num_beams,); -1 where none is."""


class Lidar:
    """A scanner on a robot.

    Attributes:
        geometry: The beams.
        law: What decides about an echo.
        is_perfect: True if there are none.
    """

    def __init__(self, config: LidarConfig) -> None:
        self.config = config
        self.geometry = config.geometry
        self._plain = no_surfaces()
        self.law = BeamModel(
            self.geometry.angle_min,
            self.geometry.angle_increment,
            float(config.range_max),
            float(config.sigma),
            float(config.sigma_relative),
            float(config.bias),
            math.radians(config.beam_width_deg),
            float(config.attenuation),
        )
        self._law = plain(self.law)
        at_once = replace(config, sweep=0.0)
        self.is_perfect = at_once == lidar_level("exact", at_once)

    def look(
        self, pose: Pose2D, segments: FloatArray, velocity: Twist2D = Twist2D(0.0, 0.0)
    ) -> Sighting:
        """Find the surface that each beam meets first.

        Convention: ``pose`` is the robot's *base* in the frame of the segments when the last beam is measured; the
        mount is applied here.

        Args:
            pose: The robot's base.
            segments: What can be seen, shape (S, 4) as x0, y0, x1, y1 [m].
            velocity: Of the base while the scan was taken.
        """
        geometry = self.geometry
        if segments.flags.writeable:
            # Always the read-only type, so that the kernel is compiled once.
            segments = segments.view()
            segments.flags.writeable = False
        ranges = np.empty(geometry.num_beams)
        hits = np.empty(geometry.num_beams, dtype=np.int64)
        sweep = self.config.scan_time
        sensors = look_along(
            plain(pose),
            plain(geometry.mount),
            (velocity.linear * sweep, velocity.angular * sweep),
            geometry.angle_min,
            geometry.angle_increment,
            segments,
            geometry.range_max,
            ranges,
            hits,
        )
        return Sighting(sensors, segments, ranges, hits)

    def true_ranges(self, pose: Pose2D, segments: FloatArray) -> FloatArray:
        """The ranges of :meth:`look`, shape (num_beams,) [m]."""
        return self.look(pose, segments).ranges

    def scan(
        self, pose: Pose2D, segments: FloatArray, rng: np.random.Generator, stamp: float
    ) -> LaserScan:
        """Measure in a world of plain surfaces.

        Convention: as :meth:`look`. Errors lie along the beam: a beam's direction is always exact.

        Args:
            pose: The robot's base.
            segments: What can be seen, shape (S, 4) [m].
            rng: Source of the errors.
            stamp: Time of the scan [s].

        Returns:
            The scan, with ranges as REP 117 wants them.
        """
        return self.measure(self.look(pose, segments), rng, stamp)

    def measure(
        self,
        sighting: Sighting,
        rng: np.random.Generator,
        stamp: float,
        surfaces: Surfaces | None = None,
        motion: Pose2D = AT_REST,
    ) -> LaserScan:
        """Make a scan of what the beams meet.

        Args:
            sighting: From :meth:`look`.
            rng: Source of the errors.
            stamp: Time of the first beam [s].
            surfaces: Materials of the segments; plain where left out.
            motion: Of the base until the last beam, by its odometry.
        """
        surfaces = surfaces or self._plain
        if self.is_perfect and len(surfaces.first) == 1:
            ranges = sighting.ranges
        else:
            ranges = self._with_errors(sighting, surfaces, rng)
        out = np.empty(len(ranges), dtype=np.float32)
        write_rep117(ranges, float(self.config.range_min), float(self.config.range_max), out)
        return LaserScan(stamp, out, self.geometry, motion)

    def _with_errors(
        self, sighting: Sighting, surfaces: Surfaces, rng: np.random.Generator
    ) -> FloatArray:
        config = self.config
        true = sighting.ranges
        normal = rng.standard_normal((2, len(true)))
        measured = np.empty(len(true))
        sensors, segments, _, hits = sighting
        measure_beams(sensors, segments, true, hits, plain(surfaces), self._law, normal, measured)
        fate = rng.random((2, len(true) + 1))
        lost = float(config.lost)
        fail_beams(measured, fate, lost, float(config.stray), float(config.range_max))
        if fate[0, -1] < config.bursts:
            first, pulses = self.draw_burst(rng)
            burst = measured[first : first + len(pulses)]
            np.minimum(burst, pulses, out=burst)
        return measured

    def draw_burst(self, rng: np.random.Generator) -> tuple[int, FloatArray]:
        """Draw the pulses of another scanner: the first beam that they hit, and the ranges that it and the next read.

        They are at much the same range; a beam that hears something nearer reads that.
        """
        num_beams = self.geometry.num_beams
        first = int(rng.integers(num_beams))
        count = min(int(rng.integers(SHORTEST_BURST, LONGEST_BURST + 1)), num_beams - first)
        distance = rng.random() * self.config.range_max
        pulses: FloatArray = distance * (1.0 + 0.03 * rng.standard_normal(count))
        return first, pulses
