"""A robot that finds itself on a finished map: hypotheses from a global search, tracked by particles, judged openly."""

import math
import time

import numpy as np

from slamgym.core.geometry import between, compose, wrap_angle
from slamgym.core.types import FloatArray, LaserGeometry, LaserScan, OccupancyGrid, Pose2D
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.localization.config import LocalizationConfig
from slamgym.slam.localization.field import explain_scan, make_field, weigh_poses
from slamgym.slam.localization.global_search import APART, APART_TURN, GlobalSearch
from slamgym.slam.localization.hypothesis import Hypothesis
from slamgym.slam.localization.judge import Belief, Judge
from slamgym.slam.localization.recent_scans import RecentScans
from slamgym.slam.motion_model import OdometryGate
from slamgym.slam.odometry_calibration import MotionSpread, OdometryCalibration
from slamgym.slam.particle_filter import FEW_POINTS

POSITION_FLOOR, HEADING_FLOOR = 0.01, 0.005
"""Odometry between processed scans is never trusted further than this [m], [rad]."""
SEED_SPREAD = (0.1, 0.1, 0.05)
"""Spread of the particles round a place that the search has found [m], [m], [rad]."""
NEGLIGIBLE = 15.0
"""A hypothesis so much below the best one in log-weight is given up."""
MOST_SCANS_COUNTED = 10
"""Scans of the memory that count in the comparison of a new place with those followed."""
SEARCH_GROWTH = 1.5
"""Each search that leaves the robot without a place makes the next one wait so many times as long."""
SAME, SAME_TURN = 0.3, 0.25
"""Hypotheses nearer to each other than this are one [m], [rad]."""
RELIABLE_METRES, RELIABLE_RADIANS = 0.03, 0.015
"""The odometry is learned from stretches between estimates this certain."""
TURN_METRES = 1.0 / math.pi
"""What a radian of turning counts as driving [m]: half a turn is a metre."""
LOST_SCANS = 3
"""So many scans in a row that fit poorly start a search at once."""


class Localizer:
    """Localises one drive on one map.

    Args:
        grid: The map.
        config: Settings.
        geometry: The scanner.
        mapping: Settings of the mapper for this scanner: its usable range, and what no return says.
        rng: Source of all randomness.
        initial_pose: Where the robot starts, if that is known: x, y [m] and theta [rad] in the map's frame.
    """

    def __init__(
        self, grid: OccupancyGrid, config: LocalizationConfig, geometry: LaserGeometry, mapping: SlamConfig,
        rng: np.random.Generator, initial_pose: Pose2D | None = None,
    ) -> None:  # fmt: skip
        self._config, self._rng = config, rng
        self._beams = BeamTable.of(geometry, mapping)
        self._longest = min(self._beams.usable, float(np.nextafter(self._beams.range_max, 0.0)))
        self._field = make_field(grid, config, self._longest)
        self._search = GlobalSearch(self._field, config)
        self._gate = OdometryGate(
            SlamConfig(
                linear_update=config.linear_update, angular_update=config.angular_update, temporal_update=None
            )
        )
        self._calibration = OdometryCalibration()
        self._memory = RecentScans(config.search_memory)
        self._hypotheses: list[Hypothesis] = []

        if initial_pose is not None:
            spread = np.array([config.initial_spread, config.initial_spread, config.initial_turn])
            pose = np.array(initial_pose, dtype=np.float64)
            first = Hypothesis.around(pose, spread, config.max_particles, 0.0, rng)
            first.driven, first.was_sure = math.inf, True
            self._hypotheses.append(first)
        self._since_search = math.inf if initial_pose is None else 0.0
        self._judge = Judge(config, self._hypotheses[0] if self._hypotheses else None)
        self._patience = config.search_distance
        self._poor_scans = 0
        self._end_points = np.zeros((geometry.num_beams, 2))
        self.belief = Belief(0.0, "searching", initial_pose or Pose2D(0.0, 0.0, 0.0), np.eye(3), 0.0, (), 0)
        self.searches = 0
        """Searches over the whole map so far."""
        self.cpu_seconds = 0.0
        """CPU time of all updates [s]."""

    @property
    def pose(self) -> Pose2D:
        """The best hypothesis at the last scan, by odometry since the last processed one."""
        return compose(self.belief.pose, self._gate.since_processed)

    def update(self, odometry: Pose2D, scan: LaserScan) -> bool:
        """Take a scan and the odometry pose at its time; whether it was processed."""
        if not self._gate.is_due(odometry, scan.stamp):
            return False
        begin = time.process_time()
        self.process(self._gate.take(scan.stamp), scan)
        self.cpu_seconds += time.process_time() - begin
        return True

    def process(self, increments: FloatArray, scan: LaserScan) -> None:
        """Take a scan and the motion (steps, 3) since the one before, in the robot frame; for callers with a gate."""
        corrected = self._calibration.correct(increments)
        driven = float(
            np.hypot(increments[:, 0], increments[:, 1]).sum() + TURN_METRES * np.abs(increments[:, 2]).sum()
        )
        before = self.belief
        points = self._end_points[
            : usable_end_points(scan.ranges, self._beams, self._longest, self._end_points)
        ]
        self._move(corrected, self._calibration.spread(increments), driven)
        motion = Pose2D(0.0, 0.0, 0.0)
        for step in corrected:
            motion = compose(motion, Pose2D(*step))
        self._memory.append(motion, driven, points)
        if len(points) >= FEW_POINTS:
            self._weigh(scan, points)
        self._since_search += driven
        self._search_if_due()
        self._tidy()
        self.belief = self._judge.belief(scan.stamp, driven, self._hypotheses, self.belief.pose)
        self._learn(before, increments)

    def _move(self, corrected: FloatArray, spread: MotionSpread, driven: float) -> None:
        spread.distance += POSITION_FLOOR**2
        spread.heading += HEADING_FLOOR**2
        for hypothesis in self._hypotheses:
            hypothesis.move(corrected, spread, self._rng)
            hypothesis.driven += driven

    def _weigh(self, scan: LaserScan, points: FloatArray) -> None:
        """Weigh particles and hypotheses by a scan, and note how much of it each explains."""
        config = self._config
        chosen = points[np.linspace(0, len(points) - 1, min(len(points), config.max_beams)).astype(int)]
        step = max(1, len(scan.ranges) // config.max_beams)
        for hypothesis in self._hypotheses:
            hypothesis.weigh(self._field, chosen, config.beam_weight, config.evidence)
            pose = np.array(hypothesis.estimate[0])
            # A place that was sure may lead out of the map; one that is sought must lie on it.
            fit, correction = explain_scan(
                self._field, pose, scan.ranges, self._beams, step, config.fit_distance, hypothesis.was_sure
            )
            hypothesis.log_weight += config.evidence * config.beam_weight * correction
            if fit >= 0.0:
                hypothesis.note_fit(fit)
            hypothesis.resample(config, config.max_particles // len(self._hypotheses), self._rng)
        if self._hypotheses:
            poor = max(hypothesis.fit for hypothesis in self._hypotheses) < config.minimum_fit
            self._poor_scans = self._poor_scans + 1 if poor else 0

    # --- searching ---

    def _search_if_due(self) -> None:
        config = self._config
        if self.belief.state == "localised":
            self._patience = config.search_distance
        distance = config.check_distance if self.belief.state == "localised" else self._patience
        if self._poor_scans >= LOST_SCANS and self.belief.state == "localised":
            # Where the robot was carried off, older scans show another place.
            self._memory.restart_with_last()
            distance = 0.0
        if self._since_search < distance:
            return
        points = self._memory.points()
        if len(points) < FEW_POINTS:
            return
        self._since_search = 0.0
        self._patience = min(self._patience * SEARCH_GROWTH, config.check_distance)
        self.searches += 1
        self._add_places(points)

    def _add_places(self, points: FloatArray) -> None:
        """Search the whole map; places that nobody follows yet become hypotheses.

        A new place begins with the weight that the memory's scans give it beside the best hypothesis.
        """
        config = self._config
        known = np.array([hypothesis.estimate[0] for hypothesis in self._hypotheses]).reshape(-1, 3)
        power = (
            config.evidence
            * config.beam_weight
            * config.max_beams
            * min(len(self._memory), MOST_SCANS_COUNTED)
        )
        best = int(np.argmax([h.log_weight for h in self._hypotheses])) if self._hypotheses else -1
        level, reference, behind = 0.0, 0.0, 0.0
        if best >= 0:
            is_established = self._hypotheses[best].driven >= config.confirm_distance
            behind = config.jump_cost if is_established else 0.0
            level, reference = (
                self._hypotheses[best].log_weight,
                self._mean_log_likelihood(known[best], points),
            )
        for place in self._search.find(points):
            near = np.hypot(*(known[:, :2] - place.pose[:2]).T) < APART
            if (near & (np.abs(wrap_angle(known[:, 2] - place.pose[2])) < APART_TURN)).any():
                continue
            advantage = power * (self._mean_log_likelihood(place.pose, points) - reference)
            log_weight = level + min(advantage, 0.0) - behind
            if log_weight < level - NEGLIGIBLE and best >= 0:
                continue
            self._hypotheses.append(
                Hypothesis.around(
                    place.pose, np.array(SEED_SPREAD), 2 * config.min_particles, log_weight, self._rng
                )
            )
            self._hypotheses[-1].fit = place.score

    def _mean_log_likelihood(self, pose: FloatArray, points: FloatArray) -> float:
        """Of the points at the best of some poses round one."""
        near = pose + np.array(SEED_SPREAD) * self._rng.standard_normal((self._config.min_particles, 3))
        out = np.empty(len(near))
        weigh_poses(self._field, near, points, out)
        return float(out.max()) / len(points)

    def _tidy(self) -> None:
        """Give up what has lost, and join what has met."""
        ranked = sorted(self._hypotheses, key=lambda h: -h.log_weight)
        kept: list[Hypothesis] = []
        poses: list[Pose2D] = []
        for hypothesis in ranked:
            if hypothesis.log_weight < ranked[0].log_weight - NEGLIGIBLE:
                break
            pose = hypothesis.estimate[0]
            same = [
                math.hypot(pose.x - other.x, pose.y - other.y) < SAME
                and abs(wrap_angle(pose.theta - other.theta)) < SAME_TURN
                for other in poses
            ]
            if any(same):
                winner = kept[same.index(True)]
                winner.log_weight = float(np.logaddexp(winner.log_weight, hypothesis.log_weight))
                winner.driven = max(winner.driven, hypothesis.driven)
                winner.was_sure |= hypothesis.was_sure
                continue
            kept.append(hypothesis)
            poses.append(pose)
        for hypothesis in kept[1:]:
            hypothesis.log_weight -= kept[0].log_weight
        if kept:
            kept[0].log_weight = 0.0
        self._hypotheses = kept[: self._config.most_hypotheses]

    def _learn(self, before: Belief, increments: FloatArray) -> None:
        """Compare the motion between two certain estimates with the odometry."""
        certain = all(
            belief.state == "localised"
            and np.trace(belief.covariance[:2, :2]) < 2.0 * RELIABLE_METRES**2
            and belief.covariance[2, 2] < RELIABLE_RADIANS**2
            for belief in (before, self.belief)
        )
        if not certain:
            self._calibration.restart()
            return
        theta = self.belief.pose.theta
        along = np.array([math.cos(theta), math.sin(theta), 0.0])
        covariance = self.belief.covariance
        moved = between(before.pose, self.belief.pose)
        self._calibration.learn(increments, moved, float(along @ covariance @ along), float(covariance[2, 2]))
