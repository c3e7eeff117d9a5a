"""One graph of two drives: the submaps of one aligned with those of the other, and least squares over all."""

from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import transform_poses, wrap_angle
from slamgym.core.portable import inverted
from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.graph.alignment import MOST_SUBMAPS, AlignmentTarget
from slamgym.slam.graph.closures import FEW_SURFACES
from slamgym.slam.graph.factor import elimination_order, rank_anchors
from slamgym.slam.graph.map_graph import MapGraph, joined_graph
from slamgym.slam.graph.pose_graph import GRADUATION, ROBUST_WIDTH
from slamgym.slam.graph.relative import Match, match_with, placed_points, seen_from
from slamgym.slam.graph.solver import Edges, optimise
from slamgym.slam.graph.submaps import Submap

ALIGNMENT_ROUNDS = 2
"""The submaps are aligned so often: after the first least squares they lie nearer."""
NEAR_SUBMAPS = 12.0
"""Submaps whose middles are so far from each other show nothing in common [m]."""
MOST_NEAR = 8
"""So many of the nearest submaps are looked at."""
LEAST_OVERLAP = 0.3
"""A submap is aligned with others that show more than this share of its surfaces."""
TIE_FIT = 0.5
"""Share of a submap's surfaces that must fit the other drive's."""
MOST_MOVED = (0.6, 0.1)
"""A submap is aligned with the other drive's if that moves it no more than this [m], [rad]."""
FEW_HITS = 10
"""A submap is tied to another if so many of its surfaces lie near the other's."""
STEPS_OF_JOINT = 15
"""Steps of least squares."""


class Joint(NamedTuple):
    """Two drives in one graph."""

    graph: MapGraph
    first: int  # nodes of the first one
    ties: int  # alignments between them
    covariance: FloatArray  # (3, 3) of the second one's first node in the frame of the first

    def parts(self, first: MapGraph, second: MapGraph) -> tuple[MapGraph, MapGraph]:
        """The two graphs that were joined, each at its place in the joint one."""
        poses = self.graph.poses
        return first.moved(poses[: self.first]), second.moved(poses[self.first :])


def join(
    first: MapGraph, second: MapGraph, submaps: tuple[list[Submap], list[Submap]], pose: FloatArray
) -> Joint | None:
    """Join two graphs, about as a transform says.

    Args:
        first: Its frame is that of the result.
        second: The other.
        submaps: Of both, as they were drawn.
        pose: (3,) of the frame of the second in that of the first.

    Returns:
        The joint graph; None if no submap of the second can be aligned there.
    """
    placed = second.moved(transform_poses(Pose2D(*pose.tolist()), second.poses))
    graph = joined_graph(first, placed)
    own = graph.edges
    count = len(first.poses)
    ties: list[Match] = []
    covariance = np.zeros((3, 3))
    for _ in range(ALIGNMENT_ROUNDS):
        ties = _align_all(graph, submaps)
        if not ties:
            return None
        graph = MapGraph(graph.poses, _with_ties(own, ties), graph.submaps, graph.drives)
        graph, covariance = _optimised(graph, count)
    return Joint(graph, count, len({tie.new for tie in ties}), covariance)


def _align_all(graph: MapGraph, submaps: tuple[list[Submap], list[Submap]]) -> list[Match]:
    """Align each submap of the second drive with those of the first that show the same."""
    first, second = submaps
    anchors = graph.submaps[:, 0]
    theirs = anchors[: len(first)]
    centres = np.array([submap.centre for submap in first])
    middles = np.column_stack(placed_points(graph.poses[theirs], centres))
    ties: list[Match] = []
    for submap, node in zip(second, anchors[len(first) :].tolist(), strict=True):
        points, sides = submap.lines()
        if len(points) < FEW_SURFACES:
            continue
        pose = graph.poses[node]
        x, y = placed_points(pose[None], submap.centre[None])
        away = np.hypot(middles[:, 0] - x, middles[:, 1] - y)
        nearest = np.argsort(away, kind="stable")[:MOST_NEAR]
        near = nearest[away[nearest] < NEAR_SUBMAPS].tolist()
        numbers = _overlapping(graph, first, near, points, sides, pose)
        if not numbers:
            continue
        target = _target(graph, first, numbers)
        placed = target.align(points, sides, pose, pose, np.zeros((3, 3)))
        moved = np.abs(placed.pose - pose)
        is_near = max(moved[0], moved[1]) < MOST_MOVED[0]
        if placed.fit < TIE_FIT or not is_near or abs(wrap_angle(moved[2])) > MOST_MOVED[1]:
            continue
        sums, hits = placed.equations
        for index, number in enumerate(numbers):
            if hits[index] >= FEW_HITS:
                old = int(theirs[number])
                tie = match_with(graph.poses, old, node, placed.pose, sums[index], len(numbers))
                ties.append(tie)
    return ties


def _overlapping(
    graph: MapGraph,
    submaps: list[Submap],
    near: list[int],
    points: FloatArray,
    sides: FloatArray,
    pose: FloatArray,
) -> list[int]:
    """Those of some submaps that show much of what is seen from a pose (3,), the most first."""
    shares: list[tuple[float, int]] = []
    for begin in range(0, len(near), MOST_SUBMAPS):
        numbers = near[begin : begin + MOST_SUBMAPS]
        found = _target(graph, submaps, numbers).hit_shares(points, sides, pose, 2)
        shares += [(-share, number) for share, number in zip(found.tolist(), numbers, strict=True)]
    shares.sort()
    return [number for share, number in shares[:MOST_SUBMAPS] if -share > LEAST_OVERLAP]


def _target(graph: MapGraph, submaps: list[Submap], numbers: list[int]) -> AlignmentTarget:
    frames = graph.poses[graph.submaps[numbers, 0]]
    return AlignmentTarget([submaps[number] for number in numbers], frames)


def _with_ties(edges: Edges, ties: list[Match]) -> Edges:
    """The edges of both drives, and those between them."""
    between = Edges(
        first=np.array([tie.old for tie in ties]),
        second=np.array([tie.new for tie in ties]),
        measured=np.array([tie.measured for tie in ties]),
        information=np.array([tie.information for tie in ties]),
        design=np.zeros((len(ties), 3, 3)),
        width=np.full(len(ties), ROBUST_WIDTH),
    )
    return Edges(*(np.concatenate(pair) for pair in zip(edges, between, strict=True)))


def _optimised(graph: MapGraph, node: int) -> tuple[MapGraph, FloatArray]:
    """A graph at its optimum, and the covariance (3, 3) of a node there."""
    edges = graph.edges
    is_anchor = np.zeros(len(graph.poses), dtype=bool)
    is_anchor[graph.submaps[:, 0]] = True
    ranks = rank_anchors(edges.first, edges.second, is_anchor)
    places = elimination_order(is_anchor, ranks)
    known = np.ones(3)  # the wheels' errors are taken out already
    no_errors = np.zeros(3)
    poses = graph.poses
    for factor in GRADUATION:
        wide = edges._replace(width=edges.width * factor)
        poses = optimise(poses, no_errors, wide, places, known, 4, 1e-3).poses
    solution = optimise(poses, no_errors, edges, places, known, STEPS_OF_JOINT)
    return graph.moved(solution.poses), solution.covariance(node, node)


def tied_loosely(
    first: MapGraph, second: MapGraph, pose: FloatArray, covariance: FloatArray
) -> MapGraph:
    """Two graphs that share no submap as one: a picture shows how they lie.

    Args:
        first: Its frame is that of the result.
        second: The other.
        pose: (3,) of its frame in that of the first.
        covariance: (3, 3) of that.
    """
    placed = second.moved(transform_poses(Pose2D(*pose.tolist()), second.poses))
    graph = joined_graph(first, placed)
    node = len(first.poses)
    tie = Match(0, node, seen_from(graph.poses[0], graph.poses[node]), inverted(covariance))
    return MapGraph(graph.poses, _with_ties(graph.edges, [tie]), graph.submaps, graph.drives)
