"""Search for a scan over a whole map and all headings: every place that explains it nearly as well as the best one.

Branch and bound (:mod:`slamgym.slam.branch_and_bound`) is exact. AMCL scatters particles instead, of which enough
must fall within the basin of the right pose.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import between, compose, transform_points, wrap_angle
from slamgym.core.jit import kernel
from slamgym.core.types import ByteArray, FloatArray, Pose2D
from slamgym.slam.branch_and_bound import HIT, best_in_block, block_score, maxima
from slamgym.slam.config import LocalizationConfig
from slamgym.slam.localization.field import FLOOR, LikelihoodField, weigh_poses
from slamgym.slam.localization.hypothesis import BEAM_WEIGHT, EVIDENCE, MIN_PARTICLES, Hypothesis
from slamgym.slam.particle_filter import FEW_POINTS

SEARCH_CELL = 0.1
"""Least size of a cell of the search [m]."""
SEARCH_SIGMA = 0.12
"""Spread of the score round surfaces: wider than a cell, so that no place falls between cells [m]."""
CLOUD_POINTS = 150
HEADING_STEPS = (0.015, 0.07)
"""Bounds of the step in heading [rad]."""
LEVELS = (3, 7)
"""The largest blocks have sides of 2 to the power of this, in cells: larger where there are very many."""
MOST_BOUNDS = 4_000_000
MOST_PLACES = 20_000
APART, APART_TURN = 0.5, 0.35
"""Places nearer to each other than this are one [m], [rad]."""
SCORE_MARGIN = 0.12
"""A place is kept if its score falls so much behind the best one's at most (1: every point lies on a wall)."""
MOST_HYPOTHESES = 60
"""The best places that a search keeps."""


SEED_SPREAD = (0.1, 0.1, 0.05)
"""Spread of the particles round a place that the search has found [m], [m], [rad]."""
NEGLIGIBLE = 15.0
"""A hypothesis so much below the best one in log-weight is given up."""
MOST_SCANS_COUNTED = 10
"""Scans of the memory that count in the comparison of a new place with those followed."""
SEARCH_GROWTH = 1.5
"""Each search that finds no place for the robot makes the next one wait so many times as long."""
LOST_SCANS = 3
"""So many scans in a row that fit poorly start a search at once."""
SEARCH_DISTANCE, CHECK_DISTANCE = 0.5, 5.0
"""A search is repeated after so much driving while the robot isn't localised, each time after more, up to the second;
and after as much while it is, to see whether another place explains more [m]."""
JUMP_COST = 10.0
"""Log-weight that a new place begins behind the one that is followed: robots are seldom carried off."""
MEMORY_METRES, MOST_SCANS = 3.0, 60
"""A search takes the scans of the last metres together, a view that fewer places share than a single scan."""
THINNING_CELL = 0.1
"""Size of the cells in each of which one point of all scans is kept [m]."""


class Place(NamedTuple):
    """A pose that explains a scan."""

    pose: FloatArray  # (3,)
    score: float  # 0 to 1: 1 if every point lies on a surface


@kernel
def search_heading(
    levels: ByteArray,
    floors: ByteArray,
    us: np.ndarray,
    vs: np.ndarray,
    bounds: np.ndarray,
    least: int,
    places: np.ndarray,
) -> int:
    """Find the best place of every block at one heading.

    Args:
        levels: (levels, rows, cols) grids of maxima of the score.
        floors: (levels, rows, cols) the same of the floor.
        us: (n,) int32 the points' columns with the robot in cell 0.
        vs: (n,) the rows.
        bounds: (block rows, block cols) of the top level: bounds of the score, 0 where there is no floor.
        least: Score from which on places are of interest.
        places: (most, 3) int64 receives score, column and row.

    Returns:
        How many were found.
    """
    top, count = len(levels) - 1, 0
    most = floors.shape[2] - 1, floors.shape[1] - 1
    for row in range(bounds.shape[0]):
        for col in range(bounds.shape[1]):
            if bounds[row, col] < least or count == len(places):
                continue
            block = col << top, row << top, bounds[row, col]
            found = best_in_block(levels, floors, us, vs, block, most, least - 1, (0.0, 0.0, 0.0))
            if found[0] >= least:
                places[count, 0], places[count, 1], places[count, 2] = found
                count += 1
    return count


@kernel
def bound_heading(
    levels: ByteArray, floors: ByteArray, us: np.ndarray, vs: np.ndarray, bounds: np.ndarray
) -> None:
    """Fill in the bounds that :func:`search_heading` takes."""
    top = len(levels) - 1
    for row in range(bounds.shape[0]):
        for col in range(bounds.shape[1]):
            bounds[row, col] = 0
            if floors[top, row << top, col << top]:
                bounds[row, col] = block_score(levels[top], 1 << top, us, vs, col << top, row << top)


class GlobalSearch:
    """Searches one map."""

    def __init__(self, field: LikelihoodField) -> None:
        self._field = field
        factor = max(1, round(SEARCH_CELL / field.cell))
        self._cell = factor * field.cell
        rows, cols = (-(-size // factor) for size in field.floor.shape)
        padding = [(0, rows * factor - field.floor.shape[0]), (0, cols * factor - field.floor.shape[1])]
        blocks = (rows, factor, cols, factor)
        distance = np.pad(field.distance, padding, constant_values=1e3).reshape(blocks).min(axis=(1, 3))
        self._score = np.rint(HIT * np.exp(-0.5 * np.square(distance / SEARCH_SIGMA))).astype(np.uint8)
        floor = (field.floor == FLOOR).astype(np.uint8)
        self._floor = np.pad(floor, padding).reshape(blocks).max(axis=(1, 3))
        self._levels: ByteArray = np.zeros((0, 0, 0), dtype=np.uint8)
        self._floors = self._levels

    def _prepare(self, headings: int) -> None:
        """Make the grids of maxima, with blocks so large that not too many must be bounded."""
        top = LEVELS[0]
        while top < LEVELS[1] and headings * (self._floor.size >> (2 * top)) > MOST_BOUNDS:
            top += 1
        if len(self._levels) != top + 1:
            self._levels, self._floors = maxima(self._score, top + 1), maxima(self._floor, top + 1)

    def find(self, points: FloatArray) -> list[Place]:
        """The best places of a scan, or of several put together, the best first.

        Args:
            points: (n, 2) end points in the robot frame [m]; at least one.
        """
        points = points[np.linspace(0, len(points) - 1, min(len(points), CLOUD_POINTS)).astype(int)]
        far = float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 80.0))
        step = min(max(self._cell / max(far, self._cell), HEADING_STEPS[0]), HEADING_STEPS[1])
        headings = np.arange(0.0, 2.0 * math.pi, 2.0 * math.pi / math.ceil(2.0 * math.pi / step))
        self._prepare(len(headings))
        top = len(self._levels) - 1
        shape = tuple(-(-size // (1 << top)) for size in self._floor.shape)
        bounds = np.zeros((len(headings), *shape), dtype=np.int32)
        cells = [self._cells(points, heading) for heading in headings]
        for at, (us, vs) in enumerate(cells):
            bound_heading(self._levels, self._floors, us, vs, bounds[at])
        places = np.empty((MOST_PLACES, 3), dtype=np.int64)
        best, margin = 0, round(SCORE_MARGIN * HIT * len(points))
        found: list[tuple[int, float, float, float]] = []
        # Headings in the order of their best bound: the first ones soon set a bar for the others.
        for at in np.argsort(-bounds.max(axis=(1, 2)), kind="stable"):
            least = max(best - margin, 1)
            if bounds[at].max() < least:
                break
            us, vs = cells[at]
            count = search_heading(self._levels, self._floors, us, vs, bounds[at], least, places)
            if count:
                best = max(best, int(places[:count, 0].max()))
            found += [(int(s), float(headings[at]), float(u), float(v)) for s, u, v in places[:count]]
        return self._distinct([place for place in found if place[0] >= best - margin], len(points))

    def _cells(self, points: FloatArray, heading: float) -> tuple[np.ndarray, np.ndarray]:
        """Columns and rows of the points round a robot in the middle of cell (0, 0)."""
        cos, sin = math.cos(heading), math.sin(heading)
        us = np.floor((cos * points[:, 0] - sin * points[:, 1]) / self._cell + 0.5)
        vs = np.floor((sin * points[:, 0] + cos * points[:, 1]) / self._cell + 0.5)
        return us.astype(np.int32), vs.astype(np.int32)

    def _distinct(self, found: list[tuple[int, float, float, float]], num_points: int) -> list[Place]:
        """The best of neighbouring places, at most as many as the settings say."""
        kept: list[Place] = []
        poses = np.zeros((0, 3))
        for score, heading, u, v in sorted(found, reverse=True):
            x = self._field.origin_x + (u + 0.5) * self._cell
            y = self._field.origin_y + (v + 0.5) * self._cell
            near = np.hypot(poses[:, 0] - x, poses[:, 1] - y) < APART
            if (near & (np.abs(wrap_angle(poses[:, 2] - heading)) < APART_TURN)).any():
                continue
            kept.append(Place(np.array([x, y, wrap_angle(heading)]), score / (HIT * num_points)))
            poses = np.vstack([poses, kept[-1].pose])
            if len(kept) == MOST_HYPOTHESES:
                break
        return kept


class Seeker:
    """Remembers the latest scans, and searches for them now and then.

    Args:
        field: The map.
        config: Settings.
        rng: Source of the particles.
        is_urgent: True if the first scan is searched for at once.
    """

    def __init__(
        self, field: LikelihoodField, config: LocalizationConfig, rng: np.random.Generator, is_urgent: bool
    ) -> None:
        self._field, self._config, self._rng = field, config, rng
        self._search = GlobalSearch(field)
        self._pose = Pose2D(0.0, 0.0, 0.0)  # by odometry
        self._way = 0.0  # driven in all
        self._scans: list[tuple[float, Pose2D, FloatArray]] = []  # the latest, with those two
        self._driven = math.inf if is_urgent else 0.0  # since the last search
        self._patience = SEARCH_DISTANCE
        self._poor_scans = 0
        self.searches = 0
        """Searches so far."""

    def append(self, motion: Pose2D, driven: float, points: FloatArray) -> None:
        """Take a scan.

        Args:
            motion: Motion since the one before, in the robot frame of that.
            driven: Its length [m], turns included.
            points: (n, 2) end points in the robot frame [m]; copied.
        """
        self._pose = compose(self._pose, motion)
        self._way += driven
        self._driven += driven
        self._scans.append((self._way, self._pose, points.copy()))
        while len(self._scans) > MOST_SCANS or self._way - self._scans[0][0] > MEMORY_METRES:
            del self._scans[0]

    def _remembered(self) -> FloatArray:
        """All end points in the robot's present frame, thinned, (n, 2) [m]."""
        moved = [transform_points(between(self._pose, pose), points) for _, pose, points in self._scans]
        together = np.concatenate(moved)
        _, first = np.unique(np.floor(together / THINNING_CELL).astype(np.int64), axis=0, return_index=True)
        return together[np.sort(first)]

    def must_search(self, hypotheses: Sequence[Hypothesis], is_localised: bool) -> bool:
        """Return True if a search is needed now.

        Args:
            hypotheses: What is followed.
            is_localised: True if the robot was sure of its place at the last scan.
        """
        if is_localised:
            self._patience = SEARCH_DISTANCE
        distance = CHECK_DISTANCE if is_localised else self._patience
        poor = max((hypothesis.fit for hypothesis in hypotheses), default=1.0) < self._config.minimum_fit
        self._poor_scans = self._poor_scans + 1 if poor else 0
        if self._poor_scans == LOST_SCANS:
            # Where the robot was carried off, older scans show another place.
            self._scans = self._scans[-1:]
            distance = 0.0
        return self._driven >= distance

    def find(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Search the whole map for the latest scans.

        Args:
            hypotheses: What is followed already.

        Returns:
            Places that no hypothesis follows yet. Each begins with the weight that the scans give it relative to the
            best hypothesis, less what it costs to have been missed so far.
        """
        config, points = self._config, self._remembered()
        if len(points) < FEW_POINTS:
            return []
        self.searches += 1
        self._driven = 0.0
        self._patience = min(self._patience * SEARCH_GROWTH, CHECK_DISTANCE)
        power = EVIDENCE * BEAM_WEIGHT * config.max_beams * min(len(self._scans), MOST_SCANS_COUNTED)
        known = np.array([hypothesis.estimate[0] for hypothesis in hypotheses]).reshape(-1, 3)
        level = reference = behind = 0.0
        least = -math.inf
        if hypotheses:
            at = int(np.argmax([hypothesis.log_weight for hypothesis in hypotheses]))
            best = hypotheses[at]
            behind = JUMP_COST if best.driven >= config.confirm_distance else 0.0
            level, reference = best.log_weight, self._mean_log_likelihood(known[at], points)
            least = level - NEGLIGIBLE
        found = []
        for place in self._search.find(points):
            near = np.hypot(*(known[:, :2] - place.pose[:2]).T) < APART
            if (near & (np.abs(wrap_angle(known[:, 2] - place.pose[2])) < APART_TURN)).any():
                continue
            advantage = power * (self._mean_log_likelihood(place.pose, points) - reference)
            log_weight = level + min(advantage, 0.0) - behind
            if log_weight >= least:
                spread, count = np.array(SEED_SPREAD), 2 * MIN_PARTICLES
                found.append(Hypothesis.around(place.pose, spread, count, log_weight, self._rng))
                found[-1].fit = place.score
        return found

    def _mean_log_likelihood(self, pose: FloatArray, points: FloatArray) -> float:
        """Mean log-likelihood of the points at the best of some poses around one."""
        near = pose + np.array(SEED_SPREAD) * self._rng.standard_normal((MIN_PARTICLES, 3))
        out = np.empty(len(near))
        weigh_poses(self._field, near, points, out)
        return float(out.max()) / len(points)
