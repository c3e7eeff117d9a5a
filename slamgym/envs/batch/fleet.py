"""Robots in their buildings, driven and sensing together: bodies, wheels, scanners, and the floor that was seen."""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import unit_vectors
from slamgym.core.jit import plain
from slamgym.core.types import FloatArray, IntArray, Pose2D, Twist2D
from slamgym.envs.batch.arrays import (
    PLACE,
    DriveModel,
    Robots,
    ScanModel,
    Scans,
    Scenes,
    WheelModel,
    bare,
    put,
)
from slamgym.envs.batch.stepping import arrive_all, drive_all, look_all
from slamgym.envs.batch.threads import divide_work
from slamgym.envs.config import ExploreConfig
from slamgym.envs.coverage import CELL, Coverage, ReachableFloor
from slamgym.envs.plan_cache import PreparedPlan, Streams
from slamgym.sim import Lidar, OdometryConfig, WheelOdometry, World
from slamgym.sim.lidar import LONGEST_BURST
from slamgym.sim.robot import WHEEL_RADIUS
from slamgym.sim.surfaces import Surfaces


class Robot(NamedTuple):
    """What belongs to one robot and is no array."""

    prepared: PreparedPlan
    world: World
    streams: Streams


class Fleet:
    """So many robots, each in its building; one of them is all that a single environment needs.

    Args:
        config: The settings.
        count: How many.
        threads: So many work on them.

    Attributes:
        config: As given.
        threads: As given.
        robots: Bodies and wheels.
        scenes: What they touch and see.
        scans: The newest scans.
        each: What belongs to one robot alone.
        lidar: The scanner that all have.
        scanner: The same for kernels, without names.
    """

    def __init__(self, config: ExploreConfig, count: int, threads: int = 1) -> None:
        self.config = config
        self.threads = threads
        self.robots = Robots.rest(count)
        self.scenes = Scenes.empty(count)
        self.scans = Scans.blank(count, config.lidar.num_beams, LONGEST_BURST)
        self.each: list[Robot] = []
        self.lidar = Lidar(config.lidar)
        self.scanner = plain(_scan_model(config, self.lidar))
        self._drive_model = DriveModel.of(config.robot, float(config.control_step))
        self._wheel_model = _wheel_model(config.odometry)
        self._fastest = np.array([config.robot.max_linear, config.robot.max_angular])

    def __len__(self) -> int:
        return len(self.robots.steps)

    @property
    def times(self) -> FloatArray:
        """Robot time, shape (N,) [s]."""
        return np.asarray(self.robots.steps * self.config.control_step, dtype=np.float64)

    @property
    def shares(self) -> FloatArray:
        """Shares of the reachable floor that were seen, shape (N,); 1 where there is no floor."""
        return self.scenes.shares.copy()

    def coverage(self, index: int) -> Coverage:
        """The floor that one robot has seen."""
        start = self.robots.start[index]
        floor = self.each[index].prepared.floor
        cells = floor.mask(start[0], start[1])
        unseen = self.scenes.unseen[index, : cells.size].reshape(cells.shape)
        return Coverage(cells, unseen, floor.frame)

    def kernel_scenes(self) -> Scenes:
        """The scenes for kernels, whose segments are of the read-only type that a single scanner's have."""
        segments = self.scenes.segments.view()
        segments.flags.writeable = False
        return bare(self.scenes._replace(segments=segments))

    def begin(self, index: int, prepared: PreparedPlan, start: Pose2D, streams: Streams) -> None:
        """Put one robot down in a building; it hasn't scanned yet.

        Raises:
            ConfigError: If the start leaves no room for the robot.
        """
        config = self.config
        world = World(
            prepared.plan,
            config.robot,
            clutter=prepared.clutter,
            surfaces=prepared.surfaces,
            state=self.robots.drive[index],
        )
        world.reset(start)
        wheels = WheelOdometry(config.odometry, config.robot, streams.odometry)
        self._put_at_rest(index, start, world.pose, wheels)
        self._put_walls(index, world, world.surfaces)
        self._put_floor(index, prepared.floor, start)
        self.each[index : index + 1] = [Robot(prepared, world, streams)]

    def _put_at_rest(self, index: int, start: Pose2D, pose: Pose2D, wheels: WheelOdometry) -> None:
        """Let one robot rest at its start."""
        robots = self.robots
        robots.start[index] = start
        robots.pose[index] = pose
        robots.odometry[index] = 0.0, 0.0, start.theta
        robots.wheels[index] = (*wheels.gains, wheels.believed_base)
        robots.steps[index] = 0
        robots.contact[index] = False
        robots.collisions[index] = 0
        robots.revisits[index] = 0
        for table in (robots.rolled, robots.velocity, robots.driven, robots.moved, robots.path):
            table[index] = 0.0

    def _put_walls(self, index: int, world: World, surfaces: Surfaces) -> None:
        """Fill in the segments that one robot touches and sees, and what they are made of."""
        scenes = self.scenes
        walls = world.segments()
        scenes.materials[index] = surfaces.num_walls, surfaces.seed
        scenes.roughness[index] = surfaces.roughness
        scenes.num_obstacles[index] = world.num_obstacles
        scenes.num_segments[index] = len(walls)
        scenes.num_discs[index] = len(world.discs)
        scenes.num_first[index] = len(surfaces.first)
        scenes.num_patches[index] = len(surfaces.patches)
        scenes.num_outside[index] = len(surfaces.outside)
        self.scenes = scenes._replace(
            segments=put(scenes.segments, index, walls),
            discs=put(scenes.discs, index, world.discs),
            first=put(scenes.first, index, surfaces.first),
            patches=put(scenes.patches, index, surfaces.patches),
            outside=put(scenes.outside, index, surfaces.outside),
        )
        self.robots.exact[index] = self.lidar.is_perfect and len(surfaces.first) == 1

    def _put_floor(self, index: int, floor: ReachableFloor, start: Pose2D) -> None:
        """Fill in the floor that one robot has still to see, and its places."""
        scenes = self.scenes
        cells = floor.mask(start.x, start.y)
        left = floor.frame.origin_x
        bottom = floor.frame.origin_y
        scenes.floor_cells[index] = np.count_nonzero(cells)
        scenes.seen[index] = 0
        scenes.shares[index] = 1.0
        scenes.floor_shape[index] = cells.shape
        scenes.floor_corner[index] = left, bottom
        rows, cols = (math.ceil(side * CELL / PLACE) for side in cells.shape)
        place = math.floor((start.y - bottom) / PLACE) * cols
        place += math.floor((start.x - left) / PLACE)
        visits = np.zeros(rows * cols, dtype=np.int64)
        visits[place] = 1
        self.robots.place[index] = place
        self.scenes = scenes._replace(
            unseen=put(scenes.unseen, index, cells.reshape(-1)),
            visits=put(scenes.visits, index, visits),
        )

    def within_limits(self, commands: FloatArray) -> FloatArray:
        """Commands, shape (N, 2) [m/s, rad/s], cut off at what the robots can do."""
        return np.minimum(np.maximum(commands, -self._fastest), self._fastest)

    def drive(self, ids: IntArray, targets: FloatArray) -> None:
        """Drive for one control step towards velocities within the limits, shape (N, 2) [m/s, rad/s]."""
        divide_work(lambda part: self._drive(part, targets), ids, self.threads)
        self.robots.steps[ids] += 1

    def _drive(self, ids: IntArray, targets: FloatArray) -> None:
        robots = self.robots
        dt = self._drive_model.dt
        for i in ids.tolist():
            _, world, streams = self.each[i]
            if not self._wheel_model.is_ideal:
                streams.odometry.standard_normal(out=robots.slips[i])
            if world.is_lively:
                world.let_time_pass(dt)
                self.scenes.segments[i, : len(world.segments())] = world.segments()
                self.scenes.discs[i, : len(world.discs)] = world.discs
        scenes = self.kernel_scenes()
        drive = bare(self._drive_model)
        wheels = bare(self._wheel_model)
        if drive_all(bare(robots), scenes, drive, wheels, ids, targets):
            touching = ids[robots.left[ids] > 0.0]
            for i in touching.tolist():
                self._touch(i, Twist2D(*targets[i].tolist()))
            arrive_all(bare(robots), scenes, drive, wheels, touching)

    def _touch(self, index: int, target: Twist2D) -> None:
        """Let one robot drive on from where it touches something."""
        robots = self.robots
        contact = self.each[index].world.drive_touching(target, robots.left[index].item())
        robots.collisions[index] += contact and not robots.contact[index]
        robots.contact[index] = contact

    def look(self, ids: IntArray) -> None:
        """Scan."""
        self.draw_noise(ids)
        scans = bare(self.scans)
        look_all(bare(self.robots), self.kernel_scenes(), self.scanner, scans, ids)

    def draw_noise(self, ids: IntArray) -> None:
        """Draw what errs in a scan, each robot from its own stream, in the order of a scanner alone."""
        scans = self.scans
        most = self.config.lidar.bursts
        for i, is_exact in zip(ids.tolist(), self.robots.exact[ids].tolist(), strict=True):
            scans.burst[i] = 0
            if is_exact:
                continue
            rng = self.each[i].streams.lidar
            rng.standard_normal(out=scans.normal[i])
            rng.random(out=scans.fate[i])
            if scans.fate[i, 0, -1] < most:
                first, pulses = self.lidar.draw_burst(rng)
                scans.burst[i] = first, len(pulses)
                scans.pulses[i, : len(pulses)] = pulses


def _scan_model(config: ExploreConfig, lidar: Lidar) -> ScanModel:
    """What all scanners have in common."""
    return ScanModel(
        law=lidar.law,
        mount=plain(lidar.geometry.mount),
        directions=unit_vectors(lidar.geometry.angles),
        range_min=float(config.lidar.range_min),
        lost=float(config.lidar.lost),
        stray=float(config.lidar.stray),
        usable=float(config.usable_range),
        sweep=float(config.lidar.sweep / config.control_step),
    )


def _wheel_model(odometry: OdometryConfig) -> WheelModel:
    """The errors of wheels that the settings name."""
    ticks = odometry.ticks_per_revolution
    return WheelModel(
        is_ideal=odometry.model == "ideal",
        tick=2.0 * math.pi * WHEEL_RADIUS / ticks if ticks else 0.0,
        slips=(
            float(odometry.slip_distance),
            float(odometry.slip_drift),
            float(odometry.slip_turn),
        ),
    )
