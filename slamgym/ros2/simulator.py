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
from slamgym.core.geometry import between, compose, part_of
from slamgym.core.types import AT_REST, Pose2D, Twist2D
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
from slamgym.ros2.parameters import SimParameters, WorldParameters
from slamgym.ros2.sim_clock import BEGIN, SimClock
from slamgym.ros2.topics import VelocityTopic
from slamgym.sim import Lidar

COMMAND_TIMEOUT = 0.5
"""Without a command for so long the robot stops [s]."""
LONGEST_WAIT = 0.2
"""As fast as commands come, the simulation waits for one so long [s]."""
BODY_HEIGHT = 0.010
"""Of a Waffle Pi's base_link over the floor [m], as TurtleBot3's description has it."""
MOUNT_HEIGHT = 0.122
"""Of its laser over the body [m]. At height 0 rounding may put echoes below the floor, where Nav2's obstacle
layers (``min_obstacle_height`` 0) and the voxels of its local costmap (``origin_z`` 0) pass them over."""
TICKS = 6
"""Messages of clock, odometry and transform in a step of 0.2 s: 30 a second, as TurtleBot3's bringup sends them."""


def begin_robot(
    plans: PlanCache, parameters: WorldParameters, config: ExploreConfig
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
        self._send_fixed_frames(parameters)
        self.get_logger().info(f"plan {plan.id}, seed {self._options.seed}, start {start}")

    def _send_fixed_frames(self, names: SimParameters) -> None:
        """Publish where the body is on the robot, and the laser on the body, in one message: only the last is kept."""
        on_body = self.header(BEGIN, names.body_frame)
        mount = self._lidar.geometry.mount
        has_body = names.body_frame != names.base_frame
        height = MOUNT_HEIGHT if has_body else BODY_HEIGHT + MOUNT_HEIGHT
        fixed = [transform_fields(on_body, names.laser_frame, mount, height)]
        if has_body:
            on_floor = self.header(BEGIN, names.base_frame)
            fixed.insert(0, transform_fields(on_floor, names.body_frame, AT_REST, BODY_HEIGHT))
        self._send["tf_static"](*fixed)

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
        self._drive()
        self.publish()

    def _drive(self) -> None:
        is_late = self.robot.time - self._commanded_at >= COMMAND_TIMEOUT
        self.robot.step(Twist2D(0.0, 0.0) if is_late else self._command)

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
        self._send_odometry(robot.time, robot.odometry_pose)
        true_pose = pose_fields(robot.true_map_pose)
        self._send["pose"]({"header": self.header(stamp, "map"), "pose": true_pose})
        self._send["coverage"]({"data": robot.coverage.share})
        names = self._options
        at_laser = self.header(self._time.began + robot.scan.stamp, names.laser_frame)
        ranges = robot.scan.ranges
        laser = self._lidar.geometry
        self._send["scan"](scan_fields(at_laser, ranges, laser, self._config.control_step))

    def _send_odometry(self, time: float, pose: Pose2D) -> None:
        """Publish the odometry at a time of the robot's [s]."""
        names = self._options
        header = self.header(self._time.began + time, names.odom_frame)
        self._send["tf"](transform_fields(header, names.base_frame, pose))
        twist = np.array(self.robot.velocity)
        self._send["odom"](odometry_fields(header, names.base_frame, pose, twist))

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
                due = self._step_in_time(due, self._config.control_step / speed)
                continue
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

    def _step_in_time(self, due: float, length: float) -> float:
        """Drive a step while its time passes: clock and odometry go on meanwhile, the scan comes at its end.

        The command that answers the last scan is waited for at most half the step: the odometry on the way needs it.

        Args:
            due: When the step begins [s].
            length: How long it takes here [s].

        Returns:
            When the next step begins.
        """
        robot = self.robot
        began = robot.time
        before = robot.odometry_pose
        sent = 0
        self._answered.clear()
        for number in range(1, TICKS + 1):
            due += length / TICKS
            if robot.time == began:
                self._answered.wait(max(0.0, due - time.monotonic()))
                if self._answered.is_set() or number >= TICKS // 2:
                    with self.worker.lock:
                        self._drive()
            time.sleep(max(0.0, due - time.monotonic()))
            with self.worker.lock:
                if self.worker.is_over or self.robot is not robot:  # reset meanwhile
                    return due
                if number < TICKS:
                    self._time.tick(began + number / TICKS * self._config.control_step)
                while robot.time > began and sent < min(number, TICKS - 1):
                    sent += 1
                    self._send_on_the_way(began, before, sent / TICKS)
        with self.worker.lock:
            if self.robot is robot:
                self.publish()
        return due

    def _send_on_the_way(self, began: float, before: Pose2D, share: float) -> None:
        """Publish the odometry after a share of a step that began at a time [s] and a pose."""
        moved = part_of(between(before, self.robot.odometry_pose), share)
        stamp = began + share * self._config.control_step
        self._send_odometry(stamp, compose(before, moved))
