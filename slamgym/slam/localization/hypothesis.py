"""The places where a robot may be, and how firmly it believes in one.

Each place has particles round it: the steps of Monte Carlo localisation. Which place leads, for how long, and how much
it explains tells the states apart.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.config import LocalizationConfig
from slamgym.slam.localization.field import LikelihoodField, wall_cost, weigh_poses
from slamgym.slam.odometry_calibration import MotionSpread
from slamgym.slam.particles import systematic_draw

State = Literal["searching", "ambiguous", "localised", "lost"]

BIN_METRES, BIN_RADIANS = 0.15, 0.1
"""Bins of KLD-sampling: AMCL's are 0.5 m and 10 degrees, which one place never fills."""
KLD_ERROR, KLD_QUANTILE = 0.05, 2.33
"""Error of the particles' distribution that is kept with a probability of 0.99 (``pf_err``, ``pf_z``)."""
MIN_PARTICLES = 100
"""Least particles of a hypothesis (``min_particles`` of all)."""
RESAMPLE_THRESHOLD = 0.5
"""Resample when N_eff falls below this share of the particles."""
BEAM_WEIGHT = 0.15
"""Power that the likelihood of a beam is taken to, because neighbouring beams and successive scans err together
(Thrun et al. 2005, section 6.3.4). Chosen so that NEES is between 2 and 5."""
EVIDENCE = 0.2
"""Weight of a scan for one hypothesis against another, as a share of its weight within one: what isn't on the map
speaks against a place in many scans on end."""
FIT_MEMORY = 0.25
"""Weight of the newest scan in the mean of a hypothesis's fit."""
CLAIM_FIT = 0.75
"""So many beams must be explained over all scans since a place was found before it is believed for the first time."""
CERTAIN_WEIGHT = 0.95
"""One hypothesis needs this share of all weight to be the robot's place."""
FIELD_FLOOR = (0.01, 0.01, 0.003)
"""Nor is a pose on a map of cells [m], [m], [rad]."""
WIDE_SPREAD = 0.5
"""A place known no better than this isn't known [m]."""
FORGIVEN_METRES, MOST_CONFIRM_METRES = 20.0, 16.0
"""After so many metres without a doubt earlier mistakes are forgotten; and a place never has to prove itself for longer
than the second."""


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
    """Distance that the robot has driven with it [m]; a turn by half counts a metre."""
    was_sure: bool = False
    """True if the robot was localised there."""

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
        """Weights of the particles; they sum to 1."""
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
        """Predict: follow the odometry, each particle with its own error.

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

    def weigh(self, field: LikelihoodField, points: FloatArray) -> None:
        """Correct: weigh each particle, and the hypothesis by the mean, with a scan's end points (k, 2) [m]."""
        out = np.empty(len(self.poses))
        weigh_poses(field, self.poses, points, out)
        before = _log_sum(self.log_weights)
        self.log_weights = self.log_weights + BEAM_WEIGHT * out - wall_cost(field, self.poses)
        self.log_weight += EVIDENCE * (_log_sum(self.log_weights) - before)

    def resample(self, most: int, rng: np.random.Generator) -> None:
        """Draw as many new particles as the spread of the present ones needs, if few of them hold the weight.

        Args:
            most: Most particles.
            rng: Source of the draw.
        """
        weights = self.weights
        if 1.0 / float(weights @ weights) >= RESAMPLE_THRESHOLD * len(weights):
            return
        drawn = self.poses[systematic_draw(weights, float(rng.random()), len(weights))]
        count = min(particles_needed(drawn), max(most, MIN_PARTICLES))
        if count != len(drawn):
            drawn = self.poses[systematic_draw(weights, float(rng.random()), count)]
        self.poses, self.log_weights = drawn.copy(), np.zeros(count)


def particles_needed(poses: FloatArray) -> int:
    """Number of particles that a distribution needs of which those drawn (n, 3) fill as many bins (Fox 2003, eq. 9)."""
    bins = np.floor(poses / (BIN_METRES, BIN_METRES, BIN_RADIANS)).astype(np.int64)
    k = len(np.unique(bins, axis=0))
    if k < 2:
        return MIN_PARTICLES
    share = 2.0 / (9.0 * (k - 1))
    needed = (k - 1) / (2.0 * KLD_ERROR) * (1.0 - share + math.sqrt(share) * KLD_QUANTILE) ** 3
    return max(math.ceil(needed), MIN_PARTICLES)


def _log_sum(values: FloatArray) -> float:
    top = float(values.max())
    return top + math.log(float(np.exp(values - top).sum()))


class Belief(NamedTuple):
    """Belief of the robot after a scan."""

    stamp: float
    state: State
    pose: Pose2D
    covariance: FloatArray  # (3, 3) of x, y [m] and theta [rad], within the best hypothesis
    fit: float
    """Share of the beams that the best hypothesis explains, a mean over the latest scans."""
    hypotheses: tuple[tuple[Pose2D, float], ...]
    """Poses with their shares of the weight, the best first."""
    particles: int


class Judge:
    """Tells the states apart, with a memory of earlier mistakes.

    Args:
        config: Thresholds.
        known: The hypothesis of a start that is known.
    """

    def __init__(self, config: LocalizationConfig, known: Hypothesis | None) -> None:
        self._config = config
        self._followed = known
        self._was_localised = known is not None
        self._led = math.inf if known is not None else 0.0
        self._confirm_distance = config.confirm_distance

    def belief(self, stamp: float, driven: float, hypotheses: Sequence[Hypothesis], last: Pose2D) -> Belief:
        """Return what is believed now, and how firmly.

        Args:
            stamp: Of the scan [s].
            driven: Since the scan before [m].
            hypotheses: The best first.
            last: The pose until now, for a robot without any.
        """
        if not hypotheses:
            return Belief(stamp, "searching", last, np.eye(3), 0.0, (), 0)
        weights = np.exp([hypothesis.log_weight for hypothesis in hypotheses])
        weights /= weights.sum()
        best = hypotheses[0]
        self._follow(best, driven, float(weights[0]))
        pose, covariance = best.estimate
        covariance = covariance + np.diag(np.square(FIELD_FLOOR))
        return Belief(
            stamp,
            self._state(best, float(weights[0]), math.sqrt(covariance[0, 0] + covariance[1, 1])),
            pose,
            covariance,
            best.fit,
            tuple((h.estimate[0], float(weight)) for h, weight in zip(hypotheses, weights, strict=True)),
            sum(len(hypothesis.poses) for hypothesis in hypotheses),
        )

    def _follow(self, best: Hypothesis, driven: float, weight: float) -> None:
        """Count for how long one hypothesis has led with certainty."""
        self._led += driven
        if best is not self._followed:
            if self._followed is not None and self._followed.was_sure:
                # That was a mistake, or the robot was carried off: the next place must prove itself for longer.
                self._confirm_distance = min(2.0 * self._confirm_distance, MOST_CONFIRM_METRES)
            self._followed, self._led = best, 0.0
        if weight < CERTAIN_WEIGHT:
            self._led = 0.0

    def _state(self, best: Hypothesis, weight: float, spread: float) -> State:
        explains = best.fit >= self._config.minimum_fit
        if explains and weight < CERTAIN_WEIGHT:
            return "ambiguous"
        if not explains or spread > WIDE_SPREAD:
            return "lost" if self._was_localised else "searching"
        is_new = not best.was_sure and best.mean_fit < CLAIM_FIT
        if is_new or min(best.driven, self._led) < self._confirm_distance:
            return "searching"
        best.was_sure = self._was_localised = True
        if self._led > FORGIVEN_METRES:
            self._confirm_distance = self._config.confirm_distance
        return "localised"
