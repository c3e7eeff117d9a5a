"""The table of frontiers: what is known of each, from the map and from the beams that were sent there.

The network that says what frontiers hide (:mod:`slamgym.agents.hidden_floor`) reads it, and so do policies that learn
to choose (:mod:`slamgym.envs.frontier_features`). All of it is belief.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slamgym.core.types import Float32Array, FloatArray
from slamgym.planning.costmap import FARTHEST_WALL, LETHAL_COST, NO_INFORMATION, Costmap
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.frontier_candidates import unknown_regions
from slamgym.planning.frontier_feature_kernels import UnknownRegion
from slamgym.planning.frontiers import Frontier, expected_gain
from slamgym.planning.view_history import ViewHistory

TIME_SCALE = 600.0
"""Robot times are divided by this [s]."""
AREA_SCALE = 100.0
"""Areas of the known floor are divided by this [m2]."""
DISTANCE_SCALE = 10.0
"""Distances from the robot are divided by this [m]."""
FRONTIER_FIGURES = (
    "size", "extent", "room", "known_area", "time", "round", "unknown_near", "unknown_far", "unknown_outside",
    "unknown_enclosed", "unknown_free_border", "unknown_wall_border", "unknown_frontiers", "gain", "clearance",
    "distance", "looks", "nearest_look", "lost", "nearest_lost", "lost_near_by", "passed", "passed_by", "met",
    "nearest_met", "unseen_share", "lost_square",
)  # fmt: skip
"""Figures of a frontier, in the order in which the network takes them in. A look is a beam towards it: lost without
return, passed beyond it, or met something there."""

SHARED_FIGURES = ("known_area", "time", "round", "unseen_share")
"""Those of the :data:`FRONTIER_FIGURES` that are the same for all frontiers."""

_LOOKS = (
    "looks", "nearest_look", "lost", "nearest_lost", "lost_near_by", "passed", "passed_by", "met",
    "nearest_met", "lost_square",
)  # fmt: skip
"""Columns of what became of the beams towards a frontier."""
_LARGEST_AREA = 1000.0
"""A larger known floor counts as this [m2]."""
_LONGEST_TIME = 3600.0
"""A longer exploration counts as this [s]."""
_FARTHEST = 10.0
"""A farther frontier counts as so far [m]."""
_RING = np.array([(-3, 0), (-2, 2), (0, 3), (2, 2), (3, 0), (2, -2), (0, -3), (-2, -2)])
"""Rows and columns of a ring about a cell, by which the side of the unknown is found [cells]."""


@dataclass(frozen=True)
class FrontierMeasures:
    """What is measured of a frontier, before it is scaled."""

    size: float
    """Number of its cells times their side [m]."""
    extent: float
    """Diagonal of the box about the centres of its cells [m]."""
    gain: float
    """Unknown area in sight of its middle [m2]."""
    clearance: float
    """Distance from walls [m]."""
    unknown: UnknownRegion
    """The unknown behind it."""
    cell: float
    """Side of the cells in which the unknown is counted [m]."""


FRONTIER_SCALES: Mapping[str, Callable[[FrontierMeasures], float]] = {
    "size": lambda one: one.size / 3.0,
    "extent": lambda one: one.extent / 3.0,
    "gain": lambda one: one.gain / 15.0,
    "clearance": lambda one: one.clearance / 1.5,
    "unknown_near": lambda one: one.unknown.near * one.cell**2 / 5.0,
    "unknown_far": lambda one: one.unknown.far * one.cell**2 / 20.0,
    "unknown_outside": lambda one: one.unknown.outside,
    "unknown_enclosed": lambda one: one.unknown.is_enclosed,
    "unknown_free_border": lambda one: one.unknown.free * one.cell / 5.0,
    "unknown_wall_border": lambda one: one.unknown.occupied * one.cell / 10.0,
    "unknown_frontiers": lambda one: one.unknown.frontiers / 4.0,
}
"""Figures of a frontier for networks, scaled to about 1: for the policy that chooses a candidate, and for the network
that says what a frontier hides (:mod:`slamgym.agents.hidden_floor`)."""


def scaled_figures(measures: FrontierMeasures) -> dict[str, float]:
    """The figures of :data:`FRONTIER_SCALES`."""
    return {name: scale(measures) for name, scale in FRONTIER_SCALES.items()}


def describe_frontiers(
    loop: ExplorationLoop, views: ViewHistory, frontiers: Sequence[Frontier]
) -> Float32Array:
    """The :data:`FRONTIER_FIGURES` of some frontiers of an exploration with a map, shape (N, figures)."""
    costmap = loop.navigator.costmap
    assert costmap is not None
    cell, regions = unknown_regions(costmap, [one.cells for one in frontiers])
    places = [costmap.frame.to_points(one.cells[:, 0], one.cells[:, 1]) for one in frontiers]
    outward = np.array([outward_of(costmap, one) for one in frontiers])
    beams = views.figures(places, outward).tolist()
    max_range = loop.context.geometry.range_max
    shared = {
        "known_area": min(loop.known_area, _LARGEST_AREA) / AREA_SCALE,
        "time": min(loop.time, _LONGEST_TIME) / TIME_SCALE,
        "round": loop.round,
        "unseen_share": expected_unseen_share(loop),
    }
    rows = []
    for index, frontier in enumerate(frontiers):
        clearance = float(costmap.distance[tuple(frontier.cells.T)].max())  # [cells]
        resolution = costmap.frame.resolution
        measures = FrontierMeasures(
            size=frontier.size * resolution,
            extent=float(np.hypot(*np.ptp(places[index], axis=0))),
            gain=expected_gain(costmap, frontier.middle, max_range),
            clearance=min(clearance * resolution, FARTHEST_WALL),
            unknown=regions[index],
            cell=cell,
        )
        figures = shared | scaled_figures(measures)
        figures["room"] = min(0.5 * frontier.size, clearance) * resolution
        figures["distance"] = min(frontier.min_distance, _FARTHEST) / DISTANCE_SCALE
        figures |= zip(_LOOKS, beams[index], strict=True)
        rows.append([figures[name] for name in FRONTIER_FIGURES])
    return np.array(rows, np.float32)


def outward_of(costmap: Costmap, frontier: Frontier) -> FloatArray:
    """Unit vector from the known to the unknown at a frontier, shape (2,)."""
    height, width = costmap.costs.shape
    around = frontier.cells[:, None] + _RING
    row = np.clip(around[..., 0], 0, height - 1)
    col = np.clip(around[..., 1], 0, width - 1)
    costs = costmap.costs[row, col]
    unknown = (costs == NO_INFORMATION).sum(axis=0)
    passable = (costs < LETHAL_COST).sum(axis=0)
    weights = unknown - 1.0 * passable
    x = float((weights * _RING[:, 1]).sum())
    y = -float((weights * _RING[:, 0]).sum())
    length = math.hypot(x, y)
    if length == 0.0:
        return np.array([1.0, 0.0])
    return np.array([x / length, y / length])


def expected_unseen_share(loop: ExplorationLoop) -> float:
    """Expected unseen share of the floor; 1 where nothing can be said.

    Behind each frontier that the robot fits through, a room as deep as the frontier is wide is expected.
    """
    costmap = loop.navigator.costmap
    space = loop.navigator.reachable
    ways_on = loop.ways_on()
    if ways_on is None or costmap is None or space is None:
        return 1.0
    unseen = sum(float((np.ptp(one.cells, axis=0) ** 2).sum()) for one in ways_on)
    return unseen / (unseen + len(space.order))
