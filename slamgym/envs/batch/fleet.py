"""Robots in their buildings, driven and sensing together: bodies, wheels, scanners, and the floor that was seen."""

import math
from collections.abc import Sequence
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
from slamgym.sim.building import Building
from slamgym.sim.encounter import Encounter
from slamgym.sim.lidar import LONGEST_BURST
from slamgym.sim.robot import WHEEL_RADIUS
from slamgym.sim.surfaces import Surfaces


class Robot(NamedTuple):
    """What belongs to one robot and is no array."""

    prepared: PreparedPlan
    world: World
    streams: Streams


class Fleet:
    """So many robots, each in its building or several in each; one of them is all that a single environment needs.

    Robots of one building see and touch each other. They have numbers in a row.

    Args:
        config: The settings.
        count: How many.
        threads: So many work on them.
        team_size: So many in each building.

    Attributes:
        config: As given.
        threads: As given.
        team_size: As given.
        building_of_robot: In which building each robot is, shape (N,).
        robots: Bodies and wheels.
        scenes: What they touch and see.
        scans: The newest scans.
        each: What belongs to one robot alone.
        lidar: The scanner that all have.
        scanner: The same for kernels, without names.
    """

    def __init__(
        self, config: ExploreConfig, count: int, threads: int = 1, team_size: int = 1
    ) -> None:
        self.config = config
        self.threads = threads
        self.team_size = team_size
        self.building_of_robot = np.arange(count) // team_size
        self._encounters: list[Encounter] = []
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
        """Put one robot down in a building, those of a building one after the other; it hasn't scanned yet.

        Raises:
            ConfigError: If the start leaves no room for the robot.
        """
        config = self.config
        place = index % self.team_size
        if place:
            building = self.each[index - 1].world.building
        else:
            building = Building(prepared.plan, prepared.clutter, prepared.surfaces)
        world = World(
            building, config.robot, state=self.robots.drive[index], others=self.team_size - 1
        )
        world.reset(start)
        wheels = WheelOdometry(config.odometry, config.robot, streams.odometry)
        self._put_at_rest(index, start, world.pose, wheels)
        self._put_walls(index, world, building.surfaces)
        self._put_floor(index, prepared.floor, start)
        self.each[index : index + 1] = [Robot(prepared, world, streams)]
        if 0 < place == self.team_size - 1:
            self._assemble(self.building_of_robot[index])

    def _assemble(self, building: int) -> None:
        """Let the robots of a building, all put down, meet each other."""
        team = self._team(building)
        self._encounters[building : building + 1] = [Encounter([self.each[i].world for i in team])]
        self._introduce(building)

    def _team(self, building: int) -> range:
        """Numbers of the robots in a building."""
        return range(building * self.team_size, (building + 1) * self.team_size)

    def _introduce(self, building: int) -> None:
        """Let the robots of a building see where the others are now, and people and furniture."""
        self._encounters[building].introduce()
        for i in self._team(building):
            self._put_moving(i)

    def _put_moving(self, index: int) -> None:
        """Note what has moved about one robot."""
        world = self.each[index].world
        segments = world.segments()
        self.scenes.segments[index, : len(segments)] = segments
        self.scenes.discs[index, : len(world.discs)] = world.discs

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
        scenes.num_obstacles[index] = world.building.num_obstacles
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
        alone = ids
        together: list[int] = []
        if self.team_size > 1:
            buildings = self.building_of_robot[ids[:: self.team_size]].tolist()
            self._let_time_pass(buildings)
            together = [one for one in buildings if self._is_crowded(one, targets)]
            alone = ids[~np.isin(self.building_of_robot[ids], together)]
        divide_work(lambda part: self._drive(part, targets), alone, self.threads)
        for building in together:
            self._drive_together(building, targets)
        if self.team_size > 1:
            for building in buildings:
                self._introduce(building)
        self.robots.steps[ids] += 1

    def _let_time_pass(self, buildings: Sequence[int]) -> None:
        """People walk and things are moved in buildings of several robots."""
        dt = self._drive_model.dt
        for one in buildings:
            building = self.each[one * self.team_size].world.building
            if building.is_lively:
                building.let_time_pass(dt, self._encounters[one].bodies())
                self._introduce(one)

    def _targets(self, building: int, targets: FloatArray) -> list[Twist2D]:
        return [Twist2D(*targets[i].tolist()) for i in self._team(building)]

    def _is_crowded(self, building: int, targets: FloatArray) -> bool:
        """True if robots of a building could touch each other in this step."""
        wanted = self._targets(building, targets)
        return self._encounters[building].is_near(wanted, self._drive_model.dt)

    def _drive_together(self, building: int, targets: FloatArray) -> None:
        """Drive the robots of a building where they could touch each other."""
        robots = self.robots
        ids = np.array(self._team(building))
        self._draw_slips(ids)
        wanted = self._targets(building, targets)
        contacts = np.array(self._encounters[building].drive(wanted, self._drive_model.dt))
        robots.collisions[ids] += contacts & ~robots.contact[ids]
        robots.contact[ids] = contacts
        self._arrive(ids)

    def _draw_slips(self, ids: IntArray) -> None:
        """Draw what errs in a step of the wheels, each robot from its own stream."""
        if not self._wheel_model.is_ideal:
            for i in ids.tolist():
                self.each[i].streams.odometry.standard_normal(out=self.robots.slips[i])

    def _arrive(self, ids: IntArray) -> None:
        """Note the poses of robots that didn't drive freely."""
        drive = bare(self._drive_model)
        arrive_all(bare(self.robots), self.kernel_scenes(), drive, bare(self._wheel_model), ids)

    def _drive(self, ids: IntArray, targets: FloatArray) -> None:
        robots = self.robots
        self._draw_slips(ids)
        if self.team_size == 1:
            for i in ids.tolist():
                world = self.each[i].world
                if world.building.is_lively:
                    world.let_time_pass(self._drive_model.dt)
                    self._put_moving(i)
        drive = bare(self._drive_model)
        wheels = bare(self._wheel_model)
        if drive_all(bare(robots), self.kernel_scenes(), drive, wheels, ids, targets):
            touching = ids[robots.left[ids] > 0.0]
            for i in touching.tolist():
                self._touch(i, Twist2D(*targets[i].tolist()))
            self._arrive(touching)

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

    def share_seen(self) -> None:
        """Let each robot have seen what any robot of its building has."""
        scenes = self.scenes
        for building in range(len(self) // self.team_size):
            team = self._team(building)
            count = int(np.prod(scenes.floor_shape[team.start]))
            unseen = scenes.unseen[team.start : team.stop, :count]
            floors = [self.coverage(i).floor.reshape(-1) for i in team]
            sights = [own | ~floor for own, floor in zip(unseen, floors, strict=True)]
            np.logical_and(unseen, np.logical_and.reduce(sights), out=unseen)
            for i, own in zip(team, unseen, strict=True):
                scenes.seen[i] = scenes.floor_cells[i] - np.count_nonzero(own)
                scenes.shares[i] = scenes.seen[i] / max(1, scenes.floor_cells[i])

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
        sweep=config.lidar.scan_time / config.control_step,
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
