"""Probabilistic roadmaps (Kavraki, Svestka, Latombe and Overmars, IEEE T-RA 12(4), 1996) on occupancy grids.

A roadmap is made once per map: random points in the largest area where the robot can drive, joined where a straight
drive keeps clear of walls. What stays apart, as behind a doorway that no pair of points sees through, is joined along
the cells of the area. A path is the shortest one over the roadmap, then shortened by leaving out points that a straight
drive can skip.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra
from scipy.spatial import cKDTree

from slamgym.core.errors import SlamgymError
from slamgym.core.types import BoolArray, FloatArray, GridFrame, IntArray
from slamgym.planning.open_tour import nearest_neighbour_tour, two_opt

_NODES_PER_M2 = 4.0
"""Random points over the free space that keeps the clearance [1/m2]: one for each half metre of a corridor."""
_MOST_NODES = 4000
"""So many points are drawn at most: no more than are joined in a second."""
_NEIGHBOURS = 12
"""Each point tries to join so many nearest points: a dense mesh."""
_FARTHEST = 3.0
"""Points farther apart than this aren't joined [m]: drives are short."""


@dataclass(frozen=True)
class DrivableArea:
    """The largest area of a map in which a robot can drive from any cell to any other."""

    frame: GridFrame
    clearance_map: FloatArray  # (H, W) [m] distance to the nearest obstacle
    clearance: float  # [m] that drives keep from obstacles
    cells: IntArray  # (C,) flat indices of its cells, growing

    @property
    def points(self) -> FloatArray:
        """Centres of its cells (C, 2) [m]."""
        return self.frame.to_points(*np.divmod(self.cells, self.frame.width_px))

    def clearance_at(self, points: FloatArray) -> FloatArray:
        """Distance (N,) [m] of points (N, 2) [m] from the nearest obstacle, interpolated; 0 beyond the map."""
        x, y = points.T
        cols = (x - self.frame.origin_x) / self.frame.resolution - 0.5
        rows = self.frame.height_px - 0.5 - (y - self.frame.origin_y) / self.frame.resolution
        return np.asarray(map_coordinates(self.clearance_map, [rows, cols], order=1))

    def cells_of(self, points: FloatArray) -> IntArray:
        """Index into :attr:`cells` of points (N, 2) [m] inside."""
        rows, cols = self.frame.to_cell(*points.T)
        return np.searchsorted(self.cells, rows * self.frame.width_px + cols)


def drivable_area(clearance_map: FloatArray, frame: GridFrame, clearance: float) -> DrivableArea:
    """Find where a robot can drive.

    Args:
        clearance_map: (H, W) [m] distance to the nearest obstacle.
        frame: Where its cells lie.
        clearance: What drives keep from obstacles [m]: the robot's radius and a margin.

    Raises:
        SlamgymError: If no free space keeps the clearance.
    """
    is_clear = clearance_map >= clearance
    # Only neighbours by a side: between two by a corner a drive comes too near to walls.
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(
        is_clear.astype(np.uint8), connectivity=4
    )
    sizes = boxes[1:, cv2.CC_STAT_AREA]
    if sizes.max(initial=0) < 2:
        raise SlamgymError(
            f"no free space keeps {clearance:g} m from the walls; the plan is too narrow for the robot"
        )
    return DrivableArea(
        frame, clearance_map, clearance, np.flatnonzero(labels == 1 + sizes.argmax())
    )


@dataclass(frozen=True)
class Roadmap:
    """Points of the free space and the straight drives between them."""

    nodes: FloatArray  # (N, 2) [m], frame of the grid; all in one connected component
    lengths: "csr_array[np.float64]"  # (N, N) [m] of the drives, symmetric
    area: DrivableArea

    def nearest(self, point: Sequence[float] | FloatArray) -> int:
        """The node nearest to ``point`` (2,) [m]."""
        return int(np.argmin(np.hypot(*(self.nodes - np.asarray(point)).T)))

    def path(self, start: int, goal: int) -> FloatArray:
        """Shortest path between two nodes, shortened; points (M, 2) [m]."""
        _, before = dijkstra(self.lengths, indices=[start], return_predecessors=True)
        chain = [goal]
        while chain[-1] != start:
            chain.append(int(before[0, chain[-1]]))
        return shorten(self.nodes[chain[::-1]], self.area)


def build_roadmap(
    area: DrivableArea, rng: np.random.Generator, places: FloatArray | None = None
) -> Roadmap:
    """Sample and join points.

    Args:
        area: Where the robot can drive.
        rng: Draws the points.
        places: Points (P, 2) [m] of the area that must be on the roadmap.
    """
    resolution = area.frame.resolution
    square_metres = len(area.cells) * resolution**2
    wanted = min(_MOST_NODES, max(30, int(_NODES_PER_M2 * square_metres)))
    picked = rng.choice(len(area.cells), size=min(wanted, len(area.cells)), replace=False)
    if places is not None:
        picked = np.union1d(picked, area.cells_of(places))
    pairs, lengths = _clear_drives(area, area.points[picked])
    on_map, links = _joined(area, picked, pairs)
    pairs = np.concatenate([pairs, links])
    lengths = np.concatenate([lengths, np.full(len(links), resolution)])
    count = len(on_map)
    graph = csr_array((lengths, tuple(pairs.T)), shape=(count, count))
    return Roadmap(area.points[on_map], csr_array(graph.maximum(graph.T)), area)


def _clear_drives(area: DrivableArea, nodes: FloatArray) -> tuple[IntArray, FloatArray]:
    """Pairs (E, 2) of near nodes (N, 2) [m] between which a straight drive keeps clear, and their lengths (E,) [m]."""
    count = min(_NEIGHBOURS + 1, len(nodes))
    distance, neighbour = cKDTree(nodes).query(nodes, k=count, distance_upper_bound=_FARTHEST)
    pairs = np.column_stack([np.repeat(np.arange(len(nodes)), count), np.ravel(neighbour)])
    is_pair = np.isfinite(np.ravel(distance)) & (np.ravel(distance) > 0.0)
    pairs = pairs[is_pair]
    clear = lines_are_clear(nodes[pairs[:, 0]], nodes[pairs[:, 1]], area)
    return pairs[clear], np.ravel(distance)[is_pair][clear]


def _joined(area: DrivableArea, picked: IntArray, pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Join the parts of a roadmap along the cells between them.

    Args:
        area: Where the robot can drive.
        picked: Cells of the nodes (N,), as indices into the area's.
        pairs: Drives (E, 2) between nodes.

    Returns:
        Cells of all nodes, those of ``picked`` first, and the drives (L, 2) of one cell that join the parts.
    """
    drives = csr_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(picked), len(picked)))
    _, part = connected_components(drives, directed=False)
    first_of_parts = np.unique(part, return_index=True)[1]
    largest = np.bincount(part).argmax()
    root = picked[first_of_parts[largest]]
    _, towards_root = breadth_first_order(_neighbouring_cells(area), root, directed=False)
    node_of: dict[int, int] = {int(cell): node for node, cell in enumerate(picked)}
    cells = picked.tolist()
    links: list[tuple[int, int]] = []
    joined = {int(largest)}
    for first in first_of_parts:
        node = int(first)
        cell = int(picked[node])
        met: set[int] = set()
        while node >= len(picked) or int(part[node]) not in joined:
            if node < len(picked):
                met.add(int(part[node]))
            cell = int(towards_root[cell])
            is_new = cell not in node_of
            following = node_of.setdefault(cell, len(cells))
            links.append((node, following))
            if is_new:
                cells.append(cell)
            elif following >= len(picked):
                break  # from here on another part went before
            node = following
        joined |= met
    return np.array(cells), np.array(links, dtype=np.int64).reshape(-1, 2)


def _neighbouring_cells(area: DrivableArea) -> "csr_array[np.float64]":
    """Which cells of an area (C, C) share a side."""
    frame = area.frame
    number = np.full(frame.height_px * frame.width_px, -1)
    number[area.cells] = np.arange(len(area.cells))
    picture = number.reshape(frame.shape)
    sides = [(picture[:, :-1], picture[:, 1:]), (picture[:-1], picture[1:])]
    pairs = np.concatenate([np.column_stack([a.ravel(), b.ravel()]) for a, b in sides])
    pairs = pairs[(pairs >= 0).all(axis=1)]
    count = len(area.cells)
    return csr_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))


def lines_are_clear(starts: FloatArray, ends: FloatArray, area: DrivableArea) -> BoolArray:
    """Mask of those straight drives that keep clear of walls, shape (E,).

    Args:
        starts: (E, 2) [m].
        ends: (E, 2) [m].
        area: Where the robot can drive.
    """
    along = ends - starts
    longest = float(np.hypot(along[:, 0], along[:, 1]).max(initial=0.0))
    spacing = 0.5 * area.frame.resolution
    steps = max(2, int(np.ceil(longest / spacing)) + 1)
    clear = np.ones(len(starts), dtype=np.bool_)
    for share in np.linspace(0.0, 1.0, steps):
        # A line is dropped at its first point that is too near.
        alive = np.flatnonzero(clear)
        points = starts[alive] + share * along[alive]
        clear[alive] = area.clearance_at(points) >= area.clearance
    return clear


def shorten(points: FloatArray, area: DrivableArea) -> FloatArray:
    """Leave out points of a path (M, 2) that a straight drive can skip; the ends stay."""
    kept = [0]
    while kept[-1] < len(points) - 1:
        here = kept[-1]
        ends = points[here + 1 :]
        starts = np.broadcast_to(points[here], ends.shape)
        clear = lines_are_clear(starts, ends, area)
        clear[0] = True  # a drive of the roadmap itself
        farthest = int(np.flatnonzero(clear)[-1])
        kept.append(here + 1 + farthest)
    return np.asarray(points[kept])


def random_path(roadmap: Roadmap, rng: np.random.Generator) -> FloatArray:
    """A path between two different random nodes; points (M, 2) [m]."""
    start, goal = rng.choice(len(roadmap.nodes), size=2, replace=False)
    return roadmap.path(int(start), int(goal))


def tour(roadmap: Roadmap, stops: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A path through all stops, starting at a random one, in an order that makes it short.

    Args:
        roadmap: Where the robot can drive.
        stops: (S, 2) [m]; each is moved to its nearest node.
        rng: Chooses the first stop.

    Returns:
        Points (M, 2) [m].
    """
    nodes = list(dict.fromkeys(roadmap.nearest(stop) for stop in stops))
    if len(nodes) < 2:
        return random_path(roadmap, rng)
    first = nodes.pop(int(rng.integers(len(nodes))))
    nodes.insert(0, first)
    distances = dijkstra(roadmap.lengths, indices=nodes)[:, nodes]
    order = np.append(0, nearest_neighbour_tour(distances))
    while two_opt(distances, order):
        pass
    parts = [roadmap.nodes[[first]]]
    for i, j in itertools.pairwise(order):
        leg = roadmap.path(nodes[i], nodes[j])
        parts.append(leg[1:])
    return np.concatenate(parts)


def spread_stops(roadmap: Roadmap, spacing: float, rng: np.random.Generator) -> FloatArray:
    """Nodes such that every node is within ``spacing`` [m] of one: stops for a map without rooms; (S, 2)."""
    first = int(rng.integers(len(roadmap.nodes)))
    stops = [first]
    gap = dijkstra(roadmap.lengths, indices=[first])[0]
    while gap.max() > spacing:
        furthest = int(gap.argmax())
        stops.append(furthest)
        gap = np.minimum(gap, dijkstra(roadmap.lengths, indices=[furthest])[0])
    return roadmap.nodes[stops]
