"""A graph of many drives stays as large as its building: what enough newer drives show again is taken out."""

from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from slamgym.core.types import UNKNOWN, BoolArray, FloatArray
from slamgym.slam.graph.map_graph import DriveScans, MapGraph, drawn_poses
from slamgym.slam.graph.relative import Match, seen_from
from slamgym.slam.graph.solver import Edges
from slamgym.slam.hit_counts import HitCountMap

KEPT_DRIVES = 3
"""So many of the newest drives that see a place are kept: two draw what has come, a third what was there before."""
SEEN_AGAIN = 0.95
"""A submap is taken out if so many newer drives, or what is kept of its own, see such a share of its cells."""
KEPT_SHAPE = (0.02, 0.02, 0.01)
"""Standard deviations with which what is left keeps its place, where the nodes between are taken out [m], [m], [rad]:
those of a match across a few metres."""


def thinned(graph: MapGraph) -> MapGraph:
    """A graph without the submaps that :data:`KEPT_DRIVES` newer drives, or others of their own, show again."""
    if len(graph.drives) <= KEPT_DRIVES:
        return graph
    whole = graph.counted(*graph.drives)
    seen = np.zeros(whole.counts.shape[:2], np.int64)
    is_kept = np.ones(len(graph.submaps), dtype=bool)
    for drive in reversed(graph.drives):
        day = np.zeros(seen.shape, dtype=bool)
        for number in np.flatnonzero(drive.owns(graph.submaps[:, 0])).tolist():
            first, end = graph.submaps[number].tolist()
            cells = _known(graph, drive, slice(first, end), whole)
            needless = (seen[cells] >= KEPT_DRIVES) | day[cells]
            if needless.mean() > SEEN_AGAIN:
                is_kept[number] = False
            else:
                day |= cells
        seen += day
    return _reduced(graph, is_kept)


def _known(graph: MapGraph, drive: DriveScans, nodes: slice, whole: HitCountMap) -> BoolArray:
    """The cells of a whole map that the scans of some nodes of a drive show."""
    drawn = HitCountMap(drive.beams, graph.drives[0].config)
    scans = slice(nodes.start - drive.first, nodes.stop - drive.first)
    drawn.draw(drawn_poses(graph.poses[nodes]), drive.ranges[scans])
    drawn.cover(whole.box)
    return drawn.classified() != UNKNOWN


def _reduced(graph: MapGraph, is_kept: BoolArray) -> MapGraph:
    """A graph with some of its submaps."""
    stays = np.zeros(len(graph.poses), dtype=bool)
    for first, end in graph.submaps[is_kept].tolist():
        stays[first:end] = True
    numbers = np.cumsum(stays) - 1  # of the nodes that stay
    drives = []
    for drive in graph.drives:
        own = stays[drive.nodes]
        if own.any():
            first = int(numbers[drive.first + np.argmax(own)])
            kept = drive._replace(first=first, stamps=drive.stamps[own], ranges=drive.ranges[own])
            drives.append(kept)
    between = stays[graph.edges.first] & stays[graph.edges.second]
    columns: list[Any] = [column[between] for column in graph.edges]
    edges = Edges(*columns)
    edges = edges._replace(first=numbers[edges.first], second=numbers[edges.second])
    submaps = graph.submaps[is_kept]
    poses = graph.poses[stays]
    ends = np.column_stack([numbers[submaps[:, 0]], numbers[submaps[:, 1] - 1] + 1])
    return MapGraph(poses, _held(edges, poses, drives), ends, tuple(drives))


def _held(edges: Edges, poses: FloatArray, drives: list[DriveScans]) -> Edges:
    """Edges, with more of them over the gaps of each drive and between drives that nothing ties."""
    count = len(poses)
    is_tied = np.zeros(count, dtype=bool)
    is_tied[edges.first[edges.second == edges.first + 1]] = True
    starts = [drive.first for drive in drives]
    gaps = np.setdiff1d(np.flatnonzero(~is_tied[:-1]), np.array(starts) - 1)
    edges = _tied(edges, poses, [(gap, gap + 1) for gap in gaps.tolist()])
    links = coo_array((np.ones(len(edges.first)), (edges.first, edges.second)), (count, count))
    _, parts = connected_components(links, directed=False)
    return _tied(edges, poses, [(0, start) for start in starts if parts[start] != parts[0]])


def _tied(edges: Edges, poses: FloatArray, pairs: list[tuple[int, int]]) -> Edges:
    """Edges, and further ones that hold pairs of nodes as they lie."""
    information = np.diag(1.0 / np.square(KEPT_SHAPE))
    ties = [
        Match(first, second, seen_from(poses[first], poses[second]), information)
        for first, second in pairs
    ]
    return edges.joined(Edges.of(ties, np.inf))
