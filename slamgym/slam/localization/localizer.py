"""Mode ``map``: a robot that finds itself on a finished map, drives by it, and draws what it sees.

Hypotheses come from a global search, are tracked by particles, and are judged openly.
"""

import math
from collections import Counter
from typing import Any

import numpy as np

from slamgym.core.geometry import between, compose, inverse, transform_poses, wrap_angle
from slamgym.core.types import FloatArray, LaserGeometry, LaserScan, OccupancyGrid, Pose2D
from slamgym.slam.columns import Columns
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import usable_end_points
from slamgym.slam.localization.field import explain_scan, make_field
from slamgym.slam.localization.global_search import MOST_HYPOTHESES, NEGLIGIBLE, Seeker
from slamgym.slam.localization.hypothesis import BEAM_WEIGHT, EVIDENCE, Belief, Hypothesis, Judge
from slamgym.slam.mapper import Mapper
from slamgym.slam.odometry_calibration import OdometryCalibration
from slamgym.slam.particle_filter import FEW_POINTS

THRESHOLDS = 0.1, 0.1, math.inf
"""A scan is processed after this distance [m] (AMCL's ``update_min_d``; 0.25 in Nav2) or this turn [rad]
(``update_min_a``; 0.2), however long it takes."""
POSITION_FLOOR, HEADING_FLOOR = 0.01, 0.005
"""Odometry between processed scans is never trusted further than this [m], [rad]."""
SAME, SAME_TURN = 0.3, 0.25
"""Hypotheses nearer to each other than this are one [m], [rad]."""
RELIABLE_METRES, RELIABLE_RADIANS = 0.03, 0.015
"""The odometry is learned from stretches between estimates this certain."""
TURN_METRES = 1.0 / math.pi
"""Driven distance to which a radian of turning is equal [m]: half a turn is a metre."""
JUMP, JUMP_TURN = 0.5, 0.3
"""A pose further than this from what the odometry said is another place [m], [rad]."""


class MapLocalizer(Mapper):
    """A mapper whose poses come from a finished map.

    The map that it publishes is its own: what it has seen. The finished one isn't in it. Scans taken while the
    place was in doubt move along when another one turns out to be right.

    Args:
        config: Settings.
        geometry: The scanner.
        initial_pose: The start; believed if ``config.localization.start`` says so.
        rng: Source of all randomness.
        finished: The finished map.
    """

    def __init__(
        self,
        config: SlamConfig,
        geometry: LaserGeometry,
        initial_pose: Pose2D,
        rng: np.random.Generator,
        finished: OccupancyGrid,
    ) -> None:
        super().__init__(config, geometry, THRESHOLDS)
        self._settings, self._rng = config.localization, rng
        settings, is_known = config.localization, config.localization.start == "known"
        self._longest = min(self._beams.usable, float(np.nextafter(self._beams.range_max, 0.0)))
        self._field = make_field(finished, settings.sigma_hit, self._longest)
        self._seeker = Seeker(self._field, settings, rng, is_urgent=not is_known)
        self._calibration = OdometryCalibration()
        self._hypotheses: list[Hypothesis] = []
        if is_known:
            spread = np.array([settings.initial_spread, settings.initial_spread, settings.initial_turn])
            pose = np.array(initial_pose, dtype=np.float64)
            first = Hypothesis.around(pose, spread, settings.max_particles, 0.0, rng)
            first.driven, first.was_sure = math.inf, True
            self._hypotheses.append(first)
        self._judge = Judge(settings, self._hypotheses[0] if self._hypotheses else None)
        self._end_points = np.zeros((geometry.num_beams, 2))
        start = initial_pose if is_known else Pose2D(0.0, 0.0, 0.0)
        self.belief = Belief(0.0, "searching", start, np.eye(3), 0.0, (), 0)
        """Belief since the last processed scan."""
        self._states = Counter[str]()
        self._seen = Columns({"ranges": np.float32}, poses=(3,), ranges=(geometry.num_beams,))
        self._drawn = self._sure = 0  # scans drawn, and scans until the robot was last localised

    @property
    def pose(self) -> Pose2D:
        """The best hypothesis, by odometry since the last processed scan."""
        return compose(self.belief.pose, self._gate.since_processed)

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) within the best hypothesis at the last processed scan."""
        return self.belief.covariance

    @property
    def searches(self) -> int:
        """Searches of the whole map so far."""
        return self._seeker.searches

    def report(self) -> dict[str, Any]:
        """Number of scans that each state lasted."""
        return {"states": dict(sorted(self._states.items()))}

    def _num_bytes(self) -> int:
        return self._path.num_bytes + self._seen.num_bytes

    def _process(self, scan: LaserScan) -> None:
        predicted = self.pose
        self._localize(self._gate.take(scan.stamp), scan)
        pose = self.belief.pose
        self._states[self.belief.state] += 1
        self._path.append(stamps=scan.stamp, poses=pose)
        jump = math.hypot(pose.x - predicted.x, pose.y - predicted.y)
        if jump > JUMP or abs(wrap_angle(pose.theta - predicted.theta)) > JUMP_TURN:
            self._move_unsure(compose(pose, inverse(predicted)))
        self._seen.append(poses=pose, ranges=scan.ranges)
        if self.belief.state == "localised":
            self._sure = len(self._seen)
        else:
            self._stats.doubtful.append(scan.stamp)

    def _move_unsure(self, shift: Pose2D) -> None:
        """Put the scans since the robot was sure of its place at another one."""
        poses, unsure = self._seen["poses"], slice(self._sure, self._drawn)
        self._map.draw(poses[unsure], self._seen["ranges"][unsure], sign=-1)
        self._drawn = min(self._drawn, self._sure)
        poses[self._sure :] = transform_poses(shift, poses[self._sure :])

    def _draw_path(self) -> None:
        self._map.draw(self._seen["poses"][self._drawn :], self._seen["ranges"][self._drawn :])
        self._drawn = len(self._seen)

    def _localize(self, increments: FloatArray, scan: LaserScan) -> None:
        """Take a scan and the motion (steps, 3) since the one before, in the robot frame."""
        corrected, spread = self._calibration.correct(increments), self._calibration.spread(increments)
        spread.distance += POSITION_FLOOR**2
        spread.heading += HEADING_FLOOR**2
        driven = float(
            np.hypot(increments[:, 0], increments[:, 1]).sum() + TURN_METRES * np.abs(increments[:, 2]).sum()
        )
        before, motion = self.belief, Pose2D(0.0, 0.0, 0.0)
        count = usable_end_points(scan.ranges, self._beams, self._longest, self._end_points)
        points = self._end_points[:count]
        for hypothesis in self._hypotheses:
            hypothesis.move(corrected, spread, self._rng)
            hypothesis.driven += driven
        for step in corrected:
            motion = compose(motion, Pose2D(*step))
        self._seeker.append(motion, driven, points)
        if count >= FEW_POINTS:
            self._weigh(scan, points)
        if self._seeker.must_search(self._hypotheses, before.state == "localised"):
            self._hypotheses += self._seeker.find(self._hypotheses)
        self._tidy()
        self.belief = self._judge.belief(scan.stamp, driven, self._hypotheses, before.pose)
        self._learn(before, increments)

    def _weigh(self, scan: LaserScan, points: FloatArray) -> None:
        """Weigh particles and hypotheses by a scan, and note how much of it each explains."""
        most = self._settings.max_beams
        chosen = points[np.linspace(0, len(points) - 1, min(len(points), most)).astype(int)]
        step = max(1, len(scan.ranges) // most)
        for hypothesis in self._hypotheses:
            hypothesis.weigh(self._field, chosen)
            pose = np.array(hypothesis.estimate[0])
            # A place that was sure may lead out of the map; one that is sought must lie on it.
            fit, correction = explain_scan(
                self._field, pose, scan.ranges, self._beams, step, hypothesis.was_sure
            )
            hypothesis.log_weight += EVIDENCE * BEAM_WEIGHT * correction
            if fit >= 0.0:
                hypothesis.note_fit(fit)
            hypothesis.resample(self._settings.max_particles // len(self._hypotheses), self._rng)

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
        self._hypotheses = kept[:MOST_HYPOTHESES]

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
