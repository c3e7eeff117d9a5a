"""Laying a map over a plan without knowing where it lies.

Coarse: the map's walls and free space, turned by every few degrees, are correlated with the plan's at all shifts.
Fine: the best distinct poses are refined by iterated closest points on the faces of walls, point to line, with normals
that agree and far residuals left out (Chetverikov et al., "The trimmed iterative closest point algorithm", 2002), so
that furniture and changes don't pull. What wins must explain the plan's walls where the map shows something.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
import shapely
from scipy.spatial import KDTree

from slamgym.cad.floorplan import FloorPlan, fill_segments
from slamgym.core.geometry import transform_points, wrap_angle
from slamgym.core.types import FREE, Float32Array, FloatArray, GridFrame, Pose2D
from slamgym.drawing.comparison.faces import MapEvidence
from slamgym.drawing.comparison.plan_walls import PlanWalls
from slamgym.metrics.maps import distance_to

ANGLES = 120
COARSE_CELL, COARSE_CELLS = 0.15, 160
"""Smallest cell of the coarse search [m], and how many of them the plan is long at most."""
PER_ANGLE, REFINED = 3, 8
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
    plan: FloorPlan, walls: PlanWalls, evidence: MapEvidence, fit_scale: bool = False
) -> Registration:
    """Find how a map lies over a plan.

    Args:
        plan: The plan.
        walls: Its walls.
        evidence: The map, in its own frame.
        fit_scale: Whether its scale is fitted, within 10 %; else that is only reported.
    """
    fitter = _Fitter(plan, walls, evidence)
    starts = _coarse_poses(plan, walls, fitter.some.grid_points, fitter.free)
    fits = [fitter.rate(*fitter.refine(start, 1.0, fit_scale)) for start in starts]
    highest = max(fit.score for fit in fits)
    # Of poses that are nearly as good, the one whose unexplained walls are nearest to others: moved, not missing.
    best = max((fit for fit in fits if highest - fit.score < _RIVAL), key=lambda fit: fit.nearness)
    pose, scale = best.pose, best.scale
    rivals = [fit.score for fit in fits if _are_distinct(fit.pose, pose, fitter.middle)]
    fitted = scale if fit_scale else fitter.refine(pose, 1.0, True)[1]
    return Registration(pose, scale, fitted, *best.shares, best.score, max(rivals, default=0.0))


class _Fit(NamedTuple):
    """A pose and scale, and how well the map agrees with the plan then."""

    pose: Pose2D
    scale: float
    score: float
    shares: tuple[float, float, float]
    """Of the plan's walls in view that are there, of the map's floor inside, of its walls supported."""
    nearness: float
    """1 where every wall in view is at one of the map's, 0 where all are far from any."""


class _Fitter:
    """Refines and rates poses of one map over one plan."""

    def __init__(self, plan: FloorPlan, walls: PlanWalls, evidence: MapEvidence) -> None:
        rng = np.random.default_rng(0)
        chosen = rng.permutation(len(evidence.grid_points))[:MAX_POINTS]
        points, normals = evidence.grid_points[chosen], evidence.grid_normals[chosen]
        self.some = replace(evidence, grid_points=points, grid_normals=normals)
        row, col = np.nonzero(evidence.grid.cells == FREE)
        chosen = rng.permutation(len(row))[:MAX_POINTS]
        self.free = evidence.grid.frame.to_points(row[chosen], col[chosen])
        self.middle = self.free.mean(axis=0)
        self._walls, self._evidence = walls, evidence
        self._features = _features(walls.points, walls.point_normals)
        self._tree = KDTree(self._features)
        self._floor = plan.free_space.buffer(0.15)
        shapely.prepare(self._floor)

    def refine(self, pose: Pose2D, scale: float, fit_scale: bool) -> tuple[Pose2D, float]:
        """Iterated closest points from a first guess."""
        for gate in GATES:
            moved, nearest, residual, normal = self._nearest(pose, scale)
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
            left = np.stack(columns, axis=1) * weight[:, None]
            x, y, angle, *more = np.linalg.lstsq(left, -residual * weight, rcond=1e-6)[0].tolist()
            factor = float(np.clip(1.0 + more[0], 0.97, 1.03)) if fit_scale else 1.0
            step = Pose2D(centre[0] + x, centre[1] + y, angle)
            ((x, y),) = transform_points(step, factor * (np.array([[pose.x, pose.y]]) - centre)).tolist()
            pose = Pose2D(x, y, float(wrap_angle(pose.theta + angle)))
            scale = float(np.clip(scale * factor, 0.9, 1.1))
        return pose, scale

    def rate(self, pose: Pose2D, scale: float) -> _Fit:
        """Compare plan and map at a pose and scale."""
        evidence = self._evidence.moved(pose, scale)
        _, nearest, residual, _ = self._nearest(pose, scale)
        supported = float(((np.abs(residual) < CLOSE) & (nearest < 2.0 * CLOSE)).mean())
        inside = float(shapely.contains_xy(self._floor, transform_points(pose, scale * self.free)).mean())
        tree = KDTree(_features(evidence.points, evidence.normals))
        asked = self._features[evidence.is_free_before(self._walls.points, self._walls.point_normals)]
        away = np.minimum(tree.query(asked, distance_upper_bound=MISSED)[0], MISSED)
        explained = float((away < 2.0 * CLOSE).mean()) if len(away) else 0.0
        score = 0.5 * explained + 0.3 * inside + 0.2 * supported
        nearness = 1.0 - float(away.mean()) / MISSED if len(away) else 0.0
        return _Fit(pose, scale, score, (explained, inside, supported), nearness)

    def _nearest(self, pose: Pose2D, scale: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Points of the map, distances to the nearest face that looks alike, the same along its normal, the normal."""
        moved = self.some.moved(pose, scale)
        distance, index = self._tree.query(_features(moved.points, moved.normals))
        normal = self._walls.point_normals[index]
        residual = ((moved.points - self._walls.points[index]) * normal).sum(axis=1)
        return moved.points, np.asarray(distance, np.float64), residual, normal


def _features(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Points of faces so that those that look alike are near each other, (N, 4)."""
    return np.hstack([points, NORMAL_WEIGHT * normals])


def _coarse_poses(plan: FloorPlan, walls: PlanWalls, points: FloatArray, free: FloatArray) -> list[Pose2D]:
    """The most promising distinct poses of a map over a plan."""
    cell = max(COARSE_CELL, plan.extent / COARSE_CELLS)
    everything = np.vstack([points, free])
    middle = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
    half = math.ceil(float(np.hypot(*(everything - middle).T).max()) / cell) + 1
    # The map's middle is tried at all cells of the plan's.
    frame = GridFrame.covering(plan.bounds, cell, margin=(half + 2) * cell)
    image = _plan_image(walls, plan, frame)
    kernel = np.ones(2 * [2 * max(2, round(DISTINCT[0] / cell)) + 1], np.uint8)
    candidates: list[tuple[float, Pose2D]] = []
    for angle in wrap_angle(2.0 * np.pi * np.arange(ANGLES) / ANGLES).tolist():
        turn = Pose2D(0.0, 0.0, angle)
        clouds = [_shares(transform_points(turn, cloud - middle) / cell, half) for cloud in (points, free)]
        scores = cv2.matchTemplate(image, np.dstack(clouds), cv2.TM_CCORR)
        peaks = np.where(scores >= cv2.dilate(scores, kernel), scores, -np.inf)
        for best in np.argsort(peaks, axis=None)[-PER_ANGLE:]:
            row, col = np.unravel_index(best, peaks.shape)
            (origin,) = transform_points(turn, -middle[None])
            x, y = (np.array(frame.to_point(int(row) + half, int(col) + half)) + origin).tolist()
            candidates.append((float(peaks[row, col]), Pose2D(x, y, angle)))
    kept: list[Pose2D] = []
    for _, pose in sorted(candidates, key=lambda entry: -entry[0]):
        if len(kept) < REFINED and all(_are_distinct(pose, other, middle) for other in kept):
            kept.append(pose)
    return kept


def _plan_image(walls: PlanWalls, plan: FloorPlan, frame: GridFrame) -> Float32Array:
    """Nearness to walls, and floor or not, (rows, cols, 2)."""
    is_wall = np.zeros(frame.shape, np.bool_)
    is_wall[frame.to_cell(*walls.points.T)] = True
    away = distance_to(is_wall)
    floor = fill_segments(plan.segments(), frame)
    return np.dstack([np.exp(-0.5 * (away / 1.2) ** 2), floor - 0.5]).astype(np.float32)


def _shares(places: FloatArray, half: int) -> Float32Array:
    """Shares of places (N, 2) [cells] in the cells about the origin, row 0 at the top."""
    edges = np.arange(-half, half + 2) - 0.5
    counts, _, _ = np.histogram2d(-places[:, 1], places[:, 0], (edges, edges))
    return (counts / max(len(places), 1)).astype(np.float32)


def _are_distinct(first: Pose2D, second: Pose2D, middle: FloatArray) -> bool:
    """True if two poses put the middle of a map at different places, or turn it differently."""
    places = [transform_points(pose, middle[None])[0] for pose in (first, second)]
    apart = float(np.hypot(*(places[0] - places[1])))
    return apart > DISTINCT[0] or abs(float(wrap_angle(first.theta - second.theta))) > DISTINCT[1]
