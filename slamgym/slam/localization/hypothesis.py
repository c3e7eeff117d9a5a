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
from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.config import LocalizationConfig
from slamgym.slam.graph.alignment import AlignmentTarget
from slamgym.slam.graph.relative import match_with, moved_by
from slamgym.slam.graph.wheels import SPREADS, WheelStep

State = Literal["searching", "ambiguous", "localised", "lost"]

FIT_MEMORY = 0.25
"""Weight of the newest scan in the mean of a hypothesis's fit."""
ALIGNED_FIT = 0.3
"""An alignment of a smaller share of fitting points is none: off the map, a few always lie near some surface."""
CERTAIN_WEIGHT, CERTAIN_FIT = 0.95, 0.7
"""To be believed for the first time, a place must hold so much of all weight while the robot drives on, and explain so
many of the beams on the way and at its end."""
FIELD_FLOOR = (0.025, 0.025, 0.005)
"""No pose on a map of cells of 5 cm is known better than to half of one [m], [m], [rad]."""
MINIMUM_FIT, WIDE_SPREAD = 0.6, 0.15
"""A place that explains a smaller share of the latest scans' beams isn't the robot's, and one known no better than the
second isn't known [m]."""


@dataclass
class Hypothesis:
    """A place, and how well it has explained the scans."""

    pose: FloatArray  # (3,)
    covariance: FloatArray  # (6, 6) of the pose and the odometry's systematic errors
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
    systematic: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Of the odometry, see :mod:`slamgym.slam.graph.wheels`."""

    @staticmethod
    def around(pose: FloatArray, spread: tuple[float, float, float]) -> "Hypothesis":
        """A place known to within standard deviations [m], [m], [rad]."""
        return Hypothesis(pose, np.diag(np.square([*spread, *SPREADS])))

    def inherit(self, other: "Hypothesis") -> None:
        """Take over what is known of a place that turns out to be this one."""
        self.led = other.led
        self.explained = other.explained
        self.proof = other.proof
        self.was_sure = other.was_sure

    def move(self, step: WheelStep, variances: FloatArray) -> None:
        """Predict: follow the odometry, whose random errors have variances (2,) of position and heading."""
        before = self.pose
        self.pose = moved_by(before, step.moved + step.design @ self.systematic)
        cos = math.cos(before[2])
        sin = math.sin(before[2])
        jacobian = np.eye(6)
        jacobian[:2, 2] = before[1] - self.pose[1], self.pose[0] - before[0]
        jacobian[:3, 3:] = (
            np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ step.design
        )
        self.covariance = jacobian @ self.covariance @ jacobian.T
        self.covariance[:3, :3] += np.diag(variances[[0, 0, 1]])

    def align(self, surfaces: AlignmentTarget, points: FloatArray, sides: FloatArray) -> None:
        """Correct: align a scan's end points (n, 2) with sides (n, 3), in the robot frame, to the map."""
        own = self.covariance[:3, :3]
        placed = surfaces.align(points, sides, self.pose, self.pose, inverted(own))
        if placed.fit < ALIGNED_FIT:
            return
        match = match_with(np.zeros((1, 3)), 0, 0, placed.pose, placed.equations.sums[0], 1)
        gain = self.covariance[:, :3] @ inverted(own + inverted(match.information + np.eye(3)))
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
    weights = np.exp(
        [hypothesis.log_weight - hypotheses[0].log_weight for hypothesis in hypotheses]
    )
    weights /= weights.sum()
    best = hypotheses[0]
    is_alone = weights[0] >= CERTAIN_WEIGHT
    for hypothesis in hypotheses[1 if is_alone else 0 :]:
        hypothesis.led = hypothesis.explained = 0.0
    best.led += driven if is_alone else 0.0
    best.explained += driven * best.fit if is_alone else 0.0
    covariance = best.covariance[:3, :3] + np.diag(np.square(FIELD_FLOOR))
    state: State = "searching"
    if best.fit < MINIMUM_FIT or covariance[0, 0] + covariance[1, 1] > WIDE_SPREAD**2:
        state = "lost" if best.was_sure else "searching"
    elif not is_alone:
        state = "ambiguous"
    elif best.led >= best.proof * config.confirm_distance and (
        best.was_sure or min(best.explained, best.fit * best.led) >= CERTAIN_FIT * best.led
    ):
        state = "localised"
        best.was_sure = True
    poses = [Pose2D(*hypothesis.pose.tolist()) for hypothesis in hypotheses]
    listed = tuple(zip(poses, weights.tolist(), strict=True))
    return Belief(stamp, state, poses[0], covariance, best.fit, listed)
