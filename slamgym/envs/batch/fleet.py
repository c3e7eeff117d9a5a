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
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Twist2D,
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
from slamgym.envs.completion import CompletionDetector
from slamgym.envs.config import ExploreConfig
from slamgym.envs.coverage import ReachableFloor
from slamgym.envs.far_look import BLOCK_SIDE
from slamgym.envs.plan_cache import PreparedPlan, Streams
from slamgym.envs.simulation import finished_map
from slamgym.sim import Lidar, OdometryConfig, WheelOdometry, World
from slamgym.sim.lidar import LONGEST_BURST
from slamgym.sim.motion import NO_TIME
from slamgym.sim.robot import WHEEL_RADIUS
from slamgym.sim.surfaces import Surfaces
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
    detector: CompletionDetector


class KernelTarget(NamedTuple):
    """What kernels that map observe, and where they write it: the last arguments of :func:`sense_all`."""

    view: tuple[float, Any]  # side and limits of a compact observation, or points of a crop
    out: Any  # one row for each robot


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
        target: How and where kernels that map write observations; set by the observer.
        is_mapped_together: True if kernels map; else each robot has its own mapper.
    """

    def __init__(self, config: ExploreConfig, count: int, threads: int) -> None:
        slam = config.slam
        self._config = config
        self.threads = threads
        self.target: KernelTarget | None = None
        self.robots = Robots.rest(count)
        self.scenes = Scenes.empty(count)
        self.maps = Maps.blank(count)
        self.scans = Scans.blank(count, config.lidar.num_beams, LONGEST_BURST)
        self.each: list[Robot] = []
        self.lidar = Lidar(config.lidar)
        self._scanner = _scan_model(config, self.lidar)
        self.map_model = _map_model(config, self.lidar.geometry)
        has_known_poses = slam.mode in ("ground_truth", "dead_reckoning")
        self.is_mapped_together = has_known_poses and slam.counting == "beams"
        self._drive_model = DriveModel.of(config.robot, float(config.control_step))
        self._wheel_model = _wheel_model(config.odometry)

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
        height, width = cells.shape
        frame = GridFrame(resolution, col * resolution, row * resolution, height, width)
        return OccupancyGrid(cells[::-1], frame)

    def tiles(self, index: int) -> MapTiles:
        """The map of one of robots that are mapped together."""
        maps = self.maps
        rows, cols = maps.shape[index].tolist()
        row, col = maps.corner[index].tolist()
        first, left, end, right = maps.known[index].tolist()
        return MapTiles(
            cells=maps.cells[index, : rows * cols].reshape(rows, cols),
            corner=(row, col),
            resolution=self.map_model.resolution,
            known=(first, left, end, right),
        )

    def begin(self, index: int, prepared: PreparedPlan, start: Pose2D, streams: Streams) -> None:
        """Put one robot down in a building; :meth:`sense` takes its first scan.

        Raises:
            ConfigError: If the start leaves no room for the robot.
        """
        config = self._config
        world = World(
            prepared.plan,
            config.robot,
            clutter=prepared.clutter,
            surfaces=prepared.surfaces,
            state=self.robots.drive[index],
        )
        world.reset(start)
        wheels = WheelOdometry(config.odometry, config.robot, streams.odometry)
        initial = Pose2D(0.0, 0.0, start.theta)
        self._put_at_rest(index, start, initial, wheels)
        self.robots.pose[index] = world.pose
        self._put_walls(index, world.segments(), world.surfaces)
        self._put_floor(index, prepared.floor, start)
        mapper = None
        if self.is_mapped_together:
            self._blank_map(index, prepared, start, initial)
        else:
            finished = finished_map(prepared.plan, start, config)
            mapper = make_mapper(config.slam, self.lidar.geometry, initial, streams.slam, finished)
        detector = CompletionDetector.of(config)
        self.each[index : index + 1] = [Robot(prepared, world, streams, mapper, detector)]

    def _put_at_rest(
        self, index: int, start: Pose2D, initial: Pose2D, wheels: WheelOdometry
    ) -> None:
        """Let one robot rest at its start; ``initial`` is that pose in the map frame."""
        robots = self.robots
        robots.start[index] = start
        robots.odometry[index] = initial
        robots.wheels[index] = (*wheels.gains, wheels.believed_base)
        robots.rolled[index] = 0.0
        robots.velocity[index] = 0.0
        robots.path[index] = 0.0
        robots.steps[index] = 0
        robots.contact[index] = False
        robots.collisions[index] = 0

    def _put_walls(self, index: int, walls: FloatArray, surfaces: Surfaces) -> None:
        """Fill in the segments that one robot touches and sees, and what they are made of."""
        scenes = self.scenes
        scenes.materials[index] = surfaces.num_walls, surfaces.seed
        scenes.roughness[index] = surfaces.roughness
        scenes.num_segments[index] = len(walls)
        scenes.num_first[index] = len(surfaces.first)
        scenes.num_patches[index] = len(surfaces.patches)
        scenes.num_outside[index] = len(surfaces.outside)
        self.scenes = scenes._replace(
            segments=put(scenes.segments, index, walls),
            first=put(scenes.first, index, surfaces.first),
            patches=put(scenes.patches, index, surfaces.patches),
            outside=put(scenes.outside, index, surfaces.outside),
        )
        self.robots.exact[index] = self.lidar.is_perfect and len(surfaces.first) == 1

    def _put_floor(self, index: int, floor: ReachableFloor, start: Pose2D) -> None:
        """Fill in the floor that one robot has still to see."""
        scenes = self.scenes
        cells = floor.mask(start.x, start.y)
        scenes.floor_cells[index] = np.count_nonzero(cells)
        scenes.seen[index] = 0
        scenes.floor_shape[index] = cells.shape
        scenes.floor_corner[index] = floor.frame.origin_x, floor.frame.origin_y
        self.scenes = scenes._replace(unseen=put(scenes.unseen, index, cells.reshape(-1)))

    def _blank_map(
        self, index: int, prepared: PreparedPlan, start: Pose2D, initial: Pose2D
    ) -> None:
        """An empty map that reaches as far as a robot in the plan can see."""
        maps = self.maps
        resolution = self.map_model.resolution
        corners = math.sqrt(0.5) * self._config.observation.crop_side
        reach = max(self._config.lidar.range_max, corners) + _SPARE
        min_x, min_y, max_x, max_y = prepared.plan.bounds
        row, rows = _whole_blocks(min_y - start.y - reach, max_y - start.y + reach, resolution)
        col, cols = _whole_blocks(min_x - start.x - reach, max_x - start.x + reach, resolution)
        maps.corner[index] = row, col
        maps.shape[index] = rows, cols
        maps.known[index] = rows, cols, 0, 0
        maps.begun[index] = False
        maps.anchor[index] = initial
        maps.since[index] = 0.0
        counts = np.zeros((rows * cols, 2), dtype=np.int32)
        cells = np.full(rows * cols, UNKNOWN, dtype=np.uint8)
        self.maps = maps._replace(
            counts=put(maps.counts, index, counts), cells=put(maps.cells, index, cells)
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
        drive_all(robots, self.scenes, self._drive_model, ids, targets)
        touching = robots.left[ids] > NO_TIME
        self._note_contact(ids[~touching], False)
        for i in ids[touching].tolist():
            target = Twist2D(*targets[i].tolist())
            contact = self.each[i].world.drive_touching(target, robots.left[i].item())
            self._note_contact(i, contact)
        if not self._wheel_model.is_ideal:
            for i in ids.tolist():
                rng = self.each[i].streams.odometry
                rng.standard_normal(out=robots.slips[i])
        integrate_wheels(robots, self._wheel_model, ids, self._drive_model.dt)

    def _note_contact(self, ids: IntArray | int, contact: bool) -> None:
        robots = self.robots
        robots.collisions[ids] += contact and ~robots.contact[ids]
        robots.contact[ids] = contact

    def sense(self, ids: IntArray, is_published: BoolArray) -> None:
        """Scan; where kernels map, map and observe too, and publish the maps of a mask, shape (N,)."""
        parts = 1 if self.is_mapped_together else 4  # some matches take much longer than others
        divide_work(lambda part: self._sense(part, is_published), ids, self.threads, parts)

    def _sense(self, ids: IntArray, is_published: BoolArray) -> None:
        self._draw_noise(ids)
        # The read-only type, with which a single scanner has its kernels compiled already.
        segments = self.scenes.segments.view()
        segments.flags.writeable = False
        scenes = self.scenes._replace(segments=segments)
        if not self.is_mapped_together:
            look_all(self.robots, scenes, self._scanner, self.scans, ids)
            self._update_mappers(ids)
            return
        assert self.target is not None, "the observer sets it"
        sense_all(
            self.robots,
            scenes,
            self.scans,
            self.maps,
            self._scanner,
            self.map_model,
            ids,
            self.times,
            is_published,
            self.target.view,
            self.target.out,
        )

    def _update_mappers(self, ids: IntArray) -> None:
        """Give each robot's mapper the newest scan."""
        robots = self.robots
        poses = robots.odometry
        if self.map_model.believes_truth:
            poses = robots.pose - robots.start * (1.0, 1.0, 0.0)
        times = self.times
        for i in ids.tolist():
            mapper = self.mapper(i)
            scan = LaserScan(times[i].item(), self.scans.ranges[i].copy(), self.lidar.geometry)
            self.maps.is_new[i] = mapper.update(Pose2D(*poses[i].tolist()), scan)
            self.maps.believed[i] = mapper.pose

    def _draw_noise(self, ids: IntArray) -> None:
        """Draw what errs in a scan, each robot from its own stream, in the order of a scanner alone."""
        scans = self.scans
        noisy = ids[~self.robots.exact[ids]]
        for i in noisy.tolist():
            rng = self.each[i].streams.lidar
            rng.standard_normal(out=scans.normal[i])
            rng.random(out=scans.fate[i])
        scans.burst[ids] = 0
        is_hit = scans.fate[noisy, 0, -1] < self._config.lidar.bursts
        for i in noisy[is_hit].tolist():
            first, pulses = self.lidar.draw_burst(self.each[i].streams.lidar)
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
    )


def _map_model(config: ExploreConfig, geometry: LaserGeometry) -> MapModel:
    """How the settings want maps to be drawn."""
    slam = config.slam
    return MapModel(
        beams=BeamTable.of(geometry, slam),
        resolution=float(slam.resolution),
        threshold=float(slam.occupied_threshold),
        min_passes=int(slam.min_passes),
        updates=update_thresholds(slam),
        believes_truth=slam.mode == "ground_truth",
        keeps_current=config.observation.map == "egocentric",
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


def _whole_blocks(low: float, high: float, resolution: float) -> tuple[int, int]:
    """First row of cells and number of rows, both multiples of a block's, that hold a span in the map frame [m]."""
    first = BLOCK_SIDE * math.floor(low / (BLOCK_SIDE * resolution))
    end = math.ceil(high / resolution)
    blocks = math.ceil((end - first) / BLOCK_SIDE)
    return first, BLOCK_SIDE * blocks
