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

from slamgym.core.config import Settings
from slamgym.core.errors import SlamgymError
from slamgym.core.types import FREE, Float32Array, FloatArray, IntArray, OccupancyGrid


class PrmConfig(Settings):
    """Settings of a roadmap."""

    clearance: float = 0.25
    """[m] that the path keeps from everything that is not free: the robot's radius and a margin."""
    nodes_per_m2: float = 4.0
    """Density of the random points over the free space that keeps the clearance."""
    max_nodes: int = 4000
    """Upper limit of their number."""
    neighbours: int = 12
    """Each point tries to join so many nearest points ..."""
    radius: float = 3.0
    """[m] ... within this distance."""


@dataclass(frozen=True)
class Roadmap:
    """Points of the free space and the straight drives between them."""

    nodes: FloatArray  # (N, 2) [m], frame of the grid; all in one connected component
    lengths: "csr_array[np.float64]"  # (N, N) [m] of the drives, symmetric
    grid: OccupancyGrid
    clearance_map: Float32Array  # (H, W) [m] distance to the nearest cell that isn't free
    config: PrmConfig

    def nearest(self, point: Sequence[float] | FloatArray) -> int:
        """The node nearest to ``point`` (2,) [m]."""
        return int(np.argmin(np.hypot(*(self.nodes - np.asarray(point)).T)))

    def path(self, start: int, goal: int) -> FloatArray:
        """Shortest path between two nodes, shortened; points (M, 2) [m]."""
        _, before = dijkstra(self.lengths, indices=[start], return_predecessors=True)
        chain = [goal]
        while chain[-1] != start:
            chain.append(int(before[0, chain[-1]]))
        return shorten(self.nodes[chain[::-1]], self.clearance_map, self.grid, self.config.clearance)


def build_roadmap(grid: OccupancyGrid, config: PrmConfig, rng: np.random.Generator) -> Roadmap:
    """Sample and join points; the largest connected part is kept.

    Raises:
        SlamgymError: If no free space keeps the clearance.
    """
    resolution = grid.frame.resolution
    # A border of the picture counts as a wall: nobody knows what is beyond.
    free = np.pad((grid.cells == FREE).astype(np.uint8), 1)
    clearance_map = cv2.distanceTransform(free, cv2.DIST_L2, 5)[1:-1, 1:-1] * np.float32(resolution)
    rows, cols = np.nonzero(clearance_map > config.clearance)
    if len(rows) < 2:
        raise SlamgymError(
            f"no free space keeps {config.clearance:g} m from the walls; the plan is too narrow for the robot"
        )
    wanted = min(config.max_nodes, max(30, int(config.nodes_per_m2 * len(rows) * resolution**2)))
    picked = rng.choice(len(rows), size=min(wanted, len(rows)), replace=False)
    nodes = np.column_stack(grid.frame.to_point(rows[picked], cols[picked]))

    count = min(config.neighbours + 1, len(nodes))
    distance, neighbour = cKDTree(nodes).query(nodes, k=count, distance_upper_bound=config.radius)
    a = np.repeat(np.arange(len(nodes)), count)
    b, length = np.ravel(neighbour), np.ravel(distance)
    pair = np.isfinite(length) & (length > 0.0)
    a, b, length = a[pair], b[pair], length[pair]
    clear = lines_are_clear(nodes[a], nodes[b], clearance_map, grid, config.clearance)
    a, b, length = a[clear], b[clear], length[clear]
    graph = csr_array((length, (a, b)), shape=(len(nodes), len(nodes)))
    graph = graph.maximum(graph.T)
    _, component = connected_components(graph, directed=False)
    kept = np.flatnonzero(component == np.bincount(component).argmax())
    return Roadmap(nodes[kept], csr_array(graph[kept][:, kept]), grid, clearance_map, config)


def lines_are_clear(
    starts: FloatArray, ends: FloatArray, clearance_map: Float32Array, grid: OccupancyGrid, clearance: float
) -> np.ndarray:
    """Whether straight drives keep clear of walls.

    Args:
        starts: (E, 2) [m].
        ends: (E, 2) [m].
        clearance_map: (H, W) [m] distance to the nearest cell that isn't free.
        grid: Where the cells lie.
        clearance: [m] to keep.

    Returns:
        (E,) bool.
    """
    longest = float(np.hypot(*(ends - starts).T).max(initial=0.0))
    steps = max(2, int(np.ceil(longest / (0.5 * grid.frame.resolution))) + 1)
    clear = np.ones(len(starts), dtype=np.bool_)
    for share in np.linspace(0.0, 1.0, steps):  # a line is dropped at its first point that is too near
        alive = np.flatnonzero(clear)
        points = starts[alive] + share * (ends[alive] - starts[alive])
        row, col = grid.frame.to_cell(points[:, 0], points[:, 1])
        inside = (row >= 0) & (row < grid.frame.height_px) & (col >= 0) & (col < grid.frame.width_px)
        clear[alive[~inside]] = False
        clear[alive[inside]] = clearance_map[row[inside], col[inside]] > clearance
    return clear


def shorten(
    points: FloatArray, clearance_map: Float32Array, grid: OccupancyGrid, clearance: float
) -> FloatArray:
    """Leave out points of a path (M, 2) that a straight drive can skip; the ends stay."""
    kept = [0]
    while kept[-1] < len(points) - 1:
        i = kept[-1]
        later = np.arange(i + 1, len(points))
        clear = lines_are_clear(
            np.broadcast_to(points[i], (len(later), 2)), points[later], clearance_map, grid, clearance
        )
        clear[0] = True  # a drive of the roadmap itself
        kept.append(int(later[np.flatnonzero(clear)[-1]]))
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
    distances = dijkstra(roadmap.lengths, indices=nodes)[:, nodes]
    order = _short_order(distances, int(rng.integers(len(nodes))))
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


def _short_order(distances: FloatArray, first: int) -> IntArray:
    """Order of all stops from ``first``: nearest next, then 2-opt exchanges while they shorten the tour."""
    left = set(range(len(distances))) - {first}
    order = [first]
    while left:
        order.append(min(left, key=lambda stop: distances[order[-1], stop]))
        left.remove(order[-1])
    best = np.array(order)
    improved = True
    while improved:
        improved = False
        for i in range(1, len(best) - 1):
            for j in range(i + 1, len(best)):
                tail = distances[best[j], best[j + 1]] if j + 1 < len(best) else 0.0
                swapped = distances[best[i], best[j + 1]] if j + 1 < len(best) else 0.0
                before = distances[best[i - 1], best[i]] + tail
                after = distances[best[i - 1], best[j]] + swapped
                if after < before - 1e-9:
                    best[i : j + 1] = best[i : j + 1][::-1]
                    improved = True
    return best
