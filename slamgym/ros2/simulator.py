"""A simulated TurtleBot3 on ROS topics: the environment's world, laser and odometry without its mapper."""

import math
import threading
import time
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from gymnasium.utils import seeding
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Float32

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D, Twist2D
from slamgym.envs.batch.fleet import Fleet
from slamgym.envs.batch.robot import SimulatedRobot
from slamgym.envs.config import ExploreConfig
from slamgym.envs.plan_cache import PlanCache, ResetOptions, Streams
from slamgym.interop.ros_messages import (
    grid_fields,
    odometry_fields,
    pose_fields,
    scan_fields,
    stamp_of,
    transform_fields,
)
from slamgym.ros2.frames import POSES_END
from slamgym.ros2.node import LATCHED, SENSOR, RosNode
from slamgym.ros2.parameters import SimParameters
from slamgym.ros2.sim_clock import BEGIN, SimClock
from slamgym.ros2.topics import VelocityTopic
from slamgym.sim import Lidar

COMMAND_TIMEOUT = 0.5
"""Without a command for so long the robot stops [s]."""
LONGEST_WAIT = 0.2
"""As fast as commands come, the simulation waits for one so long [s]."""
TICKS = 10
"""Clock messages in a step."""


def begin_robot(
    plans: PlanCache, parameters: SimParameters, config: ExploreConfig
) -> tuple[SimulatedRobot, FloorPlan]:
    """The robot that an environment with the same settings and seed has after its reset, and its building.

    Raises:
        ConfigError: If there is no such plan, or the start leaves no room for the robot.
        PlanError: If the plan can't be explored.
    """
    starts: tuple[Pose2D, ...] = ()
    if len(parameters.start) == 3:
        x, y, theta = parameters.start
        starts = (Pose2D(x, y, theta),)
    elif parameters.start:
        raise ConfigError(f"start must be x, y, theta or nothing, not {parameters.start}")
    wanted = ResetOptions(parameters.plan or None, starts)
    rng, _ = seeding.np_random(parameters.seed)
    streams = Streams.spawn(rng)
    prepared, (pose,) = plans.choose_site(wanted, [streams], config.clutter)
    fleet = Fleet(config, 1)
    fleet.begin(0, prepared, pose, streams)
    fleet.look(np.array([0]))
    return SimulatedRobot(fleet), prepared.plan


class SimNode(RosNode):
    """Publishes what the robot senses and where it truly is, in the frame ``map`` that the environment has.

    Args:
        parameters: What the command line says.
        config: Robot, laser, odometry, furniture and people.
    """

    def __init__(self, parameters: SimParameters, config: ExploreConfig) -> None:
        super().__init__("slamgym_sim", parameters)
        self._defaults = parameters
        self._config = config
        self._lidar = Lidar(config.lidar)
        plans = self.read_parameters(parameters).plans
        self._plans = PlanCache(plans, config.robot, config.lidar.surfaces)
        self._send = {
            "scan": self.offer(LaserScan, "scan", SENSOR),
            "odom": self.offer(Odometry, "odom"),
            "pose": self.offer(PoseStamped, "ground_truth/pose"),
            "coverage": self.offer(Float32, "ground_truth/coverage"),
            "map": self.offer(OccupancyGrid, "map_truth", LATCHED),
            "tf": self.offer_transforms("/tf"),
            "tf_static": self.offer_transforms("/tf_static", LATCHED),
        }
        self._answered = threading.Event()
        self._time = SimClock(self)
        self.single.remove("map")
        self._begin()
        VelocityTopic(self, self.command)
        self.listen(PoseWithCovarianceStamped, "pose", self._take_pose)
        self.serve("reset", self._reset)
        self.worker.start(self._run)

    def _begin(self) -> None:
        """Begin an episode by the parameters as they are now."""
        parameters = self.read_parameters(self._defaults)
        self.robot, plan = begin_robot(self._plans, parameters, self._config)
        self._options = parameters
        self._time.begin()
        self._command = Twist2D(0.0, 0.0)
        self._commanded_at = 0.0
        self._unanswered = 0  # scans without a command
        self._placed_at = -math.inf  # stamp of the newest pose on the map
        start = self.robot.start
        grid = plan.raster(self._config.slam.resolution, offset=(start.x, start.y))
        self._send["map"](grid_fields(self.header(BEGIN, "map"), grid))
        on_robot = self.header(BEGIN, "base_footprint")
        mount = self._lidar.geometry.mount
        self._send["tf_static"](transform_fields(on_robot, "base_scan", mount))
        self.get_logger().info(f"plan {plan.id}, seed {self._options.seed}, start {start}")

    def _reset(self) -> str:
        self._begin()
        self.publish()
        return f"begun again with seed {self._options.seed}"

    def command(self, command: Twist2D) -> None:
        """Drive so from the next step on."""
        self._command = command
        self._commanded_at = self.robot.time
        self._unanswered = max(0, self._unanswered - 1)
        self._answered.set()

    def step(self) -> None:
        """Drive for one step, and publish what is sensed then."""
        is_late = self.robot.time - self._commanded_at >= COMMAND_TIMEOUT
        self.robot.step(Twist2D(0.0, 0.0) if is_late else self._command)
        self.publish()

    def _take_pose(self, message: Any) -> None:
        self._placed_at = stamp_of(message.header, 0.0)
        self._answered.set()

    def _is_awaited(self) -> bool:
        """True if a scan lacks its command, or the mapper's pose if there is a mapper that gives poses."""
        behind = self._time.began + self.robot.scan.stamp - self._placed_at
        return self._unanswered > 0 or 1e-6 < behind < POSES_END

    def _wait_for_answers(self) -> None:
        """Wait until the newest scan was mapped and answered, lest the robot run ahead of who maps and drives.

        An answer that is late is waited for again before the next step; one that doesn't come then, either, is lost.
        """
        scans = self._unanswered
        while self._is_awaited():
            self._answered.clear()
            if self._is_awaited() and not self._answered.wait(LONGEST_WAIT):
                if self._unanswered != scans:
                    self._unanswered = 0
                return

    def publish(self) -> None:
        """Publish the newest scan, odometry, transform and truth."""
        self._unanswered += 1
        robot = self.robot
        stamp = self._time.began + robot.time
        self._time.tick(robot.time)
        header = self.header(stamp, "odom")
        pose = robot.odometry_pose
        twist = np.array(robot.velocity)
        self._send["tf"](transform_fields(header, "base_footprint", pose))
        self._send["odom"](odometry_fields(header, "base_footprint", pose, twist))
        true_pose = pose_fields(robot.true_map_pose)
        self._send["pose"]({"header": self.header(stamp, "map"), "pose": true_pose})
        self._send["coverage"]({"data": robot.coverage.share})
        at_laser = self.header(self._time.began + robot.scan.stamp, "base_scan")
        ranges = robot.scan.ranges
        laser = self._lidar.geometry
        self._send["scan"](scan_fields(at_laser, ranges, laser, self._config.control_step))

    def _run(self) -> None:
        """Step at the speed that is wanted, until the program ends."""
        self._time.find_leader()
        self.publish()
        due = time.monotonic()
        while not self.worker.is_over:
            speed = self._options.speed
            if self._time.is_led:
                if not self._wait_for_leader():
                    continue
            elif speed > 0.0:
                due = max(due, time.monotonic() - LONGEST_WAIT)  # what can't be caught up is left
                due = self._sleep_through_step(due, speed)
            else:
                self._wait_for_answers()
            with self.worker.lock:
                if not self.worker.is_over:
                    self.step()

    def _wait_for_leader(self) -> bool:
        """Wait until the leading simulator's clock says that a step is due; false if it stands."""
        now = self.robot.time
        self._time.follow_back(now)
        return self._time.wait_for(now + self._config.control_step)

    def _sleep_through_step(self, due: float, speed: float) -> float:
        """Wait as long as a step takes that was due at a time, while the clock ticks; returns when the next is due."""
        now = self.robot.time
        tick = self._config.control_step / TICKS
        for number in range(1, TICKS + 1):
            due += tick / speed
            time.sleep(max(0.0, due - time.monotonic()))
            if number < TICKS:
                self._time.tick(now + number * tick)
        return due
