"""One place where the robot may be, with particles round it: the steps of Monte Carlo localisation."""

import math
from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.localization.config import LocalizationConfig
from slamgym.slam.localization.field import LikelihoodField, wall_cost, weigh_poses
from slamgym.slam.odometry_calibration import MotionSpread

BIN_METRES, BIN_RADIANS = 0.15, 0.1
"""Bins of KLD-sampling: AMCL's are 0.5 m and 10 degrees, which one place never fills."""
FIT_MEMORY = 0.25
"""What the newest scan counts in the mean of a hypothesis's fit."""


@dataclass
class Hypothesis:
    """A place, its particles, and how well it has explained the scans."""

    poses: FloatArray  # (n, 3) particles [m, m, rad]
    log_weights: FloatArray  # (n,) since they were resampled
    log_weight: float  # of the hypothesis, relative to the others
    fit: float = 0.0
    """Share of the beams explained, a mean over the latest scans."""
    fit_sum: float = 0.0
    """The same summed over all its scans ..."""
    scans: int = 0
    """... and their number."""
    driven: float = 0.0
    """How far the robot has driven with it [m]; a turn by half counts a metre."""
    was_sure: bool = False
    """Whether the robot was localised there."""

    @staticmethod
    def around(
        pose: FloatArray, spread: FloatArray, count: int, log_weight: float, rng: np.random.Generator
    ) -> "Hypothesis":
        """Particles drawn round a pose.

        Args:
            pose: (3,).
            spread: (3,) standard deviations [m, m, rad].
            count: Number of particles.
            log_weight: See the class.
            rng: Source of the draw.
        """
        poses = pose + spread * rng.standard_normal((count, 3))
        return Hypothesis(poses, np.zeros(count), log_weight)

    def note_fit(self, fit: float) -> None:
        """Take the share of a scan's beams that the place explains."""
        self.fit += (FIT_MEMORY if self.scans else 1.0) * (fit - self.fit)
        self.fit_sum += fit
        self.scans += 1

    @property
    def mean_fit(self) -> float:
        """Share of the beams explained, over all scans since the place was found."""
        return self.fit_sum / max(self.scans, 1)

    @property
    def weights(self) -> FloatArray:
        """Of the particles; they sum to 1."""
        weights: FloatArray = np.exp(self.log_weights - self.log_weights.max())
        return weights / weights.sum()

    @property
    def estimate(self) -> tuple[Pose2D, FloatArray]:
        """Mean and covariance (3, 3) of the particles."""
        weights = self.weights
        centre = self.poses[int(np.argmax(weights))]
        away = self.poses - centre
        away[:, 2] = wrap_angle(away[:, 2])
        mean = weights @ away
        away -= mean
        x, y, theta = centre + mean
        covariance: FloatArray = (away * weights[:, None]).T @ away
        return Pose2D(float(x), float(y), float(wrap_angle(theta))), covariance

    def move(self, increments: FloatArray, spread: MotionSpread, rng: np.random.Generator) -> None:
        """Predict: follow the odometry, each particle with an error of its own.

        Args:
            increments: (steps, 3) corrected motion in the robot frame.
            spread: How far it may be off.
            rng: Source of the errors.
        """
        sigma, turn = math.sqrt(spread.distance), math.sqrt(spread.heading)
        # Half of the heading's error is there from the beginning on, half comes after the motion.
        noise = rng.standard_normal((len(self.poses), 4))
        self.poses[:, 2] += math.sqrt(0.5) * turn * noise[:, 2]
        for dx, dy, turned in increments:
            cos, sin = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
            self.poses[:, 0] += cos * dx - sin * dy
            self.poses[:, 1] += sin * dx + cos * dy
            self.poses[:, 2] += turned
        self.poses[:, :2] += sigma * noise[:, :2]
        self.poses[:, 2] += math.sqrt(0.5) * turn * noise[:, 3]

    def weigh(self, field: LikelihoodField, points: FloatArray, power: float, evidence: float) -> None:
        """Correct: weigh each particle, and the hypothesis by the mean, with a scan's end points (k, 2).

        Args:
            field: The map.
            points: End points in the robot frame [m].
            power: That the likelihood of each is taken to.
            evidence: The same of the hypothesis's own weight, as a share of that.
        """
        out = np.empty(len(self.poses))
        weigh_poses(field, self.poses, points, out)
        before = _log_sum(self.log_weights)
        self.log_weights = self.log_weights + power * out - wall_cost(field, self.poses)
        self.log_weight += evidence * (_log_sum(self.log_weights) - before)

    def resample(self, config: LocalizationConfig, most: int, rng: np.random.Generator) -> None:
        """Draw as many particles anew as the spread of the present ones needs, if few of them hold the weight.

        Args:
            config: Thresholds.
            most: Most particles.
            rng: Source of the draw.
        """
        weights = self.weights
        if 1.0 / float(weights @ weights) >= config.resample_threshold * len(weights):
            return
        totals = np.cumsum(weights)
        drawn = self.poses[_systematic(totals, len(weights), rng)]
        count = min(particles_needed(drawn, config), max(most, config.min_particles))
        if count != len(drawn):
            drawn = self.poses[_systematic(totals, count, rng)]
        self.poses, self.log_weights = drawn.copy(), np.zeros(count)


def particles_needed(poses: FloatArray, config: LocalizationConfig) -> int:
    """How many particles a distribution needs that fills as many bins (Fox 2003, equation 9).

    Args:
        poses: (n, 3) particles drawn from it.
        config: Error, quantile and bounds.
    """
    bins = np.floor(poses / (BIN_METRES, BIN_METRES, BIN_RADIANS)).astype(np.int64)
    k = len(np.unique(bins, axis=0))
    if k < 2:
        return config.min_particles
    share = 2.0 / (9.0 * (k - 1))
    needed = (k - 1) / (2.0 * config.kld_error) * (1.0 - share + math.sqrt(share) * config.kld_quantile) ** 3
    return max(math.ceil(needed), config.min_particles)


def _systematic(totals: FloatArray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Ancestors (count,) of a systematic draw from cumulated weights."""
    ticks = (np.arange(count) + float(rng.random())) / count
    return np.searchsorted(totals, ticks, side="right").clip(max=len(totals) - 1)


def _log_sum(values: FloatArray) -> float:
    top = float(values.max())
    return top + math.log(float(np.exp(values - top).sum()))
