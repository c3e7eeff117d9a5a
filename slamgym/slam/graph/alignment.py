"""Alignment of a scan with several submaps at once.

A point is bound across the line of a submap's nearest piece only (Censi, ICRA 2008): the pose is found to a fraction of
a cell, in a corridor nothing binds along it, and the normal matrix says so.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.portable import lower_factor, solve_factored
from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.graph.relative import Match, match_with, nearest_turn
from slamgym.slam.graph.submaps import LINE, PIECE, SUBMAP_CELL, VACANT, OrientedPoints, Submap

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
MOST_TRIED = 8
"""So many submaps, the nearest ones, are looked at for overlap with a scan."""
OVERLAP_SHARE = 0.3
"""A scan is matched with a submap if more than this share of its points is near the submap's surfaces."""
FEW_HITS = 10
"""It is tied to the submap if so many of its points lie near the submap's surfaces."""


class Alignment(NamedTuple):
    """A scan's place among submaps, and what each of them says of it."""

    pose: FloatArray  # (3,) in the map frame
    sums: FloatArray
    """(S, 4, 4) normal matrix of the pose (x, y, theta) in the map frame, about the robot; in the last column the
    gradient and the weighted squared error."""
    hits: IntArray  # (S,) number of points near a surface
    fits: FloatArray  # (n,) how well each point fits, 0 to 1

    @property
    def total(self) -> FloatArray:
        """What all submaps together say, (4, 4), as in :attr:`sums`."""
        return self.sums.sum(axis=0)

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
    submaps: tuple[Any, ...], points: FloatArray, sides: FloatArray, pose: FloatArray, width: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Compute what each submap says of a scan at a pose.

    Args:
        submaps: Grids and pieces of the submaps, each a tuple of ``MOST_SUBMAPS`` arrays, and of those that count, the
            first of them, their corners (S, 2) and their nodes' poses (S, 3) in the map frame.
        points: (n, 2) end points in the robot frame [m].
        sides: (n, 3) their sides in the robot frame.
        pose: (3,) of the robot in the map frame.
        width: Residual that counts a quarter [standard deviations].

    Returns:
        The sums, hits and fits of :class:`Alignment`.
    """
    grids, all_pieces, corners, frames = submaps
    sums = np.zeros((len(frames), 4, 4))
    hits = np.zeros(len(frames), dtype=np.int64)
    fits = np.zeros(len(points))
    row = np.empty(4)
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
        for i in range(len(points)):
            px = points[i, 0]
            py = points[i, 1]
            qx = sides[i, 0]
            qy = sides[i, 1]
            arm_x = cos_own * px - sin_own * py
            arm_y = sin_own * px + cos_own * py
            side_x = cos_own * qx - sin_own * qy
            side_y = sin_own * qx + cos_own * qy
            x = own_x + arm_x
            y = own_y + arm_y
            number = _nearest_line(
                grid, pieces, corners[k], x, y, side_x, side_y, sides[i, 2] > 0.0
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
    return sums, hits, fits


@kernel
def align_scan(
    submaps: tuple[Any, ...],
    points: FloatArray,
    sides: FloatArray,
    prior: FloatArray,
    known: FloatArray,
    pose: FloatArray,
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Align a scan with submaps by Gauss-Newton steps with Geman-McClure weights that narrow from step to step.

    Args:
        submaps: As for :func:`bind_scan`.
        points: As for :func:`bind_scan`.
        sides: As for :func:`bind_scan`.
        prior: (3,) expected pose.
        known: (3, 3) information of that; zero for none.
        pose: (3,) to begin at; receives the result.

    Returns:
        As :func:`bind_scan`, before the last step.
    """
    gradient = np.empty(3)
    for step in range(ALIGN_STEPS):
        width = max(ALIGN_WIDTH, FIRST_WIDTH / (1.0 + step))
        sums, hits, fits = bind_scan(submaps, points, sides, pose, width)
        away = pose - prior
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
    return sums, hits, fits


class AlignmentTarget:
    """Submaps as they lie now; a scan is aligned with at most ``MOST_SUBMAPS``.

    Args:
        submaps: The submaps.
        frames: (S, 3) poses of their nodes in the map frame.
    """

    def __init__(self, submaps: list[Submap], frames: FloatArray) -> None:
        self.submaps = submaps
        self.frames = np.ascontiguousarray(frames)
        corners = np.array([submap.corner for submap in submaps])
        blank = MOST_SUBMAPS - len(submaps)
        no_grid = np.full((1, 1, 2), VACANT, dtype=np.int32)
        no_pieces = np.zeros(1, dtype=PIECE)
        grids = [submap.grid for submap in submaps] + [no_grid] * blank
        pieces = [submap.pieces for submap in submaps] + [no_pieces] * blank
        self._arrays = (tuple(grids), tuple(pieces), corners, self.frames)

    def align(
        self, seen: OrientedPoints, start: FloatArray, prior: FloatArray, known: FloatArray
    ) -> Alignment:
        """Align a scan from a pose (3,), by a prior (3,) of known information (3, 3); zero for none."""
        pose = start.copy()
        return Alignment(pose, *align_scan(self._arrays, *seen, prior, known, pose))

    def align_freely(self, seen: OrientedPoints, start: FloatArray) -> Alignment:
        """The same where nothing is known of the pose but where to begin."""
        return self.align(seen, start, start, np.zeros((3, 3)))

    def hit_shares(self, seen: OrientedPoints, pose: FloatArray) -> FloatArray:
        """Share of the points of a scan at a pose that lie near a surface of each submap, (S,)."""
        _, hits, _ = bind_scan(self._arrays, *seen, pose, FIRST_WIDTH)
        return hits / max(1, len(seen.points))

    def matches(self, placed: Alignment, poses: FloatArray, node: int) -> list[Match]:
        """What each of the submaps says of the place of a node that was aligned with them, by all poses (N, 3)."""
        count = len(self.submaps)
        return [
            match_with(poses, submap.first, node, placed.pose, sums, count)
            for submap, sums, hits in zip(self.submaps, placed.sums, placed.hits, strict=True)
            if hits >= FEW_HITS
        ]

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
            placed = submap.means.placed(frame)
            cols, rows = np.floor((placed.points - origin) / SUBMAP_CELL).astype(np.int64).T
            inside = (rows >= 0) & (cols >= 0) & (rows < size) & (cols < size)
            for face, is_seen in enumerate(placed.seen_by_face()):
                kept = inside & is_seen
                cells[face, rows[kept], cols[kept]] = 1
        return cells, origin


TargetOf = Callable[[list[int]], AlignmentTarget]
"""Makes submaps, given by their numbers, ready for an alignment."""


def nearest_within(places: FloatArray, place: FloatArray, reach: float) -> list[int]:
    """Numbers of those of some places (N, 2) that are in reach [m] of another (2 or more,), the nearest first."""
    away = np.hypot(*(places - place[:2]).T)
    nearest = np.argsort(away, kind="stable")[:MOST_TRIED]
    in_reach: list[int] = nearest[away[nearest] < reach].tolist()
    return in_reach


def overlapping(
    target_of: TargetOf, numbers: list[int], seen: OrientedPoints, pose: FloatArray
) -> list[int]:
    """Those of some submaps that show much of what is seen from a pose (3,), the most first."""
    found: list[tuple[float, int]] = []
    for begin in range(0, len(numbers), MOST_SUBMAPS):
        tried = numbers[begin : begin + MOST_SUBMAPS]
        shares = target_of(tried).hit_shares(seen, pose)
        found += zip((-shares).tolist(), tried, strict=True)
    return [number for share, number in sorted(found) if -share > OVERLAP_SHARE]
