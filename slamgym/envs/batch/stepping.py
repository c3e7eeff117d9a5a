"""One step of environments, one or many: kernels that loop over robots.

Named tuples come as ``law[:]``, without names (:func:`slamgym.core.jit.plain`), and are named again first thing.

Every kernel takes ``ids``, the environments that it is about, shape (n,).
"""

import math
from typing import Any

import numpy as np

from slamgym.core import geometry
from slamgym.core.jit import assign, kernel
from slamgym.core.types import FloatArray, IntArray, Pose2D
from slamgym.envs.batch.arrays import (
    PLACE,
    DriveModel,
    Robots,
    ScanModel,
    Scans,
    Scenes,
    WheelModel,
)
from slamgym.envs.coverage import CELL, sweep
from slamgym.sim import motion
from slamgym.sim.beams import BeamModel, fail_beams, measure_beams, write_rep117
from slamgym.sim.raycast import cast_hits
from slamgym.sim.sweep import look_along
from slamgym.sim.wheel_odometry import count_ticks, slipped_arc

_compose: Any = kernel(geometry.compose)
_between = kernel(geometry.between)
_count_ticks = kernel(count_ticks)
_slipped_arc = kernel(slipped_arc)
_TURN = 2.0 * math.pi


@kernel
def drive_all(
    robots: Robots,
    scenes: Scenes,
    drive: DriveModel,
    wheels: WheelModel,
    ids: IntArray,
    targets: FloatArray,
) -> int:
    """Drive, but only until something is touched; those who touch nothing have driven for the whole step.

    Args:
        robots: Changed in place; ``left`` says how much of the step is left.
        scenes: Obstacles.
        drive: Limits and bodies.
        wheels: Random errors.
        ids: Environments.
        targets: Wished velocities within the limits, shape (N, 2).

    Returns:
        How many touch something.
    """
    robots = Robots(*robots)
    scenes = Scenes(*scenes)
    drive = DriveModel(*drive)
    wheels = WheelModel(*wheels)
    touching = 0
    for i in ids:
        state = robots.drive[i]
        state[motion.LEFT :] = 0.0
        left = motion.drive_freely(
            state,
            targets[i, 0],
            targets[i, 1],
            drive.limits,
            drive.dt,
            drive.radius,
            scenes.segments[i, : scenes.num_obstacles[i]],
            scenes.discs[i, : scenes.num_discs[i]],
        )
        robots.left[i] = left
        if left > motion.NO_TIME:
            touching += 1
        else:
            robots.contact[i] = False
            _arrive(robots, scenes, wheels, i, drive.dt)
    return touching


@kernel
def arrive_all(
    robots: Robots, scenes: Scenes, drive: DriveModel, wheels: WheelModel, ids: IntArray
) -> None:
    """Note the poses of robots that have touched something; see :func:`drive_all`."""
    robots = Robots(*robots)
    scenes = Scenes(*scenes)
    wheels = WheelModel(*wheels)
    for i in ids:
        _arrive(robots, scenes, wheels, i, drive[0])


@kernel
def pose_at(rows: FloatArray, i: int) -> Pose2D:
    """A row of a table of poses."""
    return Pose2D(rows[i, 0], rows[i, 1], rows[i, 2])


@kernel
def put_pose(rows: FloatArray, i: int, pose: Pose2D) -> None:
    """Write a row of a table of poses."""
    rows[i, 0] = pose.x
    rows[i, 1] = pose.y
    rows[i, 2] = pose.theta


@kernel
def _arrive(robots: Robots, scenes: Scenes, model: WheelModel, i: int, dt: float) -> None:
    """Note one robot's pose after a drive, and integrate its wheels; see :mod:`slamgym.sim.wheel_odometry`."""
    state = robots.drive[i]
    before = pose_at(robots.pose, i)
    theta = math.pi - (math.pi - state[motion.THETA]) % _TURN
    now = Pose2D(state[motion.X], state[motion.Y], theta)
    put_pose(robots.pose, i, now)
    robots.path[i] += state[motion.DISTANCE]
    driven = _between(before, now)
    put_pose(robots.driven, i, driven)
    old = pose_at(robots.odometry, i)
    new = _compose(old, driven if model.is_ideal else _rolled(robots, model, i))
    put_pose(robots.odometry, i, new)
    moved = _between(old, new)
    put_pose(robots.moved, i, moved)
    robots.velocity[i, 0] = moved.x / dt
    robots.velocity[i, 1] = moved.theta / dt
    _visit(robots, scenes, i)


@kernel
def _visit(robots: Robots, scenes: Scenes, i: int) -> None:
    """Count the visit if the robot has come to another place."""
    left, bottom = scenes.floor_corner[i]
    cols = math.ceil(scenes.floor_shape[i, 1] * CELL / PLACE)
    col = math.floor((robots.pose[i, 0] - left) / PLACE)
    place = math.floor((robots.pose[i, 1] - bottom) / PLACE) * cols + col
    robots.revisits[i] = 0
    if place != robots.place[i]:
        robots.place[i] = place
        robots.revisits[i] = scenes.visits[i, place]
        scenes.visits[i, place] += 1


@kernel
def _rolled(robots: Robots, model: WheelModel, i: int) -> Pose2D:
    """Motion of a step as the encoders measure it, with slip."""
    rolled = robots.rolled[i]
    wheels = robots.wheels[i]
    state = robots.drive[i]
    slips = robots.slips[i]
    before = rolled[0], rolled[1]
    rolled[0] += wheels[0] * state[motion.LEFT]
    rolled[1] += wheels[1] * state[motion.RIGHT]
    counted = _count_ticks(before, (rolled[0], rolled[1]), model.tick)
    return _slipped_arc(counted, wheels[2], model.slips, (slips[0], slips[1], slips[2]))


@kernel
def look_all(
    robots: Robots, scenes: Scenes, scanner: ScanModel, scans: Scans, ids: IntArray
) -> None:
    """Scan, and account for the floor that is truly seen.

    Args:
        robots: Where they stand.
        scenes: What they see; the floor is changed in place.
        scanner: The scanner.
        scans: Draws; receives the ranges.
        ids: Environments.
    """
    robots = Robots(*robots)
    scenes = Scenes(*scenes)
    scanner = ScanModel(*scanner)
    scans = Scans(*scans)
    num_beams = scans.true.shape[1]
    hits = np.empty(num_beams, dtype=np.int64)
    met = np.empty(num_beams)
    measured = np.empty(num_beams)
    law = BeamModel(*scanner.law)
    mount = scanner.mount
    begin = law.angle_min
    step = law.angle_increment
    for i in ids:
        walls = scenes.segments[i, : scenes.num_segments[i]]
        base = robots.pose[i, 0], robots.pose[i, 1], robots.pose[i, 2]
        way = robots.driven[i, 0] * scanner.sweep, robots.driven[i, 2] * scanner.sweep
        sensors = look_along(base, mount, way, begin, step, walls, law.range_max, met, hits)
        if robots.exact[i]:
            assign(met, measured)
        else:
            materials = _materials(scenes, i)
            normal = scans.normal[i]
            measure_beams(sensors, walls, met, hits, materials, law[:], normal, measured)  # type: ignore[arg-type]
            fail_beams(measured, scans.fate[i], scanner.lost, scanner.stray, law.range_max)
            _add_burst(scans, i, measured)
        write_rep117(measured, scanner.range_min, law.range_max, scans.ranges[i])
        true = scans.true[i]
        sensor = _compose(base, mount)
        if len(sensors) == 1:
            assign(met, true)
        else:
            x, y, theta = sensor
            cast_hits(x, y, theta, begin, step, walls, law.range_max, true, hits)
        _see_floor(scenes, scanner, i, sensor, true)


@kernel
def _add_burst(scans: Scans, i: int, measured: FloatArray) -> None:
    """Let a burst of cross-talk shorten the ranges that it hits."""
    first, count = scans.burst[i]
    for k in range(count):
        measured[first + k] = min(measured[first + k], scans.pulses[i, k])


@kernel
def _see_floor(
    scenes: Scenes, scanner: ScanModel, i: int, sensor: Pose2D, true: FloatArray
) -> None:
    """Account for the floor that the beams of a scan have passed."""
    rows, cols = scenes.floor_shape[i]
    unseen = scenes.unseen[i, : rows * cols].reshape(rows, cols)
    left, bottom = scenes.floor_corner[i]
    x, y, theta = sensor
    scenes.seen[i] += sweep(
        unseen, left, bottom, CELL, x, y, theta, scanner.directions, true, scanner.usable
    )
    if scenes.floor_cells[i] > 0:
        scenes.shares[i] = scenes.seen[i] / scenes.floor_cells[i]


@kernel
def _materials(scenes: Scenes, i: int) -> Any:
    """What the segments of one scene are made of: :class:`slamgym.sim.surfaces.Surfaces` without names."""
    first = scenes.first[i, : scenes.num_first[i]]
    patches = scenes.patches[i, : scenes.num_patches[i]]
    outside = scenes.outside[i, : scenes.num_outside[i]]
    num_walls, seed = scenes.materials[i]
    return first, patches, outside, num_walls, seed, scenes.roughness[i]
