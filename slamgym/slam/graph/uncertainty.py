"""How far the newest pose of a path may be off, seen from where the path began.

Between nodes the uncertainty grows: by that of the match with the map drawn so far, or by the odometry's where there
was nothing to match. Where the robot comes back to a place that the map shows already, the match ties it to the node
that drew the place, and the uncertainty falls back to that node's and the match's. So a corridor is long, a large
room is vague, and a loop that was closed is certain again; nothing is solved for the whole graph.
"""

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Pose2D

NEAR_METRES, NEAR_RADIANS = 2.0, 1.0
"""A node this near saw the same walls ..."""
APART_NODES = 10
"""... and one so many nodes back saw them on its own."""


def step_covariance(motion: FloatArray, before: FloatArray, added: FloatArray) -> FloatArray:
    """Covariance after a step, all in the map frame.

    Args:
        motion: (2,) translation of the step [m].
        before: (3, 3) covariance at its start.
        added: (3, 3) covariance of the step itself.
    """
    lever = np.eye(3)
    lever[0, 2], lever[1, 2] = -motion[1], motion[0]
    return np.asarray(lever @ before @ lever.T + added, dtype=np.float64)


class PathUncertainty:
    """Covariances of the nodes of a path, (3, 3) each, relative to the first."""

    def __init__(self) -> None:
        self._steps: list[FloatArray] = []
        self._matched: list[bool] = []
        self._covariances: list[FloatArray] = []

    @property
    def latest(self) -> FloatArray:
        """Of the newest node; zero before the first."""
        return self._covariances[-1] if self._covariances else np.zeros((3, 3))

    def append(self, poses: FloatArray, step: FloatArray, matched: bool) -> None:
        """Add a node.

        Args:
            poses: (N, 3) all nodes with the new one.
            step: (3, 3) covariance of the step to it, in the map frame.
            matched: Whether its scan was matched with the map.
        """
        self._steps.append(step)
        self._matched.append(matched)
        self._covariances.append(self._covariance_of(len(poses) - 1, poses))

    def follow(self, poses: FloatArray) -> None:
        """Compute everything again after the nodes were moved."""
        self._covariances = []
        for node in range(len(poses)):
            self._covariances.append(self._covariance_of(node, poses))

    def _covariance_of(self, node: int, poses: FloatArray) -> FloatArray:
        if node == 0:
            return np.zeros((3, 3))
        step = self._steps[node]
        chain = step_covariance(poses[node, :2] - poses[node - 1, :2], self._covariances[node - 1], step)
        if not self._matched[node] or node <= APART_NODES:
            return chain
        old = poses[: node - APART_NODES]
        away = np.hypot(old[:, 0] - poses[node, 0], old[:, 1] - poses[node, 1])
        turned = np.abs(wrap_angle(old[:, 2] - poses[node, 2]))
        near = np.flatnonzero((away < NEAR_METRES) & (turned < NEAR_RADIANS))
        near = near[np.array([self._matched[other] or other == 0 for other in near], dtype=bool)]
        if len(near) == 0:
            return chain
        sizes = [np.trace(self._covariances[other][:2, :2]) for other in near]
        best = int(near[int(np.argmin(sizes))])
        anchored = step_covariance(poses[node, :2] - poses[best, :2], self._covariances[best], 2.0 * step)
        return anchored if np.trace(anchored[:2, :2]) < np.trace(chain[:2, :2]) else chain


def advanced(pose: Pose2D, start: FloatArray, covariance: FloatArray, added: FloatArray) -> FloatArray:
    """The covariance of a pose some way after a node at ``start`` (3,)."""
    return step_covariance(np.array([pose.x - start[0], pose.y - start[1]]), covariance, added)
