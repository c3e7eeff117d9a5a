"""Errors of the wheel odometry, learned from the graph as a whole.

Systematic ones (scale of the distance, drift of the heading per metre, scale of the turn) are unknowns of the graph's
least squares. The size of the random ones follows from what is left of the odometry's edges once the laser has placed
the nodes (variance component estimation; Koch, *Parameter Estimation and Hypothesis Testing in Linear Models*, 1999).
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import compose
from slamgym.core.portable import inverted
from slamgym.core.types import BoolArray, FloatArray, Pose2D
from slamgym.slam.graph.relative import sandwich

SPREADS = (0.03, 0.015, 0.04, 0.02)
"""Before anything is learned: spread of the distance's scale, of the heading's drift [rad/m], of the turn's scale,
about twice those of :func:`slamgym.sim.odometry_level` ``high``, and of the direction in which the laser sees the robot
drive [rad]: half a degree on one public log, whose path of 1.9 km was 49 m off without this unknown and is 0.7 m off
with it; 1.2 degrees by the scans alone on another."""
SLIP_DISTANCE = 0.01
"""Random error of the position first assumed [m/sqrt(m)] (Chong and Kleeman, ICRA 1997)."""
SLIP_DRIFT = 0.01
"""Random error of the heading by distance first assumed [rad/sqrt(m)] (Chong and Kleeman, ICRA 1997)."""
SLIP_TURN = 0.02
"""Random error of the heading by turn first assumed [rad/sqrt(rad)] (Chong and Kleeman, ICRA 1997)."""
FLOORS = (0.0005, 0.0003)
"""Odometry is never trusted further than this [m], [rad]: its clock isn't the laser's."""
STRETCH = (4e-4, 9e-4)
"""Random errors are summed up over stretches of such a variance first assumed [m^2], [rad^2]."""
MATCHED = (2e-4, 3e-5)
"""Variance of the matches at both ends of a stretch [m^2], [rad^2]: so much of what is left isn't the wheels'."""
PRIOR = 0.25
"""Weight of ``FIRST_NOISE`` among what is learned of the noise [stretches]."""
FIRST_NOISE = 16.0
"""Variance of the random errors before anything is learned, in those first assumed."""
OUTLYING = 6.0
"""A squared residual counts as at most so many expected ones, the matches' included: by the wheels' alone, noise that
was once learned to be least could never grow again."""
LEAST_NOISE = 0.1
"""Least variance of the random errors that is learned, in those first assumed. Where the laser binds little, the path
follows the wheels, which then seem to be right: the path through the FHW museum by a laser cut to 4 m is 0.83 m off
with 0.01, 0.45 with 0.05, 0.38 with this and 0.34 with 0.25; homes with exact wheels are 5 to 7 mm off."""
MOST_NOISE = 400.0
"""Largest variance of the random errors that is learned, in those first assumed."""


class WheelStep(NamedTuple):
    """Odometry from one node to the next."""

    moved: FloatArray  # (3,) as measured
    design: FloatArray  # (3, 4) its change by the systematic errors
    slips: FloatArray  # (2,) variances of position and heading by random errors of the size first assumed


class WheelCalibration:
    """Systematic errors, their covariance, and the random errors' variances over those first assumed."""

    def __init__(self) -> None:
        self.systematic = np.zeros(len(SPREADS))
        self.covariance = np.diag(np.square(SPREADS))
        self.noise = np.full(2, FIRST_NOISE)
        self.prior = 1.0 / np.square(SPREADS)
        """Information (4,) of the systematic errors being zero."""

    def step(self, increments: FloatArray) -> WheelStep:
        """Add up odometry increments (steps, 3) in the robot frame."""
        moved = Pose2D(0.0, 0.0, 0.0)
        distance = 0.0
        turn = 0.0
        design = np.zeros((3, len(SPREADS)))
        for x, y, theta in increments.tolist():
            before = moved
            moved = compose(before, Pose2D(x, y, theta))
            dx = moved.x - before.x
            dy = moved.y - before.y
            # A wrong heading leads aside; half of an increment's own is there in its middle.
            driven = design[2, 1] + 0.5 * x
            turned = design[2, 2] + 0.5 * theta
            design[0] += (dx, -dy * driven, -dy * turned, -dy)
            design[1] += (dy, dx * driven, dx * turned, dx)
            design[2] += (0.0, x, theta, 0.0)
            distance += math.hypot(x, y)
            turn += abs(theta)
        position = SLIP_DISTANCE**2 * distance
        heading = SLIP_DRIFT**2 * distance + SLIP_TURN**2 * turn
        return WheelStep(np.array(moved), design, np.array([position, heading]))

    def expected(self, step: WheelStep) -> FloatArray:
        """The motion (3,) without the systematic errors."""
        change = (step.design * self.systematic).sum(axis=1)
        return step.moved + change

    def variances(self, slips: FloatArray) -> FloatArray:
        """Variances (..., 2) of position and heading by random errors."""
        return np.square(FLOORS) + self.noise * slips

    def information(self, step: WheelStep) -> FloatArray:
        """Information (3, 3) of the expected motion, in the frame that it starts from."""
        covariance = np.diag(self.variances(step.slips)[[0, 0, 1]])
        sandwich(step.design, self.covariance, covariance)
        return inverted(covariance)

    def learn(
        self,
        systematic: FloatArray,
        covariance: FloatArray,
        errors: FloatArray,
        slips: FloatArray,
        seen: BoolArray,
    ) -> None:
        """Take what the graph says.

        Args:
            systematic: (4,) errors.
            covariance: (4, 4) of them.
            errors: (N, 3) what is left of the odometry's edges.
            slips: (N, 2) of those steps.
            seen: (N, 3) true where the laser saw both ends of a step, along each of its axes: of a corridor without
                ends it says how wide that is, and nothing is left of the wheels' errors along it.
        """
        self.systematic = systematic
        self.covariance = covariance
        for kind, axes in enumerate(((0, 1), (2,))):
            excess = 0.0
            known = 0.0
            for axis in axes:
                # Over a stretch the errors of wheels grow, those of matches don't.
                seen_slips = slips[:, kind] * seen[:, axis]
                stretch = (np.cumsum(seen_slips) / STRETCH[kind]).astype(np.int64)
                slip = np.bincount(stretch, weights=seen_slips)
                squared = np.bincount(stretch, weights=errors[:, axis] * seen[:, axis]) ** 2
                expected = self.noise[kind] * slip + MATCHED[kind]
                squared = np.minimum(squared, OUTLYING * expected)
                excess += (squared - MATCHED[kind]).sum()
                known += slip.sum()
            weight = len(axes) * PRIOR * STRETCH[kind]
            noise = (excess + FIRST_NOISE * weight) / (known + weight)
            self.noise[kind] = min(max(noise, LEAST_NOISE), MOST_NOISE)
