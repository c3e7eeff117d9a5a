"""When a robot searches the whole map, and what the places that it finds count beside those that it follows."""

import math
from collections.abc import Sequence

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.localization.config import LocalizationConfig
from slamgym.slam.localization.field import LikelihoodField, weigh_poses
from slamgym.slam.localization.global_search import APART, APART_TURN, GlobalSearch
from slamgym.slam.localization.hypothesis import Hypothesis
from slamgym.slam.localization.recent_scans import RecentScans
from slamgym.slam.particle_filter import FEW_POINTS

SEED_SPREAD = (0.1, 0.1, 0.05)
"""Spread of the particles round a place that the search has found [m], [m], [rad]."""
NEGLIGIBLE = 15.0
"""A hypothesis so much below the best one in log-weight is given up."""
MOST_SCANS_COUNTED = 10
"""Scans of the memory that count in the comparison of a new place with those followed."""
SEARCH_GROWTH = 1.5
"""Each search that leaves the robot without a place makes the next one wait so many times as long."""
LOST_SCANS = 3
"""So many scans in a row that fit poorly start a search at once."""


class Seeker:
    """Remembers the latest scans, and searches for them now and then.

    Args:
        field: The map.
        config: Settings.
        rng: Source of the particles.
        is_urgent: Whether the first scan is searched for at once.
    """

    def __init__(
        self, field: LikelihoodField, config: LocalizationConfig, rng: np.random.Generator, is_urgent: bool
    ) -> None:
        self._field, self._config, self._rng = field, config, rng
        self._search = GlobalSearch(field, config)
        self._memory = RecentScans(config.search_memory)
        self._driven = math.inf if is_urgent else 0.0  # since the last search
        self._patience = config.search_distance
        self._poor_scans = 0
        self.searches = 0
        """Searches so far."""

    def append(self, motion: Pose2D, driven: float, points: FloatArray) -> None:
        """Take a scan; see :meth:`RecentScans.append`."""
        self._memory.append(motion, driven, points)
        self._driven += driven

    def is_due(self, hypotheses: Sequence[Hypothesis], is_localised: bool) -> bool:
        """Whether to search now.

        Args:
            hypotheses: What is followed.
            is_localised: Whether the robot was sure of its place at the last scan.
        """
        config = self._config
        if is_localised:
            self._patience = config.search_distance
        distance = config.check_distance if is_localised else self._patience
        poor = max((hypothesis.fit for hypothesis in hypotheses), default=1.0) < config.minimum_fit
        self._poor_scans = self._poor_scans + 1 if poor else 0
        if self._poor_scans == LOST_SCANS:
            # Where the robot was carried off, older scans show another place.
            self._memory.restart_with_last()
            distance = 0.0
        return self._driven >= distance

    def find(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Search the whole map for the latest scans.

        Args:
            hypotheses: What is followed already.

        Returns:
            Places that nobody follows yet. Each begins with the weight that the scans give it beside the best
            hypothesis, less what it costs to have been missed so far.
        """
        config, points = self._config, self._memory.points()
        if len(points) < FEW_POINTS:
            return []
        self.searches += 1
        self._driven = 0.0
        self._patience = min(self._patience * SEARCH_GROWTH, config.check_distance)
        power = config.evidence * config.beam_weight * config.max_beams
        power *= min(len(self._memory), MOST_SCANS_COUNTED)
        known = np.array([hypothesis.estimate[0] for hypothesis in hypotheses]).reshape(-1, 3)
        level = reference = behind = 0.0
        least = -math.inf
        if hypotheses:
            at = int(np.argmax([hypothesis.log_weight for hypothesis in hypotheses]))
            best = hypotheses[at]
            behind = config.jump_cost if best.driven >= config.confirm_distance else 0.0
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
                count = 2 * config.min_particles
                found.append(
                    Hypothesis.around(place.pose, np.array(SEED_SPREAD), count, log_weight, self._rng)
                )
                found[-1].fit = place.score
        return found

    def _mean_log_likelihood(self, pose: FloatArray, points: FloatArray) -> float:
        """Of the points at the best of some poses round one."""
        near = pose + np.array(SEED_SPREAD) * self._rng.standard_normal((self._config.min_particles, 3))
        out = np.empty(len(near))
        weigh_poses(self._field, near, points, out)
        return float(out.max()) / len(points)
