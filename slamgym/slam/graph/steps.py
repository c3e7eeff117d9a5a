"""What odometry and matching say of the motion between successive nodes: two edges of the graph for each step.

They are kept apart, so that what is learned of the odometry later corrects the beginning of the path, too.
"""

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.graph.solver import Edges
from slamgym.slam.odometry_calibration import OdometryCalibration
from slamgym.slam.particle_filter import ScanMatch

ODOMETRY_FLOOR = (0.001, 0.001, 0.0005)
"""Odometry between two nodes is never trusted further than this [m], [m], [rad]."""
MATCH_FLOOR = (0.01, 0.01, 0.003)
"""Nor are two matches [m], [m], [rad]."""
MATCHED_BACK = (1, 3, 8)
"""A match ties a node to those so many nodes before it: all were matched with the same map."""


class PathSteps:
    """The steps from each node to the next."""

    def __init__(self) -> None:
        self._increments: list[FloatArray] = []
        self._variances: list[FloatArray] = []
        self._matches: list[ScanMatch | None] = []  # of each node
        self._matched: list[tuple[int, int, FloatArray, FloatArray]] = []  # nodes, relative pose, covariance

    def __len__(self) -> int:
        return len(self._increments)

    def begin(self, match: ScanMatch | None) -> None:
        """Take the match of the first node."""
        self._matches.append(match)

    def append(
        self, poses: FloatArray, increments: FloatArray, variances: FloatArray, match: ScanMatch | None
    ) -> None:
        """Add a step.

        Args:
            poses: (N, 3) all nodes where they are believed by now, the last being the one that the step leads to.
            increments: (n, 3) raw odometry, in the robot frame.
            variances: (2,) of position and heading that the odometry leaves, where nothing is learned of it.
            match: What the scan alone said there; None where it can't be relied on.
        """
        node = len(poses) - 1
        for back in MATCHED_BACK:
            last = self._matches[node - back] if back <= node else None
            if last is None or match is None:
                continue
            ends = _moved(poses[node - back], last.offset), _moved(poses[node], match.offset)
            relative = relative_poses(ends[0][None], ends[1][None])[0]
            turned = rotation(float(relative[2]))
            covariance = last.covariance + turned @ match.covariance @ turned.T
            covariance = covariance + np.diag(np.square(MATCH_FLOOR))
            self._matched.append((node - back, node, relative, covariance))
        self._matches.append(match)
        self._increments.append(increments)
        self._variances.append(variances)

    def edges(self, calibration: OdometryCalibration | None) -> Edges:
        """Edges by odometry, corrected by what is known of it, and by matching.

        Odometry that a match contradicts may have lied: those edges are robust.
        """
        count = len(self)
        matched = np.array([match[:2] for match in self._matched], dtype=np.int64).reshape(-1, 2)
        measured, variances = self._odometry(calibration)
        by_odometry = np.zeros((count, 3, 3))
        by_odometry[:, np.arange(3), np.arange(3)] = 1.0 / variances
        by_match = np.linalg.inv(np.array([match[3] for match in self._matched]).reshape(-1, 3, 3))
        first = np.concatenate([np.arange(count), matched[:, 0]])
        robust = np.zeros(len(first), dtype=np.bool_)
        robust[matched[matched[:, 1] == matched[:, 0] + 1, 0]] = True
        return Edges(
            first=first,
            second=np.concatenate([np.arange(1, count + 1), matched[:, 1]]),
            measured=np.concatenate(
                [measured, np.array([match[2] for match in self._matched]).reshape(-1, 3)]
            ),
            information=np.concatenate([by_odometry, by_match]),
            robust=robust,
        )

    def covariances(
        self, calibration: OdometryCalibration | None, headings: FloatArray, first: int = 0
    ) -> FloatArray:
        """Of each step from ``first`` on, (steps, 3, 3), in the map frame.

        Args:
            calibration: What is known of the odometry.
            headings: (N,) of the nodes [rad].
            first: The first step wanted.
        """
        _, variances = self._odometry(calibration, first)
        information = np.zeros((len(self) - first, 3, 3))
        information[:, np.arange(3), np.arange(3)] = 1.0 / variances
        for old, new, _, covariance in self._matched if first == 0 else self._matched[-len(MATCHED_BACK) :]:
            if new == old + 1 and old >= first:
                information[old - first] += np.linalg.inv(covariance)
        turned = np.zeros_like(information)
        cos, sin = np.cos(headings[first : len(self)]), np.sin(headings[first : len(self)])
        turned[:, 0, 0] = turned[:, 1, 1] = cos
        turned[:, 0, 1], turned[:, 1, 0], turned[:, 2, 2] = -sin, sin, 1.0
        return np.asarray(turned @ np.linalg.inv(information) @ turned.transpose(0, 2, 1))

    def _odometry(
        self, calibration: OdometryCalibration | None, first: int = 0
    ) -> tuple[FloatArray, FloatArray]:
        """Motions (steps, 3) by odometry from step ``first`` on, and their variances along the axes."""
        chosen = self._increments[first:]
        count = len(chosen)
        increments = np.concatenate(chosen) if chosen else np.zeros((0, 3))
        counts = np.array([len(part) for part in chosen], dtype=np.int64)
        variances = np.array(self._variances[first:]).reshape(-1, 2)
        step = np.repeat(np.arange(count), counts)
        if calibration is not None:
            sums = np.zeros((count, 4))
            travelled = np.hypot(increments[:, 0], increments[:, 1])
            parts = [travelled, np.abs(increments[:, 2]), increments[:, 0], increments[:, 2]]
            for k, part in enumerate(parts):
                sums[:, k] = np.bincount(step, part, count)
            variances = np.stack(calibration.variances(*sums.T), axis=1)
            increments = calibration.correct(increments)
        before = np.cumsum(increments[:, 2]) - increments[:, 2]
        heading = before - np.repeat(before[np.cumsum(counts) - counts], counts)
        cos, sin = np.cos(heading), np.sin(heading)
        motion = np.column_stack([
            np.bincount(step, cos * increments[:, 0] - sin * increments[:, 1], count),
            np.bincount(step, sin * increments[:, 0] + cos * increments[:, 1], count),
            wrap_angle(np.bincount(step, increments[:, 2], count)),
        ])  # fmt: skip
        return motion, variances[:, [0, 0, 1]] + np.square(ODOMETRY_FLOOR)


def rotation(angle: float) -> FloatArray:
    """Matrix (3, 3) that turns x and y and keeps the heading."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _moved(pose: FloatArray, offset: FloatArray) -> FloatArray:
    """A pose moved by an offset in its own frame."""
    moved = rotation(float(pose[2])) @ offset
    return np.asarray(pose + moved, dtype=np.float64)
