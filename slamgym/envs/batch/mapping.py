"""Maps of robots with known poses: kernels that loop over robots, as :mod:`slamgym.envs.batch.stepping` has them."""

from typing import Any

from slamgym.core import geometry
from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, Float32Array, FloatArray, IntArray, Pose2D
from slamgym.envs.batch.arrays import MapModel, Maps, Robots, ScanModel, Scans, Scenes
from slamgym.envs.batch.stepping import look_all, pose_at, put_pose
from slamgym.envs.compact import write_compact
from slamgym.envs.observations import cut_crop
from slamgym.envs.turned_reading import CellBox, Place, Tiles
from slamgym.slam.hit_count_kernels import cells_of, classify_counts, draw_scans
from slamgym.slam.motion_model import add_way, is_far_enough

_compose: Any = kernel(geometry.compose)
_between = kernel(geometry.between)
_add_way = kernel(add_way)
_is_far_enough = kernel(is_far_enough)
_VELOCITY = Robots._fields.index("velocity")
_RANGES = Scans._fields.index("ranges")


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
            odometry = pose_at(robots.odometry, i)
        maps.is_new[i] = _is_processed(maps, model, i, odometry, times[i])
        moved = _between(pose_at(maps.processed, i), odometry)
        believed = _compose(pose_at(maps.anchor, i), moved)
        if maps.is_new[i]:
            put_pose(maps.anchor, i, believed)
            put_pose(maps.processed, i, odometry)
            maps.since[i, 0] = times[i]
            maps.since[i, 1:] = 0.0
            _draw(maps, model, i, scans.ranges)
            believed = _compose(believed, _between(odometry, odometry))
        put_pose(maps.believed, i, believed)


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
