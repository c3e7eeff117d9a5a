"""SE(2) arithmetic, angles, runs of masks, and one grid laid onto another.

Convention: ``compose(a, b)`` is the pose of frame b's child seen from a's parent, i.e. the matrix product
``T_a @ T_b``; ``between(a, b)`` is ``inverse(a) * b``, the pose of b seen from a.
"""

import math
from typing import Any

import numpy as np

from slamgym.core.types import BoolArray, FloatArray, IntArray, Pose2D

_TURN = 2.0 * math.pi


def wrap_angle(angle: Any) -> Any:
    """Wrap an angle or an array of angles [rad] to (-pi, pi]."""
    if isinstance(angle, (float, int)):  # a union would be made in every call
        return math.pi - (math.pi - angle) % (2.0 * math.pi)
    return np.pi - np.mod(np.pi - np.asarray(angle, dtype=np.float64), 2.0 * np.pi)


def unit_vectors(angles: FloatArray) -> FloatArray:
    """Directions at angles [rad], shape (N, 2)."""
    return np.column_stack([np.cos(angles), np.sin(angles)])


def compose(a: Pose2D, b: Pose2D) -> Pose2D:
    """Pose of b, given in frame a, expressed in the parent frame of a."""
    cos = math.cos(a[2])
    sin = math.sin(a[2])
    x = a[0] + cos * b[0] - sin * b[1]
    y = a[1] + sin * b[0] + cos * b[1]
    theta = math.pi - (math.pi - float(a[2] + b[2])) % _TURN
    return Pose2D(x, y, theta)


def inverse(a: Pose2D) -> Pose2D:
    """Undo a pose: a composed with its inverse is the identity."""
    cos = math.cos(a[2])
    sin = math.sin(a[2])
    x = -cos * a[0] - sin * a[1]
    y = sin * a[0] - cos * a[1]
    return Pose2D(x, y, math.pi - (math.pi + float(a[2])) % _TURN)


def between(a: Pose2D, b: Pose2D) -> Pose2D:
    """Pose of b seen from a (both given in one parent frame)."""
    cos = math.cos(a[2])
    sin = math.sin(a[2])
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    theta = math.pi - (math.pi - float(b[2] - a[2])) % _TURN
    return Pose2D(cos * dx + sin * dy, -sin * dx + cos * dy, theta)


def part_of(motion: Pose2D, share: float) -> Pose2D:
    """Where a motion at constant speeds has come after a share of its time: a part of its arc.

    Args:
        motion: The whole, which turns by less than half a turn.
        share: Of its time; below 0 before it began, above 1 where it goes on.
    """
    half = 0.5 * motion[2]
    shortening = math.sin(share * half) / math.sin(half) if abs(half) > 1e-8 else share
    back = (share - 1.0) * half
    cos = shortening * math.cos(back)
    sin = shortening * math.sin(back)
    x, y, turn = motion
    theta = math.pi - (math.pi - share * float(turn)) % _TURN
    return Pose2D(cos * x - sin * y, sin * x + cos * y, theta)


def transform_points(pose: Pose2D, points: FloatArray) -> FloatArray:
    """Express points, shape (..., 2) [m] in the frame of ``pose``, in the parent frame of ``pose``."""
    cos = math.cos(pose[2])
    sin = math.sin(pose[2])
    x = points[..., 0]
    y = points[..., 1]
    moved_x = cos * x - sin * y + pose[0]
    moved_y = sin * x + cos * y + pose[1]
    return np.stack([moved_x, moved_y], axis=-1)


def transform_poses(pose: Pose2D, poses: FloatArray) -> FloatArray:
    """Compose ``pose`` with each row of ``poses``, shape (N, 3)."""
    moved = np.empty_like(poses, dtype=np.float64)
    moved[:, :2] = transform_points(pose, poses[:, :2])
    moved[:, 2] = wrap_angle(poses[:, 2] + pose[2])
    return moved


def runs_of(mask: BoolArray) -> IntArray:
    """Where each run of a mask (N,) begins, and where the next place behind it is, (R, 2)."""
    changes = np.diff(mask, prepend=False, append=False)
    return np.flatnonzero(changes).reshape(-1, 2)


def paste(canvas: np.ndarray, picture: np.ndarray, top: int, left: int) -> None:
    """Fill a canvas as far as a picture reaches; what lies beyond keeps its values.

    Args:
        canvas: Written to, shape (..., H, W).
        picture: Shape (..., rows, cols), with the same leading axes.
        top: Row of the picture at which the canvas begins; may be negative or beyond the picture.
        left: Its column there.
    """
    height, width = canvas.shape[-2:]
    rows = _shown(top, height, picture.shape[-2])
    cols = _shown(left, width, picture.shape[-1])
    part = picture[..., rows, cols]
    below = canvas[..., rows.start - top :, cols.start - left :]
    below[..., : part.shape[-2], : part.shape[-1]] = part


def _shown(first: int, here: int, there: int) -> slice:
    """The part of a picture's axis that a canvas shows.

    Args:
        first: Where in the picture the canvas begins.
        here: Length of the canvas.
        there: Length of the picture.
    """
    start = min(max(0, first), there)
    stop = max(0, min(there, first + here))
    return slice(start, stop)
