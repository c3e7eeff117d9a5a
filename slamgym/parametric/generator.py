"""Maps like those of the simulated robot along a given path, at a fraction of the cost.

Building, laser, wheels and mapper are the simulation's own. Nobody explores, scans are taken only where the mapper uses
them, its particle filter has few particles, and the poses of its graph, which errs by centimetres, are drawn instead
of estimated: an error that follows from the place, as the robot recognises where it was before.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from slamgym.core.errors import PlanError
from slamgym.core.geometry import between, compose, part_of, paste, wrap_angle
from slamgym.core.types import (
    AT_REST,
    FREE,
    UNKNOWN,
    FloatArray,
    GridFrame,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Trajectory,
    Twist2D,
)
from slamgym.envs.config import ExploreConfig
from slamgym.parametric.config import ScannerView
from slamgym.parametric.model import DRIFT_MARGIN, SMOOTHING, Deformation
from slamgym.parametric.paths import check_path_is_free, sampled
from slamgym.parametric.visibility import observe
from slamgym.parametric.warp import densify, displacements, invert
from slamgym.sim import Clutter, Lidar, WheelOdometry, World, make_surfaces
from slamgym.slam import Mapper, SlamConfig, make_mapper
from slamgym.slam.motion_model import OdometryGate, update_thresholds

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

PARTICLES = 3
"""Particles that stand for more: with one or two, trees tell the maps of the recipe `paper` from those with 30."""
_WARP = 0.02
"""Height of the waves of a pose graph's error [m], fitted to the pose errors of simulated explorations."""
_WAVELENGTH = 15.0
"""Length of the waves of a pose graph's error over the building [m], fitted in the same way."""
_TURN = 0.0055
"""By how much a pose graph's error turns the whole map [rad], fitted in the same way."""
_SPREAD = 0.6
"""Deviation of the logarithm of a pose graph's error from run to run [-], fitted in the same way."""


def map_along_path(
    plan: "FloorPlan",
    trajectory: Trajectory,
    env: ExploreConfig,
    rng: np.random.Generator,
    clutter: Clutter | None = None,
) -> Deformation:
    """Draw the map that the simulated robot would have made on its way.

    Convention: everything is in the world frame of the plan.

    Args:
        plan: The building.
        trajectory: True path.
        env: Robot, sensors and mapper, as for an exploration. Its clutter has no effect: a path leads through a
            building that is furnished already.
        rng: Source of all randomness; equal seeds give equal bytes.
        clutter: Furniture and people in the building; none where left out.

    Returns:
        The map with its displacement field, and the poses at the scans that the mapper used.

    Raises:
        ConfigError: If the trajectory leaves the free space.
        PlanError: If the plan has no free cell at the mapper's resolution.
    """
    check_path_is_free(trajectory.poses[:, :2], plan.free_space, "the trajectory", "pose")
    path = sampled(trajectory, env.control_step)
    begins = _begins_of_sweeps(path, env)
    odometry, mapper = _map(plan, path, begins, env, clutter or Clutter(), rng)

    estimate = mapper.trajectory()
    start_x, start_y = path.poses[0, :2].tolist()
    grid = _about_plan(plan, _moved(mapper.occupancy_grid(), start_x, start_y))
    frame = grid.frame
    cad = plan.raster(frame.resolution, frame)
    if not (cad.cells == FREE).any():
        raise PlanError(plan.id, "has no free cell; use a finer resolution or another plan")
    used = np.searchsorted(path.stamps, estimate.stamps)
    stamps = estimate.stamps - env.lidar.scan_time
    believed = estimate.poses + np.array([start_x, start_y, 0.0])
    visibility = observe(cad.cells != FREE, frame, begins[used], _view(env))
    forward = displacements(begins[used], believed, visibility)
    forward = densify(forward, visibility.seen, SMOOTHING / frame.resolution)
    return Deformation(
        grid=grid,
        cad=cad,
        field=invert(forward, frame.resolution),
        seen=visibility.seen,
        true=Trajectory(stamps, begins[used]),
        odometry=Trajectory(stamps, odometry[used]),
        believed=Trajectory(stamps, believed),
        parameters={},
    )


def _begins_of_sweeps(path: Trajectory, env: ExploreConfig) -> FloatArray:
    """Poses at the scans' first beams, (T, 3), which are those that mappers seek."""
    last_step = np.diff(path.poses, axis=0, prepend=path.poses[:1])
    last_step[:, 2] = wrap_angle(last_step[:, 2])
    sweep = env.lidar.scan_time / env.control_step  # in steps
    return path.poses - sweep * last_step


def _map(
    plan: "FloorPlan",
    path: Trajectory,
    begins: FloatArray,
    env: ExploreConfig,
    clutter: Clutter,
    rng: np.random.Generator,
) -> tuple[FloatArray, Mapper]:
    """Let the mapper take the scans of a path; also where odometry believed to be at their first beams, shape (T, 3).

    ``begins``: true poses at the scans' first beams, (T, 3). The mapper takes the moments of their last for stamps.
    """
    of_wheels, of_laser, of_mapper = rng.spawn(3)
    step = env.control_step
    lidar = Lidar(env.lidar)
    wheels = WheelOdometry(env.odometry, env.robot, of_wheels)
    surfaces = make_surfaces(plan, clutter.segments(), env.lidar.surfaces)
    world = World(plan, env.robot, clutter=clutter, surfaces=surfaces)
    first = Pose2D(*path.poses[0].tolist())
    world.carry(first, 0.0)
    wheels.reset(first)
    slam, known = _cheaper_slam(env.slam, begins, of_mapper)
    mapper = make_mapper(slam, lidar.geometry, Pose2D(0.0, 0.0, first.theta), of_mapper)
    gate = OdometryGate(update_thresholds(slam))
    odometry = np.empty_like(path.poses)
    share = env.lidar.scan_time / step
    unseen = np.empty(0, dtype=np.float32)
    stamped_poses = zip(path.stamps.tolist(), path.poses.tolist(), strict=True)
    for index, (stamp, pose) in enumerate(stamped_poses):
        driven = Twist2D(0.0, 0.0)
        swept = AT_REST
        at_first = wheels.pose
        if index:
            motion = world.carry(Pose2D(*pose), step)
            before = wheels.pose
            wheels.update(motion, of_wheels)
            driven = Twist2D(motion.increment.x / step, motion.increment.theta / step)
            at_first = wheels.pose
            if share:
                moved = between(before, wheels.pose)
                at_first = compose(before, part_of(moved, 1.0 - share))
                knows_truth = env.slam.mode == "ground_truth"
                swept = part_of(motion.increment if knows_truth else moved, share)
        odometry[index] = at_first
        believed = at_first if known is None else Pose2D(*known[index].tolist())
        scan = LaserScan(stamp, unseen, lidar.geometry)
        if gate.must_process(believed, stamp):  # as the mapper's own says: others are not looked at
            gate.take(stamp)
            sighting = lidar.look(world.pose, world.segments(), driven)
            scan = lidar.measure(sighting, of_laser, stamp, surfaces, swept)
        mapper.update(believed, scan)
    return odometry, mapper


def _cheaper_slam(
    slam: SlamConfig, begins: FloatArray, rng: np.random.Generator
) -> tuple[SlamConfig, FloatArray | None]:
    """Settings of a mapper with less to compute, and the poses (T, 3) that it is told; None: those of odometry."""
    cheaper = replace(slam, particles=min(slam.particles, PARTICLES))
    if slam.mode == "ground_truth":
        return cheaper, begins
    if slam.mode == "pose_graph":
        return replace(cheaper, mode="ground_truth"), begins + graph_error(begins, rng)
    return cheaper, None


def graph_error(poses: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the error of a pose graph: waves over the building, so that it errs alike wherever it comes again.

    Args:
        poses: True poses (T, 3); the first has no error.
        rng: Draws the run.

    Returns:
        Errors (T, 3) [m, m, rad].
    """
    size = math.exp(_SPREAD * rng.standard_normal())
    turn = size * _TURN * rng.standard_normal()
    x, y = poses[:, :2].T
    error = turn * np.column_stack([-y, x, np.ones_like(x)])
    wave_number = 2.0 * math.pi / _WAVELENGTH
    first = rng.uniform(0.0, 2.0 * math.pi)
    for heading in (first, first + 0.5 * math.pi):
        kx = wave_number * math.cos(heading)
        ky = wave_number * math.sin(heading)
        height_x, height_y = size * _WARP * rng.standard_normal(2)
        along = kx * x + ky * y + rng.uniform(0.0, 2.0 * math.pi)
        sin = np.sin(along)
        # Half of its curl is how far a field turns what lies in it.
        curl = 0.5 * (kx * height_y - ky * height_x)
        error += np.column_stack([height_x * sin, height_y * sin, curl * np.cos(along)])
    error[:, :2] -= error[0, :2]
    error[0] = 0.0
    return error


def _view(env: ExploreConfig) -> ScannerView:
    """What the mapper uses of a laser."""
    lidar = env.lidar
    return ScannerView(
        field_of_view=math.radians(lidar.field_of_view_deg),
        range_min=lidar.range_min,
        range_max=min(lidar.range_max, env.slam.max_usable_range),
        num_beams=lidar.num_beams // (env.slam.beam_skip + 1),
        mount_x=lidar.mount[0],
    )


def _moved(grid: OccupancyGrid, x: float, y: float) -> OccupancyGrid:
    """The same cells, moved [m]."""
    frame = grid.frame
    moved = frame._replace(origin_x=frame.origin_x + x, origin_y=frame.origin_y + y)
    return OccupancyGrid(grid.cells, moved)


def _about_plan(plan: "FloorPlan", drawn: OccupancyGrid) -> OccupancyGrid:
    """A map with as many unknown cells more as the plan and a margin need."""
    frame = _frame_about(plan, drawn.frame)
    cells = np.full(frame.shape, UNKNOWN, np.uint8)
    top, left = frame.to_cell(*drawn.frame.to_point(0, 0))
    paste(cells, drawn.cells, -top, -left)
    return OccupancyGrid(cells, frame)


def _frame_about(plan: "FloorPlan", drawn: GridFrame) -> GridFrame:
    """The frame of a map, with as many cells more as the plan and a margin need."""
    step, x, y, height, width = drawn
    min_x, min_y, max_x, max_y = plan.bounds

    def cells(needed: float) -> int:
        return max(0, math.ceil((needed + DRIFT_MARGIN) / step))

    left = cells(x - min_x)
    below = cells(y - min_y)
    right = cells(max_x - x - width * step)
    above = cells(max_y - y - height * step)
    return GridFrame(
        resolution=step,
        origin_x=x - left * step,
        origin_y=y - below * step,
        height_px=height + below + above,
        width_px=width + left + right,
    )
