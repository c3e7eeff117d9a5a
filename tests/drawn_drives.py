"""Small drawn maps and drives through them, for the tests of the localisation."""

import itertools
import math

import cv2
import numpy as np

from slamgym.core.geometry import between, compose
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    GridFrame,
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
)
from slamgym.interop import Log, LogRecord
from slamgym.sim.raycast import cast_rays

GEOMETRY = LaserGeometry(180, -math.pi, math.pi / 90, 0.1, 4.0)

# Three rooms that differ: 8 x 5 m, doors in the inner walls, a niche and a pillar.
FLAT = np.array([
    (0, 0, 8, 0), (8, 0, 8, 5), (8, 5, 5.5, 5), (5.5, 5, 5.5, 4.4), (5.5, 4.4, 4.5, 4.4), (4.5, 4.4, 4.5, 5),
    (4.5, 5, 0, 5), (0, 5, 0, 0), (3, 0, 3, 1.8), (3, 2.8, 3, 5), (3, 2.8, 4.2, 2.8), (5.2, 2.8, 8, 2.8),
    (1.2, 3.4, 1.6, 3.4), (1.6, 3.4, 1.6, 3.8), (1.6, 3.8, 1.2, 3.8), (1.2, 3.8, 1.2, 3.4),
], dtype=np.float64)  # fmt: skip
# The same seen from both ends: a closed corridor.
CORRIDOR = np.array(
    [(0, 0, 7, 0), (7, 0, 7, 1.6), (7, 1.6, 0, 1.6), (0, 1.6, 0, 0)], dtype=np.float64
)
# Another building: round, with slanted walls.
OTHER = np.array([
    (0, 2, 2, 0), (2, 0, 6, 0.5), (6, 0.5, 7, 3), (7, 3, 5, 6), (5, 6, 1, 5.5), (1, 5.5, 0, 2),
    (2.5, 2.2, 3.6, 3.4), (3.6, 3.4, 2.9, 4.1),
], dtype=np.float64)  # fmt: skip
# Two ways through the flat from different rooms, and one round the other building.
HERE = [(1, 1), (2.2, 2.3), (3.8, 2.3), (4.7, 2.4), (4.7, 3.6), (7, 3.8), (4.7, 3.6), (6.5, 1.2)]
THERE = [
    (7.2, 0.8),
    (3.8, 0.8),
    (4.7, 2.4),
    (4.7, 3.8),
    (6.8, 3.6),
    (4.7, 3.6),
    (3.6, 2.3),
    (1, 4.3),
]
ROUND = [(1.5, 1.6), (5.5, 1.6), (5.6, 3), (4.5, 5), (1.8, 4.6), (1.5, 2)]


def draw(walls, inside, resolution=0.05, margin=0.5):
    """A finished map of walls (S, 4): what can be reached from ``inside`` is free."""
    low, high = walls.reshape(-1, 2).min(axis=0) - margin, walls.reshape(-1, 2).max(axis=0) + margin
    frame = GridFrame.covering((*low, *high), resolution)
    cells = np.full(frame.shape, UNKNOWN, dtype=np.uint8)
    for x0, y0, x1, y1 in walls:
        ends = [frame.to_cell(float(x), float(y))[::-1] for x, y in ((x0, y0), (x1, y1))]
        cv2.line(cells, ends[0], ends[1], OCCUPIED, 1)
    row, col = frame.to_cell(*map(float, inside))
    cv2.floodFill(cells, None, (col, row), FREE)
    return OccupancyGrid(cells, frame)


def drive(walls, way, seed=0, step=0.05, noise=0.01, carried=None):
    """A log of a drive along points (N, 2) with noisy wheels, and the true poses.

    ``carried`` is a scan's index and a way to go on with from there: the odometry notices nothing.
    """
    rng = np.random.default_rng(seed)
    ways = [way] if carried is None else [way, carried]
    records, truth = [], []
    odometry = Pose2D(0.0, 0.0, 0.3)
    for leg in ways:
        poses = _poses(np.asarray(leg, dtype=np.float64), step)
        for index, pose in enumerate(poses):
            if index > 0:
                moved = between(poses[index - 1], pose)
                slip = noise * rng.standard_normal(3) * (abs(moved.x) + 0.2 * abs(moved.theta))
                odometry = compose(
                    odometry, Pose2D(moved.x + slip[0], 0.0, moved.theta + 2.0 * slip[2])
                )
            records.append(
                LogRecord(0.2 * len(records), odometry, _scan(walls, pose, 0.2 * len(records), rng))
            )
            truth.append(pose)
    return Log("drive", records, GEOMETRY), np.array(truth)


def _poses(points, step):
    """Straight legs, and turns on the spot between them."""
    poses = []
    for start, end in itertools.pairwise(points):
        heading = math.atan2(*(end - start)[::-1])
        if poses:
            turn = math.remainder(heading - poses[-1].theta, 2.0 * math.pi)
            shares = np.linspace(0.0, 1.0, max(2, math.ceil(abs(turn) / 0.1)))[1:]
            poses += [
                Pose2D(*start, math.remainder(heading - turn * (1.0 - s), 2.0 * math.pi))
                for s in shares
            ]
        shares = np.arange(0.0, 1.0, step / np.hypot(*(end - start)))
        poses += [Pose2D(*(start + share * (end - start)), heading) for share in shares]
    return [Pose2D(*map(float, pose)) for pose in poses]


def _scan(walls, pose, stamp, rng):
    ranges = np.empty(GEOMETRY.num_beams)
    cast_rays(
        *pose, GEOMETRY.angle_min, GEOMETRY.angle_increment, walls, GEOMETRY.range_max, ranges
    )
    ranges += 0.01 * rng.standard_normal(len(ranges))
    ranges[ranges >= GEOMETRY.range_max - 0.03] = np.inf
    return LaserScan(stamp, ranges.astype(np.float32), GEOMETRY)
