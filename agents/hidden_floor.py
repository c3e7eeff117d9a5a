"""Floor that frontiers hide, predicted from the map and from what the scans met there.

Many frontiers hide nothing: patches of wall that return no beam, slivers behind posts, noise. A small network tells
them from doors by figures of the frontier and of the unknown behind it, and by what became of the beams that were sent
there: lost without return, passed beyond it, or met something there, and from how near.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgym.agents.pretrained_policy import linear_shapes, read_weights
from slamgym.core.errors import InputFileError
from slamgym.core.portable import exp, product
from slamgym.core.types import Float32Array, FloatArray
from slamgym.envs.frontier_features import (
    AREA_SCALE,
    DISTANCE_SCALE,
    TIME_SCALE,
    FrontierMeasures,
    expected_unseen_share,
    scaled_figures,
)
from slamgym.planning.costmap import FARTHEST_WALL, LETHAL_COST, NO_INFORMATION, Costmap
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.frontier_candidates import unknown_regions
from slamgym.planning.frontiers import Frontier, expected_gain
from slamgym.planning.view_history import ViewHistory

HIDDEN_FLOOR = Path(__file__).parent / "pretrained" / "hidden_floor.safetensors"
"""The network that comes with the package."""
AREAS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""The network says how probable it is that a frontier hides at least so much floor [m2]."""
FRONTIER_FIGURES = (
    "size", "extent", "room", "known_area", "time", "round", "unknown_near", "unknown_far", "unknown_outside",
    "unknown_enclosed", "unknown_free_border", "unknown_wall_border", "unknown_frontiers", "gain", "clearance",
    "distance", "looks", "nearest_look", "lost", "nearest_lost", "lost_near_by", "passed", "passed_by", "met",
    "nearest_met", "unseen_share", "lost_square",
)  # fmt: skip
"""Figures of a frontier, in the order in which the network takes them in. A look is a beam towards it: lost without
return, passed beyond it, or met something there."""

FLOOR_LAYERS = {"first": (len(FRONTIER_FIGURES), 64), "second": (64, 32), "out": (32, len(AREAS))}
"""Layers of the network: inputs and outputs."""
DESCRIPTION = ({"env": "hidden floor", "figures": list(FRONTIER_FIGURES)}, {"areas": list(AREAS)})
"""What the weights take in, and what they say."""

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


def describe_frontiers(
    loop: ExplorationLoop, views: ViewHistory, frontiers: Sequence[Frontier]
) -> Float32Array:
    """The :data:`FRONTIER_FIGURES` of some frontiers of an exploration with a map, shape (N, figures)."""
    costmap = loop.navigator.costmap
    assert costmap is not None
    _, cell, regions = unknown_regions(costmap, [one.cells for one in frontiers])
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


@dataclass(frozen=True)
class HiddenFloor:
    """The network, without torch."""

    weights: Mapping[str, Float32Array]
    """Arrays of the layers (:data:`FLOOR_LAYERS`)."""
    risk: float
    """Share of what a promise risks that what is passed over may take, calibrated on other plans."""

    @staticmethod
    def read(path: Path | str = HIDDEN_FLOOR) -> "HiddenFloor":
        """Read a file.

        Raises:
            InputFileError: If it is missing, damaged, or made for other figures.
        """
        shapes = linear_shapes(FLOOR_LAYERS)
        weights, about = read_weights(Path(path), "predictor of hidden floor", DESCRIPTION, shapes)
        risk = about.get("risk") if isinstance(about, dict) else None
        if not isinstance(risk, float) or not 0.0 < risk <= 1.0:
            raise InputFileError(
                Path(path), "doesn't say what share of a risk it may take; train it again"
            )
        return HiddenFloor(weights, risk)

    def chances(self, values: Float32Array) -> FloatArray:
        """Probabilities that frontiers of some figures (N, figures) hide at least :data:`AREAS`, shape (N, areas)."""
        for name in ("first", "second"):
            values = np.maximum(self._linear(name, values), np.float32(0.0))
        logits = self._linear("out", values).astype(np.float64)
        return 1.0 / (1.0 + exp(-logits))

    def _linear(self, name: str, values: Float32Array) -> Float32Array:
        weight = self.weights[f"{name}.weight"]
        return product(values, weight.T) + self.weights[f"{name}.bias"]


def moments(chances: FloatArray, most: float) -> FloatArray:
    """Mean and mean square of what frontiers hide, up to ``most`` [m2] each, shape (2, N) [m2, m4]."""
    # The integrals of the chance to hide more than x, and of 2x times that; between two areas it is their mean.
    ends = np.minimum((0.0, *AREAS, math.inf), most)
    widths = np.diff([ends, ends**2])
    below = np.hstack([chances[:, :1], chances])
    above = np.hstack([chances, chances[:, -1:]])
    between = 0.5 * (below + above)
    return np.cumsum(between * widths[:, None], axis=2)[..., -1]
