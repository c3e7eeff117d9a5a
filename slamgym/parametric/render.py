"""The displaced map as a picture: warped as a whole, or drawn scan by scan."""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    ByteArray,
    FloatArray,
    GridFrame,
    Int32Array,
)
from slamgym.parametric.config import LidarErrorConfig, RenderConfig, ScannerConfig
from slamgym.parametric.lidar_error import (
    HIT,
    MAX,
    NO_BEAM,
    RAND,
    SHORT,
    LidarErrors,
    WallBeams,
    draw_components,
    measure,
    short_ranges,
)
from slamgym.parametric.visibility import Visibility, poses_in_cells, sensor_poses
from slamgym.sim.raycast import cast_rays


@kernel
def count_hits(
    sensors: FloatArray,
    ranges: FloatArray,
    bearings: FloatArray,
    range_min: float,
    range_max: float,
    usable: float,
    hits: Int32Array,
    visits: Int32Array,
) -> None:
    """Visit the cells along each beam (Bresenham's line) and hit the last one.

    A range within ``usable`` is a hit. A longer one, or none, is cut there and only clears; a beam without
    return beside one that hit is left out as a failed measurement.

    Convention: everything is in cells: sensors are (col, row, heading) with continuous coordinates, rows
    growing downwards, heading and bearings counter-clockwise. Beams that leave the grid are drawn as far as
    it goes.

    Args:
        sensors: (T, 3).
        ranges: (T, B) [cells], ``inf`` for no return.
        bearings: (T, B) in the sensor frame [rad].
        range_min: Shorter ranges are left out [cells].
        range_max: A range of this or more is no return [cells].
        usable: Longest ray drawn [cells].
        hits: (H, W) out, added to.
        visits: (H, W) out, added to.
    """
    height, width = hits.shape
    for k in range(ranges.shape[0]):
        col0, row0 = math.floor(sensors[k, 0]), math.floor(sensors[k, 1])
        for b in range(ranges.shape[1]):
            r = ranges[k, b]
            if not r >= range_min:
                continue
            if r >= range_max and (
                (b > 0 and ranges[k, b - 1] <= usable)
                or (b + 1 < ranges.shape[1] and ranges[k, b + 1] <= usable)
            ):
                continue
            is_hit = r <= usable and r < range_max
            length = min(r, usable)
            direction = sensors[k, 2] + bearings[k, b]
            d_col = math.floor(sensors[k, 0] + length * math.cos(direction)) - col0
            d_row = math.floor(sensors[k, 1] - length * math.sin(direction)) - row0
            steps = max(abs(d_col), abs(d_row))
            for i in range(steps + (1 if is_hit else 0)):
                share = i / steps if steps > 0 else 0.0
                col = col0 + math.floor(d_col * share + 0.5)
                row = row0 + math.floor(d_row * share + 0.5)
                if not (0 <= row < height and 0 <= col < width):
                    continue
                visits[row, col] += 1
                if i == steps:
                    hits[row, col] += 1


def observed_cad(
    occupied: BoolArray, visibility: Visibility, beams: WallBeams, config: RenderConfig
) -> ByteArray:
    """What the scans show of the CAD map, still in its true place: the picture that is then warped.

    Walls whose beam was short, max or rand are lost; a rand beam may set a cell elsewhere.

    Returns:
        (H, W) on true cells: 0 occupied, 205 unknown, 254 free.
    """
    seen = visibility.seen
    true = np.full(occupied.shape, UNKNOWN, dtype=np.uint8)
    true[seen & ~occupied] = FREE
    true[seen & occupied] = OCCUPIED
    lost = (beams.component != NO_BEAM) & (beams.component != HIT)
    true[lost] = UNKNOWN if config.lost_walls == "unknown" else FREE
    rows, cols = visibility.frame.to_cell(beams.stray_points[:, 0], beams.stray_points[:, 1])
    true[rows, cols] = OCCUPIED
    return true


def true_ranges(
    poses: FloatArray, segments: FloatArray, angles: FloatArray, scanner: ScannerConfig
) -> FloatArray:
    """Exact ranges (T, B) [m] from the poses of the base; ``inf`` where nothing is in range."""
    sensors = sensor_poses(poses, scanner.mount_x)
    walls = segments.view()
    walls.flags.writeable = False  # always the read-only type, so that the kernel is compiled once
    ranges = np.empty((len(poses), len(angles)))
    for k, (x, y, theta) in enumerate(sensors.tolist()):
        cast_rays(x, y, theta, angles[0], angles[1] - angles[0], walls, scanner.range_max, ranges[k])
    return ranges


def measured_scans(
    ranges: FloatArray,
    angles: FloatArray,
    errors: LidarErrors,
    config: LidarErrorConfig,
    scanner: ScannerConfig,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Every beam of every scan with its component of the mixture.

    Args:
        ranges: (T, B) true ranges [m], ``inf`` for none.
        angles: (B,) true bearings [rad].
        errors: Systematic errors.
        config: Noise and mixture.
        scanner: Limits of the range.
        rng: Source of randomness.

    Returns:
        Measured ranges (T, B) [m], ``inf`` for none, and measured bearings (T, B) [rad].
    """
    seen = np.minimum(ranges, scanner.range_max)
    measured, bearings = measure(seen, np.broadcast_to(angles, ranges.shape), errors, config, rng)
    measured[np.isinf(ranges)] = np.inf
    component = draw_components(ranges.shape, config, rng)
    short = component == SHORT
    measured[short] = short_ranges(seen[short], config.lambda_short, rng)
    measured[component == MAX] = np.inf
    stray = component == RAND
    measured[stray] = rng.uniform(0.0, scanner.range_max, int(stray.sum()))
    measured[measured > scanner.range_max] = np.inf
    return measured, bearings


def hit_count_map(
    believed_poses: FloatArray,
    ranges: FloatArray,
    bearings: FloatArray,
    frame: GridFrame,
    scanner: ScannerConfig,
    config: RenderConfig,
) -> ByteArray:
    """Draw each scan at its believed pose and read the map from the counts of hits and visits.

    Args:
        believed_poses: (T, 3) of the base, in the frame that ``frame`` places.
        ranges: (T, B) measured [m].
        bearings: (T, B) measured [rad].
        frame: The grid.
        scanner: Limits of the range.
        config: Usable range and threshold.

    Returns:
        (H, W) 0 occupied, 205 unknown, 254 free.
    """
    hits, visits = np.zeros(frame.shape, dtype=np.int32), np.zeros(frame.shape, dtype=np.int32)
    r = frame.resolution
    count_hits(
        poses_in_cells(sensor_poses(believed_poses, scanner.mount_x), frame),
        ranges / r,
        bearings,
        scanner.range_min / r,
        scanner.range_max / r,
        config.usable_range / r,
        hits,
        visits,
    )
    cells = np.where(hits > config.occupied_threshold * visits, OCCUPIED, FREE)
    return np.where(visits > 0, cells, UNKNOWN).astype(np.uint8)
