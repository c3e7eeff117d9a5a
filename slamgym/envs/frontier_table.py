"""The table of frontiers: what is known of each, from the map and from the beams that were sent there.

The network that says what frontiers hide (:mod:`slamgym.agents.hidden_floor`) reads it, and so do policies that learn
to choose (:mod:`slamgym.envs.frontier_features`). All of it is belief.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slamgym.core.types import Float32Array, FloatArray
from slamgym.planning.costmap import FARTHEST_WALL, LETHAL_COST, NO_INFORMATION, Costmap
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.frontier_candidates import Runs, unknown_regions
from slamgym.planning.frontiers import Frontier, expected_gains

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


FRONTIER_SCALES: Mapping[str, float] = {
    "size": 3.0,
    "extent": 3.0,
    "gain": 15.0,
    "clearance": 1.5,
    "unknown_near": 5.0,
    "unknown_far": 20.0,
    "unknown_outside": 1.0,
    "unknown_enclosed": 1.0,
    "unknown_free_border": 5.0,
    "unknown_wall_border": 10.0,
    "unknown_frontiers": 4.0,
}
"""What figures of a frontier are divided by, so that they are about 1: lengths [m], areas [m2] and counts."""


def describe_frontiers(loop: ExplorationLoop, frontiers: Sequence[Frontier]) -> Float32Array:
    """The :data:`FRONTIER_FIGURES` of some frontiers of an exploration with a map, at least one, (N, figures)."""
    costmap = loop.navigator.costmap
    assert costmap is not None
    runs = Runs.of([one.cells for one in frontiers])
    points = costmap.frame.to_points(*runs.cells.T)
    figures: dict[str, Any] = {
        "known_area": min(loop.known_area, _LARGEST_AREA) / AREA_SCALE,
        "time": min(loop.time, _LONGEST_TIME) / TIME_SCALE,
        "round": loop.round,
        "unseen_share": expected_unseen_share(loop),
    }
    measures = _measure(costmap, runs, frontiers, loop.context.geometry.range_max)
    measures["extent"] = np.hypot(*runs.spread(points).T)
    figures |= {name: measures[name] / scale for name, scale in FRONTIER_SCALES.items()}
    figures["room"] = measures["room"]
    distances = np.array([one.min_distance for one in frontiers])
    figures["distance"] = np.minimum(distances, _FARTHEST) / DISTANCE_SCALE
    beams = loop.belief.views.figures(points, runs.starts, outward_of(costmap, runs))
    figures |= zip(_LOOKS, beams.T, strict=True)
    table = np.empty((len(frontiers), len(FRONTIER_FIGURES)), np.float32)
    for column, name in enumerate(FRONTIER_FIGURES):
        table[:, column] = figures[name]
    return table


def _measure(
    costmap: Costmap, runs: Runs, frontiers: Sequence[Frontier], max_range: float
) -> dict[str, FloatArray]:
    """What the map says of frontiers, shapes (N,) [m, m2]: all but their extent."""
    resolution = costmap.frame.resolution
    distances = costmap.distance[tuple(runs.cells.T)]
    clearance = np.maximum.reduceat(distances, runs.starts[:-1]).astype(np.float64)  # [cells]
    sizes = np.diff(runs.starts)
    unknown, cell = unknown_regions(costmap, runs)
    near, far, outside, is_enclosed, free, occupied, others = unknown.T
    return {
        "size": sizes * resolution,
        "room": np.minimum(0.5 * sizes, clearance) * resolution,
        "clearance": np.minimum(clearance * resolution, FARTHEST_WALL),
        "gain": expected_gains(costmap, [one.middle for one in frontiers], max_range),
        "unknown_near": near * cell**2,
        "unknown_far": far * cell**2,
        "unknown_outside": outside,
        "unknown_enclosed": is_enclosed,
        "unknown_free_border": free * cell,
        "unknown_wall_border": occupied * cell,
        "unknown_frontiers": others,
    }


def outward_of(costmap: Costmap, runs: Runs) -> FloatArray:
    """Unit vectors from the known to the unknown at frontiers, shape (N, 2)."""
    height, width = costmap.costs.shape
    around = runs.cells[:, None] + _RING
    row = np.clip(around[..., 0], 0, height - 1)
    col = np.clip(around[..., 1], 0, width - 1)
    costs = costmap.costs[row, col]
    is_unknown = (costs == NO_INFORMATION).astype(np.int64)
    sides = np.add.reduceat(is_unknown - (costs < LETHAL_COST), runs.starts[:-1], axis=0)
    down, right = (sides[:, :, None] * _RING).sum(axis=1).T.tolist()
    outward = []
    for x, y in zip(right, down, strict=True):
        length = math.hypot(x, y)
        outward.append((x / length, -y / length) if length else (1.0, 0.0))
    return np.array(outward)


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
