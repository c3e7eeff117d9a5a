"""What a policy knows of the frontiers it may choose from: features of each, and of the whole.

All of it is belief: map, believed pose and clock, as :class:`~slamgym.planning.frontier_driver.FrontierDriver`
has them. Neither the floor plan, nor the true pose, nor the true coverage can get in here.
"""

import math
from collections import deque
from typing import Any

import numpy as np
from gymnasium import spaces

from slamgym.core.types import BoolArray, ByteArray, Float32Array, FloatArray, Pose2D
from slamgym.envs.frontier_feature_kernels import classify, cut_frontier_crop, explore_pocket
from slamgym.planning.costmap import Costmap
from slamgym.planning.frontier_candidates import COARSENING, Candidate
from slamgym.planning.frontier_driver import FrontierDriver
from slamgym.planning.frontiers import expected_gain

FEATURE_VERSION = 1
"""Raised whenever a feature changes its meaning: weights trained on another version are refused."""

CROP_PX = 13
"""Side of the crop about a candidate [cells]."""
CROP_CELL = 0.35
"""Size of its cells [m]: it shows 2.3 m to every side."""

NEAR_POCKET = 1.5
"""The unknown behind a frontier is measured up to this distance ... [m]"""
FAR_POCKET = 4.0
"""... and to this one [m]."""

_EXPOSURE_UNIT = 1.5  # [m]
_STRETCH = 0.7  # the direction of a path is taken over so much of it [m]

LIMIT = 10.0
"""Features are cut off here."""

CANDIDATE_FEATURES: tuple[str, ...] = (
    "path_length",
    "path_cost",
    "straight_distance",
    "ahead",
    "left",
    "heading_cos",
    "heading_sin",
    "heading_change",
    "arrival_turn",
    "size",
    "extent",
    "elongation",
    "gain",
    "gain_per_way",
    "pocket_near",
    "pocket_far",
    "pocket_outside",
    "pocket_enclosed",
    "pocket_free_border",
    "pocket_wall_border",
    "pocket_others",
    "clearance",
    "doorway",
    "exposure",
    "nearest_other",
    "mean_other",
    "is_target",
    "path_detour",
)
"""Features of each candidate; docs/learning.md explains them."""

GLOBAL_FEATURES: tuple[str, ...] = (
    "time",
    "known_area",
    "growth",
    "time_since_growth",
    "last_duration",
    "frontiers",
    "frontier_length",
    "total_gain",
    "known_width",
    "known_height",
    "known_share",
    "ending",
)
"""Features of the exploration as a whole."""

Observation = dict[str, Any]


def frontier_observation_space(max_candidates: int) -> spaces.Dict:
    """The space of the observations for K candidates."""
    return spaces.Dict(
        {
            "candidates": spaces.Box(-LIMIT, LIMIT, (max_candidates, len(CANDIDATE_FEATURES)), np.float32),
            "crops": spaces.Box(0.0, 1.0, (max_candidates, 2, CROP_PX, CROP_PX), np.float32),
            "globals": spaces.Box(-LIMIT, LIMIT, (len(GLOBAL_FEATURES),), np.float32),
            "mask": spaces.Box(0.0, 1.0, (max_candidates,), np.float32),
        }
    )


class FrontierFeatures:
    """Makes the observations of one exploration.

    Args:
        max_candidates: K; rows beyond the candidates at hand are zero and masked.
    """

    def __init__(self, max_candidates: int) -> None:
        self._max_candidates = max_candidates
        self._history: deque[tuple[float, float]] = deque([(0.0, 0.0)])  # (time, known area) at decisions
        self._grown_at = 0.0

    def observe(self, driver: FrontierDriver) -> Observation:
        """The observation at a decision: features of the driver's candidates, in their order."""
        k = self._max_candidates
        observation = {
            "candidates": np.zeros((k, len(CANDIDATE_FEATURES)), np.float32),
            "crops": np.zeros((k, 2, CROP_PX, CROP_PX), np.float32),
            "globals": np.zeros(len(GLOBAL_FEATURES), np.float32),
            "mask": np.zeros(k, np.float32),
        }
        costmap, candidates = driver.navigator.costmap, driver.candidates
        if costmap is None:
            return observation
        rows: FloatArray = np.zeros((0, len(CANDIDATE_FEATURES)))
        if candidates:
            rows = _candidate_rows(driver, costmap, observation["crops"])
            observation["candidates"][: len(rows)] = np.clip(rows, -LIMIT, LIMIT)
            observation["mask"][: len(rows)] = 1.0
        overall = self._global_row(driver, costmap, rows)
        observation["globals"][:] = np.clip(overall, -LIMIT, LIMIT)
        return observation

    def _global_row(self, driver: FrontierDriver, costmap: Costmap, rows: FloatArray) -> list[float]:
        time, area = driver.time, driver.known_area
        last_time, last_area = self._history[-1]
        if area > last_area + 0.05:
            self._grown_at = time
        self._history.append((time, area))
        while len(self._history) > 2 and self._history[1][0] <= time - 20.0:
            self._history.popleft()
        since, before = self._history[0]
        frame = costmap.frame
        width = max(0.1, frame.width_px * frame.resolution - 1.0)  # without the margin about the known part
        height = max(0.1, frame.height_px * frame.resolution - 1.0)
        gain = CANDIDATE_FEATURES.index("gain")
        size = CANDIDATE_FEATURES.index("size")
        return [
            time / 600.0,
            area / 100.0,
            (area - before) / max(time - since, 1.0),
            (time - self._grown_at) / 20.0,
            (time - last_time) / 10.0,
            driver.num_frontiers / 16.0,
            float(rows[:, size].sum()) / 5.0,
            float(rows[:, gain].sum()) / 5.0,
            width / 15.0,
            height / 15.0,
            area / (width * height),
            float(driver.round),
        ]


def action_mask(observation: Observation) -> BoolArray:
    """Which actions choose a candidate, shape (K,); the first one always counts, lest nothing be left."""
    mask: BoolArray = observation["mask"] > 0.5
    mask[0] = True
    return mask


def exposures(observation: Observation) -> FloatArray:
    """Mean distance from walls of the way to each candidate, shape (K,) [m]."""
    return observation["candidates"][:, CANDIDATE_FEATURES.index("exposure")] * _EXPOSURE_UNIT


def _candidate_rows(driver: FrontierDriver, costmap: Costmap, crops: Float32Array) -> FloatArray:
    """Features of the candidates, shape (N, F); fills their crops."""
    candidates, pose = driver.candidates, driver.pose
    classes = classify(costmap.costs, COARSENING)
    labels = np.full(classes.shape, -1, np.int16)
    cells = [np.unique(one.frontier.cells // COARSENING, axis=0).astype(np.int64) for one in candidates]
    for index, coarse in enumerate(cells):
        coarse[:, 0] = np.minimum(coarse[:, 0], classes.shape[0] - 1)
        coarse[:, 1] = np.minimum(coarse[:, 1], classes.shape[1] - 1)
        labels[coarse[:, 0], coarse[:, 1]] = index
    middles = np.array([one.frontier.middle for one in candidates])
    apart = np.hypot(*(middles[:, None] - middles[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    others = len(candidates) - 1
    rows = np.zeros((len(candidates), len(CANDIDATE_FEATURES)))
    steps = _path_steps(costmap)
    for index, candidate in enumerate(candidates):
        pocket = _pocket(classes, labels, index, cells[index], costmap, len(candidates))
        outward = _outward(candidate, costmap)
        _crop(candidate, outward, classes, costmap, crops[index])
        distances = apart[index][np.isfinite(apart[index])]
        rows[index] = (
            *_way(candidate, pose, outward, steps),
            *_shape(candidate, costmap, driver.context.geometry.range_max),
            *pocket,
            *_surroundings(candidate, costmap),
            float(distances.min()) / 5.0 if others else 2.0,
            float(distances.mean()) / 10.0 if others else 2.0,
            float(driver.target is not None and candidate.target == driver.target.target),
            candidate.path_length / max(candidate.frontier.min_distance, 0.5) / 3.0,
        )
    return rows


def _way(candidate: Candidate, pose: Pose2D, outward: float, steps: int) -> list[float]:
    """How far it is, in which direction, and how much the robot would turn at both ends.

    Directions are taken over so many ``steps`` of the path.
    """
    x, y = candidate.frontier.middle
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    dx, dy = x - pose.x, y - pose.y
    path = candidate.path
    ahead = path[min(len(path) - 1, steps)] if len(path) > steps // 2 else np.array([x, y])
    first = math.remainder(math.atan2(ahead[1] - pose.y, ahead[0] - pose.x) - pose.theta, 2.0 * math.pi)
    before = path[max(0, len(path) - 1 - steps)]
    last = math.atan2(path[-1, 1] - before[1], path[-1, 0] - before[0]) if len(path) > 1 else pose.theta
    return [
        candidate.path_length / 10.0,
        candidate.path_cost / 20.0,
        candidate.frontier.min_distance / 10.0,
        (cos * dx + sin * dy) / 10.0,
        (cos * dy - sin * dx) / 10.0,
        math.cos(first),
        math.sin(first),
        abs(first) / math.pi,
        abs(math.remainder(outward - last, 2.0 * math.pi)) / math.pi,
    ]


def _shape(candidate: Candidate, costmap: Costmap, reach: float) -> list[float]:
    """Size and form of the frontier, and what could be seen from it."""
    size = candidate.frontier.size * costmap.frame.resolution
    extent = float(np.hypot(*np.ptp(candidate.points, axis=0)))
    gain = expected_gain(costmap, candidate.frontier.middle, reach)
    return [
        size / 3.0,
        extent / 3.0,
        extent / max(size, 0.1),
        gain / 15.0,
        gain / 10.0 / (1.0 + candidate.path_length),
    ]


def _pocket(
    classes: ByteArray, labels: Any, index: int, cells: Any, costmap: Costmap, count: int
) -> list[float]:
    """The unknown behind the frontier: how large, how enclosed, and what else borders it."""
    cell = costmap.frame.resolution * COARSENING
    margin = round(0.5 / cell)  # what a costmap keeps about the known part
    near, far, outside, enclosed, free, occupied, others = explore_pocket(
        classes, labels, index, cells[:, 0], cells[:, 1],
        round(NEAR_POCKET / cell), round(FAR_POCKET / cell), margin, count,
    )  # fmt: skip
    return [
        near * cell**2 / 5.0,
        far * cell**2 / 20.0,
        outside,
        enclosed,
        free * cell / 5.0,
        occupied * cell / 10.0,
        others / 4.0,
    ]


def _surroundings(candidate: Candidate, costmap: Costmap) -> list[float]:
    """Room about the frontier, whether it is a doorway, and how far from walls the way leads.

    A robot localises itself by walls in sight, so the share of the way far from them stands for the pose
    uncertainty that the way would bring (Roy et al., "Coastal navigation", 1999).
    """
    resolution, (height, width) = costmap.frame.resolution, costmap.costs.shape

    def distance(points: FloatArray) -> Float32Array:
        row, col = costmap.frame.to_cell(points[:, 0], points[:, 1])
        row, col = np.clip(row, 0, height - 1), np.clip(col, 0, width - 1)
        return np.minimum(costmap.distance[row, col] * np.float32(resolution), np.float32(3.0))

    clearance = float(distance(np.array([candidate.frontier.middle]))[0])
    extent = float(np.hypot(*np.ptp(candidate.points, axis=0)))
    return [
        clearance / 1.5,
        float(extent < 1.3 and clearance < 0.7),
        float(distance(candidate.path).mean()) / _EXPOSURE_UNIT,
    ]


def _outward(candidate: Candidate, costmap: Costmap) -> float:
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
    candidate: Candidate, outward: float, classes: ByteArray, costmap: Costmap, crop: Float32Array
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
