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
from slamgym.parametric.ekf_slam import landmark_problem
from slamgym.parametric.lidar_error import LidarErrors, WallBeams, observed_cad, wall_beams
from slamgym.parametric.odometry_error import (
    Increments,
    PhaseErrors,
    WheelErrors,
    believed_increments,
    disturb,
    increments_of,
    integrate,
)
from slamgym.parametric.paths import check_path_is_free, pick_scans
from slamgym.parametric.schur_slam import solve_schur
from slamgym.parametric.visibility import Visibility, observe
from slamgym.parametric.warp import densify, displacements, invert, warp

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

    Returns:
        The map with its displacement field, the trajectories and the drawn parameters.

    Raises:
        ConfigError: If the trajectory leaves the free space, or has too many scans for ``ekf_schur``.
        PlanError: If the plan has no free cell at this resolution.
    """
    model = config or ParametricConfig()
    model = replace(model, two_phase=model.two_phase.times(model.severity))
    # One stream per cause, so that a seed gives one robot to every method.
    of_odometry, of_lidar, of_noise, of_beams = (rng or np.random.default_rng(0)).spawn(4)
    check_path_is_free(trajectory.poses[:, :2], plan.free_space, "the trajectory", "pose")
    may_grow = frame is None
    frame = frame or GridFrame.covering(plan.bounds, model.resolution, DRIFT_MARGIN)
    cad = plan.raster(frame.resolution, frame)
    occupied = cad.cells != FREE
    if occupied.all():
        raise PlanError(plan.id, "has no free cell; use a finer resolution or another plan")
    path = pick_scans(trajectory, model.motion)
    scanner = ScannerView()
    visibility = observe(occupied, frame, path.poses, scanner)
    unit = of_odometry.standard_normal(3)
    robot = _Robot(
        wheels=WheelErrors.of_unit(unit, model.severity),
        phases=PhaseErrors.of_unit(model.two_phase, unit),
        lidar=LidarErrors.draw(of_lidar, model.severity),
    )
    beams = wall_beams(visibility, robot.lidar, scanner.range_max, model.severity, of_beams)
    if model.method == "ekf_schur":
        error = _landmark_slam(model, path.poses, visibility, robot, of_noise)
    else:
        error = _dead_reckoning(model, path.poses, visibility, robot, beams, of_noise)
    forward = densify(error.forward, error.known, SMOOTHING / frame.resolution)

    # Where the caller gives no frame, it grows until nothing lies beyond the picture.
    pad = _drift_px(forward, visibility, frame) if may_grow else 0
    forward = np.pad(forward, ((0, 0), (pad, pad), (pad, pad)), mode="edge")
    frame = _grown(frame, pad)
    field = invert(forward, frame.resolution)
    picture = np.pad(observed_cad(occupied, visibility, beams), pad, constant_values=UNKNOWN)
    return Deformation(
        grid=OccupancyGrid(warp(picture, field, frame.resolution, UNKNOWN), frame),
        cad=cad if pad == 0 else plan.raster(frame.resolution, frame),
        field=field,
        seen=np.pad(visibility.seen, pad),
        true=path,
        odometry=Trajectory(path.stamps, integrate(path.poses[0], error.controls)),
        believed=Trajectory(path.stamps, error.believed),
        parameters=to_dict(robot),
    )


def _landmark_slam(
    model: ParametricConfig,
    poses: FloatArray,
    visibility: Visibility,
    robot: _Robot,
    rng: np.random.Generator,
) -> _MapError:
    """EKF-SLAM over wall cells, as one least-squares problem."""
    controls = believed_increments(increments_of(poses), robot.wheels)
    problem = landmark_problem(
        poses,
        controls,
        visibility,
        ScannerView().mount_x,
        robot.lidar,
        model.ekf,
        rng,
        model.severity,
    )
    estimate = solve_schur(problem)
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


def _drift_px(forward: Float32Array, visibility: Visibility, frame: GridFrame) -> int:
    """Cells by which the map must grow on every side to hold all displaced walls, at most half its size."""
    rows, cols = np.nonzero(visibility.cells.best >= 0)
    x, y = forward[:, rows, cols]
    placed_rows = rows + y / frame.resolution
    placed_cols = cols - x / frame.resolution
    placed = np.column_stack([placed_rows, placed_cols])
    beyond = placed - (np.array(frame.shape) - 1)
    over = max(-placed.min(initial=0.0), beyond.max(initial=0.0))
    # Dead reckoning over kilometres drifts without bound; a picture that follows it is of no use.
    return min(math.ceil(over), max(frame.shape) // 2)
