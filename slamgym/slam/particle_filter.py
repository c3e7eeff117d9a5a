"""GMapping's Rao-Blackwellised particle filter (Grisetti, Stachniss and Burgard, T-RO 23(1), 2007).

Each particle carries its own path and map. A processed scan moves every particle by odometry with
noise, then to the best match with its own map; the match's likelihood weighs it, and when few particles hold
most of the weight they are resampled.
"""

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import plain
from slamgym.core.portable import product
from slamgym.core.types import FloatArray, LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.hill_climbing import MatchSettings, match_particles
from slamgym.slam.mapper import Mapper
from slamgym.slam.motion_model import noise_array, sample_motion
from slamgym.slam.particles import (
    ParticleMaps,
    TrajectoryTree,
    effective_sample_size,
    normalized_weights,
    systematic_resample,
)

FIRST_STEP = 0.05
"""First step of the search in x and y [m] (GMapping's ``lstep``)."""
LIKELIHOOD_SIGMA = 0.075
"""Width of the log-likelihood -d^2 / sigma that weighs the particles [m^2] (GMapping's ``lsigma``)."""
NULL_LIKELIHOOD = -0.5
"""-d^2 of a beam with nothing near [m^2] (GMapping's ``nullLikelihood``)."""
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
        halvings=config.iterations,
        minimum_score=float(config.minimum_score),
    )


class ParticleFilter(Mapper):
    """Mode ``rbpf``; see :class:`slamgym.slam.mapper.Mapper`. A single particle draws no noise: scan matching."""

    def __init__(
        self,
        config: SlamConfig,
        geometry: LaserGeometry,
        initial_pose: Pose2D,
        rng: np.random.Generator,
    ) -> None:
        count = config.particles
        super().__init__(config, geometry, initial_pose, rng)
        self._noise = noise_array(config.motion)
        self._poses: FloatArray = np.tile(np.array(initial_pose, dtype=np.float64), (count, 1))
        self._log_weights = np.zeros(count)  # since the last resampling
        self._path_log_weights = np.zeros(count)  # over the whole path
        self._maps = ParticleMaps(count, config.resolution, config.memory_limit_mb)
        self._tree = TrajectoryTree(count, geometry.num_beams)
        self._match_settings = plain(match_settings(config))

    @property
    def _weights(self) -> FloatArray:
        """Weights (particles,) since the last resampling; they sum to 1."""
        return normalized_weights(self._log_weights)

    @property
    def best_particle(self) -> int:
        """The particle whose whole path explains the scans best."""
        return int(self._path_log_weights.argmax())

    def particle_paths(self, most: int) -> list[FloatArray]:
        """Paths of at most so many particles, each (processed scans, 3)."""
        # After a resampling the places of the particles changed; their parents are at the last scan.
        count = min(most, len(self._poses)) if len(self._tree) else 0
        return [self._tree.path(particle) for particle in range(count)]

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) of the pose at the last processed scan: the spread of the particles by their weights."""
        deviations = self._poses - self._poses[self.best_particle]
        deviations[:, 2] = wrap_angle(deviations[:, 2])
        weights = self._weights[:, None]
        deviations -= (weights * deviations).sum(axis=0)
        weighted = deviations * weights
        return product(weighted.T, deviations)

    def _num_bytes(self) -> int:
        return self._maps.num_bytes + self._tree.num_bytes

    def _process(self, scan: LaserScan) -> None:
        """One step of the filter: predict, match, weigh, resample, register."""
        increments = self._gate.take(scan.stamp)
        # A single particle is at its best where the odometry says.
        draw = self._rng.standard_normal if len(self._poses) > 1 else np.zeros
        normals = draw((len(increments), *self._poses.shape))
        sample_motion(self._poses, increments, normals, self._noise)
        points = usable_end_points(scan.ranges, plain(self._beams), np.inf)
        farthest = np.abs(points).sum(axis=1).max(initial=0.0)
        self._maps.cover(self._poses, farthest + MATCH_MARGIN)
        if len(self._tree) > 0:
            self._match_and_weigh(points)
            if self._stats.n_eff[-1] < self._config.resample_threshold * len(self._poses):
                self._resample()
        self._tree.add(scan.stamp, self._poses, scan.ranges)
        self._maps.register(self._poses, points)
        self._last_pose = Pose2D(*self._poses[self.best_particle].tolist())

    def _match_and_weigh(self, points: FloatArray) -> None:
        """Move the particles to their best matches and weigh them."""
        likelihoods = np.empty(len(self._poses))
        maps = plain(self._maps.tile_maps)
        matched = match_particles(maps, self._poses, points, self._match_settings, likelihoods)
        self._stats.refused_matches += len(self._poses) - matched
        self._log_weights += likelihoods
        self._path_log_weights += likelihoods
        self._stats.n_eff.append(effective_sample_size(self._weights))

    def _resample(self) -> None:
        ancestors = systematic_resample(self._weights, self._rng.random())
        self._poses = self._poses[ancestors]
        self._path_log_weights = self._path_log_weights[ancestors]
        self._maps.resample(ancestors)
        self._tree.resample(ancestors)
        self._log_weights = np.zeros(len(self._poses))
        self._stats.resamplings += 1

    def _draw_path(self) -> None:
        self._map.follow(self.trajectory().poses, self._tree["ranges"])

    def trajectory(self) -> Trajectory:
        """The best particle's path."""
        return Trajectory(self._tree["stamps"].copy(), self._tree.path(self.best_particle))
