"""Many robots in their buildings, stepped together: bodies, scanners, wheels, coverage, and maps from known poses."""

import math
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.geometry import unit_vectors
from slamgym.core.jit import plain
from slamgym.core.types import (
    UNKNOWN,
    BoolArray,
    FloatArray,
    GridFrame,
    IntArray,
    LaserScan,
    OccupancyGrid,
    Pose2D,
)
from slamgym.envs.batch.arrays import (
    DriveModel,
    MapModel,
    Maps,
    Robots,
    ScanModel,
    Scans,
    Scenes,
    WheelModel,
    put,
)
from slamgym.envs.batch.stepping import drive_all, integrate_wheels, look_all, sense_all
from slamgym.envs.batch.threads import divide_work
from slamgym.envs.compact import MapTiles
from slamgym.envs.config import ExploreConfig
from slamgym.envs.far_look import BLOCK_SIDE
from slamgym.envs.plan_cache import PreparedPlan, Streams
from slamgym.envs.simulation import finished_map
from slamgym.sim import Lidar, WheelOdometry, World
from slamgym.sim.contact import DiscContacts, wall_order
from slamgym.sim.lidar import LONGEST_BURST
from slamgym.sim.robot import WHEEL_RADIUS
from slamgym.slam import Mapper, make_mapper
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.motion_model import update_thresholds

_SPARE = 1.0  # [m] that maps reach beyond what is seen from the plan's outline, by the scanner or in a crop


class Robot(NamedTuple):
    """One environment's part that is no array."""

    prepared: PreparedPlan
    world: World
    streams: Streams
    mapper: Mapper | None  # None where kernels map


class Fleet:
    """So many robots.

    Args:
        config: The settings.
        count: How many.
        threads: So many work on them.

    Attributes:
        threads: As given.
        robots: Bodies and wheels.
        scenes: What they touch and see.
        scans: The newest scans.
        maps: What they believe; path and map only where kernels map.
        each: What belongs to one robot alone.
        map_model: How kernels draw maps.
        shown: What kernels that map observe, and where they write it: the last arguments of :func:`sense_all`.
        is_mapped_together: True if kernels map; else each robot has its own mapper.
    """

    def __init__(self, config: ExploreConfig, count: int, threads: int) -> None:
        self._config, self.threads = config, threads
        self.shown: tuple[Any, ...] = ()
        self.robots, self.scenes, self.maps = (
            Robots.rest(count),
            Scenes.empty(count),
            Maps.blank(count),
        )
        self.scans = Scans.blank(count, config.lidar.num_beams, LONGEST_BURST)
        self.each: list[Robot] = []
        self.lidar = Lidar(config.lidar)
        robot, lidar, odometry, slam = config.robot, config.lidar, config.odometry, config.slam
        geometry = self.lidar.geometry
        failures = float(lidar.range_min), float(lidar.lost), float(lidar.stray)
        directions, mount = unit_vectors(geometry.angles), plain(geometry.mount)
        self._scanner = ScanModel(
            self.lidar.law, mount, directions, *failures, float(config.usable_range)
        )
        thresholds = float(slam.occupied_threshold), int(slam.min_passes), update_thresholds(slam)
        flags = slam.mode == "ground_truth", config.observation.map == "egocentric"
        self.map_model = MapModel(
            BeamTable.of(geometry, slam), float(slam.resolution), *thresholds, *flags
        )
        self.is_mapped_together = (
            slam.mode in ("ground_truth", "dead_reckoning") and slam.counting == "beams"
        )
        self._contacts = DiscContacts.none(count, 0)
        self._drive_model = DriveModel.of(robot, float(config.control_step))
        ticks = odometry.ticks_per_revolution
        tick = 2.0 * math.pi * WHEEL_RADIUS / ticks if ticks else 0.0
        slips = float(odometry.slip_distance), float(odometry.slip_drift), float(odometry.slip_turn)
        self._wheel_model = WheelModel(odometry.model == "ideal", tick, slips)

    def __len__(self) -> int:
        return len(self.robots.steps)

    @property
    def times(self) -> FloatArray:
        """Robot time, shape (N,) [s]."""
        return np.asarray(self.robots.steps * self._config.control_step, dtype=np.float64)

    @property
    def shares(self) -> FloatArray:
        """Shares of the reachable floor that were seen, shape (N,)."""
        totals = self.scenes.floor_cells
        return np.where(totals > 0, self.scenes.seen / np.maximum(totals, 1), 1.0)

    def mapper(self, index: int) -> Mapper:
        """One robot's, where they are not mapped together."""
        mapper = self.each[index].mapper
        assert mapper is not None, "begin() made one"
        return mapper

    def grid(self, index: int) -> OccupancyGrid:
        """One robot's map, which may have what is unknown around it."""
        if not self.is_mapped_together:
            return self.mapper(index).occupancy_grid()
        cells, (row, col), resolution, _ = self.tiles(index)
        frame = GridFrame(resolution, col * resolution, row * resolution, *cells.shape)
        return OccupancyGrid(cells[::-1], frame)

    def tiles(self, index: int) -> MapTiles:
        """The map of one of robots that are mapped together."""
        maps = self.maps
        (rows, cols), (row, col) = maps.shape[index].tolist(), maps.corner[index].tolist()
        first, left, end, right = maps.known[index].tolist()
        cells = maps.cells[index, : rows * cols].reshape(rows, cols)
        return MapTiles(cells, (row, col), self.map_model.resolution, (first, left, end, right))

    def begin(self, index: int, prepared: PreparedPlan, start: Pose2D, streams: Streams) -> None:
        """Put one robot down in a building; :meth:`sense` takes its first scan.

        Raises:
            ConfigError: If the start leaves no room for the robot.
        """
        config, robots = self._config, self.robots
        plan, clutter, surfaces = prepared.plan, prepared.clutter, prepared.surfaces
        world = World(
            plan, config.robot, clutter=clutter, surfaces=surfaces, state=robots.drive[index]
        )
        world.reset(start)
        wheels = WheelOdometry(config.odometry, config.robot, streams.odometry)
        initial = Pose2D(0.0, 0.0, start.theta)
        robots.pose[index], robots.start[index], robots.odometry[index] = world.pose, start, initial
        robots.wheels[index] = (*wheels.gains, wheels.believed_base)
        robots.rolled[index], robots.velocity[index], robots.path[index] = 0.0, 0.0, 0.0
        robots.steps[index], robots.contact[index], robots.collisions[index] = 0, False, 0
        self._place(index, prepared, world, start)
        mapper = None
        if self.is_mapped_together:
            self._blank_map(index, prepared, start, initial)
        else:
            finished = finished_map(prepared.plan, start, config)
            mapper = make_mapper(config.slam, self.lidar.geometry, initial, streams.slam, finished)
        self.each[index : index + 1] = [Robot(prepared, world, streams, mapper)]

    def _place(self, index: int, prepared: PreparedPlan, world: World, start: Pose2D) -> None:
        """Fill in what one robot touches and sees."""
        scenes, materials, walls = self.scenes, world.surfaces, world.segments()
        floor = prepared.floor.mask(start.x, start.y)
        scenes.floor_cells[index] = np.count_nonzero(floor)
        scenes.seen[index] = 0
        scenes.floor_shape[index] = floor.shape
        frame = prepared.floor.frame
        scenes.floor_corner[index] = frame.origin_x, frame.origin_y
        scenes.materials[index] = materials.num_walls, materials.seed
        scenes.roughness[index] = materials.roughness
        for counts, rows in (
            (scenes.num_segments, walls),
            (scenes.num_first, materials.first),
            (scenes.num_patches, materials.patches),
            (scenes.num_outside, materials.outside),
        ):
            counts[index] = len(rows)
        self.scenes = scenes._replace(
            segments=put(scenes.segments, index, walls),
            first=put(scenes.first, index, materials.first),
            patches=put(scenes.patches, index, materials.patches),
            outside=put(scenes.outside, index, materials.outside),
            unseen=put(scenes.unseen, index, floor.reshape(-1)),
        )
        contacts, nothing = self._contacts, np.zeros(len(walls))
        contacts.marks[index] = 0
        self._contacts = contacts._replace(
            order=put(contacts.order, index, wall_order(walls)), pairs=put(contacts.pairs, index, nothing),
            impulses=put(contacts.impulses, index, nothing), stamps=put(contacts.stamps, index, nothing),
        )  # fmt: skip
        self.robots.exact[index] = self.lidar.is_perfect and len(materials.first) == 1

    def _blank_map(
        self, index: int, prepared: PreparedPlan, start: Pose2D, initial: Pose2D
    ) -> None:
        """An empty map that reaches as far as a robot in the plan can see."""
        maps, resolution = self.maps, self.map_model.resolution
        corners = math.sqrt(0.5) * self._config.observation.crop_side
        reach = max(self._config.lidar.range_max, corners) + _SPARE
        min_x, min_y, max_x, max_y = prepared.plan.bounds
        corner = [
            BLOCK_SIDE * math.floor((low - reach) / (BLOCK_SIDE * resolution))
            for low in (min_y - start.y, min_x - start.x)
        ]
        end = [
            math.ceil((high + reach) / resolution) for high in (max_y - start.y, max_x - start.x)
        ]
        spans = zip(corner, end, strict=True)
        shape = [BLOCK_SIDE * -(-(last - first) // BLOCK_SIDE) for first, last in spans]
        maps.corner[index], maps.shape[index], maps.known[index] = corner, shape, (*shape, 0, 0)
        maps.begun[index], maps.anchor[index], maps.since[index] = False, initial, 0.0
        cells = shape[0] * shape[1]
        self.maps = maps._replace(
            counts=put(maps.counts, index, np.zeros((cells, 2), dtype=np.int32)),
            cells=put(maps.cells, index, np.full(cells, UNKNOWN, dtype=np.uint8)),
        )

    def drive(self, ids: IntArray, commands: FloatArray) -> None:
        """Drive for one control step towards velocities, shape (N, 2) [m/s, rad/s].

        Raises:
            ValueError: If a command is not a number.
        """
        if np.isnan(commands[ids]).any():
            raise ValueError(f"commands {commands[ids]} hold what is not a number")
        fastest = np.array([self._config.robot.max_linear, self._config.robot.max_angular])
        targets = np.clip(commands, -fastest, fastest)
        divide_work(lambda part: self._drive(part, targets), ids, self.threads)
        self.robots.steps[ids] += 1

    def _drive(self, ids: IntArray, targets: FloatArray) -> None:
        robots = self.robots
        drive_all(robots, self.scenes, self._contacts, self._drive_model, ids, targets)
        if not self._wheel_model.is_ideal:
            for i in ids.tolist():
                self.each[i].streams.odometry.standard_normal(out=robots.slips[i])
        integrate_wheels(robots, self._wheel_model, ids, self._drive_model.dt)

    def sense(self, ids: IntArray, is_published: BoolArray) -> None:
        """Scan; where kernels map, map and observe too, and publish the maps of a mask, shape (N,)."""
        parts = 1 if self.is_mapped_together else 4  # some matches take much longer than others
        divide_work(lambda part: self._sense(part, is_published), ids, self.threads, parts)

    def _sense(self, ids: IntArray, is_published: BoolArray) -> None:
        self._draw_noise(ids)
        # The read-only type, with which a single scanner has its kernels compiled already.
        segments = self.scenes.segments.view()
        segments.flags.writeable = False
        robots, scenes, maps = self.robots, self.scenes._replace(segments=segments), self.maps
        if self.is_mapped_together:
            world, models = (robots, scenes, self.scans, maps), (self._scanner, self.map_model)
            sense_all(world, models, ids, self.times, is_published, *self.shown)
            return
        look_all(robots, scenes, self._scanner, self.scans, ids)
        poses = robots.odometry
        if self.map_model.believes_truth:
            poses = robots.pose - robots.start * (1.0, 1.0, 0.0)
        for i in ids.tolist():
            scan = LaserScan(self.times[i].item(), self.scans.ranges[i].copy(), self.lidar.geometry)
            maps.is_new[i] = self.mapper(i).update(Pose2D(*poses[i].tolist()), scan)
            maps.believed[i] = self.mapper(i).pose

    def _draw_noise(self, ids: IntArray) -> None:
        """Draw what errs in a scan, each robot from its own stream, in the order of a scanner alone."""
        scans, each = self.scans, self.each
        noisy = ids[~self.robots.exact[ids]]
        for i in noisy.tolist():
            rng = each[i].streams.lidar
            rng.standard_normal(out=scans.normal[i])
            rng.random(out=scans.fate[i])
        scans.burst[ids] = 0
        for i in noisy[scans.fate[noisy, 0, -1] < self._config.lidar.bursts].tolist():
            first, pulses = self.lidar.draw_burst(each[i].streams.lidar)
            scans.burst[i] = first, len(pulses)
            scans.pulses[i, : len(pulses)] = pulses
