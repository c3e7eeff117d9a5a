"""The robot: a differential drive with the measures of a TurtleBot3 Waffle Pi."""

import math
from typing import Literal

from slamgym.core.config import Positive, Settings, Share
from slamgym.core.errors import ConfigError


class RobotConfig(Settings, section="robot"):
    """Measures and limits of a differential-drive robot. Its base frame stands on the axle's middle, x ahead.

    The defaults are those of the TurtleBot3 Waffle Pi in ROBOTIS's e-manual and ``turtlebot3_description``,
    with the acceleration limits and outlines of ``turtlebot3_navigation``.
    """

    wheel_separation: Positive = 0.287
    """Distance between the wheels' contact points [m]."""

    wheel_radius: Positive = 0.033
    """[m]"""

    max_linear: Positive = 0.26
    """Highest speed forward and backward [m/s]."""

    max_angular: Positive = 1.82
    """Highest turning rate [rad/s]."""

    linear_acceleration: Positive = 2.5
    """[m/s^2]"""

    angular_acceleration: Positive = 3.2
    """[rad/s^2]"""

    shape: Literal["circle", "footprint"] = "circle"
    """What collides: a disc about the axle, which can always turn on the spot, or the real rectangle."""

    radius: Positive = 0.22
    """Radius of the disc, and the clearance that planners keep; ``robot_radius`` of TurtleBot3's navigation
    [m]."""

    footprint: tuple[float, float, float, float] = (-0.205, -0.155, 0.077, 0.155)
    """Rectangle (rear, right, front, left) about the axle, which is not in its middle [m]."""

    mass: Positive = 1.8
    """[kg]; matters only for how contact turns the body."""

    contact: Literal["slide", "stop"] = "slide"
    """On contact the body slides along the obstacle, or stands until it is driven away from it.

    Sliding is frictionless: on a robot this light the scraping force is small beside what the tyres hold, so
    it neither stops the body nor turns it.
    """

    contact_slip: Share = 1.0
    """What the wheels do while contact blocks the body: 1 they roll on as driven, 0 they stall, or any share.

    The default follows from the motors: the XM430-W210's stall torque of 2.7 N m is 82 N at a wheel of 0.033
    m, far more than the tyres of a 1.8 kg robot can pass to the floor. A real Waffle Pi spins its wheels at a
    wall, and its odometry counts a distance that it didn't go.
    """

    def _check(self) -> None:
        rear, right, front, left = self.footprint
        if not (rear < 0.0 < front and right < 0.0 < left):
            raise ConfigError(
                f"robot.footprint must be (rear, right, front, left) about the axle, not {self.footprint}"
            )

    @property
    def circumscribed_radius(self) -> float:
        """Largest distance of a point of the body from the axle's middle [m]."""
        if self.shape == "circle":
            return self.radius
        rear, right, front, left = self.footprint
        return math.hypot(max(-rear, front), max(-right, left))
