"""The main path: a floor plan and a trajectory in, the map that SLAM would have drawn out.

Steps as in docs/parametric.md: scans along the trajectory, who sees what, errors of the LIDAR and of the
odometry, their conversion to an error of the map, and the map with that error in it.
"""

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

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
from slamgym.parametric.config import ParametricConfig, scaled
from slamgym.parametric.ekf_slam import run_ekf
from slamgym.parametric.landmarks import landmark_problem
from slamgym.parametric.lidar_error import HIT, LidarErrors, draw_lidar_errors, wall_beams
from slamgym.parametric.odometry_error import (
    Failures,
    Increments,
    WheelErrors,
    believed_increments,
    draw_failures,
    draw_wheel_errors,
    increments_of,
    integrate,
)
from slamgym.parametric.render import hit_count_map, measured_scans, observed_cad, true_ranges
from slamgym.parametric.schur_slam import solve_schur
from slamgym.parametric.trajectory import TimedTrajectory, check_path_is_free, pick_scans
from slamgym.parametric.two_phase import (
    PhaseErrors,
    anchored_path,
    disturb,
    draw_phase_errors,
    frame_centre,
    jittered,
    placement_field,
    rigid_motions,
)
from slamgym.parametric.visibility import Visibility, beam_angles, observe
from slamgym.parametric.warp import densify, invert, warp

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan


@dataclass(frozen=True)
class RobotErrors:
    """The systematic errors of one robot, drawn once."""

    wheels: WheelErrors
    phases: PhaseErrors
    lidar: LidarErrors


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
    seconds: dict[str, float]  # wall time of the steps


@dataclass(frozen=True)
class _Streams:
    """Independent randomness per cause, so that the same seed gives the same robot to every method."""

    wheels: np.random.Generator
    phases: np.random.Generator
    lidar: np.random.Generator
    noise: np.random.Generator
    failures: np.random.Generator
    beams: np.random.Generator


@dataclass(frozen=True)
class _Run:
    """What the conversion of odometry errors to map errors works on."""

    poses: FloatArray  # (T, 3) true poses of the scans
    motion: Increments  # between them
    visibility: Visibility
    occupied: BoolArray  # (H, W)
    robot: RobotErrors
    failures: Failures
    model: ParametricConfig
    streams: _Streams


@dataclass(frozen=True)
class _Conversion:
    """What it makes of it."""

    field: Float32Array  # (2, H, W) [m] on true cells, true minus measured
    known: BoolArray  # (H, W) cells that have a value
    odometry: FloatArray  # (T, 3)
    believed: FloatArray  # (T, 3)


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
        trajectory: True path, from :func:`slamgym.parametric.trajectory.drive` or
            :func:`slamgym.parametric.trajectory.from_recorded`.
        config: The model; the faithful preset if left out.
        rng: Source of all randomness; equal seeds give equal bytes. Left out: seed 0.
        frame: Grid of the map; by default the plan with ``config.margin``, and more where the drift carries
            walls beyond it.

    Returns:
        The map with its displacement field, the trajectories and the drawn parameters.

    Raises:
        ConfigError: If the trajectory leaves the free space, or the batched EKF gets too many landmarks.
        PlanError: If the plan has no free cell at this resolution.
    """
    given = config or ParametricConfig()
    model = scaled(given)
    streams = _Streams(*(rng or np.random.default_rng(0)).spawn(6))
    clock = _StopWatch()
    check_path_is_free(trajectory.poses[:, :2], plan.free_space, "the trajectory", "pose")
    framed = frame is not None
    frame = frame or GridFrame.covering(plan.bounds, model.resolution, model.margin)
    cad = plan.raster(frame.resolution, frame)
    occupied = cad.cells != FREE
    if occupied.all():
        raise PlanError(plan.id, "has no free cell; use a finer resolution or another plan")
    scans = pick_scans(trajectory, model.motion)
    clock.lap("plan and trajectory")

    visibility, _ = observe(occupied, frame, scans.poses, model.scanner)
    clock.lap("visibility")

    robot = RobotErrors(
        draw_wheel_errors(model.odometry, streams.wheels),
        draw_phase_errors(model.two_phase, streams.phases),
        draw_lidar_errors(model.lidar, streams.lidar),
    )
    motion = increments_of(scans.poses)
    failures = draw_failures(motion, model.failures, streams.failures)
    run = _Run(scans.poses, motion, visibility, occupied, robot, failures, model, streams)
    conversion = _two_phase(run) if model.method == "two_phase" else _landmark_slam(run)
    clock.lap("conversion")

    beams = wall_beams(visibility, robot.lidar, model.lidar, model.scanner, streams.beams)
    forward = conversion.field
    if model.method == "two_phase":
        # Landmark SLAM has taken the LIDAR's errors in as measurements; here they are added.
        forward = forward + densify(beams.field, beams.component == HIT, 0.0)
    forward = densify(forward, conversion.known, model.render.smoothing / frame.resolution)
    # Where the caller leaves the frame open, it grows until no wall drifts out of the picture.
    pad = 0 if framed else _drift_px(forward, visibility, frame)
    frame, forward = _padded(frame, pad), np.pad(forward, ((0, 0), (pad, pad), (pad, pad)), mode="edge")
    field = invert(forward, frame.resolution, model.render.inversions)
    clock.lap("field")

    if model.render.renderer == "warp":
        picture = np.pad(
            observed_cad(occupied, visibility, beams, model.render), pad, constant_values=UNKNOWN
        )
        cells = warp(picture, field, frame.resolution, UNKNOWN)
    else:
        angles = beam_angles(model.scanner, frame.resolution)
        exact = true_ranges(scans.poses, plan.segments(), angles, model.scanner)
        measured, bearings = measured_scans(
            exact, angles, robot.lidar, model.lidar, model.scanner, streams.noise
        )
        cells = hit_count_map(conversion.believed, measured, bearings, frame, model.scanner, model.render)
    clock.lap("map")

    return Deformation(
        grid=OccupancyGrid(cells, frame),
        cad=cad if pad == 0 else plan.raster(frame.resolution, frame),
        field=field,
        seen=np.pad(visibility.seen, pad),
        true=scans.as_trajectory(),
        odometry=Trajectory(scans.stamps, conversion.odometry),
        believed=Trajectory(scans.stamps, conversion.believed),
        parameters=to_dict(robot) | {"failures": failures.scans.tolist()},
        config=given,
        seconds=clock.laps,
    )


def _two_phase(run: _Run) -> _Conversion:
    """Empirical odometry errors, and every cell where its scan would have put it."""
    phases, poses, visibility = run.model.two_phase, run.poses, run.visibility
    controls = disturb(run.motion, run.robot.phases, phases, run.streams.noise)
    gain = np.where(run.failures.matched, phases.anchoring, 0.0)
    path = anchored_path(poses, run.failures.disturb(controls), visibility, run.occupied, gain, phases)
    believed = jittered(path, phases, run.streams.noise)
    mean_motion: Float32Array | None = None
    if phases.observe == "mean":
        motions = rigid_motions(poses, believed, frame_centre(visibility.frame)).astype(np.float32)
        _, sums = observe(run.occupied, visibility.frame, poses, run.model.scanner, motions)
        mean_motion = (sums / np.maximum(visibility.cells.num_scans, 1)[:, :, None]).astype(np.float32)
    return _Conversion(
        field=placement_field(poses, believed, visibility, phases.observe, mean_motion),
        known=visibility.seen,
        odometry=integrate(poses[0], controls),
        believed=believed,
    )


def _landmark_slam(run: _Run) -> _Conversion:
    """EKF-SLAM over wall cells, batched or as one least-squares problem."""
    model, frame = run.model, run.visibility.frame
    base, diameter = model.odometry.wheel_base, model.odometry.wheel_diameter
    controls = believed_increments(run.motion, run.robot.wheels, base, diameter)
    problem = landmark_problem(
        run.poses,
        run.failures.disturb(controls),
        run.visibility,
        model.scanner.mount_x,
        run.robot.lidar,
        run.failures.matched,
        model.ekf,
        run.streams.noise,
    )
    if model.method == "ekf":
        estimate = run_ekf(problem, model.ekf.max_landmarks)
    else:
        estimate = solve_schur(problem, model.ekf.iterations)
    rows, cols = np.divmod(problem.cells, frame.width_px)
    field = np.zeros((2, *frame.shape), dtype=np.float32)
    field[:, rows, cols] = (problem.points - estimate.landmarks).T
    known = np.zeros(frame.shape, dtype=np.bool_)
    known[rows, cols] = True
    return _Conversion(field, known, integrate(run.poses[0], controls), estimate.poses)


def _drift_px(forward: Float32Array, visibility: Visibility, frame: GridFrame) -> int:
    """Cells by which the map must grow on every side to hold all displaced walls, at most half its size."""
    rows, cols = np.nonzero(visibility.cells.best >= 0)
    new_rows = rows + forward[1, rows, cols] / frame.resolution
    new_cols = cols - forward[0, rows, cols] / frame.resolution
    over = (
        -new_rows.min(initial=0.0),
        -new_cols.min(initial=0.0),
        new_rows.max(initial=0.0) - (frame.height_px - 1),
        new_cols.max(initial=0.0) - (frame.width_px - 1),
    )
    # Dead reckoning over kilometres drifts without bound; a picture that follows it is of no use.
    return min(max(0, math.ceil(max(over))), max(frame.shape) // 2)


def _padded(frame: GridFrame, pad: int) -> GridFrame:
    """The frame with ``pad`` more cells on every side."""
    return GridFrame(
        frame.resolution,
        frame.origin_x - pad * frame.resolution,
        frame.origin_y - pad * frame.resolution,
        frame.height_px + 2 * pad,
        frame.width_px + 2 * pad,
    )


class _StopWatch:
    """Wall time per step [s]."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = now - self._last
        self._last = now
