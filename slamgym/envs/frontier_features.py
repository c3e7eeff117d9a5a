"""Features of the frontiers that a policy may choose from, and of the whole exploration.

All of it is belief: map, believed pose and clock, as the
:class:`~slamgym.planning.exploration_loop.ExplorationLoop` has them. Neither the floor plan, nor the true pose, nor
the true coverage can get in here.
"""

import math
from collections import deque

import numpy as np
from gymnasium import spaces

from slamgym.core.geometry import between
from slamgym.core.types import Float32Array, FloatArray, Observation, Pose2D
from slamgym.planning.costmap import FARTHEST_WALL, Costmap
from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.frontier_candidates import COARSENING, FrontierCandidate, unknown_regions
from slamgym.planning.frontier_feature_kernels import cut_frontier_crop
from slamgym.planning.frontiers import expected_gain, fits_through
from slamgym.planning.grid_path import CoarsePaths, PathLengths
from slamgym.planning.open_tour import lengths_by_first, open_tour

FEATURE_VERSION = 3
"""Raised whenever a feature changes its meaning: weights trained on another version are refused."""

CROP_PX = 13
"""Side of the crop about a candidate [cells]."""
CROP_CELL = 0.35
"""Size of its cells [m]: it shows 2.3 m to every side."""

_STRETCH = 0.7  # the direction of a path is taken over so much of it [m]

TURN_WEIGHT = 0.2
"""Cost of a radian of turning before the first leg of a tour [m/rad]: the speed of 0.26 m/s over 1.2 rad/s."""
LIMIT = 10.0
"""Features are cut off here."""


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
        self._history: deque[tuple[float, float]] = deque(
            [(0.0, 0.0)]
        )  # (time, known area) at decisions
        self._grown_at = 0.0

    def observe(self, loop: ExplorationLoop) -> Observation:
        """The observation at a decision: features of the loop's candidates, in their order."""
        observation = {name: np.zeros(shape, np.float32) for name, shape in self._shapes.items()}
        costmap, candidates = loop.navigator.costmap, loop.candidates
        if costmap is None:
            return observation
        rows: FloatArray = np.zeros((0, len(CANDIDATE_FEATURES)))
        if candidates:
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
        time, area = loop.time, loop.known_area
        last_time, last_area = self._history[-1]
        if area > last_area + 0.05:
            self._grown_at = time
        self._history.append((time, area))
        while len(self._history) > 2 and self._history[1][0] <= time - 20.0:
            self._history.popleft()
        since, before = self._history[0]
        # Without the margin about the known part.
        height, width = (
            max(0.1, size * costmap.frame.resolution - 1.0) for size in costmap.frame.shape
        )
        return {
            "time": time / 600.0,
            "known_area": area / 100.0,
            "growth": (area - before) / max(time - since, 1.0),
            "time_since_growth": (time - self._grown_at) / 20.0,
            "last_duration": (time - last_time) / 10.0,
            "frontiers": loop.num_frontiers / 16.0,
            "frontier_length": float(rows[:, CANDIDATE_FEATURES.index("size")].sum()) / 5.0,
            "total_gain": float(rows[:, CANDIDATE_FEATURES.index("gain")].sum()) / 5.0,
            "known_width": width / 15.0,
            "known_height": height / 15.0,
            "known_share": area / (width * height),
            "ending": float(loop.round),
            "unseen_share": 1.0 + 0.25 * math.log10(max(expected_unseen_share(loop), 1e-4)),
        }


def expected_unseen_share(loop: ExplorationLoop) -> float:
    """Expected unseen share of the floor; 1 where nothing can be said.

    Behind each frontier that the robot fits through, a room as deep as the frontier is wide is expected.
    """
    costmap, space, ways_on = loop.navigator.costmap, loop.navigator.reachable, loop.ways_on()
    if ways_on is None or costmap is None or space is None:
        return 1.0
    unseen = sum(float((np.ptp(one.cells, axis=0) ** 2).sum()) for one in ways_on)
    return unseen / (unseen + len(space.order))


def _measure(
    loop: ExplorationLoop, costmap: Costmap, crops: Float32Array
) -> list[dict[str, float]]:
    """Features of the candidates; fills their crops."""
    candidates, pose, resolution = loop.candidates, loop.pose, costmap.frame.resolution
    classes, cell, regions = unknown_regions(costmap, [one.frontier.cells for one in candidates])
    others = _nearest_and_mean(np.array([one.frontier.middle for one in candidates]))
    steps = max(1, round(_STRETCH / cell))  # of a path, over which its direction is taken
    lengths = candidate_tour_lengths(loop, PathLengths())
    tour, by_first = np.argsort(open_tour(lengths)), lengths_by_first(lengths)
    measured = []
    for index, one in enumerate(candidates):
        outward = _outward(one, costmap, steps)
        places = np.empty((1 + len(one.path), 2))
        places[0], places[1:] = one.frontier.middle, one.path
        clearances = _wall_distances(costmap, places)
        row, col = (
            float(place) / COARSENING for place in costmap.frame.to_cell(*one.frontier.middle)
        )
        cut_frontier_crop(classes, row, col, outward, CROP_CELL / cell, crops[index])
        ahead, left, _ = between(pose, Pose2D(*one.frontier.middle, 0.0))
        turn, arrival = _turns(one, pose, outward, steps)
        length, straight, clearance = (
            one.path_length,
            one.frontier.min_distance,
            float(clearances[0]),
        )
        size, unknown = one.frontier.size * resolution, regions[index]
        extent = float(np.hypot(*(one.points.max(axis=0) - one.points.min(axis=0))))
        behind = (
            extent**2 if fits_through(costmap, one.frontier, loop.context.robot_radius) else 0.0
        )
        gain = expected_gain(costmap, one.frontier.middle, loop.context.geometry.range_max)
        measured.append(
            {
                "path_length": length / 10.0,
                "path_cost": one.path_cost / 20.0,
                "straight_distance": straight / 10.0,
                "ahead": ahead / 10.0,
                "left": left / 10.0,
                "heading_cos": math.cos(turn),
                "heading_sin": math.sin(turn),
                "heading_change": abs(turn) / math.pi,
                "arrival_turn": abs(arrival) / math.pi,
                "size": size / 3.0,
                "extent": extent / 3.0,
                "elongation": extent / max(size, 0.1),
                "gain": gain / 15.0,
                "gain_per_metre": gain / 10.0 / (1.0 + length),
                "unknown_near": unknown.near * cell**2 / 5.0,
                "unknown_far": unknown.far * cell**2 / 20.0,
                "unknown_outside": unknown.outside,
                "unknown_enclosed": unknown.is_enclosed,
                "unknown_free_border": unknown.free * cell / 5.0,
                "unknown_wall_border": unknown.occupied * cell / 10.0,
                "unknown_frontiers": unknown.frontiers / 4.0,
                "clearance": clearance / 1.5,
                "doorway": float(extent < 1.3 and clearance < 0.7),
                "exposure": float(clearances[1:].sum() / len(one.path)) / 1.5,
                "nearest_other": others[index][0] / 5.0,
                "mean_other": others[index][1] / 10.0,
                "is_target": float(loop.target is not None and one.target == loop.target.target),
                "path_detour": length / max(straight, 0.5) / 3.0,
                "expected": 0.5 * math.log10(1.0 + 10.0 * behind),
                "tour": 1.0 / (1.0 + int(tour[index])),
                "tour_detour": float(by_first[index] - by_first.min()) / 5.0,
            }
        )
    return measured


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
    costmap, space = loop.navigator.costmap, loop.navigator.reachable
    assert costmap is not None
    assert space is not None
    paths, places = CoarsePaths(costmap, space), candidate_places(loop)
    return known.matrix(paths, loop.pose, places, TURN_WEIGHT)


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
    ahead = (
        path[min(len(path) - 1, steps)]
        if len(path) > steps // 2
        else np.array(candidate.frontier.middle)
    )
    first = math.remainder(
        math.atan2(ahead[1] - pose.y, ahead[0] - pose.x) - pose.theta, 2.0 * math.pi
    )
    before = path[max(0, len(path) - 1 - steps)]
    last = (
        math.atan2(path[-1, 1] - before[1], path[-1, 0] - before[0])
        if len(path) > 1
        else pose.theta
    )
    return first, math.remainder(outward - last, 2.0 * math.pi)


def _wall_distances(costmap: Costmap, points: FloatArray) -> Float32Array:
    """Distance of points (N, 2) from walls, at most ``FARTHEST_WALL`` [m].

    A robot localises itself by walls in sight, so the share of the path far from them stands for the pose
    uncertainty that it would bring (Roy et al., "Coastal navigation", 1999).
    """
    frame = costmap.frame
    row, col = frame.to_cell(points[:, 0], points[:, 1])
    there = costmap.distance[
        np.clip(row, 0, frame.height_px - 1), np.clip(col, 0, frame.width_px - 1)
    ]
    return np.minimum(there * np.float32(frame.resolution), np.float32(FARTHEST_WALL))


def _outward(candidate: FrontierCandidate, costmap: Costmap, steps: int) -> float:
    """Direction from where the path ends to the frontier [rad]."""
    x, y = costmap.frame.to_point(*candidate.place)
    dx, dy = candidate.frontier.middle[0] - float(x), candidate.frontier.middle[1] - float(y)
    path = candidate.path
    if math.hypot(dx, dy) < costmap.frame.resolution and len(path) > 1:
        dx, dy = (path[-1] - path[max(0, len(path) - 1 - steps)]).tolist()
    return math.atan2(dy, dx)
