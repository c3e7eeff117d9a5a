"""Where a particle filter with a scan matcher believes to be: odometry pulled towards the map drawn so far.

Nothing is searched: truth is known, so the match is the least-squares fit to what earlier scans drew, plus the errors
that real matchers make. Their sizes were fitted to simulated runs (docs/parametric.md).
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.portable import lower_factor, solve_factored, solve_upper
from slamgym.core.types import BoolArray, FloatArray, GridFrame, Int32Array
from slamgym.parametric.config import MatchingConfig
from slamgym.parametric.odometry_error import Increments
from slamgym.parametric.robot_scans import RobotScans

_LATERAL_SHARE = 0.3  # of srr that goes from one axis into the other (GMapping's sxy)
_PRIOR_LEVER = 1.0  # [m] at which a heading error of the prior counts like a position error


class WallCells(NamedTuple):
    """The cells of a map by their flat index, as far as beams hit them."""

    points: FloatArray  # (H * W, 2) true centres [m]
    normals: FloatArray  # (H * W, 2) unit normals of the walls, either sign
    width: int  # W, the row length of the flat indices


class AnchorSettings(NamedTuple):
    """Settings of a scan matcher; see :class:`slamgym.parametric.config.MatchingConfig`."""

    min_known: int  # scans with fewer beams on known walls are not matched
    prior: float  # weight of the expected pose in the fit [beams]
    thin_wall_px: int  # a new wall cell is taken for a known one up to so many cells across the wall from it
    gain: float  # share [0-1] of the correction that is applied
    scatter: float  # error of one beam [m], independent of the others'


@kernel
def anchor_poses(
    true_poses: FloatArray,
    motions: FloatArray,
    pulls: FloatArray,
    dice: FloatArray,
    hits: Int32Array,
    walls: WallCells,
    settings: AnchorSettings,
) -> FloatArray:
    """Integrate ``motions`` and correct every pose by a share of the best fit to known walls.

    The fit is the least-squares motion that brings the wall cells of a scan, where the predicted pose would
    draw them, on to the walls as earlier scans drew them; only the distance across a wall counts, as for a
    scan matcher that can't distinguish two pieces of a wall (point to line, linearised). A weak prior
    holds the pose in directions that the walls leave open, near where the matcher would go by itself: ``pulls``
    says how far from the predicted pose that is. Nor can a matcher distinguish the two faces of a thin wall: a room
    seen for the first time is pulled so that its face of the wall falls on the known one.

    Args:
        true_poses: (T, 3) world frame.
        motions: (T - 1, 3) believed distance [m], lateral [m], turn [rad].
        pulls: (T, 3) where the prior lies from the predicted pose: ahead [m], to the left [m], turned [rad].
        dice: (T, 3) standard normal; what the beams' own errors add follows from them and the walls in sight.
        hits: (T, B) flat index of the wall cell that each beam met, -1 for none.
        walls: What the beams hit.
        settings: Limits of the matching.

    Returns:
        Believed poses, (T, 3), heading not wrapped.
    """
    points, normals = walls.points, walls.normals
    placed = np.zeros_like(points)  # where the first scan that saw the cell drew it [m]
    is_placed = np.zeros(len(points), dtype=np.bool_)
    poses = np.empty_like(true_poses)
    poses[0] = true_poses[0]
    row = np.empty(3)
    for k in range(true_poses.shape[0]):
        if k > 0:
            turn = motions[k - 1, 2]
            middle = poses[k - 1, 2] + 0.5 * turn
            cos, sin = math.cos(middle), math.sin(middle)
            poses[k, 0] = poses[k - 1, 0] + cos * motions[k - 1, 0] - sin * motions[k - 1, 1]
            poses[k, 1] = poses[k - 1, 1] + sin * motions[k - 1, 0] + cos * motions[k - 1, 1]
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
            row[0], row[1], row[2] = nx, ny, x * ny - y * nx
            for i in range(3):
                g[i] += row[i] * gap
                for j in range(i + 1):
                    A[i, j] += row[i] * row[j]
        if known >= settings.min_known:
            A[0, 0] += settings.prior
            A[1, 1] += settings.prior
            A[2, 2] += settings.prior * _PRIOR_LEVER**2
            cos, sin = math.cos(poses[k, 2]), math.sin(poses[k, 2])
            g[0] += settings.prior * (cos * pulls[k, 0] - sin * pulls[k, 1])
            g[1] += settings.prior * (sin * pulls[k, 0] + cos * pulls[k, 1])
            g[2] += settings.prior * _PRIOR_LEVER**2 * pulls[k, 2]
            factor = lower_factor(A)
            poses[k] += settings.gain * solve_factored(factor, g)
            # Of covariance A^-1: what errors of single beams do to the fit.
            poses[k] += settings.scatter * solve_upper(factor, dice[k])
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


def matched_path(
    scans: RobotScans,
    odometry: Increments,
    steps: FloatArray,
    frame: GridFrame,
    config: MatchingConfig,
    beam_skip: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Believed poses of a run.

    Args:
        scans: What the robot saw from its true poses.
        odometry: T - 1 motions as the wheels report them.
        steps: (T - 1,) how many scans came since the last one that entered the map: the filter adds noise at each.
        frame: Its cells are what walls are known by.
        config: The matcher.
        beam_skip: Beams left out between two that are matched.
        rng: Source of randomness.

    Returns:
        (T, 3), world frame, heading wrapped.
    """
    motions = np.column_stack(odometry)
    noisy = motions + _motion_noise(motions, steps, config) * rng.standard_normal(motions.shape)
    pulls = np.zeros((len(scans.middle), 3))
    pulls[1:, :2] = -config.lag * noisy[:, :2]
    pulls += config.wander * rng.standard_normal(pulls.shape)
    dice = rng.standard_normal(pulls.shape)
    hits, walls = _known_cells(scans, frame, config.usable_range)
    poses = anchor_poses(
        scans.middle,
        noisy,
        pulls,
        dice,
        np.ascontiguousarray(hits[:, :: beam_skip + 1]),
        walls,
        AnchorSettings(
            config.least_beams // (beam_skip + 1),
            config.prior,
            round(config.thin_wall / frame.resolution),
            config.gain,
            config.scatter,
        ),
    )
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def _motion_noise(motions: FloatArray, steps: FloatArray, config: MatchingConfig) -> FloatArray:
    """Standard deviations (T - 1, 3) of what the particles that survive keep of the motion model's noise."""
    noise, driven, turned = config.motion, np.abs(motions[:, 0]), np.abs(motions[:, 2])
    ahead = noise.srr * driven + noise.str * turned
    aside = _LATERAL_SHARE * noise.srr * driven + noise.str * turned
    turn = noise.stt * turned + noise.srt * driven
    # Independent noise of so many parts of the motion, each its share of the whole's.
    return config.noise * np.column_stack([ahead, aside, turn]) / np.sqrt(steps)[:, None]


def _known_cells(scans: RobotScans, frame: GridFrame, usable: float) -> tuple[Int32Array, WallCells]:
    """The cell that each beam truly hit, (T, B), -1 for none, and the cells of ``frame``'s size round all of them."""
    points, near = scans.end_points(usable)
    r = frame.resolution
    low = np.floor(points.reshape(-1, 2).min(axis=0) / r).astype(np.int64) - 1
    index = np.floor(points / r).astype(np.int64) - low
    height, width = int(index[..., 1].max()) + 2, int(index[..., 0].max()) + 2
    hits = np.where(near, (height - 1 - index[..., 1]) * width + index[..., 0], -1).astype(np.int32)
    occupied = np.zeros((height, width), dtype=np.bool_)
    occupied.ravel()[hits[near]] = True
    around = GridFrame(r, float(low[0]) * r, float(low[1]) * r, height, width)
    rows, cols = np.indices(occupied.shape)
    centres = np.stack(around.to_point(rows.ravel(), cols.ravel()), axis=-1)
    return hits, WallCells(centres, wall_normals(occupied).reshape(-1, 2), width)


def wall_normals(occupied: BoolArray) -> FloatArray:
    """Direction across the wall at every cell: main axis of the structure tensor of the smoothed picture.

    Convention: world axes (x right, y up); the sign is arbitrary.

    Returns:
        (H, W, 2) unit vectors; any direction far from walls.
    """
    smooth = cv2.GaussianBlur(occupied.astype(np.float32), (0, 0), 1.0)
    gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), -cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    xx, yy, xy = (cv2.GaussianBlur(product, (0, 0), 1.5) for product in (gx * gx, gy * gy, gx * gy))
    # Half the angle of (xx - yy, 2 xy), without arctan2, whose last bit depends on the processor.
    difference, mixed = (xx - yy).astype(np.float64), 2.0 * xy.astype(np.float64)
    cos = difference / np.maximum(np.hypot(difference, mixed), 1e-12)
    return np.stack([np.sqrt(0.5 * (1.0 + cos)), np.copysign(np.sqrt(0.5 * (1.0 - cos)), mixed)], axis=-1)
