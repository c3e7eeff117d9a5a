"""Alignment of a scan with several submaps at once.

A point is bound across the line of a submap's nearest piece only (Censi, ICRA 2008): the pose is found to a fraction of
a cell, in a corridor nothing binds along it, and the normal matrix says so.
"""

import math
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import transform_points
from slamgym.core.jit import kernel
from slamgym.core.portable import lower_factor, solve_factored
from slamgym.core.types import FloatArray, IntArray, Pose2D
from slamgym.slam.graph.relative import nearest_turn
from slamgym.slam.graph.submaps import LINE, PIECE, SUBMAP_CELL, VACANT, Submap

ALIGNED_COSINE = 0.7
"""Least cosine between a point's surface and the line that it is matched with."""
SURFACE_SIGMA = 0.0105
"""Standard deviation of a point across a line [m]. Wider ones, or such as grow with the range as the data sheet of a
cheap laser says, are worse by a third on simulated homes: what errs more is left to the weights."""
ALIGN_WIDTH, FIRST_WIDTH = 3.0, 10.0
"""Residual at which a point's weight has fallen to a quarter, at the last steps and at the first one [deviations]."""
POINT_SHARE = 0.2
"""Weight of a point: neighbours err together."""
ALIGN_STEPS = 12
MOST_STEP, MOST_TURN = SUBMAP_CELL, 0.1
"""Most that one step moves [m] and turns [rad]: surfaces are sought within a cell."""
CONVERGED = 2e-4, 2e-5
FACES = 4
"""Directions of the map's axes that surfaces face."""
MOST_SUBMAPS = 4
"""Submaps that a scan is aligned with at once."""


class Binding(NamedTuple):
    """What each of some submaps binds of a scan's pose (x, y, theta) in the map frame, about the robot."""

    sums: FloatArray  # (S, 4, 4) normal matrix, in the last column the gradient and the weighted squared error
    hits: IntArray  # (S,) number of points near a surface


class Placed(NamedTuple):
    """A scan's place by an alignment."""

    pose: FloatArray  # (3,) in the map frame
    bound: Binding  # there
    fit: float  # share of the points that fit, 0 to 1


@kernel
def _nearest_line(
    grid: np.ndarray,
    pieces: np.ndarray,
    corner: FloatArray,
    x: float,
    y: float,
    side_x: float,
    side_y: float,
    is_normal: bool,
) -> int:
    """Number of the nearest piece with a line that a point seen from a side may lie on, in the submap's frame."""
    col, row = math.floor((x - corner[0]) / SUBMAP_CELL), math.floor((y - corner[1]) / SUBMAP_CELL)
    best, number = 1e18, VACANT
    for near_row in range(max(row - 1, 0), min(row + 2, grid.shape[0])):
        for near_col in range(max(col - 1, 0), min(col + 2, grid.shape[1])):
            for face in range(2):
                near = grid[near_row, near_col, face]
                if near == VACANT or pieces[near].state != LINE:
                    continue
                p = pieces[near]
                # A wall seen from behind is another wall: its far side, or that of another room.
                if p.side_x * side_x + p.side_y * side_y < 0.0:
                    continue
                if is_normal and abs(p.normal_x * side_x + p.normal_y * side_y) < ALIGNED_COSINE:
                    continue
                d2 = (x - p.own_x) ** 2 + (y - p.own_y) ** 2
                if d2 < best:
                    best, number = d2, near
    return number


@kernel
def bind_scan(
    submaps: tuple[tuple[np.ndarray, ...], ...],
    corners: FloatArray,
    frames: FloatArray,
    points: FloatArray,
    sides: FloatArray,
    stride: int,
    pose: FloatArray,
    width: float,
    bound: FloatArray,
    hits: IntArray,
) -> float:
    """Compute what each submap binds at a pose.

    Args:
        submaps: Grids and pieces of the submaps, each a tuple of ``MOST_SUBMAPS`` arrays.
        corners: (S, 2) of the submaps that count, the first of them.
        frames: (S, 3) their nodes' poses in the map frame.
        points: (n, 2) end points in the robot frame [m].
        sides: (n, 3) their sides in the robot frame.
        stride: Take every so many points.
        pose: (3,) of the robot in the map frame.
        width: Residual that counts a quarter [standard deviations].
        bound: (S, 4, 4) receives the sums of :class:`Binding`.
        hits: (S,) receives the number of points near a surface.

    Returns:
        Share of the points that fit a surface of any submap, 0 to 1.
    """
    bound[:], hits[:] = 0.0, 0
    taken = (len(points) + stride - 1) // stride
    best, row = np.zeros(taken), np.empty(4)
    for k in range(len(frames)):
        grid, pieces = submaps[0][k], submaps[1][k]
        cos, sin = math.cos(frames[k, 2]), math.sin(frames[k, 2])
        # The scan in the submap's frame.
        cos_own, sin_own = math.cos(pose[2] - frames[k, 2]), math.sin(pose[2] - frames[k, 2])
        dx, dy = pose[0] - frames[k, 0], pose[1] - frames[k, 1]
        own_x, own_y = cos * dx + sin * dy, cos * dy - sin * dx
        for i in range(taken):
            px, py = points[i * stride, 0], points[i * stride, 1]
            qx, qy = sides[i * stride, 0], sides[i * stride, 1]
            arm_x, arm_y = cos_own * px - sin_own * py, sin_own * px + cos_own * py
            side_x, side_y = cos_own * qx - sin_own * qy, sin_own * qx + cos_own * qy
            x, y = own_x + arm_x, own_y + arm_y
            number = _nearest_line(
                grid, pieces, corners[k], x, y, side_x, side_y, sides[i * stride, 2] > 0.0
            )
            if number == VACANT:
                continue
            p = pieces[number]
            error = p.normal_x * (x - p.mean_x) + p.normal_y * (y - p.mean_y)
            variance = SURFACE_SIGMA * SURFACE_SIGMA + p.variance
            weight = width * width / (width * width + error * error / variance)
            row[0], row[1] = (
                cos * p.normal_x - sin * p.normal_y,
                sin * p.normal_x + cos * p.normal_y,
            )
            row[2], row[3] = p.normal_y * arm_x - p.normal_x * arm_y, error
            known = POINT_SHARE * weight * weight / variance
            for a in range(4):
                for b in range(4):
                    bound[k, a, b] += known * row[a] * row[b]
            hits[k] += 1
            best[i] = max(best[i], weight)
    fit = 0.0
    for i in range(taken):
        fit += best[i]
    return fit / max(taken, 1)


@kernel
def align_scan(
    submaps: tuple[tuple[np.ndarray, ...], ...],
    corners: FloatArray,
    frames: FloatArray,
    points: FloatArray,
    sides: FloatArray,
    prior: FloatArray,
    known: FloatArray,
    pose: FloatArray,
    bound: FloatArray,
    hits: IntArray,
) -> float:
    """Align a scan with submaps by Gauss-Newton steps with Geman-McClure weights that narrow from step to step.

    Args:
        submaps: As for :func:`bind_scan`.
        corners: As for :func:`bind_scan`.
        frames: As for :func:`bind_scan`.
        points: As for :func:`bind_scan`.
        sides: As for :func:`bind_scan`.
        prior: (3,) expected pose.
        known: (3, 3) information of that; zero for none.
        pose: (3,) to begin at; receives the result.
        bound: (S, 4, 4) receives what each submap binds there.
        hits: (S,) receives the number of points near a surface.

    Returns:
        Share of the points that fit, 0 to 1.
    """
    fit, away, gradient = 0.0, np.empty(3), np.empty(3)
    for step in range(ALIGN_STEPS):
        width = max(ALIGN_WIDTH, FIRST_WIDTH / (1.0 + step))
        fit = bind_scan(submaps, corners, frames, points, sides, 1, pose, width, bound, hits)
        away[:] = pose - prior
        away[2] = nearest_turn(away[2])
        h = known + 1e-3 * np.eye(3)  # damped, where a direction is bound by nothing
        for a in range(3):
            gradient[a] = known[a, 0] * away[0] + known[a, 1] * away[1] + known[a, 2] * away[2]
            for k in range(len(bound)):
                gradient[a] += bound[k, a, 3]
                for b in range(3):
                    h[a, b] += bound[k, a, b]
        step_x, step_y, step_t = solve_factored(lower_factor(h), gradient)
        length = math.hypot(step_x, step_y)
        shorter = min(1.0, MOST_STEP / max(length, MOST_STEP))
        step_t = min(max(step_t, -MOST_TURN), MOST_TURN)
        pose[0] -= step_x * shorter
        pose[1] -= step_y * shorter
        pose[2] = nearest_turn(pose[2] - step_t)
        if width == ALIGN_WIDTH and length < CONVERGED[0] and abs(step_t) < CONVERGED[1]:
            break
    return fit


class Chosen:
    """Submaps as they lie now; a scan is aligned with at most ``MOST_SUBMAPS``.

    Args:
        submaps: The submaps.
        frames: (S, 3) poses of their nodes in the map frame.
    """

    def __init__(self, submaps: list[Submap], frames: FloatArray) -> None:
        self.submaps, self.frames = submaps, np.ascontiguousarray(frames)
        self._corners = np.array([submap.corner for submap in submaps])
        blank = MOST_SUBMAPS - len(submaps)
        no_grid, no_pieces = np.full((1, 1, 2), VACANT, dtype=np.int32), np.zeros(1, dtype=PIECE)
        self._arrays = (
            (*(submap.grid for submap in submaps), *[no_grid] * blank),
            (*(submap.pieces for submap in submaps), *[no_pieces] * blank),
        )

    def align(
        self,
        points: FloatArray,
        sides: FloatArray,
        start: FloatArray,
        prior: FloatArray,
        known: FloatArray,
    ) -> Placed:
        """Align a scan; see :func:`align_scan`."""
        pose, bound = start.copy(), self._nothing()
        fit = align_scan(
            self._arrays, self._corners, self.frames, points, sides, prior, known, pose, *bound
        )
        return Placed(pose, bound, float(fit))

    def hits(
        self, points: FloatArray, sides: FloatArray, pose: FloatArray, stride: int
    ) -> FloatArray:
        """Share of every ``stride``-th point that lies near a surface of each submap, (S,)."""
        bound = self._nothing()
        bind_scan(
            self._arrays,
            self._corners,
            self.frames,
            points,
            sides,
            stride,
            pose,
            FIRST_WIDTH,
            *bound,
        )
        return np.asarray(bound.hits / max(1, -(-len(points) // stride)), dtype=np.float64)

    def _nothing(self) -> Binding:
        return Binding(
            np.empty((len(self.submaps), 4, 4)), np.empty(len(self.submaps), dtype=np.int64)
        )

    def occupied(self, centre: FloatArray, radius: float) -> tuple[np.ndarray, FloatArray]:
        """Find cells with a surface within a radius of a place.

        Returns:
            (FACES, rows, cols) uint8, 1 where there is a surface less than 90 degrees away from the direction of the
            x axis, the y axis, -x, and -y; and the lower left corner (2,) of the cells [m].
        """
        half = math.ceil(radius / SUBMAP_CELL) + 2
        origin = (np.floor(centre[:2] / SUBMAP_CELL) - half) * SUBMAP_CELL
        cells = np.zeros((FACES, 2 * half, 2 * half), dtype=np.uint8)
        for submap, frame in zip(self.submaps, self.frames, strict=True):
            means, sides = submap.means
            cols, rows = (
                np.floor((transform_points(Pose2D(*frame), means) - origin) / SUBMAP_CELL)
                .astype(np.int64)
                .T
            )
            to_x, to_y = transform_points(Pose2D(0.0, 0.0, frame[2]), sides).T
            inside = (rows >= 0) & (cols >= 0) & (rows < 2 * half) & (cols < 2 * half)
            for face, towards in enumerate((to_x, to_y, -to_x, -to_y)):
                kept = inside & (towards > 0.0)
                cells[face, rows[kept], cols[kept]] = 1
        return cells, origin
