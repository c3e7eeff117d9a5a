"""A local map of surface cells, and the alignment of a scan with it: numba kernels.

A few scans round one pose are put into square cells. Each occupied cell holds the mean of its end points and
a 2 x 2 information matrix that says in which direction the mean binds: across a wall only, or both ways at a
corner (the normal-distributions transform of Biber and Strasser 2003, with the point-to-line metric of Censi
2008 on flat pieces). So the normal matrix of an alignment shows that in a corridor the scan is free
to slide, and what it gives is the information of a pose-graph edge.

Convention: all poses and points of a local map are in one frame, that of its reference node. Grids have row 0
at the bottom.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import FloatArray, IntArray

VACANT = -1
BEHIND = -0.3
"""Cosine of the angle between the views of a surface beyond which they are of its two sides."""
ENOUGH = 5.0
"""Points that a piece of surface needs to show its direction."""
STRAY = 0.01
"""Weight of a cell with fewer points, relative to one with a direction."""
FLATNESS = 0.15
"""Surface is flat if its narrow spread (standard deviation) is below this share of its wide one."""
ALIGN_STEPS = 12
"""Most steps of an alignment."""
ALIGN_WIDTH = 3.0
"""Residual at which a point's weight has fallen to a quarter [standard deviations]."""


MATCH_CELL = 0.1
"""Size of a cell [m]: of furniture's scale, and few of an indoor scanner's beams fall between."""
MARGIN_CELLS = 3
SURFACE_SIGMA = 0.02
"""Standard deviation of end points across a wall [m]; at corners and clutter twice that, both ways."""
POINT_SHARE = 0.05
"""Weight of a point in the information of a match: neighbouring points err together."""


class LocalMap(NamedTuple):
    """Surface cells round a pose."""

    numbers: np.ndarray  # (rows, cols) int32, number of the occupied cell or ``VACANT``
    origin_x: float  # lower left corner [m]
    origin_y: float  # [m]
    means: FloatArray
    """(cells, 4) the means, relative to the grid's corner [m], and the mean unit vectors towards the robot that saw the
    cell."""
    infos: FloatArray
    """(cells, 3) xx, xy and yy entries of the information matrices [1/m^2]."""


def make_local_map(
    points: FloatArray,
    counts: IntArray,
    members: IntArray,
    poses: FloatArray,
    centre: FloatArray,
    radius: float,
) -> LocalMap:
    """Make a local map.

    Args:
        points: (nodes, most points, 2) end points in each node's own frame [m].
        counts: (nodes,) how many of them are set.
        members: (members,) which nodes the map is made of.
        poses: (members, 3) their poses in the frame of the map.
        centre: (3,) what the map is centred on.
        radius: The map extends so far from there [m].
    """
    half = math.ceil(radius / MATCH_CELL) + MARGIN_CELLS
    origin_x, origin_y = (
        (math.floor(value / MATCH_CELL) - half) * MATCH_CELL for value in centre[:2].tolist()
    )
    numbers = np.full((2 * half, 2 * half), VACANT, dtype=np.int32)
    means, infos = _collect_cells(points, counts, members, poses, numbers, origin_x, origin_y)
    return LocalMap(numbers, origin_x, origin_y, means, infos)


@kernel
def _collect_cells(
    points: FloatArray,
    counts: IntArray,
    members: IntArray,
    poses: FloatArray,
    numbers: np.ndarray,
    origin_x: float,
    origin_y: float,
) -> tuple[FloatArray, FloatArray]:
    """Put the end points of some scans into cells; returns means and information, see :class:`LocalMap`.

    ``numbers`` receives the number of each occupied cell; all others as for :func:`make_local_map`.
    """
    rows, cols = numbers.shape
    most = 1
    for node in members:
        most += counts[node]
    most = min(most, numbers.size)
    places = np.empty((most, 2), dtype=np.int32)
    moments = np.empty((most, 8))  # n, sums of x, y, xx, xy, yy, and of the unit vectors towards the robot
    used = 0
    for k in range(len(members)):
        node = members[k]
        cos, sin = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for i in range(counts[node]):
            x = poses[k, 0] + cos * points[node, i, 0] - sin * points[node, i, 1] - origin_x
            y = poses[k, 1] + sin * points[node, i, 0] + cos * points[node, i, 1] - origin_y
            col, row = math.floor(x / MATCH_CELL), math.floor(y / MATCH_CELL)
            if row < 0 or col < 0 or row >= rows or col >= cols:
                continue
            number = numbers[row, col]
            if number == VACANT:
                number = used
                numbers[row, col] = number
                places[number, 0], places[number, 1] = row, col
                moments[number] = 0.0
                used += 1
            moments[number, 0] += 1.0
            moments[number, 1] += x
            moments[number, 2] += y
            moments[number, 3] += x * x
            moments[number, 4] += x * y
            moments[number, 5] += y * y
            view_x, view_y = poses[k, 0] - origin_x - x, poses[k, 1] - origin_y - y
            length = math.hypot(view_x, view_y) + 1e-9
            moments[number, 6] += view_x / length
            moments[number, 7] += view_y / length
    means, infos = np.empty((used, 4)), np.empty((used, 3))
    for number in range(used):
        own = moments[number, 0]
        means[number, 0], means[number, 1] = moments[number, 1] / own, moments[number, 2] / own
        means[number, 2], means[number, 3] = moments[number, 6] / own, moments[number, 7] / own
        _bind_cell(numbers, moments, places[number, 0], places[number, 1], infos[number])
    return means, infos


@kernel
def _bind_cell(numbers: np.ndarray, moments: FloatArray, row: int, col: int, info: FloatArray) -> None:
    """Compute what an occupied cell binds: the xx, xy and yy entries ``info`` (3,) [1/m^2]."""
    rows, cols = numbers.shape
    across = 1.0 / (SURFACE_SIGMA * SURFACE_SIGMA)
    n = sx = sy = sxx = sxy = syy = 0.0
    # Far away the beams are wider apart than the cells: then the second ring of neighbours joins in.
    for ring in range(1, 3):
        if n >= ENOUGH:
            break
        n = sx = sy = sxx = sxy = syy = 0.0
        for near_row in range(max(row - ring, 0), min(row + ring + 1, rows)):
            for near_col in range(max(col - ring, 0), min(col + ring + 1, cols)):
                near = numbers[near_row, near_col]
                if near != VACANT:
                    n += moments[near, 0]
                    sx += moments[near, 1]
                    sy += moments[near, 2]
                    sxx += moments[near, 3]
                    sxy += moments[near, 4]
                    syy += moments[near, 5]
    mean_x, mean_y = sx / n, sy / n
    var_x, var_y = sxx / n - mean_x * mean_x, syy / n - mean_y * mean_y
    cov = sxy / n - mean_x * mean_y
    middle, half = 0.5 * (var_x + var_y), 0.5 * (var_x - var_y)
    root = math.sqrt(half * half + cov * cov)
    wide, narrow = middle + root, max(middle - root, 0.0)
    if n >= ENOUGH and narrow < FLATNESS * FLATNESS * wide:
        along = 0.5 * math.atan2(2.0 * cov, var_x - var_y)
        normal_x, normal_y = -math.sin(along), math.cos(along)
        info[0] = across * normal_x * normal_x
        info[1] = across * normal_x * normal_y
        info[2] = across * normal_y * normal_y
    else:
        # A corner or clutter binds both ways; of a few stray points nothing is known.
        info[0] = info[2] = (0.25 if n >= ENOUGH else STRAY) * across
        info[1] = 0.0


@kernel
def nearest_turn(angle: float) -> float:
    """Wrap an angle to [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel
def align_scan(
    local: LocalMap,
    points: FloatArray,
    start: FloatArray,
    prior: FloatArray,
    prior_info: FloatArray,
    pose: FloatArray,
    information: FloatArray,
) -> float:
    """Align a scan with a local map by Gauss-Newton steps with Geman-McClure weights.

    Args:
        local: The local map.
        points: (n, 2) end points in the robot frame [m].
        start: (3,) pose to begin at.
        prior: (3,) expected pose, e.g. by odometry.
        prior_info: (3, 3) how much that is trusted, in the map's frame; zero for not at all.
        pose: (3,) receives the result.
        information: (3, 3) receives the normal matrix there, prior included.

    Returns:
        Share of the points that found a surface within about one cell, weighted by how well they fit.
    """
    numbers, origin_x, origin_y, means, infos = local
    rows, cols = numbers.shape
    assign(start, pose)
    scale2 = ALIGN_WIDTH * ALIGN_WIDTH
    fit = 0.0
    for _ in range(ALIGN_STEPS):
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        fit = 0.0
        assign(prior_info, information)
        away_x, away_y = pose[0] - prior[0], pose[1] - prior[1]
        away_t = nearest_turn(pose[2] - prior[2])
        gradient_x = prior_info[0, 0] * away_x + prior_info[0, 1] * away_y + prior_info[0, 2] * away_t
        gradient_y = prior_info[1, 0] * away_x + prior_info[1, 1] * away_y + prior_info[1, 2] * away_t
        gradient_t = prior_info[2, 0] * away_x + prior_info[2, 1] * away_y + prior_info[2, 2] * away_t
        for i in range(len(points)):
            turned_x = cos * points[i, 0] - sin * points[i, 1]
            turned_y = sin * points[i, 0] + cos * points[i, 1]
            x, y = pose[0] + turned_x - origin_x, pose[1] + turned_y - origin_y
            col, row = math.floor(x / MATCH_CELL), math.floor(y / MATCH_CELL)
            best, number = 1e18, VACANT
            for near_row in range(max(row - 1, 0), min(row + 2, rows)):
                for near_col in range(max(col - 1, 0), min(col + 2, cols)):
                    near = numbers[near_row, near_col]
                    if near != VACANT:
                        d2 = (x - means[near, 0]) ** 2 + (y - means[near, 1]) ** 2
                        if d2 < best:
                            best, number = d2, near
            if number == VACANT:
                continue
            # A wall seen from behind is another wall: its far side, or that of another room.
            view = -(turned_x * means[number, 2] + turned_y * means[number, 3])
            if view < BEHIND * math.hypot(turned_x, turned_y):
                continue
            error_x, error_y = x - means[number, 0], y - means[number, 1]
            a, b, c = infos[number, 0], infos[number, 1], infos[number, 2]
            chi2 = a * error_x * error_x + 2.0 * b * error_x * error_y + c * error_y * error_y
            root_weight = scale2 / (scale2 + chi2)
            weight = POINT_SHARE * root_weight * root_weight
            fit += root_weight
            # A point moves by (dx - turned_y dt, dy + turned_x dt).
            force_x, force_y = a * error_x + b * error_y, b * error_x + c * error_y
            gradient_x += weight * force_x
            gradient_y += weight * force_y
            gradient_t += weight * (-turned_y * force_x + turned_x * force_y)
            bend_x, bend_y = -a * turned_y + b * turned_x, -b * turned_y + c * turned_x
            information[0, 0] += weight * a
            information[0, 1] += weight * b
            information[1, 1] += weight * c
            information[0, 2] += weight * bend_x
            information[1, 2] += weight * bend_y
            information[2, 2] += weight * (-turned_y * bend_x + turned_x * bend_y)
        information[1, 0], information[2, 0] = information[0, 1], information[0, 2]
        information[2, 1] = information[1, 2]
        step_x, step_y, step_t = solve_symmetric(information, gradient_x, gradient_y, gradient_t)
        length = math.hypot(step_x, step_y)
        if length > MATCH_CELL:  # the surfaces were sought within a cell: further the step means nothing
            step_x, step_y = step_x * MATCH_CELL / length, step_y * MATCH_CELL / length
        step_t = min(max(step_t, -0.1), 0.1)
        pose[0] -= step_x
        pose[1] -= step_y
        pose[2] = nearest_turn(pose[2] - step_t)
        if length < 1e-4 and abs(step_t) < 1e-5:
            break
    return fit / max(len(points), 1)


@kernel
def solve_symmetric(h: FloatArray, x: float, y: float, t: float) -> tuple[float, float, float]:
    """Solve a symmetric positive 3 x 3 system by Cholesky, slightly damped where it is singular."""
    l00 = math.sqrt(h[0, 0] + 1e-3)
    l10, l20 = h[1, 0] / l00, h[2, 0] / l00
    l11 = math.sqrt(max(h[1, 1] + 1e-3 - l10 * l10, 1e-3))
    l21 = (h[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(max(h[2, 2] + 1e-3 - l20 * l20 - l21 * l21, 1e-3))
    u = x / l00
    v = (y - l10 * u) / l11
    w = (t - l20 * u - l21 * v) / l22
    w /= l22
    v = (v - l21 * w) / l11
    u = (u - l10 * v - l20 * w) / l00
    return u, v, w
