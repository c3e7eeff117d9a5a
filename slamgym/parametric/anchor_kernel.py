"""Kernel: dead reckoning that is pulled towards the map drawn so far, as a scan matcher pulls."""

import math

import numpy as np

from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, FloatArray, Int32Array

# Weight of odometry in the fit, in beams: what keeps a pose in place along a corridor that shows nothing.
_PRIOR_BEAMS = 2.0
_PRIOR_LEVER = 1.0  # [m] at which a heading error of the prior counts like a position error


@kernel
def anchor_poses(
    true_poses: FloatArray,
    motions: FloatArray,
    hits: Int32Array,
    points: FloatArray,
    normals: FloatArray,
    gain: FloatArray,
    min_known: int,
    lag: float,
    width: int,
    reach: int,
    placed: FloatArray,
    is_placed: BoolArray,
    poses: FloatArray,
) -> None:
    """Integrate ``motions`` and correct every pose by a share of the best fit to known walls.

    The fit is the least-squares motion that brings the wall cells of a scan, where the predicted pose would
    draw them, on to the walls as earlier scans drew them; only the distance across a wall counts, as for a
    scan matcher that can't tell one piece of a wall from the next (point to line, linearised). A weak prior
    holds the predicted pose in directions that the walls leave open. There a real matcher also falls behind,
    because the overlap with the known map is larger the less the robot has moved: ``lag`` is the share of the
    motion that is lost so. Nor can a matcher tell the two faces of a thin wall apart (``reach``): a room
    seen for the first time is pulled so that its face of the wall falls on the known one.

    Args:
        true_poses: (T, 3) world frame.
        motions: (T - 1, 3) believed distance [m], lateral [m], turn [rad].
        hits: (T, B) flat index of the wall cell that each beam met, -1 for none.
        points: (H * W, 2) true centres of the cells [m]; read only where a beam hit.
        normals: (H * W, 2) unit normals of the walls, either sign; read only where a beam hit.
        gain: (T,) share [0-1] of the correction that is applied.
        min_known: Scans with fewer beams on known walls are not matched.
        lag: Share of the motion lost in directions that the walls leave open.
        width: W, the row length of the flat indices.
        reach: A new wall cell is taken for a known one up to so many cells across the wall from it.
        placed: (H * W, 2) out, where the first scan that saw the cell drew it [m].
        is_placed: (H * W,) in and out, False everywhere before.
        poses: (T, 3) out, believed poses, heading not wrapped.
    """
    poses[0] = true_poses[0]
    for k in range(true_poses.shape[0]):
        moved_x, moved_y = 0.0, 0.0
        if k > 0:
            turn = motions[k - 1, 2]
            middle = poses[k - 1, 2] + 0.5 * turn
            cos, sin = math.cos(middle), math.sin(middle)
            moved_x = cos * motions[k - 1, 0] - sin * motions[k - 1, 1]
            moved_y = sin * motions[k - 1, 0] + cos * motions[k - 1, 1]
            poses[k, 0] = poses[k - 1, 0] + moved_x
            poses[k, 1] = poses[k - 1, 1] + moved_y
            poses[k, 2] = poses[k - 1, 2] + turn
        cos = math.cos(poses[k, 2] - true_poses[k, 2])
        sin = math.sin(poses[k, 2] - true_poses[k, 2])
        # Normal equations of the correction (x, y, turn about the robot).
        A = np.zeros((3, 3))
        g = np.zeros(3)
        known = 0
        for b in range(hits.shape[1]):
            cell = hits[k, b]
            if cell < 0:
                continue
            reference = _wall_in_reach(cell, normals, is_placed, width, reach)
            if reference < 0:
                continue
            known += 1
            px, py = points[cell, 0] - true_poses[k, 0], points[cell, 1] - true_poses[k, 1]
            x, y = cos * px - sin * py, sin * px + cos * py
            nx = cos * normals[cell, 0] - sin * normals[cell, 1]
            ny = sin * normals[cell, 0] + cos * normals[cell, 1]
            gap = nx * (placed[reference, 0] - poses[k, 0] - x) + ny * (
                placed[reference, 1] - poses[k, 1] - y
            )
            lever = x * ny - y * nx
            A[0, 0] += nx * nx
            A[0, 1] += nx * ny
            A[0, 2] += nx * lever
            A[1, 1] += ny * ny
            A[1, 2] += ny * lever
            A[2, 2] += lever * lever
            g[0] += nx * gap
            g[1] += ny * gap
            g[2] += lever * gap
        if known >= min_known and gain[k] > 0.0:
            A[1, 0], A[2, 0], A[2, 1] = A[0, 1], A[0, 2], A[1, 2]
            A[0, 0] += _PRIOR_BEAMS
            A[1, 1] += _PRIOR_BEAMS
            A[2, 2] += _PRIOR_BEAMS * _PRIOR_LEVER**2
            g[0] -= _PRIOR_BEAMS * lag * moved_x
            g[1] -= _PRIOR_BEAMS * lag * moved_y
            poses[k] += gain[k] * np.linalg.solve(A, g)
        cos = math.cos(poses[k, 2] - true_poses[k, 2])
        sin = math.sin(poses[k, 2] - true_poses[k, 2])
        for b in range(hits.shape[1]):
            cell = hits[k, b]
            if cell >= 0 and not is_placed[cell]:
                is_placed[cell] = True
                px, py = points[cell, 0] - true_poses[k, 0], points[cell, 1] - true_poses[k, 1]
                placed[cell, 0] = poses[k, 0] + cos * px - sin * py
                placed[cell, 1] = poses[k, 1] + sin * px + cos * py


@kernel
def _wall_in_reach(cell: int, normals: FloatArray, is_placed: BoolArray, width: int, reach: int) -> int:
    """The known wall cell that a matcher takes a cell for: itself, the nearest across the wall, or -1."""
    if is_placed[cell]:
        return cell
    for step in range(1, reach + 1):
        d_col = round(step * normals[cell, 0])
        d_row = -round(step * normals[cell, 1])
        for sign in (-1, 1):
            other = cell + sign * (int(d_row) * width + int(d_col))
            if 0 <= other < len(is_placed) and is_placed[other]:
                return other
    return -1
