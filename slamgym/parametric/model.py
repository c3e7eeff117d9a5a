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
from slamgym.core.grids import paste
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
from slamgym.parametric.conversion import ConversionInput, DeformStreams, convert, draw_robot
from slamgym.parametric.lidar_error import HIT, wall_beams
from slamgym.parametric.odometry_error import increments_of
from slamgym.parametric.render import observed_cad
from slamgym.parametric.robot_scans import RobotScans, drawn_map, furniture_beside, take_scans
from slamgym.parametric.trajectory import TimedTrajectory, check_path_is_free, pick_scans
from slamgym.parametric.visibility import Visibility, observe
from slamgym.parametric.warp import densify, invert, warp

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan


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
    scans: RobotScans | None  # what the simulator's robot measured, where it was asked for
    parameters: dict[str, Any]  # what was drawn, in JSON form
    config: ParametricConfig
    seconds: dict[str, float]  # wall time of the steps


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
    streams = DeformStreams(*(rng or np.random.default_rng(0)).spawn(6))
    clock = _StopWatch()
    check_path_is_free(trajectory.poses[:, :2], plan.free_space, "the trajectory", "pose")
    framed = frame is not None
    if frame is None:
        frame = GridFrame.covering(plan.bounds, model.resolution, model.margin)
        if model.render.renderer == "scans":
            frame = _on_lattice(frame, trajectory.poses[0, :2])
    cad = plan.raster(frame.resolution, frame)
    occupied = cad.cells != FREE
    if occupied.all():
        raise PlanError(plan.id, "has no free cell; use a finer resolution or another plan")
    scans = pick_scans(trajectory, model.motion)
    clock.lap("plan and trajectory")

    visibility = observe(occupied, frame, scans.poses, model.scanner)
    clock.lap("visibility")

    robot = draw_robot(model, streams)
    motion = increments_of(scans.poses)
    sensed = None
    if model.method == "scan_matching" or model.render.renderer == "scans":
        of_furniture, of_errors = streams.scans.spawn(2)
        furniture = furniture_beside(trajectory.poses[:, :2], plan, model.sensing.clutter, of_furniture)
        sensed = take_scans(plan, furniture, scans, model.sensing.lidar, of_errors)
        clock.lap("scans")
    run = ConversionInput(scans.poses, motion, visibility, robot, model, streams, scans.stamps, sensed)
    conversion = convert(run)
    clock.lap("conversion")

    beams = wall_beams(visibility, robot.lidar, model.lidar, model.scanner, streams.beams)
    forward = conversion.field
    if model.method == "two_phase":
        # The other methods have taken the LIDAR's errors in as measurements; here they are added.
        forward = forward + densify(beams.field, beams.component == HIT, 0.0)
    forward = densify(forward, conversion.known, model.render.smoothing / frame.resolution)
    drawn = None
    if model.render.renderer == "scans" and sensed is not None:
        drawn = drawn_map(sensed, conversion.believed, frame, model.sensing.slam)
        clock.lap("map")
    # Where the caller leaves the frame open, it grows until nothing lies beyond the picture.
    pad = 0
    if not framed:
        pad = _drift_px(forward, visibility, frame) if drawn is None else _beyond_px(drawn.frame, frame)
    frame, forward = _padded(frame, pad), np.pad(forward, ((0, 0), (pad, pad), (pad, pad)), mode="edge")
    field = invert(forward, frame.resolution, model.render.inversions)
    clock.lap("field")

    if drawn is not None:
        cells = np.full(frame.shape, UNKNOWN, np.uint8)
        top, left = _corner_of(drawn.frame, frame)
        paste(cells, drawn.cells, -top, -left)
    else:
        picture = np.pad(observed_cad(occupied, visibility, beams), pad, constant_values=UNKNOWN)
        cells = warp(picture, field, frame.resolution, UNKNOWN)
    clock.lap("map")

    return Deformation(
        grid=OccupancyGrid(cells, frame),
        cad=cad if pad == 0 else plan.raster(frame.resolution, frame),
        field=field,
        seen=np.pad(visibility.seen, pad),
        true=scans.as_trajectory(),
        odometry=Trajectory(scans.stamps, conversion.odometry),
        believed=Trajectory(scans.stamps, conversion.believed),
        scans=sensed,
        parameters=to_dict(robot),
        config=given,
        seconds=clock.laps,
    )


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


def _corner_of(inner: GridFrame, frame: GridFrame) -> tuple[int, int]:
    """Row and column of a frame's upper left cell in another of the same lattice."""
    left = round((inner.origin_x - frame.origin_x) / frame.resolution)
    bottom = round((inner.origin_y - frame.origin_y) / frame.resolution)
    return frame.height_px - bottom - inner.height_px, left


def _beyond_px(inner: GridFrame, frame: GridFrame) -> int:
    """Cells by which a frame must grow on every side to hold another of the same lattice."""
    top, left = _corner_of(inner, frame)
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
