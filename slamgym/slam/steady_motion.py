"""A robot whose speed changes little: where it is next, how well that is known, and how fast it turns out to go.

A Kalman filter of pose and speed. From scan to scan the speed changes by white noise (Barfoot, Tong and Sarkka, *Batch
continuous-time trajectory estimation as exactly sparse Gaussian process regression*, RSS 2014). So a robot goes on as
it went where its laser binds nothing, and the covariance says how little is known there.
"""

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.portable import inverted, product
from slamgym.core.types import FloatArray
from slamgym.slam.graph.relative import moved_by

SPEED_CHANGE = 0.3
"""Standard deviation of what a speed changes by within a second [m/s]."""
TURN_CHANGE = 1.5
"""Standard deviation of what the speed of a turn changes by within a second [rad/s]."""
FIRST_SPEED = 0.5
"""Standard deviation of the speed at the first scan [m/s]."""
FIRST_TURNING = 1.0
"""Standard deviation of the speed of a turn at the first scan [rad/s]."""


class SteadyMotion:
    """Pose and speed of a robot that begins at the origin.

    Attributes:
        pose: (3,) in the map frame.
        speed: (3,) in the robot's own frame [m/s], [m/s], [rad/s].
        covariance: (6, 6) of the pose in the map frame, and of the speed.
    """

    def __init__(self) -> None:
        self.pose = np.zeros(3)
        self.speed = np.zeros(3)
        self.covariance = np.zeros((6, 6))
        self.covariance[3:, 3:] = np.diag(np.square([FIRST_SPEED, FIRST_SPEED, FIRST_TURNING]))

    @property
    def pose_covariance(self) -> FloatArray:
        """Covariance (3, 3) of the pose."""
        return self.covariance[:3, :3]

    def predict(self, wait: float) -> None:
        """Go on for a time [s]."""
        before = self.pose
        self.pose = moved_by(before, self.speed * wait)
        x, y, _ = self.pose - before
        along, across, _ = moved_by(np.array([0.0, 0.0, before[2]]), np.array([wait, 0.0, 0.0]))
        change = np.eye(6)
        change[0, 2] = -y
        change[1, 2] = x
        change[:2, 3:5] = [[along, -across], [across, along]]
        change[2, 5] = wait
        rates = np.diag(np.square([SPEED_CHANGE, SPEED_CHANGE, TURN_CHANGE]))
        noise = np.zeros((6, 6))
        noise[:3, :3] = rates * wait**3 / 3.0
        noise[:3, 3:] = product(change[:3, 3:], rates) * wait / 2.0
        noise[3:, :3] = noise[:3, 3:].T
        noise[3:, 3:] = rates * wait
        self.covariance = product(product(change, self.covariance), change.T) + noise

    def correct(self, pose: FloatArray, information: FloatArray) -> None:
        """Take what the laser says of the pose (3,), and the information (3, 3) of that, which may be singular."""
        away = pose - self.pose
        away[2] = wrap_angle(away[2])
        known = inverted(self.pose_covariance)
        after = inverted(known + information)
        # What is learned of the pose bears on the speed by their common covariance.
        pull = product(self.covariance[:, :3], known)
        change = product(pull, product(after, product(information, away[:, None])))[:, 0]
        gained = product(product(pull, self.pose_covariance - after), pull.T)
        self.pose = self.pose + change[:3]
        self.pose[2] = wrap_angle(self.pose[2])
        self.speed = self.speed + change[3:]
        rest = self.covariance - gained
        self.covariance = 0.5 * (rest + rest.T)  # rounding would tilt it more and more
