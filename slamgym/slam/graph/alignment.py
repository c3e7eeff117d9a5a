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
cheap laser says, are worse by a third on simulated homes: what errs more is left to the weights, and to the variance of
the line's own points, which is added. Without that the walls of a cluttered lab turn by 14 degrees, with it by 9, and
twenty homes with a sweep have 0.049 and 0.042 m, FHW 0.160 and 0.150, Freiburg 079 0.0499 and 0.0472. Chosen on that
lab alone."""
ALIGN_WIDTH = 3.0
"""Residual at which a point's weight has fallen to a quarter, at the last steps [standard deviations]."""
FIRST_WIDTH = 10.0
"""Residual at which a point's weight has fallen to a quarter, at the first step [standard deviations]."""
POINT_SHARE = 0.2
"""Weight of a point: neighbours err together."""
ALIGN_STEPS = 12
"""Most steps of an alignment."""
MOST_STEP = SUBMAP_CELL
"""Most that one step moves [m]: surfaces are sought within a cell."""
MOST_TURN = 0.1
"""Most that one step turns [rad]."""
CONVERGED_STEP = 2e-4
"""An alignment ends with a step that moves less than this [m], if it turns little, too."""
CONVERGED_TURN = 2e-5
"""An alignment ends with a step that turns less than this [rad], if it moves little, too."""
FACES = 4
"""Directions of the map's axes that surfaces face."""
MOST_SUBMAPS = 4
"""Submaps that a scan is aligned with at once."""


class NormalEquations(NamedTuple):
    """What each of some submaps says of a scan's pose (x, y, theta) in the map frame, about the robot."""

    sums: FloatArray  # (S, 4, 4) normal matrix, in the last column the gradient and the weighted squared error
    hits: IntArray  # (S,) number of points near a surface


class Alignment(NamedTuple):
    """A scan's place among submaps."""

    pose: FloatArray  # (3,) in the map frame
    equations: NormalEquations  # there
    fits: FloatArray  # (n,) how well each point fits, 0 to 1

    @property
    def fit(self) -> float:
        """Share of the points that fit, 0 to 1."""
        return float(self.fits.sum()) / max(len(self.fits), 1)


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
    col = math.floor((x - corner[0]) / SUBMAP_CELL)
    row = math.floor((y - corner[1]) / SUBMAP_CELL)
    best = 1e18
    number = VACANT
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
                    best = d2
                    number = near
    return number


@kernel
def _weight(squared: float, width: float) -> float:
    """Weight of a squared residual (Geman-McClure), both it and the width in standard deviations."""
    return width * width / (width * width + squared)


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
    sums: FloatArray,
    hits: IntArray,
    fits: FloatArray,
) -> None:
    """Compute what each submap says of a scan at a pose.

    Args:
        submaps: Grids and pieces of the submaps, each a tuple of ``MOST_SUBMAPS`` arrays.
        corners: (S, 2) of the submaps that count, the first of them.
        frames: (S, 3) their nodes' poses in the map frame.
        points: (n, 2) end points in the robot frame [m].
        sides: (n, 3) their sides in the robot frame.
        stride: Take every so many points.
        pose: (3,) of the robot in the map frame.
        width: Residual that counts a quarter [standard deviations].
        sums: (S, 4, 4) receives the sums of :class:`NormalEquations`.
        hits: (S,) receives the number of points near a surface.
        fits: (n,) receives how well each point that is taken fits a surface of any submap, 0 to 1.
    """
    sums[:] = 0.0
    hits[:] = 0
    fits[:] = 0.0
    taken = (len(points) + stride - 1) // stride
    row = np.empty(4)
    grids, all_pieces = submaps
    for k in range(len(frames)):
        grid = grids[k]
        pieces = all_pieces[k]
        cos = math.cos(frames[k, 2])
        sin = math.sin(frames[k, 2])
        # The scan in the submap's frame.
        cos_own = math.cos(pose[2] - frames[k, 2])
        sin_own = math.sin(pose[2] - frames[k, 2])
        dx = pose[0] - frames[k, 0]
        dy = pose[1] - frames[k, 1]
        own_x = cos * dx + sin * dy
        own_y = cos * dy - sin * dx
        for i in range(taken):
            px = points[i * stride, 0]
            py = points[i * stride, 1]
            qx = sides[i * stride, 0]
            qy = sides[i * stride, 1]
            arm_x = cos_own * px - sin_own * py
            arm_y = sin_own * px + cos_own * py
            side_x = cos_own * qx - sin_own * qy
            side_y = sin_own * qx + cos_own * qy
            x = own_x + arm_x
            y = own_y + arm_y
            number = _nearest_line(
                grid, pieces, corners[k], x, y, side_x, side_y, sides[i * stride, 2] > 0.0
            )
            if number == VACANT:
                continue
            p = pieces[number]
            error = p.normal_x * (x - p.mean_x) + p.normal_y * (y - p.mean_y)
            variance = SURFACE_SIGMA * SURFACE_SIGMA + p.variance
            weight = _weight(error * error / variance, width)
            row[0] = cos * p.normal_x - sin * p.normal_y
            row[1] = sin * p.normal_x + cos * p.normal_y
            row[2] = p.normal_y * arm_x - p.normal_x * arm_y
            row[3] = error
            known = POINT_SHARE * weight * weight / variance
            for a in range(4):
                for b in range(4):
                    sums[k, a, b] += known * row[a] * row[b]
            hits[k] += 1
            # Whether a point fits is told by the laser's error alone: a heap of clutter would fit anything.
            fit = _weight(error * error / (SURFACE_SIGMA * SURFACE_SIGMA), width)
            fits[i] = max(fits[i], fit)


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
    sums: FloatArray,
    hits: IntArray,
    fits: FloatArray,
) -> None:
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
        sums: (S, 4, 4) receives what each submap says there.
        hits: (S,) receives the number of points near a surface.
        fits: (n,) receives how well each point fits, 0 to 1.
    """
    away = np.empty(3)
    gradient = np.empty(3)
    for step in range(ALIGN_STEPS):
        width = max(ALIGN_WIDTH, FIRST_WIDTH / (1.0 + step))
        bind_scan(submaps, corners, frames, points, sides, 1, pose, width, sums, hits, fits)
        away[:] = pose - prior
        away[2] = nearest_turn(away[2])
        h = known + 1e-3 * np.eye(3)  # damped, where a direction is bound by nothing
        for a in range(3):
            gradient[a] = known[a, 0] * away[0] + known[a, 1] * away[1] + known[a, 2] * away[2]
            for k in range(len(sums)):
                gradient[a] += sums[k, a, 3]
                for b in range(3):
                    h[a, b] += sums[k, a, b]
        step_x, step_y, step_t = solve_factored(lower_factor(h), gradient)
        length = math.hypot(step_x, step_y)
        shorter = min(1.0, MOST_STEP / max(length, MOST_STEP))
        step_t = min(max(step_t, -MOST_TURN), MOST_TURN)
        pose[0] -= step_x * shorter
        pose[1] -= step_y * shorter
        pose[2] = nearest_turn(pose[2] - step_t)
        if width == ALIGN_WIDTH and length < CONVERGED_STEP and abs(step_t) < CONVERGED_TURN:
            break


class AlignmentTarget:
    """Submaps as they lie now; a scan is aligned with at most ``MOST_SUBMAPS``.

    Args:
        submaps: The submaps.
        frames: (S, 3) poses of their nodes in the map frame.
    """

    def __init__(self, submaps: list[Submap], frames: FloatArray) -> None:
        self.submaps = submaps
        self.frames = np.ascontiguousarray(frames)
        self._corners = np.array([submap.corner for submap in submaps])
        blank = MOST_SUBMAPS - len(submaps)
        no_grid = np.full((1, 1, 2), VACANT, dtype=np.int32)
        no_pieces = np.zeros(1, dtype=PIECE)
        grids = [submap.grid for submap in submaps] + [no_grid] * blank
        pieces = [submap.pieces for submap in submaps] + [no_pieces] * blank
        self._arrays = (tuple(grids), tuple(pieces))

    def align(
        self,
        points: FloatArray,
        sides: FloatArray,
        start: FloatArray,
        prior: FloatArray,
        known: FloatArray,
    ) -> Alignment:
        """Align a scan; see :func:`align_scan`."""
        pose = start.copy()
        equations = self._no_equations()
        fits = np.empty(len(points))
        align_scan(
            self._arrays,
            self._corners,
            self.frames,
            points,
            sides,
            prior,
            known,
            pose,
            equations.sums,
            equations.hits,
            fits,
        )
        return Alignment(pose, equations, fits)

    def hit_shares(
        self, points: FloatArray, sides: FloatArray, pose: FloatArray, stride: int
    ) -> FloatArray:
        """Share of every ``stride``-th point that lies near a surface of each submap, (S,)."""
        equations = self._no_equations()
        bind_scan(
            self._arrays,
            self._corners,
            self.frames,
            points,
            sides,
            stride,
            pose,
            FIRST_WIDTH,
            equations.sums,
            equations.hits,
            np.empty(len(points)),
        )
        taken = math.ceil(len(points) / stride)
        return np.asarray(equations.hits / max(1, taken), dtype=np.float64)

    def _no_equations(self) -> NormalEquations:
        """Arrays for a kernel to fill."""
        count = len(self.submaps)
        return NormalEquations(np.empty((count, 4, 4)), np.empty(count, dtype=np.int64))

    def occupied(self, centre: FloatArray, radius: float) -> tuple[np.ndarray, FloatArray]:
        """Find cells with a surface within a radius of a place.

        Returns:
            (FACES, rows, cols) uint8, 1 where there is a surface less than 90 degrees away from the direction of the
            x axis, the y axis, -x, and -y; and the lower left corner (2,) of the cells [m].
        """
        half = math.ceil(radius / SUBMAP_CELL) + 2
        size = 2 * half
        origin = (np.floor(centre[:2] / SUBMAP_CELL) - half) * SUBMAP_CELL
        cells = np.zeros((FACES, size, size), dtype=np.uint8)
        for submap, frame in zip(self.submaps, self.frames, strict=True):
            means, sides = submap.means
            placed = transform_points(Pose2D(*frame), means)
            cols, rows = np.floor((placed - origin) / SUBMAP_CELL).astype(np.int64).T
            to_x, to_y = transform_points(Pose2D(0.0, 0.0, frame[2]), sides).T
            inside = (rows >= 0) & (cols >= 0) & (rows < size) & (cols < size)
            faces = (to_x, to_y, -to_x, -to_y)
            for face, towards in enumerate(faces):
                kept = inside & (towards > 0.0)
                cells[face, rows[kept], cols[kept]] = 1
        return cells, origin
