"""The robot: a differential drive with the measures of a TurtleBot3 Waffle Pi."""

import math
from dataclasses import dataclass
from typing import Literal

from slamgym.core.errors import ConfigError


@dataclass(frozen=True)
class RobotConfig:
    """Measures and limits of a differential-drive robot. Its base frame stands on the axle's middle, x ahead.

    The defaults are those of the TurtleBot3 Waffle Pi in ROBOTIS's e-manual and ``turtlebot3_description``,
    with the acceleration limits and outlines of ``turtlebot3_navigation``.
    """

    wheel_separation: float = 0.287
    """Distance between the wheels' contact points [m]."""

    wheel_radius: float = 0.033
    """[m]"""

    max_linear: float = 0.26
    """Highest speed ahead and astern [m/s]."""

    max_angular: float = 1.82
    """Highest turning rate [rad/s]."""

    linear_acceleration: float = 2.5
    """[m/s^2]"""

    angular_acceleration: float = 3.2
    """[rad/s^2]"""

    shape: Literal["circle", "footprint"] = "circle"
    """What collides: a disc about the axle, which can always turn on the spot, or the real rectangle."""

    radius: float = 0.22
    """Radius of the disc, and the clearance that planners keep; ``robot_radius`` of TurtleBot3's navigation
    [m]."""

    footprint: tuple[float, float, float, float] = (-0.205, -0.155, 0.077, 0.155)
    """Rectangle (rear, right, front, left) about the axle, which is not in its middle [m]."""

    mass: float = 1.8
    """[kg]; matters only for how contact turns the body."""

    contact: Literal["slide", "stop"] = "slide"
    """On contact the body slides along the obstacle, or stands until it is driven away from it.

    Sliding is frictionless: on a robot this light the scraping force is small beside what the tyres hold, so
    it neither stops the body nor turns it.
    """

    contact_slip: float = 1.0
    """What the wheels do while contact blocks the body: 1 they roll on as driven, 0 they stall, or any share.

    The default follows from the motors: the XM430-W210's stall torque of 2.7 N m is 82 N at a wheel of 0.033
    m, far more than the tyres of a 1.8 kg robot can pass to the floor. A real Waffle Pi spins its wheels at a
    wall, and its odometry counts a distance that it didn't go.
    """

    def __post_init__(self) -> None:
        positive = (
            "wheel_separation", "wheel_radius", "max_linear", "max_angular", "linear_acceleration",
            "angular_acceleration", "radius", "mass",
        )  # fmt: skip
        for name in positive:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"robot.{name} must be positive and finite, not {value}")
        if not 0.0 <= self.contact_slip <= 1.0:
            raise ConfigError(f"robot.contact_slip must lie in [0, 1], not {self.contact_slip}")
        if self.shape not in ("circle", "footprint"):
            raise ConfigError(f"robot.shape must be 'circle' or 'footprint', not {self.shape!r}")
        if self.contact not in ("slide", "stop"):
            raise ConfigError(f"robot.contact must be 'slide' or 'stop', not {self.contact!r}")
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
