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
from slamgym.slam.localization.field import explain_scan, make_field
from slamgym.slam.localization.hypothesis import Hypothesis
from slamgym.slam.localization.judge import Belief, Judge
from slamgym.slam.localization.seeking import NEGLIGIBLE, Seeker
from slamgym.slam.motion_model import OdometryGate
from slamgym.slam.odometry_calibration import MotionSpread, OdometryCalibration
from slamgym.slam.particle_filter import FEW_POINTS

POSITION_FLOOR, HEADING_FLOOR = 0.01, 0.005
"""Odometry between processed scans is never trusted further than this [m], [rad]."""
SAME, SAME_TURN = 0.3, 0.25
"""Hypotheses nearer to each other than this are one [m], [rad]."""
RELIABLE_METRES, RELIABLE_RADIANS = 0.03, 0.015
"""The odometry is learned from stretches between estimates this certain."""
TURN_METRES = 1.0 / math.pi
"""What a radian of turning counts as driving [m]: half a turn is a metre."""


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
        self.seeker = Seeker(self._field, config, rng, is_urgent=initial_pose is None)
        self._gate = OdometryGate(
            SlamConfig(
                linear_update=config.linear_update, angular_update=config.angular_update, temporal_update=None
            )
        )
        self._calibration = OdometryCalibration()
        self._hypotheses: list[Hypothesis] = []

        if initial_pose is not None:
            spread = np.array([config.initial_spread, config.initial_spread, config.initial_turn])
            pose = np.array(initial_pose, dtype=np.float64)
            first = Hypothesis.around(pose, spread, config.max_particles, 0.0, rng)
            first.driven, first.was_sure = math.inf, True
            self._hypotheses.append(first)
        self._judge = Judge(config, self._hypotheses[0] if self._hypotheses else None)
        self._end_points = np.zeros((geometry.num_beams, 2))
        self.belief = Belief(0.0, "searching", initial_pose or Pose2D(0.0, 0.0, 0.0), np.eye(3), 0.0, (), 0)
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
        self.seeker.append(motion, driven, points)
        if len(points) >= FEW_POINTS:
            self._weigh(scan, points)
        if self.seeker.is_due(self._hypotheses, self.belief.state == "localised"):
            self._hypotheses += self.seeker.find(self._hypotheses)
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
