"""One graph of two drives: the submaps of one aligned with those of the other, and least squares over all."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import transform_poses
from slamgym.core.portable import inverted
from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.graph.alignment import MOST_SUBMAPS, AlignmentTarget, nearest_within, overlapping
from slamgym.slam.graph.closures import FEW_SURFACES
from slamgym.slam.graph.factor import elimination_order, rank_anchors
from slamgym.slam.graph.map_graph import MapGraph, joined_graph
from slamgym.slam.graph.pose_graph import ROBUST_WIDTH
from slamgym.slam.graph.relative import Match, is_within, placed_points, seen_from
from slamgym.slam.graph.solver import Edges, approach, optimise
from slamgym.slam.graph.submaps import Submap

ALIGNMENT_ROUNDS = 2
"""The submaps are aligned so often: after the first least squares they lie nearer."""
NEAR_SUBMAPS = 12.0
"""Submaps whose middles are so far from each other show nothing in common [m]."""
TIE_FIT = 0.5
"""Share of a submap's surfaces that must fit the other drive's."""
MOST_MOVED = (0.6, 0.1)
"""A submap is aligned with the other drive's if that moves it no more than this [m], [rad]."""
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
    graph = _laid_on(first, second, pose)
    own = graph.edges
    count = len(first.poses)
    ties: list[Match] = []
    covariance = np.zeros((3, 3))
    for _ in range(ALIGNMENT_ROUNDS):
        ties = _align_all(graph, submaps)
        if not ties:
            return None
        edges = own.joined(Edges.of(ties, ROBUST_WIDTH))
        graph, covariance = _optimised(replace(graph, edges=edges), count)
    return Joint(graph, count, len({tie.new for tie in ties}), covariance)


def _laid_on(first: MapGraph, second: MapGraph, pose: FloatArray) -> MapGraph:
    """Two graphs as one, the second where a transform (3,) puts it; nothing ties them yet."""
    placed = second.moved(transform_poses(Pose2D(*pose.tolist()), second.poses))
    return joined_graph(first, placed)


def _align_all(graph: MapGraph, submaps: tuple[list[Submap], list[Submap]]) -> list[Match]:
    """Align each submap of the second drive with those of the first that show the same."""
    first, second = submaps

    def target_of(numbers: list[int]) -> AlignmentTarget:
        """Submaps of the first drive, by number."""
        frames = graph.poses[graph.submaps[numbers, 0]]
        return AlignmentTarget([first[number] for number in numbers], frames)

    anchors = graph.submaps[:, 0]
    theirs = anchors[: len(first)]
    centres = np.array([submap.centre for submap in first])
    middles = np.column_stack(placed_points(graph.poses[theirs], centres))
    ties: list[Match] = []
    for submap, node in zip(second, anchors[len(first) :].tolist(), strict=True):
        seen = submap.lines()
        if len(seen.points) < FEW_SURFACES:
            continue
        pose = graph.poses[node]
        middle = np.concatenate(placed_points(pose[None], submap.centre[None]))
        near = nearest_within(middles, middle, NEAR_SUBMAPS)
        numbers = overlapping(target_of, near, seen.every(2), pose)[:MOST_SUBMAPS]
        if not numbers:
            continue
        target = target_of(numbers)
        placed = target.align_freely(seen, pose)
        if placed.fit >= TIE_FIT and is_within(placed.pose, pose, MOST_MOVED):
            ties += target.matches(placed, graph.poses, node)
    return ties


def _optimised(graph: MapGraph, node: int) -> tuple[MapGraph, FloatArray]:
    """A graph at its optimum, and the covariance (3, 3) of a node there."""
    edges = graph.edges
    is_anchor = np.zeros(len(graph.poses), dtype=bool)
    is_anchor[graph.submaps[:, 0]] = True
    ranks = rank_anchors(edges.first, edges.second, is_anchor)
    places = elimination_order(is_anchor, ranks)
    known = np.ones(3)  # the wheels' errors are taken out already
    poses, wheels = approach(graph.poses, np.zeros(3), edges, places, known)
    solution = optimise(poses, wheels, edges, places, known, STEPS_OF_JOINT)
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
    graph = _laid_on(first, second, pose)
    node = len(first.poses)
    tie = Match(0, node, seen_from(graph.poses[0], graph.poses[node]), inverted(covariance))
    return replace(graph, edges=graph.edges.joined(Edges.of([tie], ROBUST_WIDTH)))
