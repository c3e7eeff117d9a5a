"""The graph: nodes along the path, what the odometry and the laser measured between them, and how well it is known."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from slamgym.core.jit import plain
from slamgym.core.portable import inverted
from slamgym.core.types import FloatArray, IntArray
from slamgym.slam.columns import Columns
from slamgym.slam.graph.factor import elimination_order, rank_anchors
from slamgym.slam.graph.relative import Match, relative_covariance, step_covariance, turned_matrix
from slamgym.slam.graph.solver import Edges, Solution, approach, edge_errors, optimise
from slamgym.slam.graph.wheels import SPREADS, WheelCalibration, WheelStep

TIE_LENGTH = 0.1
"""Length of a match with an old submap in the graph [m]: the uncertainty that remains after it."""
RECENT_NODES = 40
"""Matches with submaps that are no older, in nodes, are part of the way, not a short cut."""
DRIFT = 0.02
"""Systematic error of the position by matching, which the graph doesn't know [m/m]. With 0.006, and 0.0005 rad/m, true
closures are refused: the path through the FHW museum is 0.87 m off, and 0.15 m with these. NEES of homes falls from
3.7 to 1.8, with a laser of 12 m from 8.4 to 5.8. Chosen on FHW, ACES, CSAIL and six homes."""
DRIFT_TURN = 0.003
"""Systematic error of the heading by matching, which the graph doesn't know [rad/m]; see ``DRIFT``."""
TIED = 0.08
"""Standard deviation of a position that an alignment still finds [m]."""
TIED_TURN = 0.06
"""Standard deviation of a heading that an alignment still finds [rad]."""
ROBUST_WIDTH = 10.0
"""Chi-squared beyond which a match that may be false loses its pull (dynamic covariance scaling)."""
ODOMETRY_WIDTH = 100.0
"""The same of the odometry: it may lie for a few steps."""
UNRANKED_SHARE = 0.2
"""The order of elimination is sought again when such a share of the submaps is new: the factor's fill grows with the
square of their number."""
MOST_UNRANKED = 32
"""The order of elimination is sought again when so many submaps are new, whatever their share."""


class PoseGraph:
    """Nodes and edges, the wheels' errors, and the latest solution."""

    def __init__(self) -> None:
        self.wheels = WheelCalibration()
        self._nodes = Columns(
            {"bound": np.bool_},
            poses=(3,),
            moved=(3,),
            design=(3, len(SPREADS)),
            slips=(2,),
            driven=(),
            bound=(3,),
        )
        self._matches = Columns(
            {"old": np.int64, "new": np.int64},
            old=(),
            new=(),
            measured=(3,),
            information=(3, 3),
            width=(),
        )
        self.optimisations = 0
        """How often the graph was optimised."""
        self._ranks = np.zeros(0, dtype=np.int64)  # of the anchors in the order of elimination
        self._solution: Solution | None = None  # of the latest optimisation
        self._of_newest = np.zeros((3, 3))  # covariance of its newest node
        self._distances = np.zeros(0)  # of all nodes from the newest one of the factor
        self._relative: dict[int, FloatArray] = {}  # its covariances seen from old nodes
        self._added = np.zeros((3, 3))  # covariance of the motion since that node

    def __len__(self) -> int:
        return len(self._nodes)

    @property
    def poses(self) -> FloatArray:
        """Poses of the nodes (N, 3)."""
        return self._nodes["poses"]

    @property
    def driven(self) -> FloatArray:
        """Way to each node (N,) [m]."""
        return self._nodes["driven"]

    @property
    def num_bytes(self) -> int:
        """Memory."""
        return self._nodes.num_bytes + self._matches.num_bytes

    @property
    def optimised(self) -> int:
        """Number of nodes when the graph was last optimised."""
        return len(self._distances)

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) of the newest pose relative to the first."""
        if self._solution is None:
            return self._added.copy()
        node = self.optimised - 1
        motion = self.poses[-1, :2] - self.poses[node, :2]
        before = self._of_newest + drift_covariance(self._distances[0])
        return step_covariance(motion, before, self._added)

    def append(
        self, pose: FloatArray, step: WheelStep, by_wheels: FloatArray, by_laser: FloatArray
    ) -> None:
        """Add a node.

        Args:
            pose: (3,).
            step: Odometry since the last node; of the first one, no motion.
            by_wheels: (3, 3) information of the pose seen from the last node, in the map frame.
            by_laser: (3, 3) information of the pose among the submaps, in the map frame.
        """
        driven = 0.0
        bound = np.ones(3, dtype=bool)
        if len(self):
            x, y, heading = self.poses[-1]
            driven = self.driven[-1] + np.hypot(pose[0] - x, pose[1] - y)
            self._added = self._added + inverted(by_wheels + by_laser)
            found = inverted(turned_matrix(by_laser, -heading) + np.eye(3))
            bound = found.diagonal() < np.square([TIED, TIED, TIED_TURN])
        self._nodes.append(
            poses=pose,
            moved=step.moved,
            design=step.design,
            slips=step.slips,
            driven=driven,
            bound=bound,
        )

    def tie(self, match: Match, is_sure: bool = False) -> None:
        """Add what the laser measured between two nodes."""
        self._matches.append(
            old=match.old,
            new=match.new,
            measured=match.measured,
            information=match.information,
            width=np.inf if is_sure else ROBUST_WIDTH,
        )

    def optimise(self, anchors: list[int], iterations: int, is_closing: bool = False) -> None:
        """Move the nodes to where they agree best with all that was measured.

        Args:
            anchors: Nodes with many edges: the submaps'.
            iterations: Most steps.
            is_closing: True if matches may disagree much with the path as it is.
        """
        edges = self._edges()
        places = self._elimination_order(edges, anchors, is_closing)
        prior = self.wheels.prior
        poses = self.poses.copy()
        wheels = self.wheels.systematic
        if is_closing:
            poses, wheels = approach(poses, wheels, edges, places, prior)
        solution = optimise(poses, wheels, edges, places, prior, iterations)
        self._nodes["poses"][:] = solution.poses
        self.optimisations += 1
        self._learn_wheels(edges, solution)
        newest = len(self) - 1
        self._solution = solution
        self._of_newest = solution.covariance(newest, newest)
        self._distances = self._distances_from(newest)
        self._relative = {}
        self._added = np.zeros((3, 3))

    def _elimination_order(self, edges: Edges, anchors: list[int], is_closing: bool) -> IntArray:
        """Place of each node in the order of elimination; anchors are ranked anew where it pays."""
        is_anchor = np.zeros(len(self), dtype=bool)
        is_anchor[anchors] = True
        ranked = len(self._ranks)
        unranked = len(anchors) - ranked
        if is_closing or unranked > min(UNRANKED_SHARE * ranked, MOST_UNRANKED):
            self._ranks = rank_anchors(edges.first, edges.second, is_anchor)
        return elimination_order(is_anchor, self._ranks)

    def _learn_wheels(self, edges: Edges, solution: Solution) -> None:
        """Take the wheels' errors from a solution."""
        # Where the laser said nothing, nothing is left of the odometry's edge.
        bound = self._nodes["bound"]
        seen = bound[1:] & bound[:-1]
        errors = edge_errors(solution.poses, solution.wheels, plain(edges))[: len(seen)]
        slips = self._nodes["slips"][1:]
        self.wheels.learn(solution.wheels, solution.wheels_covariance, errors, slips, seen)

    def _distances_from(self, node: int) -> FloatArray:
        """Length of the shortest way from a node to every node (N,) [m]."""
        lengths = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        # The others tell headings alone.
        is_placing = self._matches["information"][:, 0, 0] > 0.0
        old = self._matches["old"][is_placing]
        new = self._matches["new"][is_placing]
        return graph_distances(lengths, old, new, node)

    def is_tied(self, old: int) -> bool:
        """True if the place of an old node, seen from the newest, is known to within what an alignment finds."""
        covariance = self.relative_covariance(old)
        variance = max(covariance[0, 0], covariance[1, 1])
        return bool(variance < TIED**2 and covariance[2, 2] < TIED_TURN**2)

    def relative_covariance(self, old: int) -> FloatArray:
        """Covariance (3, 3) of the newest node of the last optimisation seen from an old one, drift included."""
        if old >= self.optimised:
            return np.zeros((3, 3))
        if old not in self._relative:
            known = self._seen_from(old, self.optimised - 1, self._of_newest)
            self._relative[old] = known + drift_covariance(self._distances[old])
        return self._relative[old]

    def deviation(self, old: int, new: int) -> float:
        """Standard deviation of a node's place seen from an older one, in the worse direction [m]; 0 if not known."""
        if self._solution is None or new >= self.optimised:
            return 0.0
        known = self._seen_from(old, new, self._solution.covariance(new, new))
        variance = max(known[0, 0], known[1, 1], 0.0)  # rounding may leave it below zero
        return float(np.sqrt(variance))

    def _seen_from(self, old: int, new: int, of_new: FloatArray) -> FloatArray:
        """Covariance (3, 3) of a node, whose own is given, seen from an old one."""
        assert self._solution is not None, "the graph was optimised"
        of_old = self._solution.covariance(old, old)
        mixed = self._solution.covariance(old, new)
        return relative_covariance(self.poses[old], self.poses[new], of_old, of_new, mixed)

    def corrected_edges(self) -> Edges:
        """The edges without the wheels' systematic errors."""
        edges = self._edges()
        measured = edges.measured + (edges.design * self.wheels.systematic).sum(axis=-1)
        return edges._replace(measured=measured, design=np.zeros_like(edges.information))

    def _edges(self) -> Edges:
        """The odometry's edges, in the order of the path, and the laser's."""
        nodes = self._nodes
        matches = self._matches
        steps = np.arange(len(self) - 1)
        axes = np.arange(3)
        variances = self.wheels.variances(nodes["slips"][1:])
        information = np.zeros((len(steps), 3, 3))
        information[:, axes, axes] = 1.0 / variances[:, [0, 0, 1]]
        by_wheels = Edges(
            first=steps,
            second=steps + 1,
            measured=nodes["moved"][1:],
            information=information,
            design=nodes["design"][1:],
            width=np.full(len(steps), ODOMETRY_WIDTH),
        )
        by_laser = Edges(
            first=matches["old"],
            second=matches["new"],
            measured=matches["measured"],
            information=matches["information"],
            design=np.zeros((len(matches), 3, len(SPREADS))),
            width=matches["width"],
        )
        return by_wheels.joined(by_laser)


def drift_covariance(distance: float) -> FloatArray:
    """Covariance (3, 3) that the systematic errors of matching add on a way [m]."""
    drift = np.array([DRIFT, DRIFT, DRIFT_TURN]) * distance
    return np.diag(np.square(drift))


def graph_distances(
    lengths: FloatArray, first: IntArray, second: IntArray, node: int
) -> FloatArray:
    """Length of the shortest way from a node to every node, along the path and through matches with old submaps.

    Args:
        lengths: (N - 1,) distances between successive nodes [m].
        first: (E,) nodes that were matched ...
        second: (E,) ... with these.
        node: Where the ways begin.

    Returns:
        (N,) [m].
    """
    num = len(lengths) + 1
    is_old = second - first > RECENT_NODES
    steps = np.arange(num - 1)
    pairs = np.unique(first[is_old] * num + second[is_old])
    rows = np.concatenate([steps, pairs // num])
    cols = np.concatenate([steps + 1, pairs % num])
    ties = np.full(len(pairs), TIE_LENGTH)
    weights = np.concatenate([lengths + 1e-3, ties])
    graph = csr_matrix((weights, (rows, cols)), shape=(num, num))
    ways = dijkstra(graph, directed=False, indices=np.array([node]))
    return ways[0]
