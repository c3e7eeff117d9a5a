"""The robot: a differential drive with the measures of a TurtleBot3 Waffle Pi."""

from typing import Annotated

from slamgym.core.config import Settings, Within

WHEEL_RADIUS = 0.033
"""[m]; with the encoder's resolution it gives the length of a tick."""

ROBOT_MASS = 1.8
"""[kg]; a disc that slides without friction moves the same with any weight."""


class RobotConfig(Settings, section="robot"):
    """Measures and limits of a differential-drive robot. Its base frame stands on the axle's middle, x ahead.

    The defaults are those of the TurtleBot3 Waffle Pi in ROBOTIS's e-manual and ``turtlebot3_description``,
    with the acceleration limits and outlines of ``turtlebot3_navigation``.

    On contact the body slides along the obstacle without friction: on a robot this light the scraping force is small
    against what the tyres hold. The wheels roll on as driven: the XM430-W210's stall torque of 2.7 N m is 82 N at a
    wheel of 0.033 m, far more than the tyres of a 1.8 kg robot can pass to the floor. A real Waffle Pi spins its wheels
    at a wall, and its odometry counts a distance that it didn't go.
    """

    wheel_separation: Annotated[float, Within(gt=0.0, le=10.0)] = 0.287
    """Distance between the wheels' contact points [m]."""

    max_linear: Annotated[float, Within(gt=0.0, le=20.0)] = 0.26
    """Highest speed forward and backward [m/s]."""

    max_angular: Annotated[float, Within(gt=0.0, le=100.0)] = 1.82
    """Highest turning rate [rad/s]."""

    linear_acceleration: Annotated[float, Within(gt=0.0, le=1e4)] = 2.5
    """[m/s^2]"""

    angular_acceleration: Annotated[float, Within(gt=0.0, le=1e5)] = 3.2
    """[rad/s^2]"""

    radius: Annotated[float, Within(gt=0.0, le=10.0)] = 0.22
    """Radius of the disc about the axle that collides, and the clearance that planners keep; ``robot_radius`` of
    TurtleBot3's navigation [m]."""
