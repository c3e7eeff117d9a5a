"""How far the newest pose of a path may be off, seen from where the path began.

Between nodes the uncertainty grows: by that of the match with the map drawn so far, or by the odometry's where there
was nothing to match. Where the robot comes back to a place and a loop is closed, the match ties it to the node
that saw the place first, and the uncertainty falls back to that node's and the match's. So a corridor is long, a large
room is vague, and a loop that was closed is certain again; nothing is solved for the whole graph.

A filter closes no loops, but matches with the whole of its map: where it is still sure enough to find the old walls
within the reach of its matches, coming back ties it to the node that drew them.
"""

import math
from collections.abc import Iterable

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.jit import assign, kernel
from slamgym.core.portable import inverted
from slamgym.core.types import FloatArray, IntArray

_IDENTITY = np.eye(3)
POINT_INFORMATION = 50_000.0
"""Of a point across the surface that it lies on, in an edge of the graph [1/m^2]: 4.5 mm."""
ODOMETRY_FLOOR = (0.005, 0.005, 0.002)
"""Odometry between two nodes is never trusted further than this [m], [m], [rad]."""
STEP_FLOOR = (0.006, 0.006, 0.002)
"""What each node adds to the path's uncertainty at least: chosen on twenty simulated homes so that NEES is about 3."""
REVISIT_METRES, REVISIT_DRIVEN = 0.5, 5.0
"""A filter is back at a node this near, seen so much driving ago [m] ..."""
REVISIT_SIGMA = 0.3
"""... if its position has grown no more uncertain since [m]: beyond it may have drawn the old walls a second time."""
REVISIT_FLOOR = (0.03, 0.03, 0.008)
"""How far the two poses are off then at least [m], [m], [rad]: in fourteen simulated homes 3 cm and 8 mrad with true
odometry, 5 cm and 12 mrad with wheels that slip."""


def match_covariance(binding: FloatArray) -> FloatArray:
    """Covariance (3, 3) of a match in the map frame.

    Args:
        binding: (6,) what the points bind, as :func:`slamgym.slam.scan_match.align_freely` gives it.
    """
    uu, uv, vv, ut, vt, tt = binding.tolist()
    information = POINT_INFORMATION * np.array([[uu, uv, ut], [uv, vv, vt], [ut, vt, tt]])
    return np.asarray(inverted(information + _IDENTITY), dtype=np.float64)


def step_covariance(motion: FloatArray, before: FloatArray, added: FloatArray) -> FloatArray:
    """Covariance after a step, all in the map frame.

    Args:
        motion: (2,) translation of the step [m].
        before: (3, 3) covariance at its start.
        added: (3, 3) covariance of the step itself.
    """
    after = np.zeros((3, 3))
    _add_step(motion[0], motion[1], before, after + added, after)
    return after


@kernel
def know_nodes(
    first: int,
    poses: FloatArray,
    steps: FloatArray,
    tied: IntArray,
    ties: FloatArray,
    covariances: FloatArray,
    sources: IntArray,
    added: FloatArray,
) -> None:
    """Find by which older node each node is known best, and how well, in the order of the path.

    Args:
        first: Node to begin with; all later ones follow.
        poses: (N, 3).
        steps: (N, 3, 3) covariance of the motion since the node before.
        tied: (T, 2) pairs of a node and an older one, sorted by the node, all from ``first`` on.
        ties: (T, 3, 3) covariance of the older one's match with the node.
        covariances: (N, 3, 3) of the nodes; those from ``first`` on are replaced.
        sources: (N,) the older node.
        added: (N, 3, 3) covariance on the way from it.
    """
    tie = 0
    stepped = np.zeros((3, 3))
    for node in range(first, len(poses)):
        sources[node] = max(node - 1, 0)
        added[node] = 0.0
        covariances[node] = 0.0
        if node > 0:
            assign(steps[node], added[node])
            x, y = poses[node, 0] - poses[node - 1, 0], poses[node, 1] - poses[node - 1, 1]
            _add_step(x, y, covariances[node - 1], steps[node], covariances[node])
        while tie < len(tied) and tied[tie, 0] == node:
            old = tied[tie, 1]
            x, y = poses[node, 0] - poses[old, 0], poses[node, 1] - poses[old, 1]
            _add_step(x, y, covariances[old], ties[tie], stepped)
            if stepped[0, 0] + stepped[1, 1] < covariances[node, 0, 0] + covariances[node, 1, 1]:
                sources[node] = old
                assign(ties[tie], added[node])
                assign(stepped, covariances[node])
            tie += 1


@kernel
def _add_step(
    motion_x: float, motion_y: float, before: FloatArray, added: FloatArray, after: FloatArray
) -> None:
    """As :func:`step_covariance`, into ``after``."""
    for row in range(3):
        lever = -motion_y if row == 0 else motion_x if row == 1 else 0.0
        last = before[row, 2] + lever * before[2, 2]
        for col in range(3):
            arm = -motion_y if col == 0 else motion_x if col == 1 else 0.0
            after[row, col] = before[row, col] + lever * before[2, col] + arm * last + added[row, col]


class PathUncertainty:
    """Covariances of the nodes of a path, (3, 3) each, relative to the first, and of the pose since the newest.

    Args:
        distance: A pose becomes a node after so much driving [m] ...
        turn: ... or so much turning [rad].
        field_of_view: Of the laser [rad].
    """

    def __init__(self, distance: float, turn: float, field_of_view: float = 2.0 * math.pi) -> None:
        self._spacing = distance, turn
        self._field_of_view = field_of_view
        self._count = 0
        self._poses: FloatArray = np.zeros((64, 3))
        self._driven: FloatArray = np.zeros(64)  # since the start, at each node [m]
        self._steps: FloatArray = np.zeros((64, 3, 3))
        self._covariances: FloatArray = np.zeros((64, 3, 3))
        self._sources: IntArray = np.zeros(64, dtype=np.int64)  # by which node each is known best,
        self._added: FloatArray = np.zeros((64, 3, 3))  # and how well
        self.variances = np.zeros(2)
        """Of position [m^2] and heading [rad^2] by the odometry since the newest node."""
        self._distance = self._turn = 0.0

    @property
    def latest(self) -> FloatArray:
        """Of the newest node; zero before the first."""
        return self._covariances[self._count - 1].copy() if self._count else np.zeros((3, 3))

    @property
    def is_due(self) -> bool:
        """Whether the newest pose must become a node. The first one must."""
        distance, turn = self._spacing
        return not self._count or self._distance >= distance or self._turn >= turn

    def move(self, before: FloatArray, after: FloatArray, variances: FloatArray) -> None:
        """Take a motion between two poses (3,), with the variances that the odometry has over it."""
        self._distance += float(np.hypot(*(after[:2] - before[:2])))
        self._turn += abs(float(wrap_angle(after[2] - before[2])))
        self.variances = self.variances + variances

    def at(self, pose: FloatArray, match: FloatArray | None) -> FloatArray:
        """Covariance of the newest pose.

        Args:
            pose: (3,).
            match: (3, 3) covariance of its match in the map frame; None if odometry is all there is.
        """
        if not self._count:
            return np.zeros((3, 3))
        return step_covariance(pose[:2] - self._poses[self._count - 1, :2], self.latest, self._step(match))

    def append(self, pose: FloatArray, match: FloatArray | None) -> None:
        """Make the newest pose a node; arguments as for :meth:`at`."""
        node = self._count
        if node == len(self._poses):
            for name in ("_poses", "_driven", "_steps", "_covariances", "_sources", "_added"):
                rows = getattr(self, name)
                setattr(self, name, np.concatenate([rows, np.zeros_like(rows)]))
        self._count += 1
        self._steps[node] = self._step(match)
        self._poses[node] = pose
        self._driven[node] = self._driven[node - 1] + self._distance if node else 0.0
        self._know(node, [])
        self.variances = np.zeros(2)
        self._distance = self._turn = 0.0

    def revisit(self, match: FloatArray) -> None:
        """Tie the newest node to an old one, if the robot is back there and still knows that it is.

        At least half of what the laser saw then must be in its view again.

        Args:
            match: (3, 3) covariance of its match in the map frame.
        """
        node = self._count - 1
        here, now = self._poses[node], self._covariances[node]
        apart = self._poses[:node] - here
        near = np.hypot(apart[:, 0], apart[:, 1]) < REVISIT_METRES
        near &= self._driven[node] - self._driven[:node] > REVISIT_DRIVEN
        near &= np.abs(wrap_angle(apart[:, 2])) <= 0.5 * self._field_of_view
        candidates = np.flatnonzero(near)
        if len(candidates) == 0:
            return
        old = int(min(candidates, key=lambda one: _position_variance(self._covariances[one])))
        if _position_variance(now) - _position_variance(self._covariances[old]) < REVISIT_SIGMA**2:
            known = node, int(self._sources[node]), self._added[node].copy()
            self._know(node, [known, (node, old, 2.0 * match + np.diag(np.square(REVISIT_FLOOR)))])

    def between(self, one: int, other: int) -> FloatArray:
        """Covariance (3, 3) of a node seen from another, in the map frame: what was added on the way between them."""
        added = np.array(sorted(self._way(one) ^ self._way(other)), dtype=np.int64)
        total = np.zeros((3, 3))
        for node in added:
            x, y = self._poses[other, :2] - self._poses[node, :2]
            _add_step(x, y, self._added[node], total, total)
        return total

    def _way(self, node: int) -> set[int]:
        """The nodes on the way by which a node is known, but for the first of all."""
        way = set()
        while node > 0:
            way.add(node)
            node = int(self._sources[node])
        return way

    def _step(self, match: FloatArray | None) -> FloatArray:
        """Covariance of the motion since the newest node, in the map frame."""
        odometry = np.diag(self.variances[[0, 0, 1]] + np.square(ODOMETRY_FLOOR))
        if match is None:
            return odometry
        matched = 2.0 * match + np.diag(np.square(STEP_FLOOR))
        return np.asarray(inverted(inverted(odometry) + inverted(matched)), dtype=np.float64)

    def follow(self, poses: FloatArray, ties: Iterable[tuple[int, int, FloatArray]]) -> None:
        """Compute everything again after nodes were moved or loops closed.

        Args:
            poses: (N, 3) all nodes.
            ties: Pairs of nodes whose scans were matched with each other, with the covariance (3, 3) of that match
                in the map frame.
        """
        self._poses[: len(poses)] = poses
        self._know(0, [(max(one, other), min(one, other), matched) for one, other, matched in ties])

    def _know(self, first: int, ties: list[tuple[int, int, FloatArray]]) -> None:
        """Note by which older node each node from ``first`` on is known best, and how well."""
        ties.sort(key=lambda tie: tie[0])
        pairs = np.array([tie[:2] for tie in ties], dtype=np.int64).reshape(-1, 2)
        covariances = np.array([tie[2] for tie in ties], dtype=np.float64).reshape(-1, 3, 3)
        count = self._count
        know_nodes(
            first,
            self._poses[:count],
            self._steps[:count],
            pairs,
            covariances,
            self._covariances[:count],
            self._sources[:count],
            self._added[:count],
        )


def _position_variance(covariance: FloatArray) -> float:
    return float(covariance[0, 0] + covariance[1, 1])
