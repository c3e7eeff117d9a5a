"""Laying a map over a plan without knowing where it lies.

Coarse: the map's walls and free space, turned by every few degrees, are correlated with the plan's at all shifts.
Fine: the best distinct poses are refined by iterated closest points on the faces of walls, point to line, with normals
that agree and far residuals left out (Chetverikov et al., "The trimmed iterative closest point algorithm", 2002), so
that furniture and changes don't pull. What wins must explain the plan's walls where the map shows something.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from scipy.ndimage import maximum_filter
from scipy.spatial import KDTree

from slamgym.cad.floorplan import FloorPlan, fill_segments
from slamgym.core.geometry import compose, transform_points, wrap_angle
from slamgym.core.types import FREE, Float32Array, FloatArray, GridFrame, Pose2D
from slamgym.drawing.comparison.faces import MapEvidence, PlanWalls
from slamgym.drawing.free_space import cross
from slamgym.drawing.settings import SAME_DIRECTION
from slamgym.metrics.maps import distance_to

ANGLES = 120
"""Directions of the coarse search."""
COARSE_CELL = 0.15
"""Smallest cell of the coarse search [m]. Without it comparing a home takes twice as long and finds the same."""
COARSE_CELLS = 160
"""Most cells of the coarse search along the plan's longer side."""
REFINED = 8
"""Poses that are refined."""
DISTINCT_PLACE = 0.6
"""Poses are distinct if their places differ by more [m]."""
GATES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.25, 0.2)
"""Points farther from their wall than this are left out, iteration by iteration [m]."""
NORMAL_WEIGHT = 0.5
"""Weight of a difference between normals in the search for the nearest face [m per unit]. Without it 2 of
36 maps would be taken for other buildings', with it none."""
MAX_POINTS = 4000
"""Points of a map that the search uses."""
CLOSE = 0.12
"""A point that is so near to a face, and looks the same way, is explained [m]."""
MISSED = 0.75
"""A face that is farther than this from all that the map shows is missing, not moved [m]. With 1.0 there is a false
change in 9 empty homes."""
MIN_SCORE = 0.73
"""Below this score plan and map are taken to be of different buildings. Maps of changed buildings score 0.71 to 0.94
over their own plans, and 0.41 to 0.71 over others."""
_RIVAL = 0.04
"""Another pose whose score is nearer than this makes the best one ambiguous."""
SCALE_DOUBT = 0.03
"""A scale that differs from 1 by more is a doubt; good maps of robots fit best 0 to 2 % larger."""


@dataclass(frozen=True)
class Registration:
    """Pose of a map over a plan, and how well the two agree there."""

    plan_from_map: Pose2D
    scale: float
    """Factor of the map's lengths with which it would fit better; it isn't used."""
    explained: float
    """Share of the plan's walls in view that the map has, too."""
    inside: float
    """Share of the map's floor that is the plan's."""
    supported: float
    """Share of the map's walls that are the plan's; furniture lowers it."""
    nearness: float
    """1 where every wall in view is at one of the map's, 0 where all are far from any."""
    rival_score: float = 0.0
    """Score of the best pose that is clearly a different one."""

    @property
    def score(self) -> float:
        """Agreement of plan and map, in [0, 1]."""
        return 0.5 * self.explained + 0.3 * self.inside + 0.2 * self.supported

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
            found.append(
                "the map fits the plan nearly as well at another place (a symmetric building?)"
            )
        if abs(self.scale - 1.0) > SCALE_DOUBT:
            found.append(
                f"scale doubtful: the map would fit better {self.scale:.3f} times as large"
            )
        return tuple(found)


def register(plan: FloorPlan, walls: PlanWalls, evidence: MapEvidence) -> Registration:
    """Find how a map, in its own frame, lies over a plan with its walls."""
    fitter = _Fitter(plan, walls, evidence)
    starts = _coarse_poses(plan, walls, fitter.some.points, fitter.free)
    fits = [fitter.rate(*fitter.refine(start)) for start in starts]
    highest = max(fit.score for fit in fits)
    # Of poses that are nearly as good, the one whose unexplained walls are nearest to others: moved, not missing.
    nearly_as_good = [fit for fit in fits if highest - fit.score < _RIVAL]
    best = max(nearly_as_good, key=lambda fit: fit.nearness)
    pose = best.plan_from_map
    middle = fitter.free.mean(axis=0)
    rivals = [fit.score for fit in fits if _are_distinct(fit.plan_from_map, pose, middle)]
    return replace(best, rival_score=max(rivals, default=0.0))


class _Fitter:
    """Refines and rates poses of one map over one plan."""

    def __init__(self, plan: FloorPlan, walls: PlanWalls, evidence: MapEvidence) -> None:
        rng = np.random.default_rng(0)
        chosen = rng.permutation(len(evidence.points))[:MAX_POINTS]
        self.some = replace(
            evidence, points=evidence.points[chosen], normals=evidence.normals[chosen]
        )
        row, col = np.nonzero(evidence.grid.cells == FREE)
        chosen = rng.permutation(len(row))[:MAX_POINTS]
        self.free = evidence.grid.frame.to_points(row[chosen], col[chosen])
        self._walls = walls
        self._evidence = evidence
        self._features = _features(walls.points, walls.point_normals)
        self._tree = KDTree(self._features)
        self._floor = plan.free_space.buffer(0.15)
        shapely.prepare(self._floor)

    def refine(self, pose: Pose2D) -> tuple[Pose2D, float]:
        """Iterated closest points from a first guess: the pose, and the scale that would fit better there."""
        scale = 1.0
        for gate in GATES:
            moved, nearest, residual, normal = self._nearest(pose)
            good = (np.abs(residual) < gate) & (nearest < gate + 0.1)
            if good.sum() < 20:
                break
            step, scale = _best_step(moved[good], normal[good], residual[good], gate)
            # About the middle of the points, not about the origin.
            x, y = moved[good].mean(axis=0)
            about = Pose2D(pose.x - x, pose.y - y, pose.theta)
            moved_by = Pose2D(x + step.x, y + step.y, step.theta)
            pose = compose(moved_by, about)
        return pose, scale

    def rate(self, pose: Pose2D, scale: float) -> Registration:
        """Compare plan and map at a pose."""
        _, nearest, residual, _ = self._nearest(pose)
        is_supported = (np.abs(residual) < CLOSE) & (nearest < 2.0 * CLOSE)
        is_inside = shapely.contains_xy(self._floor, transform_points(pose, self.free))
        away = self._distances_from_map(pose)
        return Registration(
            plan_from_map=pose,
            scale=scale,
            explained=float((away < 2.0 * CLOSE).mean()) if len(away) else 0.0,
            inside=float(is_inside.mean()),
            supported=float(is_supported.mean()),
            nearness=1.0 - float(away.mean()) / MISSED if len(away) else 0.0,
        )

    def _distances_from_map(self, pose: Pose2D) -> FloatArray:
        """For points of the plan's walls in view the distance to the nearest of the map's, :data:`MISSED` at most."""
        evidence = self._evidence.moved(pose)
        walls = self._walls
        in_view = evidence.is_free_before(walls.points, walls.point_normals)
        tree = KDTree(_features(evidence.points, evidence.normals))
        away, _ = tree.query(self._features[in_view], distance_upper_bound=MISSED)
        return np.minimum(away, MISSED)

    def _nearest(self, pose: Pose2D) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Points of the map, distances to the nearest face that looks alike, the same along its normal, the normal."""
        moved = self.some.moved(pose)
        distance, index = self._tree.query(_features(moved.points, moved.normals))
        normal = self._walls.point_normals[index]
        difference = moved.points - self._walls.points[index]
        residual = (difference * normal).sum(axis=1)
        return moved.points, np.asarray(distance, np.float64), residual, normal


def _best_step(
    moved: FloatArray, normal: FloatArray, residual: FloatArray, gate: float
) -> tuple[Pose2D, float]:
    """The small motion about their middle that brings points to their faces, and the scale that would fit better.

    Args:
        moved: The points, (N, 2) [m].
        normal: Of their faces, (N, 2).
        residual: Their distances from their faces, (N,) [m].
        gate: The largest of these [m].
    """
    arm = moved - moved.mean(axis=0)
    turning = cross(arm, normal)
    scaling = (normal * arm).sum(axis=1)
    # Faces that all stand a little before or behind their place are no scale.
    before = np.ones(len(arm))
    left = np.column_stack([normal, turning, scaling, before])
    weight = np.sqrt(1.0 / (1.0 + (residual / (0.4 * gate)) ** 2))
    weighted_left = left * weight[:, None]
    weighted_right = -residual * weight
    solution, *_ = np.linalg.lstsq(weighted_left, weighted_right, rcond=1e-6)
    x, y, angle, larger, _ = solution.tolist()
    return Pose2D(x, y, angle), 1.0 + larger


def _features(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Points of faces so that those that look alike are near each other, (N, 4)."""
    return np.hstack([points, NORMAL_WEIGHT * normals])


def _coarse_poses(
    plan: FloorPlan, walls: PlanWalls, points: FloatArray, free: FloatArray
) -> list[Pose2D]:
    """The most promising distinct poses of a map over a plan."""
    cell = max(COARSE_CELL, plan.extent / COARSE_CELLS)
    everything = np.vstack([points, free])
    middle = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
    radius = float(np.hypot(*(everything - middle).T).max())
    half = math.ceil(radius / cell) + 1
    # The map's middle is tried at all cells of the plan's.
    frame = GridFrame.covering(plan.bounds, cell, margin=(half + 2) * cell)
    image = _plan_image(walls, plan, frame)
    angles = wrap_angle(2.0 * np.pi * np.arange(ANGLES) / ANGLES).tolist()
    turns = [Pose2D(0.0, 0.0, angle) for angle in angles]
    scores = []
    for turn in turns:
        of_walls = _shares(transform_points(turn, points - middle) / cell, half)
        of_free = _shares(transform_points(turn, free - middle) / cell, half)
        turned = np.dstack([of_walls, of_free])
        scores.append(cv2.matchTemplate(image, turned, cv2.TM_CCORR))
    poses = []
    for number, row, col in _highest_peaks(np.stack(scores), cell):
        turn = turns[number]
        shift = transform_points(turn, -middle[None])[0]
        x, y = frame.to_points(row + half, col + half) + shift
        poses.append(turn._replace(x=float(x), y=float(y)))
    return poses


def _highest_peaks(scores: Float32Array, cell: float) -> list[tuple[int, int, int]]:
    """Turn, row and column of the highest distinct peaks of scores (turns, rows, cols), the highest last."""
    rows_apart = math.ceil(DISTINCT_PLACE / cell)
    turns_apart = math.ceil(SAME_DIRECTION * ANGLES / (2.0 * np.pi))
    side = 2 * rows_apart + 1
    size = (2 * turns_apart + 1, side, side)
    highest_around = maximum_filter(scores, size, mode=("wrap", "nearest", "nearest"))
    is_peak = scores >= highest_around
    of_peaks = np.where(is_peak, scores, -np.inf)
    best = np.argsort(of_peaks, axis=None)[-REFINED:]
    peaks = np.stack(np.unravel_index(best, scores.shape), axis=1)
    return [(turn, row, col) for turn, row, col in peaks.tolist()]


def _plan_image(walls: PlanWalls, plan: FloorPlan, frame: GridFrame) -> Float32Array:
    """Nearness to walls, and floor or not, (rows, cols, 2)."""
    is_wall = np.zeros(frame.shape, np.bool_)
    is_wall[frame.to_cell(*walls.points.T)] = True
    away = distance_to(is_wall)
    nearness = np.exp(-0.5 * (away / 1.2) ** 2)
    floor = fill_segments(plan.segments(), frame)
    return np.dstack([nearness, floor - 0.5]).astype(np.float32)


def _shares(places: FloatArray, half: int) -> Float32Array:
    """Shares of places (N, 2) [cells] in the cells about the origin, row 0 at the top."""
    edges = np.arange(-half, half + 2) - 0.5
    down = -places[:, 1]
    right = places[:, 0]
    counts, _, _ = np.histogram2d(down, right, (edges, edges))
    shares = counts / max(len(places), 1)
    return shares.astype(np.float32)


def _are_distinct(first: Pose2D, second: Pose2D, middle: FloatArray) -> bool:
    """True if two poses put the middle of a map at different places, or turn it differently."""
    place = transform_points(first, middle[None])[0]
    other = transform_points(second, middle[None])[0]
    turn = abs(float(wrap_angle(first.theta - second.theta)))
    return math.dist(place, other) > DISTINCT_PLACE or turn > SAME_DIRECTION
