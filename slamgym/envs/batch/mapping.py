"""Maps of robots with known poses: kernels that loop over robots, as :mod:`slamgym.envs.batch.stepping` has them."""

import math
from typing import Any

import numpy as np

from slamgym.core import geometry
from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, Float32Array, FloatArray, IntArray, Pose2D
from slamgym.envs.batch.arrays import MapModel, Maps, Robots, ScanModel, Scans, Scenes
from slamgym.envs.batch.stepping import look_all, pose_at, put_pose
from slamgym.envs.compact import write_compact
from slamgym.envs.observations import cut_crop
from slamgym.envs.turned_reading import CellBox, Place, Tiles
from slamgym.sim.beams import BeamModel
from slamgym.slam.deskew import take_at_once
from slamgym.slam.hit_count_kernels import cells_of, classify_counts, draw_scans
from slamgym.slam.motion_model import add_way, is_far_enough

_compose: Any = kernel(geometry.compose)
_between = kernel(geometry.between)
_inverse = kernel(geometry.inverse)
_part_of = kernel(geometry.part_of)
_add_way = kernel(add_way)
_is_far_enough = kernel(is_far_enough)
_VELOCITY = Robots._fields.index("velocity")


@kernel
def map_all(
    robots: Robots,
    scans: Scans,
    maps: Maps,
    scanner: ScanModel,
    model: MapModel,
    ids: IntArray,
    stamps: FloatArray,
    seen: Float32Array,
) -> None:
    """Let the robots believe their poses and draw the scans that are due; see :class:`slamgym.slam.PoseTracker`.

    Args:
        robots: Where they stand, or believe to.
        scans: The newest scans.
        maps: Changed in place.
        scanner: The scanner.
        model: How maps are drawn.
        ids: Environments.
        stamps: Times of the scans' first beams, shape (N,) [s].
        seen: Receives the scans as seen from where the robots are now, shape (N, num_beams) [m]; the scans' own ranges
            of a laser that measures all at once.
    """
    robots = Robots(*robots)
    scans = Scans(*scans)
    maps = Maps(*maps)
    scanner = ScanModel(*scanner)
    model = MapModel(*model)
    for i in ids:
        motion = _in_scan(robots.moved, scanner, i)
        if scanner.sweep > 0.0:
            _see_from_end(scans.ranges[i], scanner, motion, seen[i])
        if model.believes_truth:
            true = robots.pose[i]
            start = robots.start[i]
            odometry = Pose2D(true[0] - start[0], true[1] - start[1], true[2])
            motion = _in_scan(robots.driven, scanner, i)
        else:
            odometry = pose_at(robots.odometry, i)
        if not _is_rest(motion):
            odometry = _compose(odometry, _inverse(motion))
        maps.is_new[i] = _is_processed(maps, model, i, odometry, stamps[i])
        moved = _between(pose_at(maps.processed, i), odometry)
        believed = _compose(pose_at(maps.anchor, i), moved)
        if maps.is_new[i]:
            put_pose(maps.anchor, i, believed)
            put_pose(maps.processed, i, odometry)
            maps.since[i, 0] = stamps[i]
            maps.since[i, 1:] = 0.0
            _draw(maps, model, i, _seen_from_begin(scans.ranges[i : i + 1], scanner, motion))
            believed = _compose(believed, _between(odometry, odometry))
        if not _is_rest(motion):
            believed = _compose(believed, motion)
        put_pose(maps.believed, i, believed)


@kernel
def _in_scan(motions: FloatArray, scanner: ScanModel, i: int) -> Pose2D:
    """The part of a step's motion that fell into the scan: its end, at the same speeds."""
    if scanner.sweep == 0.0:
        return Pose2D(0.0, 0.0, 0.0)
    return _part_of(pose_at(motions, i), scanner.sweep)


@kernel
def _is_rest(motion: Pose2D) -> bool:
    return motion[0] == 0.0 and motion[1] == 0.0 and motion[2] == 0.0


@kernel
def _of_sensor(motion: Pose2D, scanner: ScanModel) -> tuple[float, float, float]:
    """A motion of the base as one of the sensor, seen from where it was before."""
    x, y, theta = scanner.mount
    mount = Pose2D(x, y, theta)
    moved = _compose(_compose(_inverse(mount), motion), mount)
    return moved[0], moved[1], moved[2]


@kernel
def _take_at_once(
    ranges: Float32Array, scanner: ScanModel, motion: Pose2D, is_backwards: bool, out: Float32Array
) -> None:
    """As :func:`slamgym.slam.deskew.deskewed`, nan where no beam has met a direction."""
    law = BeamModel(*scanner.law)
    moved = _of_sensor(motion, scanner)
    begin = law.angle_min
    out[:] = np.nan
    take_at_once(ranges, begin, law.angle_increment, law.range_max, moved, is_backwards, out)


@kernel
def _seen_from_begin(ranges: Float32Array, scanner: ScanModel, motion: Pose2D) -> Float32Array:
    """A scan, shape (1, num_beams) [m], as it was seen from its first beam's pose."""
    if _is_rest(motion):
        return ranges
    seen = np.empty_like(ranges)
    _take_at_once(ranges[0], scanner, motion, False, seen[0])
    return seen


@kernel
def _see_from_end(
    ranges: Float32Array, scanner: ScanModel, motion: Pose2D, out: Float32Array
) -> None:
    """Write a scan as it is seen from its last beam's pose; infinite where it saw nothing."""
    if _is_rest(motion):
        out[:] = ranges
        return
    _take_at_once(ranges, scanner, _inverse(motion), True, out)
    for k in range(len(out)):
        if math.isnan(out[k]):
            out[k] = np.inf


@kernel
def _is_processed(maps: Maps, model: MapModel, i: int, odometry: Pose2D, time: float) -> bool:
    """Take the odometry of a scan; returns True if the scan must be processed."""
    since = maps.since[i]
    if not maps.begun[i]:
        maps.begun[i] = True
        put_pose(maps.last, i, odometry)
        put_pose(maps.processed, i, odometry)
        return True
    increment = _between(pose_at(maps.last, i), odometry)
    put_pose(maps.last, i, odometry)
    since[1], since[2] = _add_way(since[1], since[2], increment)
    return _is_far_enough(since[1], since[2], time - since[0], model.updates)


@kernel
def _draw(maps: Maps, model: MapModel, i: int, ranges: Float32Array) -> None:
    """Draw a scan, shape (1, num_beams) [m], from the last processed pose."""
    rows, cols = maps.shape[i]
    counts = _counts(maps, i)
    corner = _corner(maps, i)
    resolution = model.resolution
    poses = maps.anchor[i : i + 1]
    bounds = draw_scans(counts, corner, resolution, poses, ranges, model.beams[:], 1)  # type: ignore[arg-type]
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
    stamps: FloatArray,
    is_published: BoolArray,
    seen: Float32Array,
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
        stamps: As for :func:`map_all`.
        is_published: Whose map is published now, shape (N,).
        seen: As for :func:`map_all`.
        view: Side of the crop and limits for :func:`slamgym.envs.compact.write_compact`, or what
            :func:`slamgym.envs.observations.crop_points` says.
        out: Receives observations of the preset ``compact``, shape (N, n), or crops, shape (N, 1, h, w).
    """
    all_maps = Maps(*maps)
    how = MapModel(*model)
    velocities = robots[_VELOCITY]
    for k in range(len(ids)):
        i = ids[k]
        one = ids[k : k + 1]
        look_all(robots, scenes, scanner, scans, one)
        map_all(robots, scans, maps, scanner, model, one, stamps, seen)
        tiles = _tiles(all_maps, i, how.resolution)
        pose = all_maps.believed[i]
        if is_published[i] and not how.keeps_current:
            _classify(all_maps, how, i, tiles[3])
        if out.ndim == 2:
            write_compact(tiles, pose, view[0], seen[i], velocities[i], view[1], out[i])
        else:
            cut_crop(tiles, pose, view[0], view[1], out[i, 0])
