"""Calibration of the wheels while a robot drives: systematic errors of the odometry, and how far to trust it.

Scan matching tells how the robot moved between processed scans, except where there is little to match. What the
odometry said of the same stretch differs by systematic errors, which are regressed on the distance driven and the
angle turned (a Kalman filter, after Martinelli, Tomatis and Siegwart, *Simultaneous localization and odometry self
calibration*, Autonomous Robots 22, 2007), and by random slip whose variance grows with both (Chong and Kleeman, ICRA
1997). Both are used where matching can't help: in rooms larger than the laser's range, and in long corridors.
"""

import math
from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import compose, wrap_angle
from slamgym.core.types import FloatArray, Pose2D

DISTANCE, HEADING = 0, 1
"""Places of the two random errors."""
SCALE_SPREAD = 0.03
"""Before anything is learned: spread of the distance's scale, true over measured ..."""
DRIFT_SPREAD = 0.015
"""... of the heading's drift per metre [rad/m] ..."""
TURN_SPREAD = 0.04
"""... and of the turn's scale; about twice those of :func:`slamgym.sim.wheel_odometry.odometry_level` ``high``."""
SLIP_DISTANCE, SLIP_DRIFT, SLIP_TURN = 0.02, 0.015, 0.03
"""Random errors before anything is learned: of the distance [m/sqrt(m)], of the heading by distance
[rad/sqrt(m)] and by turn [rad/sqrt(rad)]."""
WINDOW_METRES, WINDOW_RADIANS = 0.5, 0.5
"""A stretch this long or with so much turning is compared: matches err by a few millimetres at either end."""
PRIOR_STRETCHES = 4.0
"""Weight of the random errors' sizes before anything is learned, in stretches."""
MEMORY_STRETCHES = 60.0
"""Older stretches are forgotten: floors and loads change."""
OUTLIER = 9.0
"""A squared error beyond this many times what is expected counts as so many."""
LEAST_NOISE = 0.01
"""Share of the random errors above that stays, however true the odometry seems."""
TRUE_NOISE, FAULTY_NOISE = 0.15, 0.35
"""Below the first noise of the heading the odometry seems to be true, above the second it doesn't."""
SIGNIFICANT = 9.0
"""Systematic errors of odometry that seems to be true are believed beyond this chi-squared."""


@dataclass
class MotionSpread:
    """Variances of a motion by odometry, in the robot frame it started from."""

    distance: float  # [m^2], along and across
    heading: float  # [rad^2]
    random_distance: float  # the part that is new with each motion [m^2]
    random_heading: float  # [rad^2]


class OdometryCalibration:
    """Systematic and random errors of the odometry at hand, learned from matches."""

    def __init__(self) -> None:
        self.scale = 0.0
        """Share by which the robot drives further than measured."""
        self.heading = np.zeros(2)
        """Drift per metre [rad/m], and share by which it turns further than measured."""
        self._scale_variance = SCALE_SPREAD**2
        self._heading_covariance = np.diag([DRIFT_SPREAD**2, TURN_SPREAD**2])
        self.noise = [1.0, 1.0]
        """Variances of the random errors of distances, over that of ``SLIP_DISTANCE``, and of headings, over that of
        ``SLIP_DRIFT`` and ``SLIP_TURN``."""
        self._weights = [PRIOR_STRETCHES, PRIOR_STRETCHES]  # of what they were learned from
        self.significance = self._believed_share()
        """Share of the systematic errors that is believed."""
        self.restart()

    def correct(self, increments: FloatArray) -> FloatArray:
        """Take the systematic errors out of motions in the robot frame, shape (steps, 3)."""
        corrected = np.array(increments, dtype=np.float64)
        share = self.significance
        drift, turn = share * self.heading
        corrected[:, :2] *= 1.0 + share * self.scale
        corrected[:, 2] += drift * increments[:, 0] + turn * increments[:, 2]
        return corrected

    def _believed_share(self) -> float:
        """Share of the systematic errors that is believed (positive-part James and Stein).

        A laser's bias moves all matches alike and looks like an error of the wheels. Where the random errors are so
        small that the odometry seems to be true, only significant systematic ones count.
        """
        squared = self.scale**2 / self._scale_variance
        drift, turn = self.heading.tolist()
        (drift_variance, both), (_, turn_variance) = self._heading_covariance.tolist()
        squared += (drift**2 * turn_variance - 2.0 * drift * turn * both + turn**2 * drift_variance) / (
            drift_variance * turn_variance - both**2
        )
        truth = (FAULTY_NOISE - self.noise[HEADING]) / (FAULTY_NOISE - TRUE_NOISE)
        return max(0.0, 1.0 - SIGNIFICANT * min(max(truth, 0.0), 1.0) / max(squared, 1e-9))

    def spread(self, increments: FloatArray) -> MotionSpread:
        """Uncertainty of a motion by odometry once it is corrected.

        Args:
            increments: (steps, 3) in the robot frame.
        """
        distance, turn = _lengths(increments)
        forward, turned = float(increments[:, 0].sum()), float(increments[:, 2].sum())
        share = np.array([forward, turned])
        random_distance = max(self.noise[DISTANCE], LEAST_NOISE) * SLIP_DISTANCE**2 * distance
        slip = SLIP_DRIFT**2 * distance + SLIP_TURN**2 * turn
        random_heading = max(self.noise[HEADING], LEAST_NOISE) * slip
        return MotionSpread(
            random_distance + self._scale_variance * forward**2,
            random_heading + float((share * self._shared(share)).sum()),
            random_distance,
            random_heading,
        )

    def restart(self) -> None:
        """Compare from here on: the pose here can't be relied on."""
        self._odometry = self._moved = Pose2D(0.0, 0.0, 0.0)
        self._distance = self._turn = self._signed = 0.0

    def learn(self, increments: FloatArray, moved: Pose2D, along: float, heading: float) -> None:
        """Take a match that can be relied on.

        Args:
            increments: (steps, 3) raw odometry since the last one, in the robot frame.
            moved: The motion since by matching.
            along: Variance of a matched position along the robot's heading [m^2].
            heading: Variance of a matched heading [rad^2].
        """
        self._moved = compose(self._moved, moved)
        for increment in increments.tolist():
            self._odometry = compose(self._odometry, Pose2D(*increment))
        distance, turn = _lengths(increments)
        self._distance += distance
        self._signed += float(increments[:, 0].sum())
        self._turn += turn
        if self._distance < WINDOW_METRES and self._turn < WINDOW_RADIANS:
            return
        self._learn_heading(float(wrap_angle(self._moved.theta - self._odometry.theta)), 2.0 * heading)
        length = math.hypot(self._odometry.x, self._odometry.y)
        if length > 0.5 * WINDOW_METRES:
            forward = self._moved.x * self._odometry.x + self._moved.y * self._odometry.y
            error = forward / length - length
            self._learn_distance(error, length, 2.0 * along)
        self.significance = self._believed_share()
        self.restart()

    def _learn_heading(self, error: float, match_variance: float) -> None:
        shares = np.array([self._signed, self._odometry.theta])
        slip = SLIP_DRIFT**2 * self._distance + SLIP_TURN**2 * self._turn
        innovation = error - float((self.heading * shares).sum())
        systematic = float((shares * self._shared(shares)).sum())
        spread = self._learn_noise(HEADING, innovation, systematic, slip, match_variance)
        if innovation**2 <= OUTLIER * spread:
            gain = self._shared(shares) / spread
            self.heading = self.heading + gain * innovation
            self._heading_covariance = self._heading_covariance - np.outer(gain, self._shared(shares))

    def _shared(self, shares: FloatArray) -> FloatArray:
        """The covariance of the heading's errors times shares of them, (2,)."""
        return np.asarray((self._heading_covariance * shares).sum(axis=1), dtype=np.float64)

    def _learn_distance(self, error: float, length: float, match_variance: float) -> None:
        slip, innovation = SLIP_DISTANCE**2 * self._distance, error - self.scale * length
        systematic = self._scale_variance * length**2
        spread = self._learn_noise(DISTANCE, innovation, systematic, slip, match_variance)
        if innovation**2 <= OUTLIER * spread:
            gain = self._scale_variance * length / spread
            self.scale += gain * innovation
            self._scale_variance *= 1.0 - gain * length

    def _learn_noise(
        self, which: int, innovation: float, systematic: float, slip: float, match_variance: float
    ) -> float:
        """Learn a random error's size from one more stretch; returns the variance expected of the innovation.

        Args:
            which: ``DISTANCE`` or ``HEADING``.
            innovation: Of the stretch.
            systematic: Variance by what is not known of the systematic errors.
            slip: Variance that an error of size 1 has over the stretch.
            match_variance: Variance of the matches.
        """
        spread = systematic + (max(self.noise[which], LEAST_NOISE) * slip + match_variance)
        # Not cut off at zero: that would make true odometry seem noisy.
        excess = (min(innovation**2, OUTLIER * spread) - match_variance) / slip
        share = 1.0 if innovation**2 > OUTLIER * spread else (slip / (slip + match_variance)) ** 2
        weight = self._weights[which] + share
        self.noise[which] += share * (excess - self.noise[which]) / weight
        self._weights[which] = min(weight, MEMORY_STRETCHES)
        return spread


def _lengths(increments: FloatArray) -> tuple[float, float]:
    """Distance driven [m] and angle turned [rad], both adding up."""
    return float(np.hypot(increments[:, 0], increments[:, 1]).sum()), float(np.abs(increments[:, 2]).sum())
