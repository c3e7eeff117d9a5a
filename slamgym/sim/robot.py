"""The robot: a differential drive with the measures of a TurtleBot3 Waffle Pi."""

from slamgym.core.config import Positive, Settings

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

    wheel_separation: Positive = 0.287
    """Distance between the wheels' contact points [m]."""

    max_linear: Positive = 0.26
    """Highest speed forward and backward [m/s]."""

    max_angular: Positive = 1.82
    """Highest turning rate [rad/s]."""

    linear_acceleration: Positive = 2.5
    """[m/s^2]"""

    angular_acceleration: Positive = 3.2
    """[rad/s^2]"""

    radius: Positive = 0.22
    """Radius of the disc about the axle that collides, and the clearance that planners keep; ``robot_radius`` of
    TurtleBot3's navigation [m]."""
