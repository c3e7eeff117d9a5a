"""Poses (3,), x, y, theta [m, m, rad], seen from others, and what is measured between two nodes."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import between, compose, wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.portable import inverted, multiply
from slamgym.core.types import FloatArray, Pose2D

MATCH_FLOOR = (0.01, 0.01, 0.003)
"""Standard deviations of a match that its points don't show [m], [m], [rad]: errors of the map it was matched with."""
DAMPING = 10.0
"""Information below which a direction of a match counts as unknown [1/m^2], [1/rad^2]."""
WEAK = 15_000.0
"""Information of a direction that counts half [1/m^2], [1/rad^2]: that of eight points."""


class Match(NamedTuple):
    """A relative pose that the laser measured between two nodes."""

    old: int
    new: int
    measured: FloatArray  # (3,) pose of the new node seen from the old one
    information: FloatArray  # (3, 3) in the frame of the old one


def match_with(
    poses: FloatArray, old: int, node: int, pose: FloatArray, sums: FloatArray, count: int
) -> Match:
    """What a submap says of a scan's place.

    Args:
        poses: (N, 3) of the nodes.
        old: The submap's node.
        node: The scan's.
        pose: (3,) of the scan.
        sums: (4, 4) what the submap binds there; see :class:`slamgym.slam.graph.alignment.Alignment`.
        count: Submaps that the scan was aligned with: their errors are one scan's.
    """
    shift, information = weigh_match(sums, poses[old, 2], count, WEAK)
    return Match(old, node, seen_from(poses[old], pose - shift), information)


@kernel
def weigh_match(
    sums: FloatArray, heading: float, count: int, weak: float
) -> tuple[FloatArray, FloatArray]:
    """Weigh what a submap binds (4, 4); see :func:`match_with`. Of a direction with information ``weak`` half counts.

    Returns:
        The motion (3,) from where the submap alone would have put the scan to where all together have, in the map
        frame, and the information (3, 3) in the frame of the submap's node, which has a heading [rad].
    """
    own = np.eye(3)
    shift = np.zeros(3)
    information = sums[:3, :3].copy()
    step = inverted(information + DAMPING * own)
    for row in range(3):
        for col in range(3):
            shift[row] += step[row, col] * sums[col, 3]
    # A few points in a direction are as well pulled by a door frame that is not theirs.
    information += weak * (weak * inverted(information + weak * own) - own)
    covariance = inverted(turned_matrix(information, -heading) + own)
    for axis in range(3):
        covariance[axis, axis] += count * MATCH_FLOOR[axis] ** 2
    return shift, inverted(covariance)


@kernel
def nearest_turn(angle: float) -> float:
    """Wrap an angle to [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def chi_squared(pose: FloatArray, expected: FloatArray, information: FloatArray) -> float:
    """Squared Mahalanobis distance of a pose (3,) from the expected one, whose information (3, 3) is given."""
    away = pose - expected
    away[2] = wrap_angle(away[2])
    pulled = (information * away).sum(axis=1)
    return float((pulled * away).sum())


def is_within(pose: FloatArray, centre: FloatArray, window: Sequence[float] | FloatArray) -> bool:
    """True if a pose (3,) lies in a window (2,) [m], [rad] about another."""
    x, y, turn = np.abs(pose - centre)
    return bool(max(x, y) <= window[0] and abs(wrap_angle(turn)) <= window[1])


def pose_spreads(covariance: FloatArray) -> FloatArray:
    """Standard deviations (2,) of a position, in the worse axis, and of a heading by a covariance (3, 3) [m], [rad]."""
    metres = math.sqrt(max(covariance[0, 0], covariance[1, 1]))
    return np.array([metres, math.sqrt(covariance[2, 2])])


def seen_from(frame: FloatArray, pose: FloatArray) -> FloatArray:
    """A pose (3,) in the frame of another."""
    return np.array(between(Pose2D(*frame.tolist()), Pose2D(*pose.tolist())))


def moved_by(frame: FloatArray, motion: FloatArray) -> FloatArray:
    """A pose (3,) given in the frame of another."""
    return np.array(compose(Pose2D(*frame.tolist()), Pose2D(*motion.tolist())))


def placed_points(frames: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """X and y, both (N,), of points (N, 2 or more) that are each given in a frame of its own (N, 3)."""
    cos = np.cos(frames[:, 2])
    sin = np.sin(frames[:, 2])
    x = frames[:, 0] + cos * points[:, 0] - sin * points[:, 1]
    y = frames[:, 1] + sin * points[:, 0] + cos * points[:, 1]
    return x, y


@kernel
def sandwich(jacobian: FloatArray, matrix: FloatArray, out: FloatArray) -> None:
    """Add J M J^T, J (3, K) and M (K, K), to ``out`` (3, 3)."""
    for row in range(3):
        for col in range(3):
            for i in range(len(matrix)):
                for j in range(len(matrix)):
                    out[row, col] += jacobian[row, i] * matrix[i, j] * jacobian[col, j]


@kernel
def turned_matrix(matrix: FloatArray, angle: float) -> FloatArray:
    """A covariance or information (3, 3) of a pose, in axes that are turned by ``-angle``."""
    cos = math.cos(angle)
    sin = math.sin(angle)
    rotation = np.eye(3)
    out = np.zeros((3, 3))
    rotation[0, 0] = cos
    rotation[0, 1] = -sin
    rotation[1, 0] = sin
    rotation[1, 1] = cos
    sandwich(rotation, matrix, out)
    return out


def step_covariance(motion: FloatArray, before: FloatArray, added: FloatArray) -> FloatArray:
    """Covariance after a step, all in the map frame.

    Args:
        motion: (2,) translation of the step [m].
        before: (3, 3) covariance at its start.
        added: (3, 3) covariance of the step itself.
    """
    lever = np.eye(3)
    lever[0, 2] = -motion[1]
    lever[1, 2] = motion[0]
    out = added.copy()
    sandwich(lever, before, out)
    return out


@kernel
def relative_jacobian(old: FloatArray, new: FloatArray, out: FloatArray) -> None:
    """Write the change (3, 6) of a pose (3,) seen from another, the old one, by both."""
    cos = math.cos(old[2])
    sin = math.sin(old[2])
    dx = new[0] - old[0]
    dy = new[1] - old[1]
    out[0, 0] = -cos
    out[0, 1] = -sin
    out[0, 2] = cos * dy - sin * dx
    out[0, 3] = cos
    out[0, 4] = sin
    out[1, 0] = sin
    out[1, 1] = -cos
    out[1, 2] = -cos * dx - sin * dy
    out[1, 3] = -sin
    out[1, 4] = cos
    out[2, 2] = -1.0
    out[2, 5] = 1.0


@kernel
def relative_covariance(
    old: FloatArray, new: FloatArray, of_old: FloatArray, of_new: FloatArray, mixed: FloatArray
) -> FloatArray:
    """Covariance (3, 3) of a new node seen from an old one.

    Args:
        old: (3,) pose.
        new: (3,) pose.
        of_old: (3, 3) covariance of the old one.
        of_new: (3, 3) of the new one.
        mixed: (3, 3) of the old with the new.
    """
    change = np.zeros((3, 6))
    relative_jacobian(old, new, change)
    joint = np.empty((6, 6))
    half = np.zeros((3, 6))
    out = np.zeros((3, 3))
    for row in range(3):
        for col in range(3):
            joint[row, col] = of_old[row, col]
            joint[row, 3 + col] = mixed[row, col]
            joint[3 + col, row] = mixed[row, col]
            joint[3 + row, 3 + col] = of_new[row, col]
    multiply(change, joint, half)
    multiply(half, np.ascontiguousarray(change.T), out)
    return out
