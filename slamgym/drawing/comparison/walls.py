"""What has become of each of the plan's walls: present, moved, missing, unclear, or not seen.

Every few centimetres along its faces, the map's nearest face that was seen from the same side is looked for. Where a
wall stands is what most of these points agree on.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.drawing.comparison.distortion import Drift
from slamgym.drawing.comparison.faces import FACE_STEP, MapEvidence, PlanWalls
from slamgym.drawing.comparison.records import FindingKind, Line, PlanFinding
from slamgym.drawing.comparison.registration import MISSED
from slamgym.drawing.settings import ComparisonConfig

LATERAL = 0.045
"""A point of the map lies before a point of a face if it is no farther to its side [m]."""
ALIKE = 0.7
"""Cosine of the angle between normals up to which a face of the map may be one of the plan."""
NEAR = 0.1
"""So near to its place a wall is there, and so near to the commonest offset a point belongs to its wall [m]."""
LEAST_SEEN = 0.3
"""A wall of which less is seen, from either side, is not judged."""
CELL_ROUNDING = 0.05 / np.sqrt(12.0)
"""A straight wall lies anywhere within its row of cells [m]."""
MOST, SOME = 0.5, 0.25
"""Shares of what is in view."""
CORRELATED = 0.25
"""Offsets of points nearer to each other than this say the same [m]."""
FURNITURE = (0.15, 0.8)
"""A face so far before the place of a wall whose other side isn't seen may be furniture [m]."""


@dataclass(frozen=True)
class Survey:
    """Everything that was measured at the walls W and their points S."""

    plan: PlanWalls
    offsets: (
        FloatArray  # (S,) along the walls' normals [m]; nan where the map has no such face nearby
    )
    drift: FloatArray  # (W,) offset by the map's distortion [m]
    deviation: FloatArray  # (W,) standard error of that [m]
    field: Drift
    in_view: BoolArray  # (S,)
    is_open: BoolArray  # (S,) free on both sides of the face

    def drift_at(self, place: FloatArray) -> FloatArray:
        """The map's shift at a place (2,), (2,) [m]."""
        return self.field.predict(np.tile(place, (2, 1)), np.eye(2))[0]


def measure_walls(plan: PlanWalls, evidence: MapEvidence) -> Survey:
    """Measure all walls: once as the map shows them, for its distortion, and then without that."""
    pairs = _pairs(plan, evidence)
    drift, deviation, field = _distortion(plan, _nearest_offsets(pairs, np.zeros(len(plan.points))))
    offsets = _nearest_offsets(pairs, drift[plan.wall])
    normals = plan.point_normals
    places = plan.points + (plan.side * drift[plan.wall])[:, None] * normals
    is_open = evidence.across(places, normals) > 0
    is_near = np.abs(offsets - drift[plan.wall]) < NEAR  # false for nan
    in_view = evidence.is_free_before(places, normals) | is_open | is_near
    return Survey(plan, offsets, drift, deviation, field, in_view, is_open)


def judge_wall(found: Survey, wall: int, config: ComparisonConfig) -> PlanFinding:
    """Report on a wall, from all points of its faces."""
    plan = found.plan
    line: Line = tuple(plan.lines[wall].tolist())
    what, drift = f"wall of {plan.lengths[wall]:.1f} m", float(found.drift[wall])
    own = np.flatnonzero(plan.wall == wall)
    view = own[found.in_view[own]]
    share = max(
        found.in_view[own[plan.side[own] == side]].mean() for side in np.unique(plan.side[own])
    )
    seen = float(share)
    if seen < LEAST_SEEN or len(view) < 3:
        return PlanFinding("wall_not_seen", what, line, seen=seen)
    values, sides = found.offsets[view] - drift, plan.side[view]
    near = np.abs(values) <= NEAR
    centre = _commonest(values)
    place = _around(values, sides, centre)
    if place.support < MOST and near.mean() < SOME and found.is_open[view].mean() >= MOST:
        return PlanFinding("wall_missing", what, line, seen=seen)
    if near.mean() >= SOME and abs(centre) > NEAR:
        # Part of it stands at its place: what is before the rest is furniture.
        place = _around(values, sides, float(np.median(values[near])))
    if place.support < SOME:
        return PlanFinding("wall_unclear", what, line, seen=seen)
    offset, error = place.offset, float(np.hypot(place.error, found.deviation[wall]))
    if place.support < MOST or abs(offset) <= max(config.moved, config.sure * error):
        return PlanFinding("wall_present", what, line, offset, error, offset + drift, seen)
    may_be_furniture = (
        len(place.sides) == 1 and FURNITURE[0] < place.sides[0] * offset < FURNITURE[1]
    )
    kind: FindingKind = "wall_unclear" if may_be_furniture else "wall_moved"
    return PlanFinding(kind, what, line, offset, error, offset + drift, seen)


def open_runs(found: Survey, wall: int, shortest: float) -> list[tuple[float, float]]:
    """Gaps in a wall through which the map is free: first and last place along it [m]."""
    own = np.flatnonzero((found.plan.wall == wall) & (found.plan.side > 0.0))
    runs = found.plan.lengths[wall] / len(own) * runs_of(found.is_open[own])
    return [(start, stop) for start, stop in runs.tolist() if stop - start >= shortest]


def runs_of(mask: BoolArray) -> IntArray:
    """Where each run of a mask (N,) begins, and where the next place behind it is, (R, 2)."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


def _pairs(plan: PlanWalls, evidence: MapEvidence) -> tuple[IntArray, FloatArray]:
    """Points of walls and of the map before or behind them: numbers of the first, offsets along walls' normals [m]."""
    tree = KDTree(evidence.points)
    near = KDTree(plan.points).sparse_distance_matrix(tree, MISSED, output_type="ndarray")
    index, other = near["i"], near["j"]
    normal = plan.point_normals[index]
    difference = evidence.points[other] - plan.points[index]
    sideways = np.abs(difference[:, 0] * normal[:, 1] - difference[:, 1] * normal[:, 0])
    alike = (evidence.normals[other] * normal).sum(axis=1) > ALIKE
    keep = alike & (sideways < LATERAL)
    return index[keep], (plan.side[index] * (difference * normal).sum(axis=1))[keep]


def _nearest_offsets(pairs: tuple[IntArray, FloatArray], expected: FloatArray) -> FloatArray:
    """For each point the offset that is nearest to what is expected, (S,); nan where there is none."""
    index, offset = pairs
    order = np.lexsort((np.abs(offset - expected[index]), index))
    first = order[np.unique(index[order], return_index=True)[1]]
    found = np.full(len(expected), np.nan)
    found[index[first]] = offset[first]
    return found


def _distortion(plan: PlanWalls, offsets: FloatArray) -> tuple[FloatArray, FloatArray, Drift]:
    """The distortion along the normals of all walls, from the other walls around, its standard error, and its field."""
    count = len(plan.lengths)
    values, noise = np.zeros(count), np.full(count, np.inf)
    for wall in range(count):
        own = plan.wall == wall
        place = _around(offsets[own], plan.side[own], _commonest(offsets[own]))
        values[wall], noise[wall] = place.offset, place.error
    seen = np.flatnonzero(np.isfinite(noise))
    field = Drift(plan.middles[seen], plan.normals[seen], values[seen], noise[seen])
    drift, deviation = field.predict(plan.middles, plan.normals)
    drift[seen], deviation[seen] = field.expected, field.deviation
    return drift, deviation, field


def _commonest(values: FloatArray) -> float:
    """The offset (N,), nan where there is none, that most points agree on; the smaller if two are as common."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0
    agree = (np.abs(known[:, None] - known) <= NEAR).sum(axis=1) - 0.05 * np.abs(known)
    return float(known[agree.argmax()])


class _Place(NamedTuple):
    """Where a wall stands."""

    offset: float  # [m]
    error: float  # its standard error [m]: neighbours are correlated, and all are rounded to cells
    support: float  # share of the points that say so
    sides: list[float]  # of the wall's faces, 1 and -1, those that do


def _around(values: FloatArray, sides: FloatArray, centre: float) -> _Place:
    """What the offsets (N,) about a centre say, nan where there is none; a thicker wall is none that has moved."""
    close = np.abs(values - centre) <= NEAR  # false for nan
    if not close.any():
        return _Place(centre, np.inf, 0.0, [])
    seen = [side for side in (1.0, -1.0) if (sides[close] == side).any()]
    offset = float(np.mean([np.median(values[close & (sides == side)]) for side in seen]))
    scatter = 1.4826 * np.median(np.abs(values[close] - offset))
    independent = max(1.0, close.sum() * FACE_STEP / CORRELATED)
    error = np.hypot(np.sqrt(1.57 / independent) * scatter, CELL_ROUNDING)
    return _Place(offset, float(error), float(close.mean()), seen)
