"""Kernels of the path follower: scan points, progress along a path, and arcs that stay clear of them."""

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import ByteArray, Float32Array, FloatArray


@kernel
def scan_points(
    ranges: Float32Array,
    angle_min: float,
    angle_increment: float,
    range_min: float,
    range_max: float,
    mount_x: float,
    mount_y: float,
    mount_theta: float,
) -> FloatArray:
    """End points of the beams that hit something, in the robot's frame, shape (N, 2) [m].

    A hit counts only if a beam at most two places aside ends within 0.2 m of its range: single short or
    random readings (Thrun et al., Probabilistic Robotics, section 6.3) are no obstacles.
    """
    n = len(ranges)
    points = np.empty((n, 2))
    count = 0
    for i in range(n):
        r = ranges[i]
        if not (r > range_min and r < 0.999 * range_max):
            continue
        agrees = False
        for j in range(max(0, i - 2), min(n, i + 3)):
            if j != i and abs(ranges[j] - r) < 0.2:
                agrees = True
        if agrees:
            angle = mount_theta + angle_min + i * angle_increment
            points[count, 0] = mount_x + r * np.cos(angle)
            points[count, 1] = mount_y + r * np.sin(angle)
            count += 1
    return points[:count].copy()


@kernel
def points_within(points: FloatArray, distance: float) -> FloatArray:
    """Those points, shape (N, 2) [m], that are nearer to the origin than a distance [m]."""
    near = np.empty_like(points)
    count = 0
    for i in range(len(points)):
        if points[i, 0] ** 2 + points[i, 1] ** 2 < distance**2:
            near[count, 0], near[count, 1] = points[i, 0], points[i, 1]
            count += 1
    return near[:count]


@kernel
def nearest_on_path(path: FloatArray, x: float, y: float, begin: int, window: int) -> int:
    """Index of the path point nearest to (x, y) among ``window`` points from ``begin`` on."""
    best, index = np.inf, begin
    for i in range(begin, min(len(path), begin + window)):
        squared = (path[i, 0] - x) ** 2 + (path[i, 1] - y) ** 2
        if squared < best:
            best, index = squared, i
    return index


@kernel
def lookahead_on_path(
    path: FloatArray,
    begin: int,
    x: float,
    y: float,
    lookahead: float,
    costs: ByteArray,
    limit: int,
    origin_x: float,
    top_y: float,
    resolution: float,
) -> int:
    """Index of the farthest path point within the lookahead that a straight line reaches over free cells.

    Args:
        path: Points [m], shape (N, 2).
        begin: Index of the point where the robot is.
        x: The robot [m].
        y: The robot [m].
        lookahead: Largest distance from the robot [m].
        costs: Costmap, shape (H, W).
        limit: Cells at or above this cost must not be crossed.
        origin_x: Left border of the costmap [m].
        top_y: Upper border of the costmap [m].
        resolution: [m/cell].
    """
    height, width = costs.shape
    chosen = min(begin + 1, len(path) - 1)
    for i in range(chosen, len(path)):
        length = np.hypot(path[i, 0] - x, path[i, 1] - y)
        if length > lookahead and i > chosen:
            break
        steps = max(1, int(np.ceil(2.0 * length / resolution)))
        free, left_start = True, False
        for k in range(1, steps + 1):
            px = x + (path[i, 0] - x) * k / steps
            py = y + (path[i, 1] - y) * k / steps
            row, col = int(np.floor((top_y - py) / resolution)), int(np.floor((px - origin_x) / resolution))
            open_cell = 0 <= row < height and 0 <= col < width and costs[row, col] < limit
            # Where the robot already stands too near to an obstacle the line may lead out, but not in again.
            if not open_cell and (left_start or k == steps):
                free = False
                break
            left_start = left_start or open_cell
        if free:
            chosen = i
    return chosen


@kernel
def free_travel(
    points: FloatArray, linear: float, angular: float, radius: float, horizon: float, time_step: float
) -> float:
    """How long a round robot can hold a velocity before it comes too near to a point, up to the horizon [s].

    Args:
        points: Obstacles in the robot's frame, shape (N, 2) [m].
        linear: [m/s].
        angular: [rad/s].
        radius: Distance to keep [m]; if a point is nearer already, then no step may bring the robot nearer.
        horizon: [s].
        time_step: [s].
    """
    nearest = np.inf
    for i in range(len(points)):
        nearest = min(nearest, points[i, 0] ** 2 + points[i, 1] ** 2)
    keep = min(radius, np.sqrt(nearest) - 1e-3)
    keep_squared = keep * keep if keep > 0.0 else 0.0
    x, y, theta, time = 0.0, 0.0, 0.0, 0.0
    while time < horizon - 1e-9:
        x += linear * time_step * np.cos(theta + 0.5 * angular * time_step)
        y += linear * time_step * np.sin(theta + 0.5 * angular * time_step)
        theta += angular * time_step
        for i in range(len(points)):
            if (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 < keep_squared:
                return time
        time += time_step
    return horizon


@kernel
def best_arc(
    points: FloatArray,
    target_x: float,
    target_y: float,
    max_linear: float,
    max_angular: float,
    radius: float,
    horizon: float,
    time_step: float,
) -> tuple[float, float, float]:
    """The free arc that ends nearest to a target, as in the dynamic window approach (Fox et al. 1997).

    Returns:
        Forward speed [m/s], rate of turn [rad/s], and how much nearer to the target (in the robot's frame)
        the arc ends [m]; all 0 if every arc is blocked or leads away.
    """
    best_linear, best_angular, best_gain = 0.0, 0.0, 0.0
    start = np.hypot(target_x, target_y)
    for i in range(1, 4):
        linear = max_linear * i / 3.0
        for j in range(-6, 7):
            angular = max_angular * j / 6.0
            turned = 0.5 * angular * horizon
            chord = linear * horizon * (np.sin(turned) / turned if abs(turned) > 1e-9 else 1.0)
            gain = start - np.hypot(target_x - chord * np.cos(turned), target_y - chord * np.sin(turned))
            if (
                gain > best_gain
                and free_travel(points, linear, angular, radius, horizon, time_step) >= horizon
            ):
                best_linear, best_angular, best_gain = linear, angular, gain
    return best_linear, best_angular, best_gain
