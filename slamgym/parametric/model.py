"""The main path: a floor plan and a trajectory in, the map that SLAM would have drawn out.

Steps as in docs/parametric.md: scans along the trajectory, who sees what, errors of the LIDAR and of the
odometry, their conversion to an error of the map, and the map with that error in it.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.core.config import to_dict
from slamgym.core.errors import PlanError
from slamgym.core.geometry import paste
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
from slamgym.parametric.config import ParametricConfig, scaled
from slamgym.parametric.ekf_slam import landmark_problem
from slamgym.parametric.lidar_error import LidarErrors, observed_cad, wall_beams
from slamgym.parametric.odometry_error import (
    Increments,
    PhaseErrors,
    WheelErrors,
    believed_increments,
    disturb,
    increments_of,
    integrate,
)
from slamgym.parametric.paths import TimedTrajectory, check_path_is_free, pick_scans
from slamgym.parametric.robot_scans import drawn_map, furniture_beside, take_scans
from slamgym.parametric.scan_matching import matched_path
from slamgym.parametric.schur_slam import solve_schur
from slamgym.parametric.visibility import Visibility, observe
from slamgym.parametric.warp import densify, displacements, invert, warp

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

DRIFT_MARGIN = 0.5
"""Unknown space round the plan, room for the drift [m]."""
_SMOOTHING = 0.1
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
    config: ParametricConfig


@dataclass(frozen=True)
class _Robot:
    """The systematic errors of one robot, drawn once; wheels and phases are two descriptions of the same."""

    wheels: WheelErrors
    phases: PhaseErrors
    lidar: LidarErrors


def deform(
    plan: "FloorPlan",
    trajectory: TimedTrajectory,
    config: ParametricConfig | None = None,
    rng: np.random.Generator | None = None,
    frame: GridFrame | None = None,
) -> Deformation:
    """Make the map that a SLAM robot would have drawn of a plan.

    Convention: everything is in the world frame of the plan. The robot starts at the true pose, so the map
    frame of a SLAM program differs by a translation only.

    Args:
        plan: The building.
        trajectory: True path, from :func:`slamgym.parametric.paths.drive` or
            :func:`slamgym.parametric.paths.from_recorded`.
        config: The model; the faithful preset if left out.
        rng: Source of all randomness; equal seeds give equal bytes. Left out: seed 0.
        frame: Grid of the map; by default the plan with :data:`DRIFT_MARGIN`, and more where the drift carries
            walls beyond it.

    Returns:
        The map with its displacement field, the trajectories and the drawn parameters.

    Raises:
        ConfigError: If the trajectory leaves the free space, or has too many scans for ``ekf_schur``.
        PlanError: If the plan has no free cell at this resolution.
    """
    given = config or ParametricConfig()
    model, draws_scans = scaled(given), given.renderer == "scans"
    # One stream per cause, so that a seed gives one robot to every method; the fourth is unused: seeds keep their maps.
    of_odometry, of_lidar, of_noise, _, of_scans, of_beams = (rng or np.random.default_rng(0)).spawn(6)
    check_path_is_free(trajectory.poses[:, :2], plan.free_space, "the trajectory", "pose")
    framed = frame is not None
    if frame is None:
        frame = GridFrame.covering(plan.bounds, model.resolution, DRIFT_MARGIN)
        if draws_scans:
            frame = _on_lattice(frame, trajectory.poses[0, :2])
    cad = plan.raster(frame.resolution, frame)
    occupied = cad.cells != FREE
    if occupied.all():
        raise PlanError(plan.id, "has no free cell; use a finer resolution or another plan")
    path = pick_scans(trajectory, model.motion)
    visibility = observe(occupied, frame, path.poses, model.scanner)
    unit = of_odometry.standard_normal(3)
    robot = _Robot(
        WheelErrors.of_unit(unit, model.severity),
        PhaseErrors.of_unit(model.two_phase, unit),
        LidarErrors.draw(of_lidar, model.severity),
    )
    scans = None
    if model.method == "scan_matching" or draws_scans:
        of_furniture, of_errors = of_scans.spawn(2)
        furniture = furniture_beside(trajectory.poses[:, :2], plan, model.sensing.clutter, of_furniture)
        scans = take_scans(plan, furniture, path, model.sensing.lidar, of_errors)

    if model.method == "ekf_schur":
        forward, known, controls, believed = _landmark_slam(model, path.poses, visibility, robot, of_noise)
    else:
        controls = disturb(increments_of(path.poses), robot.phases, model.two_phase, of_noise)
        believed = integrate(path.poses[0], controls)
        if scans is not None and model.method == "scan_matching":
            rate, skip = model.sensing.lidar.rate, model.sensing.slam.beam_skip
            steps = np.maximum(1.0, np.round(np.diff(path.stamps) * rate))
            believed = matched_path(scans, controls, steps, frame, model.matching, skip, of_noise)
        forward, known = displacements(path.poses, believed, visibility), visibility.seen
    beams = wall_beams(visibility, robot.lidar, model.scanner.range_max, model.severity, of_beams)
    if model.method == "two_phase":
        # The other methods have taken the LIDAR's errors in as measurements; here they are added.
        forward = forward + densify(beams.field, beams.hit, 0.0)
    forward = densify(forward, known, _SMOOTHING / frame.resolution)

    drawn = (
        drawn_map(scans, believed, frame, model.sensing.slam) if scans is not None and draws_scans else None
    )
    # Where the caller gives no frame, it grows until nothing lies beyond the picture.
    pad = 0
    if not framed:
        pad = _drift_px(forward, visibility, frame) if drawn is None else _beyond_px(drawn.frame, frame)
    forward = np.pad(forward, ((0, 0), (pad, pad), (pad, pad)), mode="edge")
    r, x, y, height, width = frame
    frame = GridFrame(r, x - pad * r, y - pad * r, height + 2 * pad, width + 2 * pad)
    field = invert(forward, frame.resolution)
    if drawn is not None:
        cells = np.full(frame.shape, UNKNOWN, np.uint8)
        top, left = frame.to_cell(*drawn.frame.to_point(0, 0))
        paste(cells, drawn.cells, -top, -left)
    else:
        picture = np.pad(observed_cad(occupied, visibility, beams), pad, constant_values=UNKNOWN)
        cells = warp(picture, field, frame.resolution, UNKNOWN)
    return Deformation(
        grid=OccupancyGrid(cells, frame),
        cad=cad if pad == 0 else plan.raster(frame.resolution, frame),
        field=field,
        seen=np.pad(visibility.seen, pad),
        true=path.as_trajectory(),
        odometry=Trajectory(path.stamps, integrate(path.poses[0], controls)),
        believed=Trajectory(path.stamps, believed),
        parameters=to_dict(robot),
        config=given,
    )


def _landmark_slam(
    model: ParametricConfig,
    poses: FloatArray,
    visibility: Visibility,
    robot: _Robot,
    rng: np.random.Generator,
) -> tuple[Float32Array, BoolArray, Increments, FloatArray]:
    """EKF-SLAM over wall cells, as one least-squares problem.

    Returns:
        Displacements [m] on true cells (2, H, W), which are known (H, W), believed increments, and poses (T, 3).
    """
    controls = believed_increments(increments_of(poses), robot.wheels)
    problem = landmark_problem(
        poses, controls, visibility, model.scanner.mount_x, robot.lidar, model.ekf, rng, model.severity
    )
    estimate = solve_schur(problem)
    rows, cols = np.divmod(problem.cells, visibility.frame.width_px)
    field = np.zeros((2, *visibility.frame.shape), dtype=np.float32)
    field[:, rows, cols] = (problem.points - estimate.landmarks).T
    known = np.zeros(visibility.frame.shape, dtype=np.bool_)
    known[rows, cols] = True
    return field, known, controls, estimate.poses


def _drift_px(forward: Float32Array, visibility: Visibility, frame: GridFrame) -> int:
    """Cells by which the map must grow on every side to hold all displaced walls, at most half its size."""
    walls = np.nonzero(visibility.cells.best >= 0)
    down, left = forward[1][walls] / frame.resolution, forward[0][walls] / frame.resolution
    placed = np.column_stack([walls[0] + down, walls[1] - left])
    beyond = placed - (np.array(frame.shape) - 1)
    over = max(-placed.min(initial=0.0), beyond.max(initial=0.0))
    # Dead reckoning over kilometres drifts without bound; a picture that follows it is of no use.
    return min(math.ceil(over), max(frame.shape) // 2)


def _beyond_px(inner: GridFrame, frame: GridFrame) -> int:
    """Cells by which a frame must grow on every side to hold another of the same lattice."""
    top, left = frame.to_cell(*inner.to_point(0, 0))
    bottom, right = top + inner.height_px - frame.height_px, left + inner.width_px - frame.width_px
    return max(0, -top, -left, bottom, right)


def _on_lattice(frame: GridFrame, start: FloatArray) -> GridFrame:
    """The frame shifted by less than a cell and grown by one, so that cell borders meet the robot's start (2,)."""
    r = frame.resolution
    x, y = (
        float(s + math.floor((o - s) / r) * r)
        for o, s in zip((frame.origin_x, frame.origin_y), start, strict=True)
    )
    return GridFrame(r, x, y, frame.height_px + 1, frame.width_px + 1)
