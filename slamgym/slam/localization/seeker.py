"""Where else the robot may be: the latest scans, searched for on the whole map now and then."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.jit import plain
from slamgym.core.portable import inverted
from slamgym.core.types import Float32Array, FloatArray
from slamgym.slam.graph.relative import chi_squared, moved_by, seen_from
from slamgym.slam.graph.sight import ScanView
from slamgym.slam.graph.submaps import SUBMAP_CELL, OrientedPoints
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.localization.global_search import MOST_HYPOTHESES, find_places, is_same
from slamgym.slam.localization.hypothesis import Hypothesis
from slamgym.slam.localization.known_map import KnownMap, explain_scan

NEGLIGIBLE = 15.0
"""A hypothesis so much below the best one in log-weight is given up."""
MOST_SCANS_COUNTED = 10
"""Scans of the memory that count in the comparison of a new place with those followed."""
SEARCH_METRES = 2.0
"""A search is repeated after so much driving while the robot isn't localised [m]."""
CHECK_METRES = 5.0
"""A search is repeated after so much driving while the robot is localised, to see whether another place explains more
[m]."""
JUMP_COST = 10.0
"""Log-weight that a new place begins behind the one that is followed: robots are seldom carried off."""
MOST_PROOF = 5.0
"""No place has to lead for more times the usual distance."""
MEMORY_METRES = 3.0
"""A search takes the scans of the last metres together, a view that fewer places share than a single scan."""
CLOUD_POINTS = 150
"""A search takes no more points than this."""
SEED_SPREAD = (0.1, 0.1, 0.05)
"""Spread of a place that a search has found [m], [m], [rad]."""


class RememberedScan(NamedTuple):
    """A scan of the last metres."""

    way: float  # driven until then in all [m]
    pose: FloatArray  # (3,) by odometry
    view: ScanView


class Seeker:
    """Remembers the latest scans, and searches for them.

    Args:
        known: The map.
        beams: The scanner.
        max_beams: Beams of a scan that are looked at.
    """

    def __init__(self, known: KnownMap, beams: BeamTable, max_beams: int) -> None:
        self._known = known
        self._beams = plain(beams)
        self._step = max(1, len(beams.directions) // max_beams)
        self._pose = np.zeros(3)  # by odometry
        self._way = 0.0  # driven in all
        self._scans: list[RememberedScan] = []  # the latest
        self._searched = -math.inf  # way at the last search
        self.searches = 0
        """Searches so far."""

    def append(self, motion: FloatArray, driven: float, view: ScanView) -> None:
        """Take a scan after a motion (3,), in the frame of the one before, of a length [m]."""
        self._pose = moved_by(self._pose, motion)
        self._way += driven
        self._scans.append(RememberedScan(self._way, self._pose, view))
        while self._way - self._scans[0].way > MEMORY_METRES:
            del self._scans[0]

    def forget(self) -> None:
        """Search anew from here on: where the robot was carried off, older scans show another place."""
        self._scans = []
        self._searched = -math.inf

    def evidence(
        self, pose: FloatArray, ranges: Float32Array, excuses: bool, missed: Float32Array
    ) -> tuple[float, float]:
        """Evidence of a scan against a pose (3,), and its fit; see :func:`explain_scan`."""
        return explain_scan(
            plain(self._known.field), pose, ranges, self._beams, self._step, excuses, missed
        )

    def find(self, hypotheses: Sequence[Hypothesis], is_localised: bool) -> list[Hypothesis]:
        """Search the whole map for the latest scans, if that is due.

        Args:
            hypotheses: What is followed already, the best first.
            is_localised: True if the robot was sure of its place at the last scan.

        Returns:
            More places. Each begins with the weight that the scans give it relative to the best hypothesis, less what
            it costs to have been missed so far: nothing where that one may lie as well.
        """
        interval = CHECK_METRES if is_localised else SEARCH_METRES
        if self._way - self._searched < interval:
            return []
        self.searches += 1
        self._searched = self._way
        seen = self._latest()
        rivals = np.array([hypothesis.pose for hypothesis in hypotheses[1:]]).reshape(-1, 3)
        found = []
        for place in find_places(self._known, seen.points):
            placed = self._known.surfaces.align_freely(seen, place)
            if is_same(rivals, placed.pose).any():
                continue
            new = Hypothesis.around(placed.pose, SEED_SPREAD, self._known.no_misses())
            if hypotheses:
                self._compare(new, hypotheses[0])
            found.append(new)
        return found

    def _compare(self, new: Hypothesis, best: Hypothesis) -> None:
        """Give a new place its weight, and what it must prove."""
        against_new = self._remembered(new.pose, False, new.missed)
        against_best = self._remembered(best.pose, best.was_sure, self._known.no_misses())
        known = inverted(best.covariance[:3, :3])
        jump = min(0.5 * chi_squared(new.pose, best.pose, known), JUMP_COST)
        new.log_weight = best.log_weight - max(against_new - against_best, 0.0)
        new.proof = best.proof
        if best.was_sure:
            new.log_weight -= jump
            new.proof = min(2.0 * best.proof, MOST_PROOF)
        if jump < JUMP_COST:
            new.inherit(best)

    def _latest(self) -> OrientedPoints:
        """The latest scans in the robot's present frame, at most one point in a cell."""
        clouds = []
        for scan in self._scans:
            x, y, turn = seen_from(self._pose, scan.pose)
            cloud = np.hstack(scan.view.seen)
            # Points and sides as complex numbers.
            turned = cloud[:, :4].copy().view(np.complex128) * np.exp(1j * turn)
            turned[:, 0] += complex(x, y)
            cloud[:, :4] = turned.view(np.float64)
            clouds.append(cloud)
        cloud = np.concatenate(clouds)
        cells = np.floor(cloud[:, :2] / SUBMAP_CELL).astype(np.int64)
        _, first_in_cell = np.unique(cells, axis=0, return_index=True)
        count = len(first_in_cell)
        spread = np.linspace(0, count - 1, min(count, CLOUD_POINTS)).astype(int)
        kept = cloud[np.sort(first_in_cell)[spread]]
        return OrientedPoints(kept[:, :2], kept[:, 2:]).every(1)

    def _remembered(self, pose: FloatArray, excuses: bool, missed: Float32Array) -> float:
        """Evidence of some of the latest scans against a pose (3,) of the robot now."""
        step = math.ceil(len(self._scans) / MOST_SCANS_COUNTED)
        total = 0.0
        for scan in self._scans[::-step]:
            then = moved_by(pose, seen_from(self._pose, scan.pose))
            against, _ = self.evidence(then, scan.view.ranges, excuses, missed)
            total += against
        return total


def distinct(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Give up what has lost, and join what has met; the best first."""
    ranked = sorted(hypotheses, key=lambda hypothesis: -hypothesis.log_weight)
    kept: list[Hypothesis] = []
    for hypothesis in ranked[:MOST_HYPOTHESES]:
        if hypothesis.log_weight < ranked[0].log_weight - NEGLIGIBLE:
            break
        poses = np.array([other.pose for other in kept]).reshape(-1, 3)
        same = is_same(poses, hypothesis.pose)
        if same.any():
            winner = kept[np.argmax(same)]
            if hypothesis.led > winner.led:
                winner.inherit(hypothesis)
        else:
            kept.append(hypothesis)
    return kept
