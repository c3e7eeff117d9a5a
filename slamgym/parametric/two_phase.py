"""Two-phase empirical method: odometry errors of straight lines and turns, carried over to the map.

After Souza, Santana, Britto, Goncalves and Medeiros, *Representation of Odometry Errors on Occupancy Grids*
(ICINCO 2008). The robot's believed path is integrated from increments with empirical errors; each cell is
placed as the scan that saw it would have placed it.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import cv2
import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.types import BoolArray, Float32Array, FloatArray, GridFrame, Int32Array
from slamgym.parametric.config import TwoPhaseConfig
from slamgym.parametric.odometry_error import Increments, integrate
from slamgym.parametric.visibility import Visibility

# Weight of odometry in the fit, in beams: what keeps a pose in place along a corridor that shows nothing.
_PRIOR_BEAMS = 2.0
_PRIOR_LEVER = 1.0  # [m] at which a heading error of the prior counts like a position error


class WallCells(NamedTuple):
    """The cells of a map by their flat index, as far as beams hit them."""

    points: FloatArray  # (H * W, 2) true centres [m]
    normals: FloatArray  # (H * W, 2) unit normals of the walls, either sign
    width: int  # W, the row length of the flat indices


class AnchorSettings(NamedTuple):
    """What a scan matcher does; see :class:`slamgym.parametric.config.TwoPhaseConfig`."""

    min_known: int  # scans with fewer beams on known walls are not matched
    lag: float  # share of the motion lost in directions that the walls leave open
    thin_wall_px: int  # a new wall cell is taken for a known one up to so many cells across the wall from it


@kernel
def anchor_poses(
    true_poses: FloatArray,
    motions: FloatArray,
    hits: Int32Array,
    walls: WallCells,
    gain: FloatArray,
    settings: AnchorSettings,
) -> FloatArray:
    """Integrate ``motions`` and correct every pose by a share of the best fit to known walls.

    The fit is the least-squares motion that brings the wall cells of a scan, where the predicted pose would
    draw them, on to the walls as earlier scans drew them; only the distance across a wall counts, as for a
    scan matcher that can't distinguish two pieces of a wall (point to line, linearised). A weak prior
    holds the predicted pose in directions that the walls leave open. There a real matcher also falls behind,
    because the overlap with the known map is larger the less the robot has moved: ``lag`` is the share of the
    motion that is lost so. Nor can a matcher distinguish the two faces of a thin wall: a room
    seen for the first time is pulled so that its face of the wall falls on the known one.

    Args:
        true_poses: (T, 3) world frame.
        motions: (T - 1, 3) believed distance [m], lateral [m], turn [rad].
        hits: (T, B) flat index of the wall cell that each beam met, -1 for none.
        walls: What the beams hit.
        gain: (T,) share [0-1] of the correction that is applied.
        settings: Limits of the matching.

    Returns:
        Believed poses, (T, 3), heading not wrapped.
    """
    points, normals = walls.points, walls.normals
    placed = np.zeros_like(points)  # where the first scan that saw the cell drew it [m]
    is_placed = np.zeros(len(points), dtype=np.bool_)
    poses = np.empty_like(true_poses)
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
            reference = _known_wall(cell, walls, is_placed, settings.thin_wall_px)
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
        if known >= settings.min_known and gain[k] > 0.0:
            A[1, 0], A[2, 0], A[2, 1] = A[0, 1], A[0, 2], A[1, 2]
            A[0, 0] += _PRIOR_BEAMS
            A[1, 1] += _PRIOR_BEAMS
            A[2, 2] += _PRIOR_BEAMS * _PRIOR_LEVER**2
            g[0] -= _PRIOR_BEAMS * settings.lag * moved_x
            g[1] -= _PRIOR_BEAMS * settings.lag * moved_y
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
    return poses


@kernel
def _known_wall(cell: int, walls: WallCells, is_placed: BoolArray, thin_wall_px: int) -> int:
    """The known wall cell that a matcher takes a cell for: itself, the nearest across the wall, or -1."""
    if is_placed[cell]:
        return cell
    for step in range(1, thin_wall_px + 1):
        d_col = round(step * walls.normals[cell, 0])
        d_row = -round(step * walls.normals[cell, 1])
        for sign in (-1, 1):
            other = cell + sign * (int(d_row) * walls.width + int(d_col))
            if 0 <= other < len(is_placed) and is_placed[other]:
                return other
    return -1


@dataclass(frozen=True)
class PhaseErrors:
    """Systematic coefficients of one robot, drawn once."""

    k_l: float = 0.0  # [-]
    k_lt: float = 0.0  # [rad/m]
    k_t: float = 0.0  # [-]


def draw_phase_errors(config: TwoPhaseConfig, rng: np.random.Generator) -> PhaseErrors:
    """Draw one robot."""
    k_l, k_lt, k_t = rng.standard_normal(3)
    return PhaseErrors(
        k_l=config.k_l * float(k_l), k_lt=config.k_lt * float(k_lt), k_t=config.k_t * float(k_t)
    )


def disturb(
    true: Increments, errors: PhaseErrors, config: TwoPhaseConfig, rng: np.random.Generator
) -> Increments:
    """Believed increments: E_lin added to every distance, E_ang to every turn.

    Args:
        true: The motion.
        errors: Systematic coefficients.
        config: Random coefficients.
        rng: Source of the random part.
    """
    noise = rng.standard_normal((2, len(true.turn)))
    driven, turned = np.abs(true.distance), np.abs(true.turn)
    linear = errors.k_l * true.distance + config.s_l * np.sqrt(driven) * noise[0]
    angular = (
        errors.k_t * true.turn
        + errors.k_lt * true.distance
        + (config.s_t * np.sqrt(turned) + config.s_lt * np.sqrt(driven)) * noise[1]
    )
    return Increments(true.distance + linear, true.lateral, true.turn + angular)


def anchored_path(
    true_poses: FloatArray,
    believed: Increments,
    visibility: Visibility,
    occupied: BoolArray,
    gain: FloatArray,
    config: TwoPhaseConfig,
) -> FloatArray:
    """Integrate believed increments, pulled towards the map drawn so far as a scan matcher pulls.

    Args:
        true_poses: (T, 3).
        believed: T - 1 motions as odometry believes them.
        visibility: Who saw what; decides which part of a scan lies on known walls.
        occupied: (H, W) wall cells.
        gain: (T,) share of the error against the map that the scan removes; 0 where it is not matched.
        config: Limits of the matching.

    Returns:
        Believed poses, shape (T, 3).
    """
    if not gain.any():
        return integrate(true_poses[0], believed)
    frame = visibility.frame
    cells = np.arange(frame.height_px * frame.width_px, dtype=np.int32)
    points = visibility.cell_points(cells)
    # Only what is near enough to be matched counts.
    away = np.hypot(*(points[visibility.cells.hits] - visibility.sensors[:, None, :2]).transpose(2, 0, 1))
    matched = np.where(away <= config.matched_range, visibility.cells.hits, -1).astype(np.int32)
    poses = anchor_poses(
        true_poses,
        np.column_stack([believed.distance, believed.lateral, believed.turn]),
        matched,
        WallCells(points, wall_normals(occupied).reshape(-1, 2), frame.width_px),
        gain,
        AnchorSettings(config.matched_beams, config.lag, round(config.thin_wall / frame.resolution)),
    )
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def wall_normals(occupied: BoolArray) -> FloatArray:
    """Direction across the wall at every cell: main axis of the structure tensor of the smoothed picture.

    Convention: world axes (x right, y up); the sign is arbitrary.

    Returns:
        (H, W, 2) unit vectors; any direction far from walls.
    """
    smooth = cv2.GaussianBlur(occupied.astype(np.float32), (0, 0), 1.0)
    gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), -cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    xx, yy, xy = (cv2.GaussianBlur(product, (0, 0), 1.5) for product in (gx * gx, gy * gy, gx * gy))
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy).astype(np.float64)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def jittered(poses: FloatArray, config: TwoPhaseConfig, rng: np.random.Generator) -> FloatArray:
    """Poses (T, 3) with the white error of a scan match on each but the first, which is known."""
    noise = rng.standard_normal((len(poses), 3)) * (
        config.jitter,
        config.jitter,
        math.radians(config.jitter_deg),
    )
    noise[0] = 0.0
    shaken = poses + noise
    shaken[:, 2] = wrap_angle(shaken[:, 2])
    return shaken


def rigid_motions(true_poses: FloatArray, believed_poses: FloatArray, centre: FloatArray) -> FloatArray:
    """How each scan displaces what it draws: p' = that + R(thetahat - theta)(p - t), as four numbers.

    They enter p' linearly, so their mean over several scans gives the mean placement.

    Args:
        true_poses: (T, 3).
        believed_poses: (T, 3).
        centre: (2,) point that the numbers refer to [m]; near the map keeps them small.

    Returns:
        (T, 4): cos - 1, sin, and the displacement (x, y) of ``centre`` [m].
    """
    turn = believed_poses[:, 2] - true_poses[:, 2]
    cos, sin = np.cos(turn), np.sin(turn)
    x, y = centre[0] - true_poses[:, 0], centre[1] - true_poses[:, 1]
    return np.column_stack(
        [
            cos - 1.0,
            sin,
            believed_poses[:, 0] + cos * x - sin * y - centre[0],
            believed_poses[:, 1] + sin * x + cos * y - centre[1],
        ]
    )


def placement_field(
    true_poses: FloatArray,
    believed_poses: FloatArray,
    visibility: Visibility,
    choice: Literal["first", "mean", "last"] = "first",
    mean_motion: Float32Array | None = None,
) -> Float32Array:
    """The proprioceptive field d_O over every seen cell.

    Convention: world frame, component 0 = x, 1 = y, true minus measured [m]; lies on *true* cells.

    Args:
        true_poses: (T, 3).
        believed_poses: (T, 3).
        visibility: Who saw what.
        choice: Which scan places a cell.
        mean_motion: (H, W, 4) mean of :func:`rigid_motions` over the scans that saw the cell, for ``mean``.

    Returns:
        (2, H, W) float32, 0 in cells that no scan saw.
    """
    frame, seen = visibility.frame, visibility.seen
    centre = frame_centre(frame)
    if choice == "mean":
        if mean_motion is None:
            raise ValueError("the mean placement needs mean_motion")
        motion = mean_motion[seen].astype(np.float64)
    else:
        scan = visibility.cells.first if choice == "first" else visibility.cells.last
        motion = rigid_motions(true_poses, believed_poses, centre)[scan[seen]]
    rows, cols = np.nonzero(seen)
    x, y = frame.to_point(rows, cols)
    x, y = x - centre[0], y - centre[1]
    field = np.zeros((2, *frame.shape), dtype=np.float32)
    field[0, seen] = -(motion[:, 0] * x - motion[:, 1] * y + motion[:, 2])
    field[1, seen] = -(motion[:, 1] * x + motion[:, 0] * y + motion[:, 3])
    return field


def frame_centre(frame: GridFrame) -> FloatArray:
    """The middle of a grid, shape (2,) [m]."""
    min_x, min_y, max_x, max_y = frame.bounds
    return np.array([0.5 * (min_x + max_x), 0.5 * (min_y + max_y)])
