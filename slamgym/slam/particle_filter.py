"""GMapping's Rao-Blackwellised particle filter (Grisetti, Stachniss and Burgard, T-RO 23(1), 2007).

Each particle carries its own path and map. A processed scan moves every particle by odometry with
noise, then to the best match with its own map; the match's likelihood weighs it, and when few particles hold
most of the weight they are resampled.
"""

import math

import numpy as np

from slamgym.core.geometry import between, compose, wrap_angle
from slamgym.core.jit import plain
from slamgym.core.portable import product
from slamgym.core.types import (
    Float32Array,
    FloatArray,
    IntArray,
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Trajectory,
)
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import farthest, usable_end_points
from slamgym.slam.hill_climbing import MatchSettings
from slamgym.slam.mapper import Mapper
from slamgym.slam.motion_model import noise_array, sample_motion
from slamgym.slam.odometry_calibration import OdometryCalibration
from slamgym.slam.particles import (
    ParticleMaps,
    TrajectoryTree,
    effective_sample_size,
    normalized_weights,
    systematic_resample,
    trace_lineage,
)
from slamgym.slam.scan_match import align_freely, match_particles
from slamgym.slam.uncertainty import PathUncertainty, match_covariance

POSITION_FLOOR = 0.005
HEADING_FLOOR = 0.003
"""Odometry is never trusted further than this [m], [rad]."""
FIRST_STEP = 0.05
"""First step of the search in x and y [m] (GMapping's ``lstep``)."""
LIKELIHOOD_SIGMA = 0.075
"""Width of the log-likelihood -d^2 / sigma that weighs the particles [m^2] (GMapping's ``lsigma``)."""
NULL_LIKELIHOOD = -0.5
"""-d^2 of a beam with nothing near [m^2] (GMapping's ``nullLikelihood``)."""
COMMON_ERROR = 40.0
"""A laser's bias moves all points of a surface together: where a match is compared with the odometry, its variances
are so many times larger. Matches of the default laser err by 1 cm and 5 mrad over half a metre; 0.7 of
that is taken, for there are better lasers."""
DOUBT_SHARE = 0.6
"""A match of which less than this share of the points fits is in doubt ..."""
FEW_POINTS = 20
"""... and a scan with fewer points says nothing."""
RELIABLE_SHARE, RELIABLE_METRES, RELIABLE_RADIANS = 0.5, 0.02, 0.01
"""The odometry is compared with matches of which so much fits, and whose deviation along the heading [m] and in it
[rad] is no more."""
MATCH_MARGIN = 1.5
"""Margin round the scan's end points where the maps are made ready [m]; a match that strays further finds nothing."""


def match_settings(config: SlamConfig) -> MatchSettings:
    """The settings as the matching kernels take them, lengths in cells."""
    return MatchSettings(
        gain=config.resolution**2 / config.sigma,
        likelihood_gain=config.resolution**2 / LIKELIHOOD_SIGMA,
        miss=NULL_LIKELIHOOD / LIKELIHOOD_SIGMA,
        stride=config.beam_skip + 1,
        linear_step=FIRST_STEP / config.resolution,
        only_climbs=config.matcher == "hill_climbing",
        halvings=config.iterations,
        minimum_score=float(config.minimum_score),
        odometry_weight=float(config.odometry_weight),
    )


class ParticleFilter(Mapper):
    """Modes ``rbpf`` and ``scan_matching``; see :class:`slamgym.slam.mapper.Mapper`."""

    def __init__(
        self, config: SlamConfig, geometry: LaserGeometry, initial_pose: Pose2D, rng: np.random.Generator
    ) -> None:
        count = config.particles if config.mode == "rbpf" else 1
        super().__init__(config, geometry)
        self._rng = rng
        self._noise = noise_array(config.motion)
        self._poses: FloatArray = np.tile(np.array(initial_pose, dtype=np.float64), (count, 1))
        self._log_weights = np.zeros(count)  # since the last resampling
        self._path_log_weights = np.zeros(count)  # over the whole path
        self._weights: FloatArray = np.full(count, 1.0 / count)
        self._maps = ParticleMaps(count, config.resolution, config.memory_limit_mb)
        self._tree = TrajectoryTree(count, geometry.num_beams)
        self._lineage: IntArray = np.zeros(0, dtype=np.int64)  # of the path drawn
        self._drawn_poses: FloatArray = np.zeros((0, 3))
        self._end_points = np.zeros((geometry.num_beams, 2))
        self._match_settings = plain(match_settings(config))
        self._calibration = OdometryCalibration() if config.learn_odometry else None
        self._free_offset = Pose2D(0.0, 0.0, 0.0)
        self._match_covariance: FloatArray | None = None
        self._uncertainty = PathUncertainty(geometry.num_beams * geometry.angle_increment)

    @property
    def pose(self) -> Pose2D:
        """The best particle's pose, moved on by the odometry since."""
        return compose(Pose2D(*self._poses[self.best_particle].tolist()), self._gate.since_processed)

    @property
    def best_particle(self) -> int:
        """The particle whose whole path explains the scans best."""
        return int(self._path_log_weights.argmax())

    def particle_paths(self, most: int) -> list[FloatArray]:
        """Paths of at most so many particles, each (processed scans, 3)."""
        # After a resampling the places of the particles changed; their parents are at the last scan.
        count = min(most, len(self._poses)) if len(self._tree) else 0
        return [self._tree.poses_along(self._tree.lineage(particle)) for particle in range(count)]

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) of the pose at the last processed scan: that of one path, and between the particles."""
        best = self._poses[self.best_particle]
        deviations = self._poses - best
        deviations[:, 2] = wrap_angle(deviations[:, 2])
        deviations -= (self._weights[:, None] * deviations).sum(axis=0)
        spread = product((deviations * self._weights[:, None]).T, deviations)
        return np.asarray(self._uncertainty.at(best, self._match_covariance) + spread, dtype=np.float64)

    @property
    def n_eff(self) -> float:
        """Effective number of particles at the last processed scan, before resampling."""
        return self._stats.n_eff[-1] if self._stats.n_eff else float(len(self._poses))

    def know(self, grid: OccupancyGrid) -> None:
        """Begin with an older map, which scans are matched with, too."""
        super().know(grid)
        self._new_particle_maps()

    def _new_particle_maps(self) -> None:
        """Begin the maps that scans are matched with, on what was known before."""
        self._maps = ParticleMaps(len(self._poses), self._config.resolution, self._config.memory_limit_mb)
        if self._known is not None:
            self._maps.add_known(self._known)

    def _num_bytes(self) -> int:
        return self._maps.num_bytes + self._tree.num_bytes

    def _process(self, scan: LaserScan) -> None:
        """One step of the filter: predict, match, weigh, resample, register."""
        increments = self._gate.take(scan.stamp)
        before = self._poses.copy()
        variances = self._predict(increments)
        predicted = self._poses.copy()
        points = self._usable_points(scan.ranges)
        self._maps.cover(self._poses, farthest(points) + MATCH_MARGIN)
        best = 0
        if len(self._tree) > 0:
            best = self._match_and_weigh(points, *variances)
            free, share = self._assess_match(scan.stamp, increments, predicted[best], best, points)
            fits = share >= RELIABLE_SHARE and len(points) >= FEW_POINTS
            self._learn(increments, before[best], best, free, fits)
        matched = self._poses[best].copy()
        if len(self._tree) > 0 and self.n_eff < self._config.resample_threshold * len(self._poses):
            self._resample()
        self._tree.add(scan.stamp, self._poses, scan.ranges)
        self._maps.register(self._poses, points)
        self._uncertainty.move(before[best], matched, np.array(variances))
        if self._uncertainty.needs_node:
            self._add_node(scan, matched)

    def _add_node(self, scan: LaserScan, pose: FloatArray) -> None:
        """Note how far the path may be off here."""
        del scan
        self._uncertainty.append(pose, self._match_covariance)
        if self._match_covariance is not None:
            self._uncertainty.revisit(self._match_covariance)

    def _usable_points(self, ranges: Float32Array, longest: float = math.inf) -> FloatArray:
        """End points (n, 2) in the robot frame that can be matched; valid until the next call."""
        usable = min(self._beams.usable, longest, float(np.nextafter(self._beams.range_max, 0.0)))
        return self._end_points[: usable_end_points(ranges, plain(self._beams), usable, self._end_points)]

    def _predict(self, increments: FloatArray) -> tuple[float, float]:
        """Move the particles by odometry; returns the variances of position and heading that result."""
        count = len(self._poses)
        rbpf = self._config.mode == "rbpf"
        if self._calibration is None:
            shape = (len(increments), count, 3)
            normals = self._config.drawn_noise * self._rng.standard_normal(shape) if rbpf else np.zeros(shape)
            variance, turn_variance = sample_motion(self._poses, increments, normals, self._noise)
            return variance + POSITION_FLOOR**2, turn_variance + HEADING_FLOOR**2
        spread = self._calibration.spread(increments)
        corrected = self._calibration.correct(increments)
        sample_motion(self._poses, corrected, np.zeros((len(increments), count, 3)), self._noise)
        if rbpf:
            deviations = np.sqrt([spread.random_distance, spread.random_distance, spread.random_heading])
            self._poses += self._config.drawn_noise * deviations * self._rng.standard_normal((count, 3))
        return spread.distance + POSITION_FLOOR**2, spread.heading + HEADING_FLOOR**2

    def _align_freely(self, pose: FloatArray, points: FloatArray, particle: int = 0) -> FloatArray:
        """Alignment by the scan alone from a pose on: pose, score, binding; see :func:`align_freely`."""
        free = np.empty(10)
        align_freely(plain(self._maps.tile_maps), particle, pose, points, self._match_settings, free)
        return free

    def _resettle(
        self, increments: FloatArray, predicted: FloatArray, points: FloatArray, share: float
    ) -> float:
        """Nothing is tried; a mode that can search wider does."""
        del increments, predicted, points
        return share

    def _assess_match(
        self, stamp: float, increments: FloatArray, predicted: FloatArray, best: int, points: FloatArray
    ) -> tuple[FloatArray, float]:
        """Align the best particle's scan freely; where it fits poorly, search wider or note the doubt.

        Returns:
            What :meth:`_align_freely` gives, and the share of the points that fit.
        """
        free = self._align_freely(self._poses[best], points, best)
        share = free[3] / max(len(points), 1)
        if self._calibration is not None and share < DOUBT_SHARE and len(points) >= FEW_POINTS:
            found = self._resettle(increments, predicted, points, share)
            if found > share:
                free = self._align_freely(self._poses[best], points, best)
            if found < DOUBT_SHARE:
                self._stats.doubtful.append(stamp)
            share = found
        return free, share

    def _learn(
        self, increments: FloatArray, before: FloatArray, best: int, free: FloatArray, fits: bool
    ) -> None:
        """Note how well the best particle's match is known; where it can be relied on, compare it with the odometry."""
        last_offset = self._free_offset
        matched, aligned = Pose2D(*self._poses[best].tolist()), Pose2D(*free[:3].tolist())
        self._free_offset = between(matched, aligned)
        covariance = match_covariance(free[4:])
        along = np.array([math.cos(matched.theta), math.sin(matched.theta), 0.0])
        along_variance = float((covariance * np.outer(along, along)).sum())
        turn_variance = float(covariance[2, 2])
        reliable = fits and along_variance <= RELIABLE_METRES**2 and turn_variance <= RELIABLE_RADIANS**2
        self._match_covariance = covariance if reliable else None
        if self._calibration is None:
            return
        if not reliable:
            self._calibration.restart()
            return
        moved = between(compose(Pose2D(*before.tolist()), last_offset), aligned)
        along_variance, turn_variance = COMMON_ERROR * along_variance, COMMON_ERROR * turn_variance
        self._calibration.learn(increments, moved, along_variance, turn_variance)

    def _match_and_weigh(self, points: FloatArray, variance: float, turn_variance: float) -> int:
        """Move the particles to their best matches and weigh them; returns the best particle."""
        likelihoods, maps = np.empty(len(self._poses)), plain(self._maps.tile_maps)
        settings = self._match_settings
        matched = match_particles(maps, self._poses, points, variance, turn_variance, settings, likelihoods)
        self._stats.refused_matches += len(self._poses) - matched
        self._log_weights += likelihoods
        self._path_log_weights += likelihoods
        self._weights = normalized_weights(self._log_weights)
        self._stats.n_eff.append(effective_sample_size(self._weights))
        return self.best_particle

    def _resample(self) -> None:
        ancestors = systematic_resample(self._weights, float(self._rng.random()))
        self._poses = self._poses[ancestors]
        self._path_log_weights = self._path_log_weights[ancestors]
        self._maps.resample(ancestors)
        self._tree.resample(ancestors)
        self._log_weights = np.zeros(len(self._poses))
        self._weights = np.full(len(self._poses), 1.0 / len(self._poses))
        self._stats.resamplings += 1

    def _draw_path(self) -> None:
        """Make the drawn path that of the best particle: take out what it doesn't share, draw the rest."""
        steps, known, ranges = len(self._tree), len(self._lineage), self._tree["ranges"]
        if steps == 0:
            return
        lineage = np.full(steps, -1, dtype=np.int64)
        lineage[:known] = self._lineage
        first = trace_lineage(self._tree["parents"], steps - 1, self.best_particle, lineage)
        self._map.draw(self._drawn_poses[first:], ranges[first:known], sign=-1)
        poses = self._tree.poses_along(lineage, first)
        self._map.draw(poses, ranges[first:])
        self._lineage = lineage
        self._drawn_poses = np.concatenate([self._drawn_poses[:first], poses])

    def trajectory(self) -> Trajectory:
        """The best particle's path."""
        lineage = self._tree.lineage(self.best_particle)
        return Trajectory(self._tree["stamps"].copy(), self._tree.poses_along(lineage))
