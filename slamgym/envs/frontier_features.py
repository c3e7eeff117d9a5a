"""Features of the frontiers that a policy may choose from, and of the whole exploration.

All of it is belief: map, believed pose and clock, as the
:class:`~slamgym.planning.exploration_loop.ExplorationLoop` has them. Neither the floor plan, nor the true pose, nor
the true coverage can get in here.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

from slamgym.core.geometry import between
from slamgym.core.types import Float32Array, FloatArray, Observation, Pose2D
from slamgym.planning.costmap import FARTHEST_WALL, Costmap
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.frontier_candidates import COARSENING, FrontierCandidate, unknown_regions
from slamgym.planning.frontier_feature_kernels import UnknownRegion, cut_frontier_crop
from slamgym.planning.frontiers import expected_gain, fits_through
from slamgym.planning.grid_path import CoarsePaths, PathLengths
from slamgym.planning.open_tour import lengths_by_first, open_tour

FEATURE_VERSION = 3
"""Raised whenever a feature changes its meaning: weights trained on another version are refused."""

CROP_PX = 13
"""Side of the crop about a candidate [cells]."""
CROP_CELL = 0.35
"""Size of its cells [m]: it shows 2.3 m to every side."""

_STRETCH = 0.7
"""The direction of a path is taken over so much of it [m]."""

TURN_WEIGHT = 0.2
"""Cost of a radian of turning before the first leg of a tour [m/rad]: the speed of 0.26 m/s over 1.2 rad/s."""
LIMIT = 10.0
"""Features are cut off here."""
TIME_SCALE = 600.0
"""Robot times are divided by this [s]."""
AREA_SCALE = 100.0
"""Areas of the known floor are divided by this [m2]."""
DISTANCE_SCALE = 10.0
"""Distances from the robot are divided by this [m]."""


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


CANDIDATE_FEATURES: tuple[str, ...] = (
    "path_length", "path_cost", "straight_distance", "ahead", "left", "heading_cos", "heading_sin",
    "heading_change", "arrival_turn", "size", "extent", "elongation", "gain", "gain_per_metre", "unknown_near",
    "unknown_far", "unknown_outside", "unknown_enclosed", "unknown_free_border", "unknown_wall_border",
    "unknown_frontiers", "clearance", "doorway", "exposure", "nearest_other", "mean_other", "is_target",
    "path_detour", "expected", "tour", "tour_detour",
)  # fmt: skip
"""Features of each candidate, as :func:`_measure` scales them."""

GLOBAL_FEATURES: tuple[str, ...] = (
    "time", "known_area", "growth", "time_since_growth", "last_duration", "frontiers", "frontier_length",
    "total_gain", "known_width", "known_height", "known_share", "ending", "unseen_share",
)  # fmt: skip
"""Features of the exploration as a whole."""


class FrontierFeatures:
    """Makes the observations of one exploration.

    Args:
        max_candidates: K; rows beyond the candidates at hand are zero and masked.

    Attributes:
        space: Of the observations.
    """

    def __init__(self, max_candidates: int) -> None:
        k = max_candidates
        self.space = spaces.Dict(
            {
                "candidates": spaces.Box(-LIMIT, LIMIT, (k, len(CANDIDATE_FEATURES)), np.float32),
                "crops": spaces.Box(0.0, 1.0, (k, 2, CROP_PX, CROP_PX), np.float32),
                "globals": spaces.Box(-LIMIT, LIMIT, (len(GLOBAL_FEATURES),), np.float32),
                "mask": spaces.Box(0.0, 1.0, (k,), np.float32),
            }
        )
        self._shapes = {name: box.shape or () for name, box in self.space.items()}
        # Time and known area at decisions.
        self._history: deque[tuple[float, float]] = deque([(0.0, 0.0)])
        self._grown_at = 0.0

    def observe(self, loop: ExplorationLoop) -> Observation:
        """The observation at a decision: features of the loop's candidates, in their order."""
        observation = {name: np.zeros(shape, np.float32) for name, shape in self._shapes.items()}
        costmap = loop.navigator.costmap
        if costmap is None:
            return observation
        rows: FloatArray = np.zeros((0, len(CANDIDATE_FEATURES)))
        if loop.candidates:
            measured = _measure(loop, costmap, observation["crops"])
            rows = np.array([[one[name] for name in CANDIDATE_FEATURES] for one in measured])
            observation["candidates"][: len(rows)] = np.clip(rows, -LIMIT, LIMIT)
            observation["mask"][: len(rows)] = 1.0
        whole = self._measure_whole(loop, costmap, rows)
        observation["globals"][:] = np.clip(
            [whole[name] for name in GLOBAL_FEATURES], -LIMIT, LIMIT
        )
        return observation

    def _measure_whole(
        self, loop: ExplorationLoop, costmap: Costmap, rows: FloatArray
    ) -> dict[str, float]:
        """Features of the whole, given those of the candidates, shape (N, len(CANDIDATE_FEATURES))."""
        time = loop.time
        area = loop.known_area
        last_time, last_area = self._history[-1]
        if area > last_area + 0.05:
            self._grown_at = time
        self._history.append((time, area))
        while len(self._history) > 2 and self._history[1][0] <= time - 20.0:
            self._history.popleft()
        since, before = self._history[0]
        height, width = _known_size(costmap)
        unseen_share = max(expected_unseen_share(loop), 1e-4)
        return {
            "time": time / TIME_SCALE,
            "known_area": area / AREA_SCALE,
            "growth": (area - before) / max(time - since, 1.0),
            "time_since_growth": (time - self._grown_at) / 20.0,
            "last_duration": (time - last_time) / 10.0,
            "frontiers": loop.num_frontiers / 16.0,
            "frontier_length": _total(rows, "size") / 5.0,
            "total_gain": _total(rows, "gain") / 5.0,
            "known_width": width / 15.0,
            "known_height": height / 15.0,
            "known_share": area / (width * height),
            "ending": float(loop.round),
            "unseen_share": 1.0 + 0.25 * math.log10(unseen_share),
        }


def _known_size(costmap: Costmap) -> tuple[float, float]:
    """Height and width of the known part, without the margin that a costmap has about it [m]."""
    height, width = costmap.frame.shape
    resolution = costmap.frame.resolution
    return max(0.1, height * resolution - 1.0), max(0.1, width * resolution - 1.0)


def _total(rows: FloatArray, name: str) -> float:
    """Sum of a feature over the candidates."""
    return float(rows[:, CANDIDATE_FEATURES.index(name)].sum())


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


def _measure(
    loop: ExplorationLoop, costmap: Costmap, crops: Float32Array
) -> list[dict[str, float]]:
    """Features of the candidates; fills their crops."""
    candidates = loop.candidates
    classes, cell, regions = unknown_regions(costmap, [one.frontier.cells for one in candidates])
    others = _nearest_and_mean(np.array([one.frontier.middle for one in candidates]))
    steps = max(1, round(_STRETCH / cell))  # of a path, over which its direction is taken
    lengths = candidate_tour_lengths(loop, PathLengths())
    ranks = np.argsort(open_tour(lengths))
    by_first = lengths_by_first(lengths)
    measured = []
    for index, one in enumerate(candidates):
        outward = _outward(one, costmap, steps)
        row, col = costmap.frame.to_cell(*one.frontier.middle)
        crop_row = float(row) / COARSENING
        crop_col = float(col) / COARSENING
        cut_frontier_crop(classes, crop_row, crop_col, outward, CROP_CELL / cell, crops[index])
        nearest, mean = others[index]
        is_target = loop.target is not None and one.target == loop.target.target
        measured.append(
            {
                **_figures_of_place(one, loop, costmap, regions[index], cell),
                **_figures_of_way(one, loop.pose, outward, steps),
                "nearest_other": nearest / 5.0,
                "mean_other": mean / 10.0,
                "is_target": float(is_target),
                "tour": 1.0 / (1.0 + int(ranks[index])),
                "tour_detour": float(by_first[index] - by_first.min()) / 5.0,
            }
        )
    return measured


def _figures_of_place(
    one: FrontierCandidate,
    loop: ExplorationLoop,
    costmap: Costmap,
    unknown: UnknownRegion,
    cell: float,
) -> dict[str, float]:
    """Features of a candidate's frontier, of what lies behind it, and of the walls about it.

    Args:
        one: The candidate.
        loop: The exploration.
        costmap: Its map.
        unknown: The unknown behind the frontier.
        cell: Side of the cells in which that is counted [m].
    """
    frontier = one.frontier
    clearances = _wall_distances(costmap, np.vstack([frontier.middle, one.path]))
    exposure = float(clearances[1:].sum() / len(one.path))
    clearance = float(clearances[0])
    size = frontier.size * costmap.frame.resolution
    extent = float(np.hypot(*np.ptp(one.points, axis=0)))
    gain = expected_gain(costmap, frontier.middle, loop.context.geometry.range_max)
    measures = FrontierMeasures(size, extent, gain, clearance, unknown, cell)
    is_way_on = fits_through(costmap, frontier, loop.context.robot_radius)
    room_behind = extent**2 if is_way_on else 0.0  # as deep as the frontier is wide [m2]
    return {
        **scaled_figures(measures),
        "elongation": extent / max(size, 0.1),
        "gain_per_metre": gain / 10.0 / (1.0 + one.path_length),
        "doorway": float(extent < 1.3 and clearance < 0.7),
        "exposure": exposure / 1.5,
        "expected": 0.5 * math.log10(1.0 + 10.0 * room_behind),
    }


def _figures_of_way(
    one: FrontierCandidate, pose: Pose2D, outward: float, steps: int
) -> dict[str, float]:
    """Features of the way to a candidate; see :func:`_turns` for the arguments."""
    ahead, left, _ = between(pose, Pose2D(*one.frontier.middle, 0.0))
    turn, arrival = _turns(one, pose, outward, steps)
    length = one.path_length
    straight = one.frontier.min_distance
    return {
        "path_length": length / DISTANCE_SCALE,
        "path_cost": one.path_cost / 20.0,
        "straight_distance": straight / DISTANCE_SCALE,
        "path_detour": length / max(straight, 0.5) / 3.0,
        "ahead": ahead / DISTANCE_SCALE,
        "left": left / DISTANCE_SCALE,
        "heading_cos": math.cos(turn),
        "heading_sin": math.sin(turn),
        "heading_change": abs(turn) / math.pi,
        "arrival_turn": abs(arrival) / math.pi,
    }


def candidate_places(loop: ExplorationLoop) -> FloatArray:
    """Where the paths to the candidates end, map frame, shape (N, 2) [m]."""
    costmap = loop.navigator.costmap
    assert costmap is not None
    rows, cols = np.array([candidate.place for candidate in loop.candidates]).T
    return np.column_stack(costmap.frame.to_point(rows, cols))


def candidate_tour_lengths(loop: ExplorationLoop, known: PathLengths) -> FloatArray:
    """Path lengths between the robot and the candidates, shape (N + 1, N + 1) [m]; turning to the first counts, too.

    Args:
        loop: An exploration with a map.
        known: Lengths that were found before, to which these are added.
    """
    costmap = loop.navigator.costmap
    space = loop.navigator.reachable
    assert costmap is not None
    assert space is not None
    paths = CoarsePaths(costmap, space)
    return known.matrix(paths, loop.pose, candidate_places(loop), TURN_WEIGHT)


def _nearest_and_mean(places: FloatArray) -> list[tuple[float, float]]:
    """Distance of each place, shape (N, 2), to the nearest of the others and to all others in the mean [m]."""
    count = len(places)
    if count == 1:
        return [(10.0, 20.0)]
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    apart = apart[~np.eye(count, dtype=np.bool_)].reshape(count, count - 1)
    return list(zip(apart.min(axis=1).tolist(), apart.mean(axis=1).tolist(), strict=True))


def _turns(
    candidate: FrontierCandidate, pose: Pose2D, outward: float, steps: int
) -> tuple[float, float]:
    """Turns of the robot at both ends of the path [rad]; directions are taken over so many ``steps``."""
    path = candidate.path
    ahead = np.array(candidate.frontier.middle)
    if len(path) > steps // 2:
        ahead = path[min(len(path) - 1, steps)]
    heading = math.atan2(ahead[1] - pose.y, ahead[0] - pose.x)
    turn = math.remainder(heading - pose.theta, 2.0 * math.pi)
    last_heading = pose.theta
    if len(path) > 1:
        before = path[max(0, len(path) - 1 - steps)]
        last_heading = math.atan2(path[-1, 1] - before[1], path[-1, 0] - before[0])
    return turn, math.remainder(outward - last_heading, 2.0 * math.pi)


def _wall_distances(costmap: Costmap, points: FloatArray) -> Float32Array:
    """Distance of points (N, 2) from walls, at most ``FARTHEST_WALL`` [m].

    A robot localises itself by walls in sight, so the share of the path far from them stands for the pose
    uncertainty that it would bring (Roy et al., "Coastal navigation", 1999).
    """
    frame = costmap.frame
    row, col = frame.to_cell(points[:, 0], points[:, 1])
    row = np.clip(row, 0, frame.height_px - 1)
    col = np.clip(col, 0, frame.width_px - 1)
    metres = costmap.distance[row, col] * np.float32(frame.resolution)
    return np.minimum(metres, np.float32(FARTHEST_WALL))


def _outward(candidate: FrontierCandidate, costmap: Costmap, steps: int) -> float:
    """Direction from where the path ends to the frontier [rad]."""
    x, y = costmap.frame.to_point(*candidate.place)
    dx = candidate.frontier.middle[0] - float(x)
    dy = candidate.frontier.middle[1] - float(y)
    path = candidate.path
    if math.hypot(dx, dy) < costmap.frame.resolution and len(path) > 1:
        dx, dy = (path[-1] - path[max(0, len(path) - 1 - steps)]).tolist()
    return math.atan2(dy, dx)
