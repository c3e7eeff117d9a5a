"""Laying a map over a plan without knowing where it lies.

Coarse: the map's walls and free space, turned by every few degrees, are correlated with the plan's at all shifts
(FFT). Fine: the best distinct poses are refined by iterated closest points on the faces of walls, point to line, with
normals that agree and far residuals left out (Chetverikov et al., "The trimmed iterative closest point algorithm",
2002), so that furniture and changes don't pull. What wins must explain the plan's walls where the map shows something.
"""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import shapely
from scipy import fft
from scipy.spatial import KDTree

from slamgym.cad.floorplan import FloorPlan, fill_segments
from slamgym.core.geometry import transform_points, wrap_angle
from slamgym.core.types import FREE, Float32Array, FloatArray, GridFrame, Pose2D
from slamgym.drawing.comparison.faces import IN_VIEW, MapEvidence, PlanFaces

ANGLES = 120
COARSE_CELL, COARSE_CELLS = 0.15, 160
"""Smallest cell of the coarse search [m], and how many of them the plan is long at most."""
PER_ANGLE, REFINED = 3, 16
"""Shifts kept of each angle, and poses that are refined."""
DISTINCT = (0.6, 0.12)
"""Poses that differ by less are the same [m], [rad]."""
GATES = (1.0, 1.0, 0.7, 0.7, 0.5, 0.5, 0.35, 0.35, 0.25, 0.25, 0.25, 0.2, 0.2, 0.2)
"""Points farther from their wall than this are left out, iteration by iteration [m]."""
NORMAL_WEIGHT = 0.5
"""Weight of a difference between normals in the search for the nearest face [m per unit]."""
MAX_POINTS = 4000
"""Points of a map that the search uses."""
CLOSE = 0.12
"""A point that is so near to a face, and looks the same way, is explained [m]."""
MISSED = 0.75
"""A face that is farther than this from all that the map shows is missing, not moved [m]."""
MIN_SCORE = 0.73
"""Below this score plan and map are taken to be of different buildings. Maps of changed buildings score 0.71 to 0.94
over their own plans, and 0.41 to 0.71 over others."""
_RIVAL = 0.04
"""Another pose whose score is nearer than this makes the best one ambiguous."""
SCALE_DOUBT = 0.03
"""A scale that differs from 1 by more is a doubt; good maps of robots fit best 0 to 2 % larger."""


@dataclass(frozen=True)
class Registration:
    """Pose and scale of a map over a plan."""

    plan_from_map: Pose2D
    scale: float
    """Factor of the map's lengths; 1 unless it was to be fitted."""
    fitted_scale: float
    """The scale as a fit finds it, used or not."""
    explained: float
    """Share of the plan's walls in view that the map has, too."""
    inside: float
    """Share of the map's floor that is the plan's."""
    supported: float
    """Share of the map's walls that are the plan's; furniture lowers it."""
    score: float
    rival_score: float
    """Score of the best pose that is clearly a different one."""

    @property
    def is_same_building(self) -> bool:
        """True if plan and map agree at all."""
        return self.score >= MIN_SCORE

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts about it, as sentences."""
        found = []
        if not self.is_same_building:
            found.append(
                f"plan and map are of different buildings, it seems: {self.explained:.0%} of the plan's walls in view "
                f"are in the map, and {self.inside:.0%} of its floor is the plan's"
            )
        elif self.score - self.rival_score < _RIVAL:
            found.append("the map fits the plan nearly as well at another place (a symmetric building?)")
        if abs(self.fitted_scale - 1.0) > SCALE_DOUBT:
            found.append(f"scale doubtful: the map would fit better {self.fitted_scale:.3f} times as large")
        return tuple(found)


def register(
    plan: FloorPlan, faces: PlanFaces, evidence: MapEvidence, fit_scale: bool = False
) -> Registration:
    """Find how a map lies over a plan.

    Args:
        plan: The plan.
        faces: Its faces.
        evidence: The map, in its own frame.
        fit_scale: Whether its scale is fitted, within 10 %; else that is only reported.
    """
    fitter = _Fitter(plan, faces, evidence)
    starts = _coarse_poses(plan, faces, fitter.points, fitter.free)
    found = [fitter.refine(start, 1.0, fit_scale) for start in starts]
    rated = sorted(
        ((fitter.score(pose, scale), pose, scale) for pose, scale in found), key=lambda entry: -entry[0][0]
    )
    # Of poses that are nearly as good, the one whose unexplained walls are nearest to others: moved, not missing.
    near_best = [entry for entry in rated if rated[0][0][0] - entry[0][0] < _RIVAL]
    best = max(near_best, key=lambda entry: entry[0][4])
    (score, explained, inside, supported, _), pose, scale = best
    rivals = [entry[0][0] for entry in rated if _are_distinct(entry[1], pose, fitter.middle)]
    _, fitted = (pose, scale) if fit_scale else fitter.refine(pose, 1.0, True)
    return Registration(pose, scale, fitted, explained, inside, supported, score, max(rivals, default=0.0))


class _Fitter:
    """Refines and rates poses of one map over one plan."""

    def __init__(self, plan: FloorPlan, faces: PlanFaces, evidence: MapEvidence) -> None:
        rng = np.random.default_rng(0)
        chosen = rng.permutation(len(evidence.points))[:MAX_POINTS]
        self.points, self.normals = evidence.points[chosen], evidence.normals[chosen]
        row, col = np.nonzero(evidence.cells == FREE)
        some = rng.permutation(len(row))[:MAX_POINTS]
        self.free = np.stack(evidence.frame.to_point(row[some], col[some]), axis=1)
        self.middle = self.free.mean(axis=0)
        self._faces, self._evidence = faces, evidence
        self._tree = KDTree(np.hstack([faces.points, NORMAL_WEIGHT * faces.point_normals]))
        self._floor = plan.free_space.buffer(0.15)
        shapely.prepare(self._floor)

    def refine(self, pose: Pose2D, scale: float, fit_scale: bool) -> tuple[Pose2D, float]:
        """Iterated closest points from a first guess."""
        for gate in GATES:
            moved = transform_points(pose, scale * self.points)
            normals = transform_points(Pose2D(0.0, 0.0, pose.theta), self.normals)
            nearest, residual, normal = self._nearest(moved, normals)
            good = (np.abs(residual) < gate) & (nearest < gate + 0.1)
            if good.sum() < 20:
                break
            moved, normal, residual = moved[good], normal[good], residual[good]
            centre = moved.mean(axis=0)
            arm = moved - centre
            columns = [normal[:, 0], normal[:, 1], normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]]
            if fit_scale:
                # Faces that all stand a little before or behind their place are no scale.
                columns += [(normal * arm).sum(axis=1), np.ones(len(arm))]
            weight = np.sqrt(1.0 / (1.0 + (residual / (0.4 * gate)) ** 2))
            step = np.linalg.lstsq(
                np.stack(columns, axis=1) * weight[:, None], -residual * weight, rcond=1e-6
            )[0]
            factor = float(np.clip(1.0 + step[3], 0.97, 1.03)) if fit_scale else 1.0
            pose, scale = _stepped(pose, centre, step, factor), float(np.clip(scale * factor, 0.9, 1.1))
        return pose, scale

    def score(self, pose: Pose2D, scale: float) -> tuple[float, float, float, float, float]:
        """Score; shares of the plan's walls in view that are there, of floor inside, of walls supported; nearness."""
        evidence = self._evidence.moved(pose, scale)
        moved = transform_points(pose, scale * self.points)
        nearest, residual, _ = self._nearest(
            moved, transform_points(Pose2D(0.0, 0.0, pose.theta), self.normals)
        )
        supported = (
            float(((np.abs(residual) < CLOSE) & (nearest < 2.0 * CLOSE)).mean()) if len(moved) else 0.0
        )
        inside = float(shapely.contains_xy(self._floor, *transform_points(pose, scale * self.free).T).mean())
        faces = self._faces
        before = faces.points[:, None] + IN_VIEW[:, None] * faces.point_normals[:, None]
        in_view = (evidence.values(before) == FREE).any(axis=1)
        tree = KDTree(np.hstack([evidence.points, NORMAL_WEIGHT * evidence.normals]))
        asked = np.hstack([faces.points, NORMAL_WEIGHT * faces.point_normals])[in_view]
        if not len(asked):
            return 0.0, 0.0, inside, supported, 0.0
        away = np.minimum(tree.query(asked, distance_upper_bound=MISSED)[0], MISSED)
        explained = float((away < 2.0 * CLOSE).mean())
        score = 0.5 * explained + 0.3 * inside + 0.2 * supported
        return score, explained, inside, supported, float(1.0 - away.mean() / MISSED)

    def _nearest(self, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance to the nearest face that looks alike, distance along its normal, and the normal."""
        distance, index = self._tree.query(np.hstack([points, NORMAL_WEIGHT * normals]))
        distance = np.asarray(distance, np.float64)
        normal = self._faces.point_normals[index]
        residual = ((points - self._faces.points[index]) * normal).sum(axis=1)
        return distance, residual, normal


def _stepped(pose: Pose2D, centre: FloatArray, step: FloatArray, factor: float) -> Pose2D:
    """A pose after a small motion about a centre."""
    angle = float(step[2])
    cos, sin = math.cos(angle), math.sin(angle)
    arm = factor * (np.array([pose.x, pose.y]) - centre)
    x = centre[0] + cos * arm[0] - sin * arm[1] + step[0]
    y = centre[1] + sin * arm[0] + cos * arm[1] + step[1]
    return Pose2D(float(x), float(y), float(wrap_angle(pose.theta + angle)))


def _coarse_poses(plan: FloorPlan, faces: PlanFaces, points: FloatArray, free: FloatArray) -> list[Pose2D]:
    """The most promising distinct poses of a map over a plan."""
    low, high = np.array(plan.bounds[:2]), np.array(plan.bounds[2:])
    cell = max(COARSE_CELL, float((high - low).max()) / COARSE_CELLS)
    everything = np.vstack([points, free])
    middle = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
    radius = float(np.hypot(*(everything - middle).T).max())
    frame = GridFrame.covering((*low, *high), cell, margin=2.0 * cell)
    walls, floor = _plan_images(faces, plan, frame)
    half = math.ceil(radius / cell) + 1
    shape = [fft.next_fast_len(size + 2 * half + 1, real=True) for size in frame.shape]
    spectra = [fft.rfft2(image, shape, workers=1) for image in (walls, floor)]
    candidates: list[tuple[float, Pose2D]] = []
    for angle in 2.0 * np.pi * np.arange(ANGLES) / ANGLES:
        turn = Pose2D(0.0, 0.0, float(angle))
        total: Any = 0.0
        for spectrum, cloud in zip(spectra, (points, free), strict=True):
            image = _point_image(transform_points(turn, cloud - middle), cell, half)
            total = total + spectrum * np.conj(fft.rfft2(image, shape, workers=1))
        scores = fft.irfft2(total, shape, workers=1)
        for score, row, col in _peaks(scores, max(2, round(DISTINCT[0] / cell))):
            # The image's middle lies at (half, half); negative shifts are at the far end.
            shift_row = row - shape[0] if row >= frame.height_px else row
            shift_col = col - shape[1] if col >= frame.width_px else col
            x, y = frame.to_point(shift_row + half, shift_col + half)
            offset = transform_points(turn, -middle[None])[0]
            candidates.append(
                (score, Pose2D(float(x + offset[0]), float(y + offset[1]), float(wrap_angle(angle))))
            )
    candidates.sort(key=lambda entry: -entry[0])
    kept: list[Pose2D] = []
    for _, pose in candidates:
        if all(_are_distinct(pose, other, middle) for other in kept):
            kept.append(pose)
        if len(kept) == REFINED:
            break
    return kept


def _plan_images(faces: PlanFaces, plan: FloorPlan, frame: GridFrame) -> tuple[Float32Array, Float32Array]:
    """Nearness to walls, and floor or not, row 0 at the top."""
    canvas = np.full(frame.shape, 255, np.uint8)
    row, col = frame.to_cell(faces.points[:, 0], faces.points[:, 1])
    canvas[np.clip(row, 0, canvas.shape[0] - 1), np.clip(col, 0, canvas.shape[1] - 1)] = 0
    away = cv2.distanceTransform(canvas, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    floor = fill_segments(plan.segments(), frame)
    return np.exp(-0.5 * (away / 1.2) ** 2).astype(np.float32), (floor - 0.5).astype(np.float32)


def _point_image(points: FloatArray, cell: float, half: int) -> Float32Array:
    """Shares of the points in cells about the origin, row 0 at the top."""
    size = 2 * half + 1
    col = np.clip(np.floor(points[:, 0] / cell + 0.5).astype(np.int64) + half, 0, size - 1)
    row = np.clip(half - np.floor(points[:, 1] / cell + 0.5).astype(np.int64), 0, size - 1)
    counts = np.bincount(row * size + col, minlength=size * size).reshape(size, size)
    return (counts / max(len(points), 1)).astype(np.float32)


def _peaks(scores: FloatArray, apart: int) -> list[tuple[float, int, int]]:
    """The highest places of a field, no two of them near each other."""
    scores = scores.copy()
    found = []
    for _ in range(PER_ANGLE):
        row, col = np.unravel_index(int(scores.argmax()), scores.shape)
        found.append((float(scores[row, col]), int(row), int(col)))
        rows = np.arange(row - apart, row + apart + 1) % scores.shape[0]
        cols = np.arange(col - apart, col + apart + 1) % scores.shape[1]
        scores[np.ix_(rows, cols)] = -np.inf
    return found


def _are_distinct(first: Pose2D, second: Pose2D, middle: FloatArray) -> bool:
    """True if two poses put the middle of a map at different places, or turn it differently."""
    places = [transform_points(pose, middle[None])[0] for pose in (first, second)]
    apart = float(np.hypot(*(places[0] - places[1])))
    return apart > DISTINCT[0] or abs(float(wrap_angle(first.theta - second.theta))) > DISTINCT[1]
