"""The places where a robot may be, and how firmly it believes in one.

Each place is an extended Kalman filter of the pose and the odometry's systematic errors, moved by the odometry and
aligned to the map. Which place leads, for how long, and how much it explains tells the states apart.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.portable import inverted
from slamgym.core.types import Float32Array, FloatArray, Pose2D
from slamgym.slam.config import LocalizationConfig
from slamgym.slam.graph.alignment import AlignmentTarget
from slamgym.slam.graph.relative import match_with, moved_by
from slamgym.slam.graph.submaps import OrientedPoints
from slamgym.slam.graph.wheels import SPREADS, WheelStep

State = Literal["searching", "ambiguous", "localised", "lost"]

FIT_MEMORY = 0.25
"""Weight of the newest scan in the mean of a hypothesis's fit."""
ALIGNED_FIT = 0.3
"""An alignment of a smaller share of fitting points is none: off the map, a few always lie near some surface."""
CERTAIN_WEIGHT = 0.95
"""A place leads while it holds so much of all weight."""
CERTAIN_FIT = 0.7
"""A place is believed for the first time if it explains so many of the beams, while it leads and at the end ..."""
PATIENT_FIT = 0.5
"""... or so many after :data:`PATIENT_FOR` times the usual distance: much of the furniture was moved."""
PATIENT_FOR = 2.0
FIELD_FLOOR = (0.025, 0.025, 0.005)
"""No pose on a map of cells of 5 cm is known better than to half of one [m], [m], [rad]."""
MINIMUM_FIT = 0.6
"""A place that explains a smaller share of the latest scans' beams isn't the robot's ..."""
PROVEN_FIT = 0.4
"""... or a smaller one than this once it has led for :data:`PROVEN`: where all furniture was moved the right place
explains little. With 0.45 and with this 90 and 92.4 % of the scans of nine days in one home are localised; in a home
and 12 others that nothing was chosen on 89.5 and 89.6, 42.6 and 44.1. Wrong are as many as before on days and in other
buildings (0.75 %), 0.34 instead of 0.28 % where the robot was carried off."""
PROVEN = 10.0
"""[m], counted as :attr:`Hypothesis.led` is."""
WIDE_SPREAD = 0.15
"""A place with a larger standard deviation isn't known [m]."""


@dataclass
class Hypothesis:
    """A place, and how well it has explained the scans."""

    pose: FloatArray  # (3,)
    covariance: FloatArray  # (7, 7) of the pose and the odometry's systematic errors
    missed: Float32Array
    """Beams that it didn't explain, by their places; see :func:`slamgym.slam.localization.known_map.explain_scan`."""
    log_weight: float = 0.0  # relative to the others
    fit: float = 1.0
    """Share of the beams explained, a mean over the latest scans."""
    led: float = 0.0
    """Distance [m] that the robot has driven while this place was certain; half a turn counts a metre."""
    explained: float = 0.0
    """The same times the share of beams explained."""
    proof: float = 1.0
    """So many times the usual distance it must lead: twice as far after each place that was believed and given up."""
    was_sure: bool = False
    """True if the robot was localised there."""
    systematic: FloatArray = field(default_factory=lambda: np.zeros(len(SPREADS)))
    """Of the odometry, see :mod:`slamgym.slam.graph.wheels`."""

    @staticmethod
    def around(
        pose: FloatArray, spread: tuple[float, float, float], missed: Float32Array
    ) -> "Hypothesis":
        """A place known to within standard deviations [m], [m], [rad], and what it has missed."""
        return Hypothesis(pose, np.diag(np.square([*spread, *SPREADS])), missed)

    def inherit(self, other: "Hypothesis") -> None:
        """Take over what is known of a place that turns out to be this one."""
        self.led = other.led
        self.explained = other.explained
        self.proof = other.proof
        self.was_sure = other.was_sure

    def move(self, step: WheelStep, variances: FloatArray) -> None:
        """Predict: follow the odometry, whose random errors have variances (2,) of position and heading."""
        x, y, heading = self.pose
        self.pose = moved_by(self.pose, step.moved + step.design @ self.systematic)
        cos = math.cos(heading)
        sin = math.sin(heading)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        jacobian = np.eye(len(self.covariance))
        jacobian[0, 2] = y - self.pose[1]
        jacobian[1, 2] = self.pose[0] - x
        jacobian[:3, 3:] = rotation @ step.design
        self.covariance = jacobian @ self.covariance @ jacobian.T
        self.covariance[:3, :3] += np.diag(variances[[0, 0, 1]])

    def align(self, surfaces: AlignmentTarget, seen: OrientedPoints) -> None:
        """Correct: align a scan, in the robot frame, to the map."""
        own = self.covariance[:3, :3]
        placed = surfaces.align(seen, self.pose, self.pose, inverted(own))
        if placed.fit < ALIGNED_FIT:
            return
        map_frame = np.zeros((1, 3))
        match = match_with(map_frame, 0, 0, placed.pose, placed.total, 1)
        measured = inverted(match.information + np.eye(3))
        gain = self.covariance[:, :3] @ inverted(own + measured)
        error = match.measured - self.pose
        error[2] = wrap_angle(error[2])
        self.pose = self.pose + gain[:3] @ error
        self.systematic = self.systematic + gain[3:] @ error
        self.pose[2] = wrap_angle(self.pose[2])
        covariance = self.covariance - gain @ self.covariance[:3]
        self.covariance = 0.5 * (covariance + covariance.T)  # rounding would add up


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


def believe(
    stamp: float,
    driven: float,
    hypotheses: Sequence[Hypothesis],
    last: Pose2D,
    config: LocalizationConfig,
) -> Belief:
    """Return what is believed after a scan, and how firmly.

    Args:
        stamp: Of the scan [s].
        driven: Since the scan before [m].
        hypotheses: The best first; the distances for which they led are brought up to date.
        last: The pose until now, for a robot without any.
        config: Thresholds.
    """
    if not hypotheses:
        return Belief(stamp, "searching", last, np.eye(3), 0.0, ())
    best = hypotheses[0]
    weights = np.exp([hypothesis.log_weight - best.log_weight for hypothesis in hypotheses])
    weights /= weights.sum()
    is_alone = bool(weights[0] >= CERTAIN_WEIGHT)
    for hypothesis in hypotheses:
        if hypothesis is best and is_alone:
            best.led += driven
            best.explained += driven * best.fit
        else:
            hypothesis.led = 0.0
            hypothesis.explained = 0.0
    covariance = best.covariance[:3, :3] + np.diag(np.square(FIELD_FLOOR))
    state = _state_of(best, is_alone, covariance, config)
    if state == "localised":
        best.was_sure = True
    poses = [Pose2D(*hypothesis.pose.tolist()) for hypothesis in hypotheses]
    listed = tuple(zip(poses, weights.tolist(), strict=True))
    return Belief(stamp, state, poses[0], covariance, best.fit, listed)


def _state_of(
    best: Hypothesis, is_alone: bool, covariance: FloatArray, config: LocalizationConfig
) -> State:
    """How firmly the best hypothesis is believed, given the covariance (3, 3) of its pose."""
    is_wide = covariance[0, 0] + covariance[1, 1] > WIDE_SPREAD**2
    least_fit = PROVEN_FIT if best.led >= PROVEN else MINIMUM_FIT
    if best.fit < least_fit or is_wide:
        return "lost" if best.was_sure else "searching"
    if not is_alone:
        return "ambiguous"
    usual = best.proof * config.confirm_distance
    if best.led < usual:
        return "searching"
    explained = min(best.explained, best.fit * best.led)
    least = PATIENT_FIT if best.led >= PATIENT_FOR * usual else CERTAIN_FIT
    if best.was_sure or explained >= least * best.led:
        return "localised"
    return "searching"
