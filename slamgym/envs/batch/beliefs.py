"""What robots believe: where they are, and their maps."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from slamgym.cad import FloorPlan
from slamgym.core.geometry import compose
from slamgym.core.jit import plain
from slamgym.core.types import (
    AT_REST,
    UNKNOWN,
    BoolArray,
    Float32Array,
    GridFrame,
    IntArray,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.envs.batch.arrays import MapModel, Maps, bare, put
from slamgym.envs.batch.fleet import Fleet
from slamgym.envs.batch.mapping import sense_all
from slamgym.envs.batch.robot import SimulatedRobot, before
from slamgym.envs.batch.threads import divide_work
from slamgym.envs.compact import MapTiles
from slamgym.envs.config import ExploreConfig
from slamgym.envs.far_look import BLOCK_SIDE
from slamgym.envs.observations import ShownMap
from slamgym.envs.plan_cache import PreparedPlan
from slamgym.interop import read_ros_map
from slamgym.slam import Mapper, make_mapper
from slamgym.slam.deskew import deskewed_at_last_beam
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import cropped_to_known
from slamgym.slam.motion_model import update_thresholds

_SPARE = 1.0  # [m] that maps reach beyond what is seen from the plan's outline, by the scanner or in a crop


class KernelTarget(NamedTuple):
    """What kernels that map observe, and where they write it: the last arguments of :func:`sense_all`."""

    view: tuple[float, Any]  # side and limits of a compact observation, or points of a crop
    out: Any  # one row for each robot


class Beliefs:
    """Poses and maps that robots believe in.

    Args:
        fleet: The robots.
        prefers_kernels: True to map by kernels where they can, which takes known poses and an observation of the
            map's surroundings; else each robot has a mapper of its own.

    Attributes:
        fleet: As given.
        maps: Poses; path and map only where kernels map.
        ranges: The newest scans as seen from where the robots are now, shape (N, num_beams) [m].
        is_mapped_together: True if kernels map; else each robot has its own mapper.
        map_model: How kernels draw maps.
        target: How and where kernels that map write observations; set by the observer.
        shown: Whose map a robot of a number sees: its own, or what it shares with its team.
    """

    def __init__(self, fleet: Fleet, prefers_kernels: bool) -> None:
        config = fleet.config
        slam = config.slam
        self.fleet = fleet
        self._robots: list[SimulatedRobot] = []
        self._mappers: list[Mapper] = []
        self.target: KernelTarget | None = None
        self.shown: Callable[[int], ShownMap] = self.mapper
        self.maps = Maps.blank(len(fleet))
        self.map_model = _map_model(config, fleet.lidar.geometry)
        has_known_poses = slam.mode in ("ground_truth", "dead_reckoning")
        can_map = has_known_poses and slam.counting == "beams"
        self.is_mapped_together = (
            prefers_kernels and can_map and not config.observation.is_whole_map
        )
        self.ranges: Float32Array = fleet.scans.ranges
        if config.lidar.scan_time:
            self.ranges = np.zeros_like(fleet.scans.ranges)

    def mapper(self, index: int) -> Mapper:
        """One robot's, where they are not mapped together."""
        return self._mappers[index]

    def grid(self, index: int) -> OccupancyGrid:
        """One robot's map, cropped to what is known."""
        if not self.is_mapped_together:
            return self.mapper(index).occupancy_grid()
        cells, (row, col), resolution, (top, left, bottom, right) = self.tiles(index)
        corner = row + top, col + left
        return cropped_to_known(cells[top:bottom, left:right], corner, resolution)

    def live_grid(self, index: int) -> OccupancyGrid:
        """One robot's map, with what is unknown around it and at no cost: it changes with the next step."""
        if not self.is_mapped_together:
            return self.shown(index).occupancy_grid()
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

    def begin(self, index: int, start: Pose2D) -> None:
        """Forget what one robot believes, which has been put down at a start."""
        robot = self.fleet.each[index]
        config = self.fleet.config
        initial = Pose2D(0.0, 0.0, start.theta)
        if self.is_mapped_together:
            self._blank_map(index, robot.prepared, start, initial)
            return
        finished = finished_map(robot.prepared.plan, start, config)
        geometry = self.fleet.lidar.geometry
        mapper = make_mapper(config.slam, geometry, initial, robot.streams.slam, finished)
        self._mappers[index : index + 1] = [mapper]
        self._robots[index : index + 1] = [SimulatedRobot(self.fleet, index)]

    def _blank_map(
        self, index: int, prepared: PreparedPlan, start: Pose2D, initial: Pose2D
    ) -> None:
        """An empty map that reaches as far as a robot in the plan can see."""
        config = self.fleet.config
        maps = self.maps
        resolution = self.map_model.resolution
        corners = math.sqrt(0.5) * config.observation.crop_side
        reach = max(config.lidar.range_max, corners) + _SPARE
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

    def sense(self, ids: IntArray, is_published: BoolArray) -> None:
        """Scan and map; where kernels map, observe too, and publish the maps of a mask, shape (N,)."""
        parts = 1 if self.is_mapped_together else 4  # some matches take much longer than others
        divide_work(lambda part: self._sense(part, is_published), ids, self.fleet.threads, parts)

    def _sense(self, ids: IntArray, is_published: BoolArray) -> None:
        fleet = self.fleet
        if not self.is_mapped_together:
            fleet.look(ids)
            for i in ids.tolist():
                self._update_mapper(i)
            return
        assert self.target is not None, "the observer sets it"
        fleet.draw_noise(ids)
        sense_all(
            bare(fleet.robots),
            fleet.kernel_scenes(),
            bare(fleet.scans),
            bare(self.maps),
            fleet.scanner,
            plain(self.map_model),
            ids,
            fleet.times - self.fleet.config.lidar.scan_time,
            is_published,
            self.ranges,
            self.target.view,
            self.target.out,
        )

    def _update_mapper(self, index: int) -> None:
        """Give one robot's mapper the newest scan."""
        robot = self._robots[index]
        scan = robot.scan
        if scan.motion != AT_REST:
            ranges = deskewed_at_last_beam(scan).ranges
            self.ranges[index] = np.where(np.isnan(ranges), np.float32(np.inf), ranges)
        elif self.ranges is not self.fleet.scans.ranges:
            self.ranges[index] = scan.ranges
        if self.map_model.believes_truth:
            swept = robot.swept
            odometry = before(robot.true_map_pose, swept)
            if swept != scan.motion:
                scan = replace(scan, motion=swept)
        else:
            odometry = before(robot.odometry_pose, scan.motion)
        mapper = self._mappers[index]
        self.maps.is_new[index] = mapper.update(odometry, scan)
        pose = mapper.pose
        self.maps.believed[index] = pose if scan.motion == AT_REST else compose(pose, scan.motion)


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


def _whole_blocks(low: float, high: float, resolution: float) -> tuple[int, int]:
    """First row of cells and number of rows, both multiples of a block's, that hold a span in the map frame [m]."""
    first = BLOCK_SIDE * math.floor(low / (BLOCK_SIDE * resolution))
    end = math.ceil(high / resolution)
    blocks = math.ceil((end - first) / BLOCK_SIDE)
    return first, BLOCK_SIDE * blocks


def finished_map(plan: FloorPlan, start: Pose2D, config: ExploreConfig) -> OccupancyGrid | None:
    """The finished map that a robot is given to localise on, in the map frame; None where the settings ask for none.

    Args:
        plan: The building.
        start: Where the robot stands at first, world frame.
        config: Names the map's file, if it isn't the plan as a drawing.

    Raises:
        InputFileError: If the map's file can't be read.
    """
    if config.slam.mode != "map":
        return None
    if config.finished_map is None:
        return plan.raster(config.slam.resolution, offset=(start.x, start.y), outside=UNKNOWN)
    grid = read_ros_map(config.finished_map)
    frame = grid.frame._replace(
        origin_x=grid.frame.origin_x - start.x, origin_y=grid.frame.origin_y - start.y
    )
    return OccupancyGrid(grid.cells, frame)
