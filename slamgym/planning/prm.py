"""Probabilistic roadmaps (Kavraki, Svestka, Latombe and Overmars, IEEE T-RA 12(4), 1996) on occupancy grids.

A roadmap is made once per map: random points in the free space, joined where a straight drive keeps clear of
walls. A path is the shortest one over the roadmap, then shortened by leaving out points that a straight drive
can skip.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from slamgym.core.errors import SlamgymError
from slamgym.core.types import FREE, BoolArray, Float32Array, FloatArray, OccupancyGrid
from slamgym.planning.costmap import cells_inside
from slamgym.planning.open_tour import nearest_neighbour_tour, two_opt

_NODES_PER_M2, _MOST_NODES = 4.0, 4000
"""Density of the random points over the free space that keeps the clearance, and their number at most: one for each
half metre of a corridor, and no more than are joined in a second."""
_NEIGHBOURS, _FARTHEST = 12, 3.0
"""Each point tries to join so many nearest points within this distance [m]: a dense mesh of short straight drives."""


@dataclass(frozen=True)
class Roadmap:
    """Points of the free space and the straight drives between them."""

    nodes: FloatArray  # (N, 2) [m], frame of the grid; all in one connected component
    lengths: "csr_array[np.float64]"  # (N, N) [m] of the drives, symmetric
    grid: OccupancyGrid
    clearance_map: Float32Array  # (H, W) [m] distance to the nearest cell that isn't free
    clearance: float  # [m] that drives keep from everything that is not free

    def nearest(self, point: Sequence[float] | FloatArray) -> int:
        """The node nearest to ``point`` (2,) [m]."""
        return int(np.argmin(np.hypot(*(self.nodes - np.asarray(point)).T)))

    def path(self, start: int, goal: int) -> FloatArray:
        """Shortest path between two nodes, shortened; points (M, 2) [m]."""
        _, before = dijkstra(self.lengths, indices=[start], return_predecessors=True)
        chain = [goal]
        while chain[-1] != start:
            chain.append(int(before[0, chain[-1]]))
        return shorten(self.nodes[chain[::-1]], self.clearance_map, self.grid, self.clearance)


def build_roadmap(grid: OccupancyGrid, clearance: float, rng: np.random.Generator) -> Roadmap:
    """Sample and join points; the largest connected part is kept.

    Args:
        grid: The map.
        clearance: What drives keep from everything that is not free [m]: the robot's radius and a margin.
        rng: Draws the points.

    Raises:
        SlamgymError: If no free space keeps the clearance.
    """
    resolution = grid.frame.resolution
    # A border of the picture counts as a wall: what is beyond is unknown.
    free = np.pad((grid.cells == FREE).astype(np.uint8), 1)
    clearance_map = cv2.distanceTransform(free, cv2.DIST_L2, 5)[1:-1, 1:-1] * np.float32(resolution)
    rows, cols = np.nonzero(clearance_map > clearance)
    if len(rows) < 2:
        raise SlamgymError(
            f"no free space keeps {clearance:g} m from the walls; the plan is too narrow for the robot"
        )
    wanted = min(_MOST_NODES, max(30, int(_NODES_PER_M2 * len(rows) * resolution**2)))
    picked = rng.choice(len(rows), size=min(wanted, len(rows)), replace=False)
    nodes = grid.frame.to_points(rows[picked], cols[picked])

    count = min(_NEIGHBOURS + 1, len(nodes))
    distance, neighbour = cKDTree(nodes).query(nodes, k=count, distance_upper_bound=_FARTHEST)
    pairs = np.column_stack([np.repeat(np.arange(len(nodes)), count), np.ravel(neighbour)])
    is_pair = np.isfinite(np.ravel(distance)) & (np.ravel(distance) > 0.0)
    pairs, length = pairs[is_pair], np.ravel(distance)[is_pair]
    clear = lines_are_clear(nodes[pairs[:, 0]], nodes[pairs[:, 1]], clearance_map, grid, clearance)
    graph = csr_array((length[clear], tuple(pairs[clear].T)), shape=(len(nodes), len(nodes)))
    graph = graph.maximum(graph.T)
    _, component = connected_components(graph, directed=False)
    kept = np.flatnonzero(component == np.bincount(component).argmax())
    return Roadmap(nodes[kept], csr_array(graph[kept][:, kept]), grid, clearance_map, clearance)


def lines_are_clear(
    starts: FloatArray,
    ends: FloatArray,
    clearance_map: Float32Array,
    grid: OccupancyGrid,
    clearance: float,
) -> BoolArray:
    """Mask of those straight drives that keep clear of walls, shape (E,).

    Args:
        starts: (E, 2) [m].
        ends: (E, 2) [m].
        clearance_map: (H, W) [m] distance to the nearest cell that isn't free.
        grid: Where the cells lie.
        clearance: [m] to keep.
    """
    longest = float(np.hypot(*(ends - starts).T).max(initial=0.0))
    steps = max(2, int(np.ceil(longest / (0.5 * grid.frame.resolution))) + 1)
    clear = np.ones(len(starts), dtype=np.bool_)
    for share in np.linspace(
        0.0, 1.0, steps
    ):  # a line is dropped at its first point that is too near
        alive = np.flatnonzero(clear)
        row, col, inside = cells_inside(
            grid.frame, starts[alive] + share * (ends[alive] - starts[alive])
        )
        clear[alive[~inside]] = False
        clear[alive[inside]] = clearance_map[row, col] > clearance
    return clear


def shorten(
    points: FloatArray, clearance_map: Float32Array, grid: OccupancyGrid, clearance: float
) -> FloatArray:
    """Leave out points of a path (M, 2) that a straight drive can skip; the ends stay."""
    kept = [0]
    while kept[-1] < len(points) - 1:
        i = kept[-1]
        ends = points[i + 1 :]
        clear = lines_are_clear(
            np.broadcast_to(points[i], ends.shape), ends, clearance_map, grid, clearance
        )
        clear[0] = True  # a drive of the roadmap itself
        kept.append(i + 1 + int(np.flatnonzero(clear)[-1]))
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
    nodes.insert(0, nodes.pop(int(rng.integers(len(nodes)))))
    distances = dijkstra(roadmap.lengths, indices=nodes)[:, nodes]
    order = np.append(0, nearest_neighbour_tour(distances))
    while two_opt(distances, order):
        pass
    legs = [roadmap.path(nodes[i], nodes[j]) for i, j in itertools.pairwise(order)]
    return np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])


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
