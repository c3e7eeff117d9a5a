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
from slamgym.metrics.maps import distance_to

ANGLES = 120
COARSE_CELL, COARSE_CELLS = 0.15, 160
"""Smallest cell of the coarse search [m], and how many of them the plan is long at most."""
REFINED = 8
"""Poses that are refined."""
DISTINCT = (0.6, 0.12)
"""Poses that differ by less are the same [m], [rad]."""
GATES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.25, 0.2)
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
    best = max((fit for fit in fits if highest - fit.score < _RIVAL), key=lambda fit: fit.nearness)
    pose, middle = best.plan_from_map, fitter.free.mean(axis=0)
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
        self._walls, self._evidence = walls, evidence
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
            moved, normal, residual = moved[good], normal[good], residual[good]
            centre = moved.mean(axis=0)
            arm = moved - centre
            turning = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
            # Faces that all stand a little before or behind their place are no scale.
            left = np.column_stack([normal, turning, (normal * arm).sum(axis=1), np.ones(len(arm))])
            weight = np.sqrt(1.0 / (1.0 + (residual / (0.4 * gate)) ** 2))
            fit = np.linalg.lstsq(left * weight[:, None], -residual * weight, rcond=1e-6)[0]
            x, y, angle, larger, _ = fit.tolist()
            scale = 1.0 + larger
            step = Pose2D(centre[0] + x, centre[1] + y, angle)
            pose = compose(step, Pose2D(pose.x - centre[0], pose.y - centre[1], pose.theta))
        return pose, scale

    def rate(self, pose: Pose2D, scale: float) -> Registration:
        """Compare plan and map at a pose."""
        evidence = self._evidence.moved(pose)
        _, nearest, residual, _ = self._nearest(pose)
        supported = float(((np.abs(residual) < CLOSE) & (nearest < 2.0 * CLOSE)).mean())
        inside = float(shapely.contains_xy(self._floor, transform_points(pose, self.free)).mean())
        tree = KDTree(_features(evidence.points, evidence.normals))
        asked = self._features[
            evidence.is_free_before(self._walls.points, self._walls.point_normals)
        ]
        away = np.minimum(tree.query(asked, distance_upper_bound=MISSED)[0], MISSED)
        explained = float((away < 2.0 * CLOSE).mean()) if len(away) else 0.0
        nearness = 1.0 - float(away.mean()) / MISSED if len(away) else 0.0
        return Registration(pose, scale, explained, inside, supported, nearness)

    def _nearest(self, pose: Pose2D) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Points of the map, distances to the nearest face that looks alike, the same along its normal, the normal."""
        moved = self.some.moved(pose)
        distance, index = self._tree.query(_features(moved.points, moved.normals))
        normal = self._walls.point_normals[index]
        residual = ((moved.points - self._walls.points[index]) * normal).sum(axis=1)
        return moved.points, np.asarray(distance, np.float64), residual, normal


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
    half = math.ceil(float(np.hypot(*(everything - middle).T).max()) / cell) + 1
    # The map's middle is tried at all cells of the plan's.
    frame = GridFrame.covering(plan.bounds, cell, margin=(half + 2) * cell)
    image = _plan_image(walls, plan, frame)
    angles = wrap_angle(2.0 * np.pi * np.arange(ANGLES) / ANGLES).tolist()
    turns = [Pose2D(0.0, 0.0, angle) for angle in angles]
    scores = []
    for turn in turns:
        clouds = [
            _shares(transform_points(turn, cloud - middle) / cell, half) for cloud in (points, free)
        ]
        scores.append(cv2.matchTemplate(image, np.dstack(clouds), cv2.TM_CCORR))
    far, wide = math.ceil(DISTINCT[0] / cell), math.ceil(DISTINCT[1] * ANGLES / (2.0 * np.pi))
    size = 2 * wide + 1, 2 * far + 1, 2 * far + 1
    peaks = scores >= maximum_filter(scores, size, mode=("wrap", "nearest", "nearest"))
    best = np.argsort(np.where(peaks, scores, -np.inf), axis=None)[-REFINED:]
    angle, row, col = np.unravel_index(best, peaks.shape)
    shifts = [transform_points(turns[k], -middle[None])[0] for k in angle]
    places = frame.to_points(row + half, col + half) + shifts
    return [turns[k]._replace(x=x, y=y) for k, (x, y) in zip(angle, places.tolist(), strict=True)]


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
    apart = math.dist(*places)
    return apart > DISTINCT[0] or abs(float(wrap_angle(first.theta - second.theta))) > DISTINCT[1]
