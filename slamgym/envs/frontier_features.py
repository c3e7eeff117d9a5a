"""What a policy knows of the frontiers it may choose from: features of each, and of the whole.

All of it is belief: map, believed pose and clock, as the
:class:`~slamgym.planning.exploration_loop.ExplorationLoop` has them. Neither the floor plan, nor the true pose, nor
the true coverage can get in here.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from slamgym.core.types import BoolArray, ByteArray, Float32Array, FloatArray, IntArray, Observation, Pose2D
from slamgym.planning.costmap import Costmap
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.frontier_candidates import COARSENING, FrontierCandidate
from slamgym.planning.frontier_feature_kernels import (
    UnknownRegion,
    classify_costs,
    coarse_cells,
    cut_frontier_crop,
    explore_unknown_region,
)
from slamgym.planning.frontiers import expected_gain
from slamgym.planning.grid_path import tour_lengths
from slamgym.planning.open_tour import lengths_by_first, open_tour
from slamgym.planning.promise import expected_floor, pretrained_unseen_floor

FEATURE_VERSION = 3
"""Raised whenever a feature changes its meaning: weights trained on another version are refused."""

CROP_PX = 13
"""Side of the crop about a candidate [cells]."""
CROP_CELL = 0.35
"""Size of its cells [m]: it shows 2.3 m to every side."""

NEAR_UNKNOWN = 1.5
"""The unknown region behind a frontier is measured up to this distance ... [m]"""
FAR_UNKNOWN = 4.0
"""... and to this one [m]."""

_EXPOSURE_UNIT = 1.5  # [m]
_FARTHEST_WALL = 3.0  # [m]
_LARGEST_EXPECTED = 100.0  # [m2]
_TURN_WEIGHT = 0.2  # what a radian of turning before the first leg of a tour counts, as in the rule [m/rad]
_STRETCH = 0.7  # the direction of a path is taken over so much of it [m]

LIMIT = 10.0
"""Features are cut off here."""


@dataclass(frozen=True)
class _Measured:
    """A candidate and what was measured of it."""

    candidate: FrontierCandidate
    bearing: tuple[float, float]  # its middle, ahead and left of the robot [m]
    turns: tuple[float, float]  # at the start of the path, and from its end to the frontier [rad]
    size: float  # [m]
    extent: float  # [m]
    gain: float  # unknown area in sight [m2]
    cell: float  # side of a cell of the unknown region [m]
    unknown: UnknownRegion
    clearance: float  # distance of its middle from walls [m]
    exposure: float  # mean distance of the path from walls [m]
    others: tuple[float, float]  # distance to the nearest other candidate, and the mean distance [m]
    is_target: bool
    expected: float  # unseen floor behind it by the estimate that promises go by, inf where it has none [m2]
    tour: int  # its position in the shortest tour through all candidates
    tour_detour: float  # how much longer that tour is if it begins here [m]


_CANDIDATE_TABLE: tuple[tuple[str, Callable[[_Measured], float]], ...] = (
    ("path_length", lambda m: m.candidate.path_length / 10.0),
    ("path_cost", lambda m: m.candidate.path_cost / 20.0),
    ("straight_distance", lambda m: m.candidate.frontier.min_distance / 10.0),
    ("ahead", lambda m: m.bearing[0] / 10.0),
    ("left", lambda m: m.bearing[1] / 10.0),
    ("heading_cos", lambda m: math.cos(m.turns[0])),
    ("heading_sin", lambda m: math.sin(m.turns[0])),
    ("heading_change", lambda m: abs(m.turns[0]) / math.pi),
    ("arrival_turn", lambda m: abs(m.turns[1]) / math.pi),
    ("size", lambda m: m.size / 3.0),
    ("extent", lambda m: m.extent / 3.0),
    ("elongation", lambda m: m.extent / max(m.size, 0.1)),
    ("gain", lambda m: m.gain / 15.0),
    ("gain_per_metre", lambda m: m.gain / 10.0 / (1.0 + m.candidate.path_length)),
    ("unknown_near", lambda m: m.unknown.near * m.cell**2 / 5.0),
    ("unknown_far", lambda m: m.unknown.far * m.cell**2 / 20.0),
    ("unknown_outside", lambda m: m.unknown.outside),
    ("unknown_enclosed", lambda m: m.unknown.is_enclosed),
    ("unknown_free_border", lambda m: m.unknown.free * m.cell / 5.0),
    ("unknown_wall_border", lambda m: m.unknown.occupied * m.cell / 10.0),
    ("unknown_frontiers", lambda m: m.unknown.frontiers / 4.0),
    ("clearance", lambda m: m.clearance / 1.5),
    ("doorway", lambda m: float(m.extent < 1.3 and m.clearance < 0.7)),
    ("exposure", lambda m: m.exposure / _EXPOSURE_UNIT),
    ("nearest_other", lambda m: m.others[0] / 5.0),
    ("mean_other", lambda m: m.others[1] / 10.0),
    ("is_target", lambda m: float(m.is_target)),
    ("path_detour", lambda m: m.candidate.path_length / max(m.candidate.frontier.min_distance, 0.5) / 3.0),
    ("expected", lambda m: 0.5 * math.log10(1.0 + 10.0 * min(m.expected, _LARGEST_EXPECTED))),
    ("tour", lambda m: 1.0 / (1.0 + m.tour)),
    ("tour_detour", lambda m: m.tour_detour / 5.0),
)

CANDIDATE_FEATURES: tuple[str, ...] = tuple(name for name, _ in _CANDIDATE_TABLE)
"""Features of each candidate; docs/learning.md explains them."""


class _Overall(NamedTuple):
    """What was measured of the whole exploration."""

    loop: ExplorationLoop
    growth: float  # of the known area, lately [m2/s]
    since_growth: float  # [s]
    since_last: float  # decision [s]
    length: float  # of all candidates' frontiers, as a feature
    gain: float  # of all candidates, as a feature
    width: float  # of what is known [m]
    height: float  # [m]
    unseen: float  # estimated share of the floor


_GLOBAL_TABLE: tuple[tuple[str, Callable[[_Overall], float]], ...] = (
    ("time", lambda o: o.loop.time / 600.0),
    ("known_area", lambda o: o.loop.known_area / 100.0),
    ("growth", lambda o: o.growth),
    ("time_since_growth", lambda o: o.since_growth / 20.0),
    ("last_duration", lambda o: o.since_last / 10.0),
    ("frontiers", lambda o: o.loop.num_frontiers / 16.0),
    ("frontier_length", lambda o: o.length / 5.0),
    ("total_gain", lambda o: o.gain / 5.0),
    ("known_width", lambda o: o.width / 15.0),
    ("known_height", lambda o: o.height / 15.0),
    ("known_share", lambda o: o.loop.known_area / (o.width * o.height)),
    ("ending", lambda o: float(o.loop.round)),
    ("unseen_share", lambda o: 1.0 + 0.25 * math.log10(max(o.unseen, 1e-4))),
)

GLOBAL_FEATURES: tuple[str, ...] = tuple(name for name, _ in _GLOBAL_TABLE)
"""Features of the exploration as a whole."""


class ExtraFeatures(NamedTuple):
    """Further features of candidates, behind those of :data:`CANDIDATE_FEATURES`."""

    names: tuple[str, ...]
    measure: Callable[[ExplorationLoop], FloatArray]
    """Of the loop's candidates in their order, shape (N, names); scaled to a few units, cut off at :data:`LIMIT`."""


def frontier_observation_space(max_candidates: int, extra: ExtraFeatures | None = None) -> spaces.Dict:
    """The space of the observations for K candidates."""
    width = len(CANDIDATE_FEATURES) + (len(extra.names) if extra else 0)
    return spaces.Dict(
        {
            "candidates": spaces.Box(-LIMIT, LIMIT, (max_candidates, width), np.float32),
            "crops": spaces.Box(0.0, 1.0, (max_candidates, 2, CROP_PX, CROP_PX), np.float32),
            "globals": spaces.Box(-LIMIT, LIMIT, (len(GLOBAL_FEATURES),), np.float32),
            "mask": spaces.Box(0.0, 1.0, (max_candidates,), np.float32),
        }
    )


class FrontierFeatures:
    """Makes the observations of one exploration.

    Args:
        max_candidates: K; rows beyond the candidates at hand are zero and masked.
        extra: Further features of each candidate.
    """

    def __init__(self, max_candidates: int, extra: ExtraFeatures | None = None) -> None:
        self._max_candidates, self._extra = max_candidates, extra
        self._history: deque[tuple[float, float]] = deque([(0.0, 0.0)])  # (time, known area) at decisions
        self._grown_at = 0.0

    def restarted(self) -> "FrontierFeatures":
        """For another exploration."""
        return FrontierFeatures(self._max_candidates, self._extra)

    def observe(self, loop: ExplorationLoop) -> Observation:
        """The observation at a decision: features of the loop's candidates, in their order."""
        k, own = self._max_candidates, len(CANDIDATE_FEATURES)
        width = own + (len(self._extra.names) if self._extra else 0)
        observation = {
            "candidates": np.zeros((k, width), np.float32),
            "crops": np.zeros((k, 2, CROP_PX, CROP_PX), np.float32),
            "globals": np.zeros(len(GLOBAL_FEATURES), np.float32),
            "mask": np.zeros(k, np.float32),
        }
        costmap, candidates = loop.navigator.costmap, loop.candidates
        if costmap is None:
            return observation
        rows: FloatArray = np.zeros((0, own))
        if candidates:
            measured = _measure(loop, costmap, observation["crops"])
            rows = np.array([[value(one) for _, value in _CANDIDATE_TABLE] for one in measured])
            observation["candidates"][: len(rows), :own] = np.clip(rows, -LIMIT, LIMIT)
            if self._extra:
                further = np.clip(self._extra.measure(loop), -LIMIT, LIMIT)
                observation["candidates"][: len(rows), own:] = further
            observation["mask"][: len(rows)] = 1.0
        overall = self._measure_whole(loop, costmap, rows)
        values = [value(overall) for _, value in _GLOBAL_TABLE]
        observation["globals"][:] = np.clip(values, -LIMIT, LIMIT)
        return observation

    def _measure_whole(self, loop: ExplorationLoop, costmap: Costmap, rows: FloatArray) -> _Overall:
        time, area = loop.time, loop.known_area
        last_time, last_area = self._history[-1]
        if area > last_area + 0.05:
            self._grown_at = time
        self._history.append((time, area))
        while len(self._history) > 2 and self._history[1][0] <= time - 20.0:
            self._history.popleft()
        since, before = self._history[0]
        frame, remains = costmap.frame, loop.remains()
        return _Overall(
            loop=loop,
            growth=(area - before) / max(time - since, 1.0),
            since_growth=time - self._grown_at,
            since_last=time - last_time,
            length=float(rows[:, CANDIDATE_FEATURES.index("size")].sum()),
            gain=float(rows[:, CANDIDATE_FEATURES.index("gain")].sum()),
            width=max(
                0.1, frame.width_px * frame.resolution - 1.0
            ),  # without the margin about the known part
            height=max(0.1, frame.height_px * frame.resolution - 1.0),
            unseen=pretrained_unseen_floor().share(remains) if remains is not None else 1.0,
        )


def action_mask(observation: Observation) -> BoolArray:
    """Which actions choose a candidate, shape (K,); the first one always counts, so that one is left."""
    mask: BoolArray = observation["mask"] > 0.5
    mask[0] = True
    return mask


def exposures(observation: Observation) -> FloatArray:
    """Mean distance from walls of the path to each candidate, shape (K,) [m]."""
    return observation["candidates"][:, CANDIDATE_FEATURES.index("exposure")] * _EXPOSURE_UNIT


def _measure(loop: ExplorationLoop, costmap: Costmap, crops: Float32Array) -> list[_Measured]:
    """Measure the candidates; fills their crops."""
    candidates, pose = loop.candidates, loop.pose
    classes = classify_costs(costmap.costs, COARSENING)
    labels = np.full(classes.shape, -1, np.int16)
    cells = [coarse_cells(one.frontier.cells, COARSENING, classes.shape) for one in candidates]
    for index, coarse in enumerate(cells):
        labels[coarse[:, 0], coarse[:, 1]] = index
    middles = np.array([one.frontier.middle for one in candidates])
    others = _nearest_and_mean(middles)
    resolution = costmap.frame.resolution
    cell = resolution * COARSENING
    margin = round(0.5 / cell)  # what a costmap keeps about the known part
    steps = _path_steps(costmap)
    expected = _expected(loop)
    tour, tour_detours = _tour(loop, costmap)
    measured = []
    for index, one in enumerate(candidates):
        outward = _outward(one, costmap)
        places = np.empty((1 + len(one.path), 2))
        places[0], places[1:] = one.frontier.middle, one.path
        clearances = _wall_distances(costmap, places)
        _crop(one, outward, classes, costmap, crops[index])
        measured.append(
            _Measured(
                candidate=one,
                bearing=_bearing(one, pose),
                turns=_turns(one, pose, outward, steps),
                size=one.frontier.size * resolution,
                extent=float(np.hypot(*(one.points.max(axis=0) - one.points.min(axis=0)))),
                gain=expected_gain(costmap, one.frontier.middle, loop.context.geometry.range_max),
                cell=cell,
                unknown=explore_unknown_region(
                    classes, labels, index, cells[index],
                    (round(NEAR_UNKNOWN / cell), round(FAR_UNKNOWN / cell)), margin, len(candidates),
                ),
                clearance=float(clearances[0]),
                exposure=float(clearances[1:].sum() / len(one.path)),
                others=others[index],
                is_target=loop.target is not None and one.target == loop.target.target,
                expected=float(expected[index]),
                tour=int(tour[index]),
                tour_detour=float(tour_detours[index]),
            )
        )  # fmt: skip
    return measured


def _expected(loop: ExplorationLoop) -> FloatArray:
    """Unseen floor expected behind each candidate, shape (N,) [m2]."""
    remains = loop.remains()
    if remains is None:
        return np.full(len(loop.candidates), np.inf)
    return expected_floor(remains, [one.points for one in loop.candidates])


def _tour(loop: ExplorationLoop, costmap: Costmap) -> tuple[IntArray, FloatArray]:
    """Position of each candidate in the shortest tour through all of them, and the detour of beginning there [m]."""
    space = loop.navigator.reachable
    assert space is not None
    places = np.array([costmap.frame.to_point(*one.place) for one in loop.candidates], dtype=np.float64)
    lengths = tour_lengths(costmap, space, loop.pose, places, _TURN_WEIGHT)
    order = open_tour(lengths) - 1
    by_first = lengths_by_first(lengths)
    return np.argsort(order), by_first - by_first.min()


def _nearest_and_mean(places: FloatArray) -> list[tuple[float, float]]:
    """Distance of each place, shape (N, 2), to the nearest of the others and to all others in the mean [m]."""
    count = len(places)
    if count == 1:
        return [(10.0, 20.0)]
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    apart = apart[~np.eye(count, dtype=np.bool_)].reshape(count, count - 1)
    return list(zip(apart.min(axis=1).tolist(), apart.mean(axis=1).tolist(), strict=True))


def _bearing(candidate: FrontierCandidate, pose: Pose2D) -> tuple[float, float]:
    """The middle of a frontier, ahead and left of the robot [m]."""
    x, y = candidate.frontier.middle
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    dx, dy = x - pose.x, y - pose.y
    return cos * dx + sin * dy, cos * dy - sin * dx


def _turns(candidate: FrontierCandidate, pose: Pose2D, outward: float, steps: int) -> tuple[float, float]:
    """How much the robot would turn at both ends of the path [rad]; directions are taken over so many ``steps``."""
    path = candidate.path
    ahead = path[min(len(path) - 1, steps)] if len(path) > steps // 2 else np.array(candidate.frontier.middle)
    first = math.remainder(math.atan2(ahead[1] - pose.y, ahead[0] - pose.x) - pose.theta, 2.0 * math.pi)
    before = path[max(0, len(path) - 1 - steps)]
    last = math.atan2(path[-1, 1] - before[1], path[-1, 0] - before[0]) if len(path) > 1 else pose.theta
    return first, math.remainder(outward - last, 2.0 * math.pi)


def _wall_distances(costmap: Costmap, points: FloatArray) -> Float32Array:
    """Distance of points (N, 2) from walls, at most ``_FARTHEST_WALL`` [m].

    A robot localises itself by walls in sight, so the share of the path far from them stands for the pose
    uncertainty that it would bring (Roy et al., "Coastal navigation", 1999).
    """
    frame = costmap.frame
    row, col = frame.to_cell(points[:, 0], points[:, 1])
    there = costmap.distance[np.clip(row, 0, frame.height_px - 1), np.clip(col, 0, frame.width_px - 1)]
    return np.minimum(there * np.float32(frame.resolution), np.float32(_FARTHEST_WALL))


def _outward(candidate: FrontierCandidate, costmap: Costmap) -> float:
    """Direction from where the path ends to the frontier [rad]."""
    x, y = costmap.frame.to_point(*candidate.place)
    dx, dy = candidate.frontier.middle[0] - float(x), candidate.frontier.middle[1] - float(y)
    if math.hypot(dx, dy) < costmap.frame.resolution and len(candidate.path) > 1:
        dx, dy = (
            float(value)
            for value in candidate.path[-1]
            - candidate.path[max(0, len(candidate.path) - 1 - _path_steps(costmap))]
        )
    return math.atan2(dy, dx)


def _path_steps(costmap: Costmap) -> int:
    """Cells of a path that make up the stretch over which its direction is taken."""
    return max(1, round(_STRETCH / (costmap.frame.resolution * COARSENING)))


def _crop(
    candidate: FrontierCandidate, outward: float, classes: ByteArray, costmap: Costmap, crop: Float32Array
) -> None:
    row, col = costmap.frame.to_cell(*candidate.frontier.middle)
    cut_frontier_crop(
        classes,
        float(row) / COARSENING,
        float(col) / COARSENING,
        outward,
        CROP_CELL / (costmap.frame.resolution * COARSENING),
        crop,
    )
