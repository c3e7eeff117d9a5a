"""What has become of each of the plan's walls: present, moved, missing, unclear, or not seen.

Every few centimetres along its faces, the map's nearest face that was seen from the same side is looked for. Where a
wall stands is what most of these points agree on.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from slamgym.core.geometry import runs_of
from slamgym.core.types import BoolArray, FloatArray, IntArray
from slamgym.drawing.comparison.distortion import Drift
from slamgym.drawing.comparison.faces import MapEvidence, PlanWalls
from slamgym.drawing.comparison.records import FindingKind, Line, PlanFinding
from slamgym.drawing.comparison.registration import MISSED
from slamgym.drawing.free_space import cross
from slamgym.drawing.settings import MAJORITY, USUAL_CELL, ComparisonConfig

ALIKE = 0.7
"""Cosine of the angle between normals up to which a face of the map may be one of the plan. With 0 walls that moved are
measured to 2.3 instead of 2.1 cm in furnished homes."""
NEAR = 0.1
"""So near to its place a wall is there, and so near to the commonest offset a point belongs to its wall [m]."""
LEAST_SEEN = 0.3
"""A share of a wall or a room that is less says nothing of it: the wall isn't judged, the room not yet explored."""
CORRELATED = 0.25
"""Offsets of points nearer to each other than this say the same [m]. If none do, 9 furnished homes have 8 false changes
instead of 6."""
FURNITURE = (0.15, 0.8)
"""A face so far before the place of a wall whose other side isn't seen may be furniture [m], and one further behind it
another wall, unless its place is seen to be open. Without the first 9 furnished homes have 7 false changes instead of
6, without the second a map that is compared with itself one."""


@dataclass(frozen=True)
class Survey:
    """Everything that was measured at the walls W and their points S."""

    plan: PlanWalls
    offsets: FloatArray
    """(S,) along the walls' normals [m]; nan where the map has no such face nearby."""
    drift: FloatArray  # (W,) offset by the map's distortion [m]
    deviation: FloatArray  # (W,) standard error of that [m]
    field: Drift
    in_view: BoolArray  # (S,)
    is_open: BoolArray  # (S,) free on both sides of the face

    def drift_at(self, place: FloatArray) -> FloatArray:
        """The map's shift at a place (2,), (2,) [m]."""
        twice = np.tile(place, (2, 1))
        along_axes, _ = self.field.predict(twice, np.eye(2))
        return along_axes


def measure_walls(plan: PlanWalls, evidence: MapEvidence) -> Survey:
    """Measure all walls: once as the map shows them, for its distortion, and then without that."""
    pairs = _pairs(plan, evidence)
    raw_offsets = _nearest_offsets(pairs, np.zeros(len(plan.points)))
    drift, deviation, field = _distortion(plan, raw_offsets)
    drift_of_points = drift[plan.wall]
    offsets = _nearest_offsets(pairs, drift_of_points)
    normals = plan.point_normals
    places = plan.points + (plan.side * drift_of_points)[:, None] * normals
    is_open = evidence.across(places, normals) > 0
    is_near = np.abs(offsets - drift_of_points) < NEAR  # false for nan
    in_view = evidence.is_free_before(places, normals) | is_open | is_near
    return Survey(plan, offsets, drift, deviation, field, in_view, is_open)


def judge_wall(found: Survey, wall: int, config: ComparisonConfig) -> PlanFinding:
    """Report on a wall, from all points of its faces."""
    plan = found.plan
    line: Line = tuple(plan.lines[wall].tolist())
    what = f"wall of {plan.lengths[wall]:.1f} m"
    drift = float(found.drift[wall])
    own = np.flatnonzero(plan.wall == wall)
    view = own[found.in_view[own]]
    seen = _share_seen(found, own)
    if seen < LEAST_SEEN or len(view) < 3:
        return PlanFinding("wall_not_seen", what, line, seen=seen)
    values = found.offsets[view] - drift
    sides = plan.side[view]
    near = np.abs(values) <= NEAR
    centre = _commonest(values)
    place = _around(values, sides, centre)
    is_open = found.is_open[view].mean() >= MAJORITY
    if place.support < MAJORITY and near.mean() < LEAST_SEEN and is_open:
        return PlanFinding("wall_missing", what, line, seen=seen)
    if near.mean() >= LEAST_SEEN and abs(centre) > NEAR:
        # Part of it stands at its place: what is before the rest is furniture.
        place = _around(values, sides, float(np.median(values[near])))
    if place.support < LEAST_SEEN:
        return PlanFinding("wall_unclear", what, line, seen=seen)
    error = float(np.hypot(place.error, found.deviation[wall]))
    kind = _kind_at(place, error, config, is_open)
    raw_offset = place.offset + drift
    return PlanFinding(kind, what, line, place.offset, error, raw_offset, seen)


def _share_seen(found: Survey, own: IntArray) -> float:
    """Share of the points of a wall that are in view, on the side that shows more."""
    sides = found.plan.side[own]
    in_view = found.in_view[own]
    shares = [in_view[sides == side].mean() for side in np.unique(sides)]
    return float(max(shares))


def _kind_at(place: "_Place", error: float, config: ComparisonConfig, is_open: bool) -> FindingKind:
    """What a wall is that stands at a place so far from its own, open or not, with a standard error [m]."""
    least = max(config.moved, config.sure * error)
    if place.support < MAJORITY or abs(place.offset) <= least:
        return "wall_present"
    nearest, farthest = FURNITURE
    before = place.sides[0] * place.offset
    is_behind = before < -nearest and not is_open
    if len(place.sides) == 1 and (is_behind or nearest < before < farthest):
        return "wall_unclear"
    return "wall_moved"


def open_runs(found: Survey, wall: int, shortest: float) -> list[tuple[float, float]]:
    """Gaps in a wall through which the map is free: first and last place along it [m]."""
    plan = found.plan
    is_own = (plan.wall == wall) & (plan.side > 0.0)
    is_open = found.is_open[is_own]
    step = plan.lengths[wall] / len(is_open)
    runs = step * runs_of(is_open)
    return [(start, stop) for start, stop in runs.tolist() if stop - start >= shortest]


def _pairs(plan: PlanWalls, evidence: MapEvidence) -> tuple[IntArray, FloatArray]:
    """Points of walls and of the map before or behind them: numbers of the first, offsets along walls' normals [m]."""
    tree = KDTree(evidence.points)
    near = KDTree(plan.points).sparse_distance_matrix(tree, MISSED, output_type="ndarray")
    index = near["i"]
    other = near["j"]
    normal = plan.point_normals[index]
    difference = evidence.points[other] - plan.points[index]
    sideways = np.abs(cross(difference, normal))
    forward = (difference * normal).sum(axis=1)
    alike = (evidence.normals[other] * normal).sum(axis=1) > ALIKE
    keep = alike & (sideways < USUAL_CELL)
    offset = plan.side[index] * forward
    return index[keep], offset[keep]


def _nearest_offsets(pairs: tuple[IntArray, FloatArray], expected: FloatArray) -> FloatArray:
    """For each point the offset that is nearest to what is expected, (S,); nan where there is none."""
    index, offset = pairs
    away = np.abs(offset - expected[index])
    order = np.lexsort((away, index))
    _, firsts = np.unique(index[order], return_index=True)
    first = order[firsts]
    found = np.full(len(expected), np.nan)
    found[index[first]] = offset[first]
    return found


def _distortion(plan: PlanWalls, offsets: FloatArray) -> tuple[FloatArray, FloatArray, Drift]:
    """The distortion along the normals of all walls, from the other walls around, its standard error, and its field."""
    count = len(plan.lengths)
    values = np.zeros(count)
    noise = np.full(count, np.inf)
    for wall in range(count):
        is_own = plan.wall == wall
        own = offsets[is_own]
        place = _around(own, plan.side[is_own], _commonest(own))
        values[wall] = place.offset
        noise[wall] = place.error
    seen = np.flatnonzero(np.isfinite(noise))
    field = Drift(plan.middles[seen], plan.normals[seen], values[seen], noise[seen])
    drift, deviation = field.predict(plan.middles, plan.normals)
    drift[seen] = field.expected
    deviation[seen] = field.deviation
    return drift, deviation, field


def _commonest(values: FloatArray) -> float:
    """The offset (N,), nan where there is none, that most points agree on; the smaller if two are as common."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0
    apart = np.abs(known[:, None] - known)
    agree = (apart <= NEAR).sum(axis=1)
    rating = agree - 0.05 * np.abs(known)
    return float(known[rating.argmax()])


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
    seen = []
    middles = []
    for side in (1.0, -1.0):
        of_side = values[close & (sides == side)]
        if len(of_side):
            seen.append(side)
            middles.append(np.median(of_side))
    offset = float(np.mean(middles))
    scatter = 1.4826 * np.median(np.abs(values[close] - offset))
    independent = max(1.0, close.sum() * USUAL_CELL / CORRELATED)
    rounding = USUAL_CELL / np.sqrt(12.0)  # a straight wall lies anywhere within its row of cells
    error = np.hypot(np.sqrt(1.57 / independent) * scatter, rounding)
    return _Place(offset, float(error), float(close.mean()), seen)
