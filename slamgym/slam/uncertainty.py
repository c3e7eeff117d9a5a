"""Uncertainty of the newest pose of a path, seen from where the path began.

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
from slamgym.slam.columns import Columns

_IDENTITY = np.eye(3)
POINT_INFORMATION = 50_000.0
"""Information of a point across the surface that it lies on, in an edge of the graph [1/m^2]: 4.5 mm."""
ODOMETRY_FLOOR = (0.005, 0.005, 0.002)
"""Odometry between two nodes is never trusted further than this [m], [m], [rad]."""
NODE_METRES, NODE_RADIANS = 0.5, 0.2
"""A pose becomes a node after so much driving [m], or so much turning [rad]."""
STEP_FLOOR = (0.006, 0.006, 0.002)
"""Least uncertainty that each node adds to the path: chosen on twenty simulated homes so that NEES is about 3."""
REVISIT_METRES, REVISIT_DRIVEN = 0.5, 5.0
"""A filter is back at a node this near, seen so much driving ago [m] ..."""
REVISIT_SIGMA = 0.3
"""... if its position has grown no more uncertain since [m]: beyond it may have drawn the old walls a second time."""
REVISIT_FLOOR = (0.03, 0.03, 0.008)
"""Least error between the two poses then [m], [m], [rad]: in fourteen simulated homes 3 cm and 8 mrad with true
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
        field_of_view: Of the laser [rad].
    """

    def __init__(self, field_of_view: float = 2.0 * math.pi) -> None:
        self._field_of_view = field_of_view
        # Metres driven since the start, by which node each is known best, and how well.
        self._nodes = Columns(
            {"sources": np.int64}, poses=(3,), driven=(), steps=(3, 3), covariances=(3, 3), sources=(), added=(3, 3)
        )  # fmt: skip
        self.variances = np.zeros(2)
        """Variances of position [m^2] and heading [rad^2] by the odometry since the newest node."""
        self._distance = self._turn = 0.0

    @property
    def latest(self) -> FloatArray:
        """Uncertainty of the newest node; zero before the first."""
        return np.array(self._nodes["covariances"][-1]) if len(self._nodes) else np.zeros((3, 3))

    @property
    def needs_node(self) -> bool:
        """True if the newest pose must become a node. The first one must."""
        return not len(self._nodes) or self._distance >= NODE_METRES or self._turn >= NODE_RADIANS

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
        if not len(self._nodes):
            return np.zeros((3, 3))
        return step_covariance(pose[:2] - self._nodes["poses"][-1, :2], self.latest, self._step(match))

    def append(self, pose: FloatArray, match: FloatArray | None) -> None:
        """Make the newest pose a node; arguments as for :meth:`at`."""
        driven = self._nodes["driven"][-1] + self._distance if len(self._nodes) else 0.0
        self._nodes.append(poses=pose, driven=driven, steps=self._step(match))
        self._know(len(self._nodes) - 1, [])
        self.variances = np.zeros(2)
        self._distance = self._turn = 0.0

    def revisit(self, match: FloatArray) -> None:
        """Tie the newest node to an old one, if the robot is back there and still knows that it is.

        At least half of what the laser saw then must be in its view again.

        Args:
            match: (3, 3) covariance of its match in the map frame.
        """
        node, covariances, driven = len(self._nodes) - 1, self._nodes["covariances"], self._nodes["driven"]
        apart = self._nodes["poses"][:node] - self._nodes["poses"][node]
        near = np.hypot(apart[:, 0], apart[:, 1]) < REVISIT_METRES
        near &= driven[node] - driven[:node] > REVISIT_DRIVEN
        near &= np.abs(wrap_angle(apart[:, 2])) <= 0.5 * self._field_of_view
        candidates = np.flatnonzero(near)
        if len(candidates) == 0:
            return
        variances = covariances[:, 0, 0] + covariances[:, 1, 1]
        old = int(candidates[np.argmin(variances[candidates])])
        if variances[node] - variances[old] < REVISIT_SIGMA**2:
            known = node, int(self._nodes["sources"][node]), self._nodes["added"][node].copy()
            self._know(node, [known, (node, old, 2.0 * match + np.diag(np.square(REVISIT_FLOOR)))])

    def between(self, one: int, other: int) -> FloatArray:
        """Covariance (3, 3) of a node seen from another, in the map frame: what was added on the way between them."""
        poses, total = self._nodes["poses"], np.zeros((3, 3))
        for node in sorted(self._way(one) ^ self._way(other)):
            x, y = poses[other, :2] - poses[node, :2]
            _add_step(x, y, self._nodes["added"][node], total, total)
        return total

    def _way(self, node: int) -> set[int]:
        """The nodes on the way by which a node is known, but for the first of all."""
        way = set()
        while node > 0:
            way.add(node)
            node = int(self._nodes["sources"][node])
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
        self._nodes["poses"][: len(poses)] = poses
        self._know(0, [(max(one, other), min(one, other), matched) for one, other, matched in ties])

    def _know(self, first: int, ties: list[tuple[int, int, FloatArray]]) -> None:
        """Note by which older node each node from ``first`` on is known best, and how well; see :func:`know_nodes`."""
        ties.sort(key=lambda tie: tie[0])
        pairs = np.array([tie[:2] for tie in ties], dtype=np.int64).reshape(-1, 2)
        covariances = np.array([tie[2] for tie in ties], dtype=np.float64).reshape(-1, 3, 3)
        nodes = self._nodes
        know_nodes(
            first, nodes["poses"], nodes["steps"], pairs, covariances,
            nodes["covariances"], nodes["sources"], nodes["added"],
        )  # fmt: skip
