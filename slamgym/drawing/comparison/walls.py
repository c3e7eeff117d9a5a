"""State of each face of the plan's walls: present, moved, missing, covered, or not seen."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from slamgym.core.types import FREE, OCCUPIED, BoolArray, FloatArray, IntArray
from slamgym.drawing.comparison.distortion import Stretches, estimate_drift
from slamgym.drawing.comparison.faces import FACE_STEP, IN_VIEW, MapEvidence, PlanFaces
from slamgym.drawing.comparison.records import FaceReport, FaceState, Line
from slamgym.drawing.comparison.registration import MISSED
from slamgym.drawing.settings import ComparisonConfig

LATERAL = 0.045
"""A point of the map lies before a point of a face if it is no farther to its side [m]."""
ALIKE = 0.7
"""Cosine of the angle between normals up to which a face of the map may be one of the plan."""
NEAR = 0.1
"""So near to its place a wall is there, and so near to the commonest offset a point belongs to its face [m]."""
NO_OPENING = 0.3
"""Where a wall stands so near to its place it has no opening, even if cells behind it are free [m]."""
THROUGH = (-0.075, -0.025, 0.025, 0.075)
"""Where the map is free so far from a face on both sides, there is no wall [m]."""
LEAST_SEEN = 0.3
"""A face of a wall of which less is seen is not judged."""
CELL_ROUNDING = 0.05 / np.sqrt(12.0)
"""A straight wall lies anywhere within its row of cells [m]."""
MOST, SOME = 0.5, 0.25
"""Shares of what is in view."""
CORRELATED = 0.25
"""Offsets of points nearer to each other than this say the same [m]."""
USUAL_DISTORTION = 0.4
"""Offsets beyond this say nothing about the map's distortion [m]."""


@dataclass(frozen=True)
class Faces:
    """Everything that was measured at the points of the faces, (S,)."""

    plan: PlanFaces
    offsets: FloatArray  # [m]; nan where the map has no such face nearby
    expected: FloatArray  # [m] offset by the map's distortion
    deviation: FloatArray  # standard error of that [m]
    in_view: BoolArray
    is_open: BoolArray  # free on both sides of the face

    @property
    def corrected(self) -> FloatArray:
        """Offsets without the distortion [m]."""
        return self.offsets - self.expected


def measure_faces(faces: PlanFaces, evidence: MapEvidence) -> Faces:
    """Measure all faces; in the second round the map's distortion is known from the first."""
    expected, deviation = np.zeros(len(faces.points)), np.zeros(len(faces.points))
    pairs = _pairs(faces, evidence)
    for _ in range(2):
        found = _look(faces, evidence, _nearest_offsets(pairs, expected), expected, deviation)
        expected, deviation = _expected(found)
    return _look(faces, evidence, _nearest_offsets(pairs, expected), expected, deviation)


def judge_face(found: Faces, face: int, config: ComparisonConfig) -> FaceReport:
    """Report on a face, from all of its points."""
    plan = found.plan
    line: Line = tuple(float(value) for value in plan.segments[face])  # type: ignore[assignment]
    own = np.flatnonzero(plan.face == face)
    view = own[found.in_view[own]]
    seen = len(view) / len(own)
    if seen < LEAST_SEEN or len(view) < 3:
        return FaceReport(line, "not_seen", seen, None, None, None, None)
    values = found.corrected[view]
    centre, support = _commonest(values)
    near = float((np.abs(values) <= NEAR).mean())
    if support < MOST and near < SOME and found.is_open[view].mean() >= MOST:
        return FaceReport(line, "missing", seen, None, None, None, None)
    if near >= SOME and abs(centre) > NEAR:
        # Part of it stands at its place: what is before the rest is furniture.
        centre = float(np.median(values[np.abs(values) <= NEAR]))
        support = near
    if support < SOME:
        return FaceReport(line, "unclear", seen, None, None, None, None)
    close = view[np.abs(found.corrected[view] - centre) <= NEAR]
    offset = float(np.median(found.corrected[close]))
    distortion = float(found.expected[close].mean())
    error = _standard_error(found, close, offset)
    is_moved = abs(offset) > config.moved and abs(offset) > config.sure * error and support >= MOST
    state: FaceState = "moved" if is_moved else "present"
    return FaceReport(line, state, seen, offset, error, offset + distortion, distortion)


def open_runs(found: Faces, face: int, shortest: float) -> list[tuple[float, float]]:
    """Gaps in a face through which the map is free: first and last place along it [m]."""
    own = np.flatnonzero(found.plan.face == face)
    wall_beside = np.abs(found.corrected[own]) <= NO_OPENING  # false for nan
    step = found.plan.lengths[face] / len(own)
    runs = step * runs_of(found.is_open[own] & ~wall_beside)
    return [(start, stop) for start, stop in runs.tolist() if stop - start >= shortest]


def runs_of(mask: BoolArray) -> IntArray:
    """Where each run of a mask (N,) begins, and where the next place behind it is, (R, 2)."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


def _standard_error(found: Faces, points: IntArray, offset: float) -> float:
    """Standard error of a median of correlated offsets, with rounding to cells and the error of the distortion [m]."""
    scatter = 1.4826 * float(np.median(np.abs(found.corrected[points] - offset)))
    independent = max(1.0, len(points) * FACE_STEP / CORRELATED)
    return float(
        np.sqrt(1.57 * scatter**2 / independent + CELL_ROUNDING**2 + found.deviation[points].mean() ** 2)
    )


def _pairs(faces: PlanFaces, evidence: MapEvidence) -> tuple[IntArray, FloatArray]:
    """Points of faces and points of the map before or behind them: number of the first, offset [m]."""
    tree = KDTree(evidence.points)
    lists: Any = tree.query_ball_point(faces.points, MISSED)
    counts = np.array([len(entries) for entries in lists])
    index = np.repeat(np.arange(len(faces.points)), counts)
    other = np.concatenate([np.asarray(entries, np.int64) for entries in lists]) if len(index) else index
    normal = faces.point_normals[index]
    difference = evidence.points[other] - faces.points[index]
    offset = (difference * normal).sum(axis=1)
    sideways = np.abs(difference[:, 0] * normal[:, 1] - difference[:, 1] * normal[:, 0])
    alike = (evidence.normals[other] * normal).sum(axis=1) > ALIKE
    keep = alike & (sideways < LATERAL)
    return index[keep], offset[keep]


def _nearest_offsets(pairs: tuple[IntArray, FloatArray], expected: FloatArray) -> FloatArray:
    """For each point the offset that is nearest to what is expected, (S,); nan where there is none."""
    index, offset = pairs
    order = np.lexsort((np.abs(offset - expected[index]), index))
    first = order[np.unique(index[order], return_index=True)[1]]
    found = np.full(len(expected), np.nan)
    found[index[first]] = offset[first]
    return found


def _expected(found: Faces) -> tuple[FloatArray, FloatArray]:
    """The distortion along the normal at every point, from the other walls around, and its standard error."""
    faces, count = found.plan, len(found.plan.lengths)
    values, noise = np.zeros(count), np.ones(count)
    for face in range(count):
        own = faces.face == face
        known = found.offsets[own]
        known = known[np.abs(known - found.expected[own]) < USUAL_DISTORTION]
        if len(known) >= max(3, SOME * own.sum()):
            values[face] = np.median(known)
            scatter = 1.4826 * np.median(np.abs(known - values[face]))
            noise[face] = np.hypot(
                CELL_ROUNDING, scatter / np.sqrt(max(1.0, len(known) * FACE_STEP / CORRELATED))
            )
    measured = np.flatnonzero(noise < 1.0)
    middles = 0.5 * (faces.segments[:, :2] + faces.segments[:, 2:])
    everywhere = Stretches(middles, faces.normals, values, noise)
    expected, deviation = np.zeros(count), np.full(count, 0.1)
    if len(measured) >= 4:
        chosen = Stretches(*(part[measured] for part in everywhere))
        same = np.array([faces.same_wall(face)[measured] for face in measured.tolist()])
        own_drift, error, expected, deviation = estimate_drift(chosen, same, everywhere)
        expected[measured], deviation[measured] = own_drift, error
    return expected[faces.face], deviation[faces.face]


def _look(
    faces: PlanFaces, evidence: MapEvidence, offsets: FloatArray, expected: FloatArray, deviation: FloatArray
) -> Faces:
    """Find the points in view, and those where the map is free through a face."""
    normals = faces.point_normals
    place = faces.points + expected[:, None] * normals
    through = evidence.values(place[:, None] + np.array(THROUGH)[:, None] * normals[:, None])
    before = evidence.values(place[:, None] + IN_VIEW[:, None] * normals[:, None])
    is_open = (through == FREE).mean(axis=1) > 0.7
    is_open &= ~(through == OCCUPIED).any(axis=1)
    in_view = (before == FREE).any(axis=1) | is_open | (np.abs(offsets - expected) < NEAR)
    return Faces(faces, offsets, expected, deviation, in_view, is_open)


def _commonest(values: FloatArray) -> tuple[float, float]:
    """The offset that most points agree on, and their share of all, those without any included."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 0.0
    agree = (np.abs(known[:, None] - known) <= NEAR).sum(axis=1) - 0.05 * np.abs(known)
    centre = float(known[agree.argmax()])
    return centre, float((np.abs(known - centre) <= NEAR).sum() / len(values))
