"""Turns of the robot between the nodes of a graph by its wheels, once the whole drive has shown their errors.

While driving, matches half a metre apart can't tell wheels that hardly err from true ones: a match errs as much as
they do (:mod:`slamgym.slam.odometry_calibration`). Over several metres the errors of wheels have grown, those of
matches haven't. So the heading's systematic errors, and the size of the random ones, are estimated from all nodes each
time that the graph is optimised, and the turns of the odometry become separate edges, next to those of the matches
(variances from residuals: variance component estimation; Koch, *Parameter Estimation and Hypothesis Testing in Linear
Models*, 1999). Distances are left to the matches: a laser's bias looks like an error of the wheels, and a scale that is
wrong bends maps.
"""

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray
from slamgym.slam.odometry_calibration import DRIFT_SPREAD, SLIP_DRIFT, SLIP_TURN, TURN_SPREAD

LONG_STRETCH = 6.0
"""Headings are compared over stretches of so many metres and radians together."""
HEADING_ERROR = 0.006
"""Standard deviation of a matched heading within the map drawn so far [rad]."""
EXPECTED_NOISE, EXPECTED_WEIGHT = 0.5, 2.0
"""Random errors of the heading before anything is known, as a share of the slips' variance, and for how many stretches
that counts ..."""
SMALLEST_NOISE = 0.01
"""... and the least share."""
LARGEST_NOISE = 0.05
"""Wheels that slip more are left to the matches: what they add then is no better than chance."""
TURN_FLOOR = 0.0005
"""The turn between two nodes is never trusted further than this [rad]."""
GROSS_CHI2 = 16.0
"""A stretch whose turn disagrees so much with the match was no slip of a wheel, but something worse: it is left out."""
OUTLYING_CHI2 = 9.0
"""A squared residual beyond so many times what is expected counts as so many."""
ESTIMATION_ROUNDS = 8


class WheelTurns:
    """Raw odometry between successive nodes."""

    def __init__(self) -> None:
        self._way = np.zeros(4)  # since the newest node, see below
        # Metres driven and ahead, radians turned either way and to the left.
        self._ways: list[FloatArray] = []

    def move(self, increments: FloatArray) -> None:
        """Take motions (steps, 3) in the robot frame."""
        x, y, turn = increments.T
        self._way = self._way + np.array([np.hypot(x, y).sum(), x.sum(), np.abs(turn).sum(), turn.sum()])

    def append(self) -> None:
        """The newest pose is a node."""
        self._ways.append(self._way)
        self._way = np.zeros(4)

    def between(
        self, poses: FloatArray, matched: FloatArray, variances: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The turns from each node to the next by odometry that was learned from the path.

        Args:
            poses: (N, 3) the nodes.
            matched: (N - 1,) those turns as they were matched [rad].
            variances: (N - 1,) of them [rad^2].

        Returns:
            Turns (N - 1,) [rad], and their information (N - 1,) [1/rad^2]; zero for what is left out, and everywhere
            if the wheels slip much.
        """
        driven, ahead, turned, left = np.array(self._ways[1:]).T
        slip = SLIP_DRIFT**2 * driven + SLIP_TURN**2 * turned
        spread = slip + (DRIFT_SPREAD * ahead) ** 2 + (TURN_SPREAD * left) ** 2
        kept = wrap_angle(matched - left) ** 2 < GROSS_CHI2 * (spread + variances)
        stretch = np.cumsum((driven + turned) * kept) // LONG_STRETCH
        errors = wrap_angle(np.diff(poses[:, 2]) - left)
        systematic, noise = _learn_headings(
            *(_sums(stretch, column * kept) for column in (errors, ahead, left, slip))
        )
        if noise > LARGEST_NOISE:
            kept = np.zeros_like(kept)
        turns = left + systematic[0] * ahead + systematic[1] * left
        return turns, kept / (noise * slip + TURN_FLOOR**2)


def _sums(stretch: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(np.bincount(stretch.astype(np.int64), weights=values), dtype=np.float64)


def _learn_headings(
    errors: FloatArray, ahead: FloatArray, left: FloatArray, slip: FloatArray
) -> tuple[FloatArray, float]:
    """Drift per metre [rad/m] and share by which the robot turns further than measured, and the random errors' size.

    Args:
        errors: (S,) how much further than measured the robot turned over each long stretch [rad].
        ahead: (S,) metres driven ahead.
        left: (S,) radians turned to the left.
        slip: (S,) variance of random errors of size 1 [rad^2].
    """
    noise = 1.0
    systematic: FloatArray = np.zeros(2)
    shares, prior = np.column_stack([ahead, left]), np.diag([DRIFT_SPREAD**-2, TURN_SPREAD**-2])
    match_variance = 2.0 * HEADING_ERROR**2
    driven = slip > 0.0
    for _ in range(ESTIMATION_ROUNDS):
        variances = noise * slip + match_variance
        information = (shares.T / variances) @ shares + prior
        systematic = np.asarray(
            np.linalg.solve(information, (shares.T / variances) @ errors), dtype=np.float64
        )
        residuals = np.minimum((errors - shares @ systematic) ** 2, OUTLYING_CHI2 * variances)
        fitted = np.einsum("si,ij,sj->s", shares, np.linalg.inv(information), shares)
        weights = (slip / variances) ** 2
        found = (residuals + fitted - match_variance)[driven] / slip[driven]
        total = float(weights[driven] @ found) + EXPECTED_WEIGHT * EXPECTED_NOISE
        noise = max(total / (float(weights.sum()) + EXPECTED_WEIGHT), SMALLEST_NOISE)
    return systematic, noise
