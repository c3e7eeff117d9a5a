"""The paper's model: a floor plan and a trajectory in, the map that SLAM would have drawn out.

Steps as in docs/parametric.md: scans along the trajectory, who sees what, errors of the LIDAR and of the
odometry, their conversion to an error of the map, and the map with that error in it.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from slamgym.core.config import to_dict
from slamgym.core.errors import PlanError
from slamgym.core.progress import say
from slamgym.core.types import (
    FREE,
    UNKNOWN,
    BoolArray,
    Float32Array,
    FloatArray,
    GridFrame,
    OccupancyGrid,
    Trajectory,
)
from slamgym.parametric.config import ParametricConfig, ScannerView
from slamgym.parametric.ekf_slam import check_ekf_size, run_ekf
from slamgym.parametric.landmarks import landmark_problem
from slamgym.parametric.lidar_error import LidarErrors
from slamgym.parametric.odometry_error import (
    Increments,
    PhaseErrors,
    WheelErrors,
    believed_increments,
    disturb,
    increments_of,
    integrate,
)
from slamgym.parametric.paths import check_path_is_free, pick_scans, thinned_scans
from slamgym.parametric.schur_slam import MAX_SCANS, solve_schur
from slamgym.parametric.visibility import Visibility, observe
from slamgym.parametric.wall_beams import WallBeams, corrected_beams, observed_cad, printed_beams
from slamgym.parametric.warp import densify, displacements, enlarged, invert, warp

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

DRIFT_MARGIN = 0.5
"""Unknown space round the plan, room for the drift [m]."""
SMOOTHING = 0.1
"""Gaussian over the densified field [m]: 2 px of a 256 px map at 0.05 m."""


@dataclass(frozen=True)
class Deformation:
    """One hypothesis of the SLAM map of a plan."""

    grid: OccupancyGrid  # the map, world frame of the plan
    cad: OccupancyGrid  # the plan on the same frame: free inside, occupied in walls and outside
    field: Float32Array  # (2, H, W) [m] x, y, true minus measured; out(q) = in(q + d(q))
    seen: BoolArray  # (H, W) true cells that some scan saw
    true: Trajectory  # poses of the scans
    odometry: Trajectory  # what the wheels alone believed
    believed: Trajectory  # where the scans were drawn
    parameters: dict[str, Any]  # what was drawn, in JSON form


@dataclass(frozen=True)
class _Robot:
    """The systematic errors of one robot, drawn once; wheels and phases are two descriptions of the same."""

    wheels: WheelErrors
    phases: PhaseErrors
    lidar: LidarErrors


class _View(NamedTuple):
    """The plan on a grid, and what the scans see of it."""

    cad: OccupancyGrid
    occupied: BoolArray  # (H, W)
    visibility: Visibility


class _MapError(NamedTuple):
    """How odometry's errors displace the map."""

    forward: Float32Array  # (2, H, W) [m] on true cells
    known: BoolArray  # (H, W) cells where it is known
    controls: Increments  # what odometry believes
    believed: FloatArray  # (T, 3) poses


def deform(
    plan: "FloorPlan",
    trajectory: Trajectory,
    config: ParametricConfig | None = None,
    rng: np.random.Generator | None = None,
    frame: GridFrame | None = None,
    map_frame: GridFrame | None = None,
) -> Deformation:
    """Make the map that a SLAM robot would have drawn of a plan.

    Convention: everything is in the world frame of the plan. The robot starts at the true pose, so the map
    frame of a SLAM program differs by a translation only.

    Args:
        plan: The building.
        trajectory: True path.
        config: The model; the defaults are the paper's, with its misprints corrected.
        rng: Source of all randomness; equal seeds give equal bytes. Left out: seed 0.
        frame: Grid of the map; by default the plan with :data:`DRIFT_MARGIN`, and more where the drift carries
            walls beyond it.
        map_frame: A finer grid of the same extent: the displacements are computed on ``frame`` and enlarged to it.

    Returns:
        The map with its displacement field, the trajectories and the drawn parameters.

    Raises:
        ConfigError: If the trajectory leaves the free space, or the grid is too large for ``ekf``.
        PlanError: If the plan has no free cell at this resolution.
    """
    model = config or ParametricConfig()
    model = replace(model, two_phase=model.two_phase.times(model.severity))
    # One stream per cause, so that a seed gives one robot to every method.
    of_odometry, of_lidar, of_noise, of_beams = (rng or np.random.default_rng(0)).spawn(4)
    check_path_is_free(trajectory.poses[:, :2], plan.free_space, "the trajectory", "pose")
    path = _scans(plan, trajectory, model)
    may_grow = frame is None
    view = _look(
        plan, frame or GridFrame.covering(plan.bounds, model.resolution, DRIFT_MARGIN), path
    )
    unit = of_odometry.standard_normal(3)
    robot = _Robot(
        wheels=WheelErrors.of_unit(unit, model.severity),
        phases=PhaseErrors.of_unit(model.two_phase, unit),
        lidar=LidarErrors.draw(of_lidar, model.severity),
    )
    beams = _beams(model, view.visibility, robot, of_beams)
    convert = _dead_reckoning if model.method == "two_phase" else _landmark_slam
    error = convert(model, path.poses, view.visibility, robot, beams, of_noise)
    forward = densify(error.forward, error.known, SMOOTHING / view.cad.frame.resolution)
    if map_frame is not None:
        forward = enlarged(forward, map_frame.shape)
        view = _look(plan, map_frame, path)
        beams = _beams(model, view.visibility, robot, of_beams)

    # Where the caller gives no frame, it grows until nothing lies beyond the picture.
    pad = _drift_px(forward, view.visibility) if may_grow else 0
    forward = np.pad(forward, ((0, 0), (pad, pad), (pad, pad)), mode="edge")
    drawn = _grown(view.cad.frame, pad)
    field = invert(forward, drawn.resolution)
    picture = observed_cad(view.occupied, view.visibility, beams)
    picture = np.pad(picture, pad, constant_values=UNKNOWN)
    return Deformation(
        grid=OccupancyGrid(warp(picture, field, drawn.resolution, UNKNOWN), drawn),
        cad=view.cad if pad == 0 else plan.raster(drawn.resolution, drawn),
        field=field,
        seen=np.pad(view.visibility.seen, pad),
        true=path,
        odometry=Trajectory(path.stamps, integrate(path.poses[0], error.controls)),
        believed=Trajectory(path.stamps, error.believed),
        parameters=to_dict(robot),
    )


def _scans(plan: "FloorPlan", trajectory: Trajectory, model: ParametricConfig) -> Trajectory:
    """The poses of the scans that enter the map; fewer, and said so, where there are too many to solve for."""
    path = pick_scans(trajectory, model.motion)
    if model.method != "ekf_schur" or len(path) <= MAX_SCANS:
        return path
    thin, motion = thinned_scans(trajectory, model.motion, MAX_SCANS)
    say(
        f"{plan.id}: {len(path):,} scans are more than ekf_schur can solve for; took {len(thin):,}, one every "
        f"{motion.scan_spacing:.2f} m or {motion.scan_angle:.2f} rad"
    )
    return thin


def _look(plan: "FloorPlan", frame: GridFrame, path: Trajectory) -> _View:
    """Draw the plan and cast the scans of a path.

    Raises:
        PlanError: If the plan has no free cell.
    """
    cad = plan.raster(frame.resolution, frame)
    occupied = cad.cells != FREE
    if occupied.all():
        raise PlanError(plan.id, "has no free cell; use a finer resolution or another plan")
    return _View(cad, occupied, observe(occupied, frame, path.poses, ScannerView()))


def _beams(
    model: ParametricConfig, visibility: Visibility, robot: _Robot, rng: np.random.Generator
) -> WallBeams:
    """The exteroceptive model by the equations that are wanted."""
    draw = printed_beams if model.equations == "printed" else corrected_beams
    return draw(visibility, robot.lidar, ScannerView().range_max, model.severity, rng)


def _landmark_slam(
    model: ParametricConfig,
    poses: FloatArray,
    visibility: Visibility,
    robot: _Robot,
    beams: WallBeams,
    rng: np.random.Generator,
) -> _MapError:
    """EKF-SLAM over wall cells: as a filter, or as one least-squares problem."""
    if model.method == "ekf":
        check_ekf_size(visibility.frame, int((visibility.cells.best >= 0).sum()))
    controls = believed_increments(increments_of(poses), robot.wheels)
    problem = landmark_problem(
        poses,
        controls,
        visibility,
        robot.lidar,
        model.ekf,
        rng,
        noise=model.severity,
        field=beams.field if model.equations == "printed" else None,
    )
    estimate = run_ekf(problem) if model.method == "ekf" else solve_schur(problem)
    rows, cols = np.divmod(problem.cells, visibility.frame.width_px)
    field = np.zeros((2, *visibility.frame.shape), dtype=np.float32)
    field[:, rows, cols] = (problem.points - estimate.landmarks).T
    known = np.zeros(visibility.frame.shape, dtype=np.bool_)
    known[rows, cols] = True
    return _MapError(forward=field, known=known, controls=controls, believed=estimate.poses)


def _dead_reckoning(
    model: ParametricConfig,
    poses: FloatArray,
    visibility: Visibility,
    robot: _Robot,
    beams: WallBeams,
    rng: np.random.Generator,
) -> _MapError:
    """The two phases of the way, without any correction by the map."""
    controls = disturb(increments_of(poses), robot.phases, model.two_phase, rng)
    believed = integrate(poses[0], controls)
    # The EKF has taken the LIDAR's errors in as measurements; here they are added.
    of_odometry = displacements(poses, believed, visibility)
    of_lidar = densify(beams.field, beams.hit, 0.0)
    return _MapError(
        forward=of_odometry + of_lidar, known=visibility.seen, controls=controls, believed=believed
    )


def _grown(frame: GridFrame, pad: int) -> GridFrame:
    """A frame with so many cells more on every side."""
    return GridFrame(
        resolution=frame.resolution,
        origin_x=frame.origin_x - pad * frame.resolution,
        origin_y=frame.origin_y - pad * frame.resolution,
        height_px=frame.height_px + 2 * pad,
        width_px=frame.width_px + 2 * pad,
    )


def _drift_px(forward: Float32Array, visibility: Visibility) -> int:
    """Cells by which the map must grow on every side to hold all displaced walls, at most half its size."""
    frame = visibility.frame
    rows, cols = np.nonzero(visibility.cells.best >= 0)
    x, y = forward[:, rows, cols]
    placed_rows = rows + y / frame.resolution
    placed_cols = cols - x / frame.resolution
    placed = np.column_stack([placed_rows, placed_cols])
    beyond = placed - (np.array(frame.shape) - 1)
    over = max(-placed.min(initial=0.0), beyond.max(initial=0.0))
    # Dead reckoning over kilometres drifts without bound; a picture that follows it is of no use.
    return min(math.ceil(over), max(frame.shape) // 2)
