"""How far the newest pose of a path may be off, seen from where the path began.

Between nodes the uncertainty grows: by that of the match with the map drawn so far, or by the odometry's where there
was nothing to match. Where the robot comes back to a place and a loop is closed, the match ties it to the node
that saw the place first, and the uncertainty falls back to that node's and the match's. So a corridor is long, a large
room is vague, and a loop that was closed is certain again; nothing is solved for the whole graph.
"""

from collections.abc import Iterable

import numpy as np

from slamgym.core.types import FloatArray


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
        self._ties: dict[int, list[tuple[int, FloatArray]]] = {}
        self._covariances: list[FloatArray] = []

    @property
    def latest(self) -> FloatArray:
        """Of the newest node; zero before the first."""
        return self._covariances[-1] if self._covariances else np.zeros((3, 3))

    def append(self, poses: FloatArray, step: FloatArray) -> None:
        """Add a node.

        Args:
            poses: (N, 3) all nodes with the new one.
            step: (3, 3) covariance of the step to it, in the map frame.
        """
        self._steps.append(step)
        self._covariances.append(self._covariance_of(len(poses) - 1, poses))

    def follow(self, poses: FloatArray, ties: Iterable[tuple[int, int, FloatArray]]) -> None:
        """Compute everything again after nodes were moved or loops closed.

        Args:
            poses: (N, 3) all nodes.
            ties: Pairs of nodes whose scans were matched with each other, with the covariance (3, 3) of that match
                in the map frame.
        """
        self._ties.clear()
        for one, other, covariance in ties:
            self._ties.setdefault(max(one, other), []).append((min(one, other), covariance))
        self._covariances = []
        for node in range(len(self._steps)):
            self._covariances.append(self._covariance_of(node, poses))

    def _covariance_of(self, node: int, poses: FloatArray) -> FloatArray:
        if node == 0:
            return np.zeros((3, 3))
        step = self._steps[node]
        best = step_covariance(poses[node, :2] - poses[node - 1, :2], self._covariances[node - 1], step)
        for old, matched in self._ties.get(node, ()):
            tied = step_covariance(poses[node, :2] - poses[old, :2], self._covariances[old], matched)
            if np.trace(tied[:2, :2]) < np.trace(best[:2, :2]):
                best = tied
        return best
