"""A drive through a room of eight metres with obstacles, as a log: for checks of logs, whose faults tests put in."""

import dataclasses
import functools

import numpy as np

from slamgym.core.geometry import between, compose
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.interop import Log, LogRecord
from slamgym.metrics.trajectory import relative_poses
from slamgym.sim.raycast import cast_rays

WALLS = np.array([
    (0, 0, 8, 0), (8, 0, 8, 6), (8, 6, 3, 6), (3, 6, 3, 5), (3, 5, 0, 5), (0, 5, 0, 0), (2, 1.6, 2.6, 2.2),
    (2.6, 2.2, 2, 2.8), (2, 2.8, 2, 1.6), (5.5, 3.2, 6.5, 3.2), (6.5, 3.2, 6, 4), (6, 4, 5.5, 3.2),
], dtype=np.float64)  # fmt: skip
GEOMETRY = LaserGeometry(180, -np.pi, np.pi / 90, 0.1, 8.0, Pose2D(-0.06, 0.0, 0.0))
PERIOD = 0.2
TIMES = PERIOD * np.arange(500)


def true_poses(stamps):
    """A way through the room that speeds up, slows down, and turns both ways."""
    t = 0.13 * stamps + 0.2 * np.sin(0.5 * stamps)
    x, y = 4.0 + 2.9 * np.cos(t), 2.6 + 1.7 * np.sin(2 * t)
    dx, dy = -2.9 * np.sin(t), 3.4 * np.cos(2 * t)
    return np.column_stack([x, y, np.arctan2(dy, dx)])


def scan_at(pose, stamp, rng):
    sensor = compose(Pose2D(*pose), GEOMETRY.mount)
    ranges = np.empty(GEOMETRY.num_beams)
    cast_rays(
        *sensor, GEOMETRY.angle_min, GEOMETRY.angle_increment, WALLS, GEOMETRY.range_max, ranges
    )
    noisy = (ranges + 0.01 * rng.standard_normal(len(ranges))).astype(np.float32)
    return LaserScan(stamp, noisy, GEOMETRY)


@functools.cache
def good_drive():
    """A good log of 100 s; its odometry drifts by a few per cent."""
    rng = np.random.default_rng(0)
    truth = true_poses(TIMES)
    odometry, records = Pose2D(0.0, 0.0, 0.0), []
    for k, (stamp, pose) in enumerate(zip(TIMES.tolist(), truth.tolist(), strict=True)):
        if k:
            d = between(Pose2D(*truth[k - 1]), Pose2D(*pose))
            odometry = compose(
                odometry, Pose2D(1.02 * d.x, d.y, 0.98 * d.theta + 0.002 * rng.standard_normal())
            )
        records.append(LogRecord(stamp, odometry, scan_at(pose, stamp, rng)))
    return Log("drive", records, GEOMETRY)


def with_steps(log, change):
    """The log with other motions between its scans: ``change(stamps, steps)`` returns them."""
    poses = np.array([record.odometry for record in log])
    path = [log.records[0].odometry]
    for step in change(TIMES[1:], relative_poses(poses[:-1], poses[1:])).tolist():
        path.append(compose(path[-1], Pose2D(*step)))
    records = [record._replace(odometry=pose) for record, pose in zip(log, path, strict=True)]
    return dataclasses.replace(log, records=records)


def times(x, y, theta, begin=0.0, end=np.inf):
    """Multiplies the motions of a while."""
    return lambda stamps, steps: np.where(
        ((stamps > begin) & (stamps <= end))[:, None], steps * np.array([x, y, theta]), steps
    )
