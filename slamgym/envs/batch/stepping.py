"""One step of environments, one or many: kernels that loop over robots.

Named tuples come as ``law[:]``, without names (:func:`slamgym.core.jit.plain`), and are named again first thing.

Every kernel takes ``ids``, the environments that it is about, shape (n,).
"""

import math
from typing import Any

import numpy as np

from slamgym.core import geometry
from slamgym.core.jit import assign, kernel
from slamgym.core.types import BoolArray, Float32Array, FloatArray, IntArray, Pose2D
from slamgym.envs.batch.arrays import (
    PLACE,
    DriveModel,
    MapModel,
    Maps,
    Robots,
    ScanModel,
    Scans,
    Scenes,
    WheelModel,
)
from slamgym.envs.compact import write_compact
from slamgym.envs.coverage import CELL, sweep
from slamgym.envs.observations import cut_crop
from slamgym.envs.turned_reading import CellBox, Place, Tiles
from slamgym.sim import motion
from slamgym.sim.beams import BeamModel, fail_beams, measure_beams, write_rep117
from slamgym.sim.raycast import cast_hits
from slamgym.sim.sweep import look_along
from slamgym.sim.wheel_odometry import count_ticks, slipped_arc
from slamgym.slam.hit_count_kernels import cells_of, classify_counts, draw_scans
from slamgym.slam.motion_model import add_way, is_far_enough

_compose: Any = kernel(geometry.compose)
_between = kernel(geometry.between)
_count_ticks = kernel(count_ticks)
_slipped_arc = kernel(slipped_arc)
_add_way = kernel(add_way)
_is_far_enough = kernel(is_far_enough)
_TURN = 2.0 * math.pi
_VELOCITY = Robots._fields.index("velocity")
_RANGES = Scans._fields.index("ranges")


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
def _pose(rows: FloatArray, i: int) -> Pose2D:
    return Pose2D(rows[i, 0], rows[i, 1], rows[i, 2])


@kernel
def _put_pose(rows: FloatArray, i: int, pose: Pose2D) -> None:
    rows[i, 0] = pose.x
    rows[i, 1] = pose.y
    rows[i, 2] = pose.theta


@kernel
def _arrive(robots: Robots, scenes: Scenes, model: WheelModel, i: int, dt: float) -> None:
    """Note one robot's pose after a drive, and integrate its wheels; see :mod:`slamgym.sim.wheel_odometry`."""
    state = robots.drive[i]
    before = _pose(robots.pose, i)
    theta = math.pi - (math.pi - state[motion.THETA]) % _TURN
    now = Pose2D(state[motion.X], state[motion.Y], theta)
    _put_pose(robots.pose, i, now)
    robots.path[i] += state[motion.DISTANCE]
    driven = _between(before, now)
    _put_pose(robots.driven, i, driven)
    old = _pose(robots.odometry, i)
    new = _compose(old, driven if model.is_ideal else _rolled(robots, model, i))
    _put_pose(robots.odometry, i, new)
    moved = _between(old, new)
    _put_pose(robots.moved, i, moved)
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


@kernel
def map_all(
    robots: Robots, scans: Scans, maps: Maps, model: MapModel, ids: IntArray, times: FloatArray
) -> None:
    """Let the robots believe their poses and draw the scans that are due; see :class:`slamgym.slam.PoseTracker`.

    Args:
        robots: Where they stand, or believe to.
        scans: The newest scans.
        maps: Changed in place.
        model: How maps are drawn.
        ids: Environments.
        times: Robot time, shape (N,) [s].
    """
    robots = Robots(*robots)
    scans = Scans(*scans)
    maps = Maps(*maps)
    model = MapModel(*model)
    for i in ids:
        if model.believes_truth:
            true = robots.pose[i]
            start = robots.start[i]
            odometry = Pose2D(true[0] - start[0], true[1] - start[1], true[2])
        else:
            odometry = _pose(robots.odometry, i)
        maps.is_new[i] = _is_processed(maps, model, i, odometry, times[i])
        moved = _between(_pose(maps.processed, i), odometry)
        believed = _compose(_pose(maps.anchor, i), moved)
        if maps.is_new[i]:
            _put_pose(maps.anchor, i, believed)
            _put_pose(maps.processed, i, odometry)
            maps.since[i, 0] = times[i]
            maps.since[i, 1:] = 0.0
            _draw(maps, model, i, scans.ranges)
            believed = _compose(believed, _between(odometry, odometry))
        _put_pose(maps.believed, i, believed)


@kernel
def _is_processed(maps: Maps, model: MapModel, i: int, odometry: Pose2D, time: float) -> bool:
    """Take the odometry of a scan; returns True if the scan must be processed."""
    since = maps.since[i]
    if not maps.begun[i]:
        maps.begun[i] = True
        _put_pose(maps.last, i, odometry)
        _put_pose(maps.processed, i, odometry)
        return True
    increment = _between(_pose(maps.last, i), odometry)
    _put_pose(maps.last, i, odometry)
    since[1], since[2] = _add_way(since[1], since[2], increment)
    return _is_far_enough(since[1], since[2], time - since[0], model.updates)


@kernel
def _draw(maps: Maps, model: MapModel, i: int, ranges: Float32Array) -> None:
    """Draw a scan from the last processed pose."""
    rows, cols = maps.shape[i]
    counts = _counts(maps, i)
    corner = _corner(maps, i)
    resolution = model.resolution
    poses = maps.anchor[i : i + 1]
    bounds = draw_scans(counts, corner, resolution, poses, ranges[i : i + 1], model.beams[:], 1)  # type: ignore[arg-type]
    top, left, bottom, right = cells_of(bounds, corner, resolution)
    if top < 0 or left < 0 or bottom >= rows or right >= cols:
        return  # beliefs have drifted so far that the map doesn't cover the scan
    known = maps.known[i]
    known[0] = min(known[0], top)
    known[1] = min(known[1], left)
    known[2] = max(known[2], bottom + 1)
    known[3] = max(known[3], right + 1)
    if model.keeps_current:
        _classify(maps, model, i, (top, left, bottom + 1, right + 1))


@kernel
def _corner(maps: Maps, i: int) -> Place:
    """Row and column of the lattice at which a map begins."""
    row, col = maps.corner[i]
    return row, col


@kernel
def _counts(maps: Maps, i: int) -> Any:
    """Hits and visits of one map's cells, shape (H, W, 2)."""
    rows, cols = maps.shape[i]
    return maps.counts[i, : rows * cols].reshape(rows, cols, 2)


@kernel
def _cells(maps: Maps, i: int) -> Any:
    """One map as it is shown, shape (H, W)."""
    rows, cols = maps.shape[i]
    return maps.cells[i, : rows * cols].reshape(rows, cols)


@kernel
def _classify(maps: Maps, model: MapModel, i: int, box: CellBox) -> None:
    """Bring shown cells up to date."""
    counts = _counts(maps, i)
    cells = _cells(maps, i)
    classify_counts(counts, box, model.threshold, (0.0, 0.0), model.min_passes, cells)


@kernel
def _tiles(maps: Maps, i: int, resolution: float) -> Tiles:
    """One robot's map."""
    top, left, bottom, right = maps.known[i]
    return _cells(maps, i), _corner(maps, i), resolution, (top, left, bottom, right)


@kernel
def sense_all(
    robots: Robots,
    scenes: Scenes,
    scans: Scans,
    maps: Maps,
    scanner: ScanModel,
    model: MapModel,
    ids: IntArray,
    times: FloatArray,
    is_published: BoolArray,
    view: tuple[float, Any],
    out: Any,
) -> None:
    """Scan, map, publish and observe, one robot after the other, so that each map is in the cache.

    Args:
        robots: Where they stand, or believe to.
        scenes: What they see; the floor is changed in place.
        scans: Draws; receives the ranges.
        maps: Changed in place.
        scanner: The scanner.
        model: How maps are drawn.
        ids: Environments.
        times: Robot time, shape (N,) [s].
        is_published: Whose map is published now, shape (N,).
        view: Side of the crop and limits for :func:`slamgym.envs.compact.write_compact`, or what
            :func:`slamgym.envs.observations.crop_points` says.
        out: Receives observations of the preset ``compact``, shape (N, n), or crops, shape (N, 1, h, w).
    """
    all_maps = Maps(*maps)
    how = MapModel(*model)
    velocities = robots[_VELOCITY]
    all_ranges = scans[_RANGES]
    for k in range(len(ids)):
        i = ids[k]
        one = ids[k : k + 1]
        look_all(robots, scenes, scanner, scans, one)
        map_all(robots, scans, maps, model, one, times)
        tiles = _tiles(all_maps, i, how.resolution)
        pose = all_maps.believed[i]
        if is_published[i] and not how.keeps_current:
            _classify(all_maps, how, i, tiles[3])
        if out.ndim == 2:
            write_compact(tiles, pose, view[0], all_ranges[i], velocities[i], view[1], out[i])
        else:
            cut_crop(tiles, pose, view[0], view[1], out[i, 0])
