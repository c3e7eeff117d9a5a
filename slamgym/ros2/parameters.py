"""What the nodes may be told: on the command line, or as ROS parameters of the same names."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from slamgym.core.config import Arguments, CountOrZero, Positive, Within
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D

RosOut = Annotated[Path, tyro.conf.arg(aliases=["-o"])]


class FrameNames(Arguments):
    """Names of the frames (REP 105)."""

    map_frame: str = "map"
    """Frame of the map."""
    odom_frame: str = "odom"
    """Frame of the odometry."""
    base_frame: str = "base_footprint"
    """Frame of the robot."""
    laser_mount: tuple[float, float, float] = (-0.064, 0.0, 0.0)
    """The laser on the robot (x, y [m], yaw [rad]) until /tf_static says it; TurtleBot3 Waffle Pi's."""

    autostart: bool = True
    """Begin active; false (a ROS parameter): a lifecycle manager configures and activates the node."""
    scan_time: Annotated[float, Within(ge=-1.0, le=10.0)] = -1.0
    """Time from the first beam of a scan to the last [s]; 0: all are measured at once; -1: as the messages say."""

    @property
    def mount(self) -> Pose2D:
        """The laser on the robot until /tf_static says it."""
        x, y, yaw = self.laser_mount
        return Pose2D(x, y, yaw)


class WorldParameters(Arguments):
    """A simulated TurtleBot3 in a floor plan, without Gazebo."""

    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    plan: str = ""
    """Id of the plan; by default one that follows from the seed."""
    start: tuple[float, ...] = ()
    """Start in the plan's frame (x, y, theta [m, rad]); by default it follows from the seed."""
    seed: CountOrZero = 0
    """Seed of everything random: with the same commands the scans are the environment's."""
    speed: Annotated[float, Within(ge=0.0)] = 1.0
    """Times real time; 0: as fast as commands come, a step for each (with none for 0.2 s it goes on)."""


class SimParameters(WorldParameters):
    """The simulated robot, with the frames of its transforms: odom -> base_footprint -> base_link -> base_scan."""

    odom_frame: str = "odom"
    """Frame of the odometry."""
    base_frame: str = "base_footprint"
    """Frame of the robot on the floor."""
    body_frame: str = "base_link"
    """Frame of the robot's body, which Nav2's own parameters name; may be the base frame."""
    laser_frame: str = "base_scan"
    """Frame of the laser."""


class MapParameters(FrameNames):
    """Map by graph SLAM, as slam_toolbox or GMapping do, or localise on a finished map."""

    out: RosOut = Path("mapped")
    """Folder that is written to every minute, by the services `save` and `draw`, and at the end of the node. What an
    earlier run left there is put aside (run1, run2, ...)."""
    continue_: Annotated[bool, tyro.conf.arg(name="continue")] = False
    """Go on with the map that an earlier run left there: its log is mapped again first. The robot's odometry must have
    run on since."""
    map: str = ""
    """A finished map (yaml): the robot is localised on it, nothing is mapped."""
    odometry: Literal["tf", "laser"] = "tf"
    """tf: from /tf, or from /odom where /tf has none; laser: by the laser alone."""
    map_interval: Positive = 2.0
    """Time between two maps [s]."""

    def _check(self) -> None:
        if self.continue_ and self.map:
            raise ConfigError(
                "--continue goes on with mapping, but with --map nothing is mapped; leave one of them out"
            )


class ExploreParameters(FrameNames):
    """Explore until everything that the robot can get to is on the map, as explore_lite does."""

    robots: tuple[str, ...] | None = None
    """Namespaces of several robots, as in `robot1 robot2`: one explorer is started for each, and what merges their
    maps."""
    explorer: str = "tour"
    """Who chooses: tour, nearest, explore_lite, rl, ...; behind @ a promise at which it is done, as in tour@98%:95%."""
    drive: Literal["wheels", "goals"] = "wheels"
    """wheels: velocities to cmd_vel; goals: goals to Nav2 (navigate_to_pose, or goal_pose without nav2_msgs)."""
    area: tuple[float, ...] = ()
    """Corners (x y x y ... [m], map frame) of the polygon in which to explore; everywhere by default."""
    return_to_start: bool = False
    """Drive back to the start at the end."""
    wait: bool = False
    """Wait for the service `start`."""
    out: RosOut = Path("explored")
    """Folder for the map and its drawing, written when it is done."""
    robot_radius: Positive = 0.22
    """Radius of the circle that holds the robot [m]."""
    max_linear: Positive = 0.26
    """Highest speed [m/s]."""
    max_angular: Positive = 1.82
    """Highest turning rate [rad/s]."""
    exit: bool = False
    """End the node when it is done."""
    rerun: str = ""
    """Recording to write, .rrd, which the rerun viewer shows on a timeline."""
    video: str = ""
    """Film to write, .mp4 or .gif."""
    view: Annotated[int, Within(ge=0, le=65535)] = 0
    """Port of a live view for the browser, http://localhost:PORT, with a button that stops the robot; 0: none."""

    def _check(self) -> None:
        if self.robots is not None:
            check_robots(self.robots)
            if not self.robots:
                raise ConfigError("a team of no robots: name some behind --robots, or leave it out")
        if len(self.area) % 2 or 0 < len(self.area) < 6:
            raise ConfigError(
                f"--area is x y of three corners or more, not {len(self.area)} numbers"
            )

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Of the area, in the map frame [m]."""
        return tuple(zip(self.area[::2], self.area[1::2], strict=True))


class MergeParameters(Arguments):
    """Make one map of the maps of several robots, whoever their mappers are; a robot may join late, or die."""

    robots: tuple[str, ...] = ()
    """Namespaces of the robots, as in `robot1 robot2` for /robot1/map; by default all whose maps are published, those
    that come later, too."""
    starts: tuple[float, ...] = ()
    """Where the origins of their maps lie (x y theta [m, m, rad] of each robot) in one frame, where that is known.
    Without it the first map gives the frame, and another is used once it is sure where it lies."""
    map_frame: str = "map"
    """Frame of the merged map."""
    merge_interval: Positive = 5.0
    """Time between two merged maps [s]."""
    out: RosOut = Path("merged")
    """Folder for the map, written by the service `save` and at the end."""

    def _check(self) -> None:
        check_robots(self.robots)
        if self.starts and len(self.starts) != 3 * len(self.robots):
            raise ConfigError(
                f"--starts is x y theta of each of {len(self.robots)} robots, not {len(self.starts)} numbers; name the "
                "robots, too"
            )

    @property
    def places(self) -> dict[str, Pose2D]:
        """Where the robots' maps lie, as far as that is known."""
        numbers = iter(self.starts)
        poses = [Pose2D(*pose) for pose in zip(numbers, numbers, numbers, strict=True)]
        return dict(zip(self.robots, poses, strict=False))


def check_robots(names: tuple[str, ...]) -> None:
    """Refuse robots of one name, and names that no namespace can have.

    Raises:
        ConfigError: If there are some.
    """
    for number, name in enumerate(names):
        if name in names[:number]:
            raise ConfigError(f"two robots are called {name}; give each a name of its own")
        if not name.isidentifier():
            raise ConfigError(
                f"the robot {name!r} can't be a namespace; take letters, digits and _, as in robot1"
            )


class DemoParameters(WorldParameters):
    """All three nodes at once: a simulated robot explores a floor plan over topics, and saves map and drawing."""

    speed: Annotated[float, Within(ge=0.0)] = 0.0
    """Times real time; 0: as fast as the explorer drives."""
    explorer: str = "tour"
    """Who chooses: tour, nearest, explore_lite, rl, ..."""
    out: RosOut = Path("ros2_demo")
    """Folder for map, drawing and log."""
    rerun: str = ""
    """Recording to write, .rrd, for the rerun viewer."""
    video: str = ""
    """Film to write, .mp4 or .gif."""
    view: Annotated[int, Within(ge=0, le=65535)] = 0
    """Port of a live view for the browser, http://localhost:PORT; 0: none."""
