"""Mode ``map``: a robot that finds itself on a finished map, drives by it, and draws what it sees.

Hypotheses come from a global search, are tracked by alignment, and are judged openly.
"""

import math
from collections import Counter
from typing import Any

import numpy as np

from slamgym.core.geometry import compose, inverse, transform_poses
from slamgym.core.types import FloatArray, LaserGeometry, LaserScan, OccupancyGrid, Pose2D
from slamgym.slam.columns import Columns
from slamgym.slam.config import SlamConfig
from slamgym.slam.graph.mapper import FEW_POINTS
from slamgym.slam.graph.sight import ScanView
from slamgym.slam.graph.submaps import OrientedPoints, oriented_scan
from slamgym.slam.graph.wheels import WheelCalibration
from slamgym.slam.localization.beyond import SurfacesBeyond
from slamgym.slam.localization.global_search import is_same
from slamgym.slam.localization.hypothesis import FIT_MEMORY, Belief, Hypothesis, believe
from slamgym.slam.localization.known_map import KnownMap
from slamgym.slam.localization.seeker import Seeker, distinct
from slamgym.slam.mapper import Mapper

THRESHOLDS = (0.1, 0.1, math.inf)
"""A scan is processed after this distance [m] (AMCL's ``update_min_d``; 0.25 in Nav2) or this turn [rad]
(``update_min_a``; 0.2), however long it takes."""
TURN_METRES = 1.0 / math.pi
"""Driven distance to which a radian of turning is equal [m]: half a turn is a metre."""

START_SPREAD = (0.5, 0.5, 0.26)
"""Standard deviations of a known start [m], [m], [rad] (the roots of AMCL's ``initial_cov_xx``, ``_yy``, ``_aa``)."""
MOST_BEAMS = 60
"""Beams of a scan that weigh a hypothesis (``laser_max_beams``; 30 in AMCL's launch file, 60 in Nav2)."""


class MapLocalizer(Mapper):
    """A mapper whose poses come from a finished map.

    The map that it publishes is its own: what it has seen. The finished one isn't in it. Scans taken while the
    place was in doubt move along when another one turns out to be right.

    Args:
        config: Settings.
        geometry: The scanner.
        initial_pose: The start; believed if ``config.localization.start`` says so.
        rng: Not used: nothing is random here.
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
        settings = config.localization
        is_known = settings.start == "known"
        start = initial_pose if is_known else Pose2D(0.0, 0.0, 0.0)
        super().__init__(config, geometry, start, rng, THRESHOLDS)
        self._known_map = KnownMap(finished)
        self._beyond = SurfacesBeyond(self._known_map)
        self._wheels = WheelCalibration()
        self._hypotheses: list[Hypothesis] = []
        if is_known:
            pose = np.array(initial_pose, dtype=np.float64)
            first = Hypothesis.around(pose, START_SPREAD, self._known_map.no_misses())
            first.led = math.inf
            first.was_sure = True
            self._hypotheses.append(first)
        self._seeker = Seeker(self._known_map, self._beams, MOST_BEAMS)
        self.belief = Belief(0.0, "searching", start, np.eye(3), 0.0, ())
        """Belief since the last processed scan."""
        self._states = Counter[str]()
        self._path = Columns(
            {"ranges": np.float32}, stamps=(), poses=(3,), ranges=(geometry.num_beams,)
        )
        self._sure = 0  # scans until the robot was last localised

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) within the best hypothesis at the last processed scan."""
        return self.belief.covariance

    def report(self) -> dict[str, Any]:
        """Number of scans that each state lasted, and of searches of the whole map."""
        return {"states": dict(sorted(self._states.items())), "searches": self._seeker.searches}

    def _process(self, scan: LaserScan) -> None:
        predicted = self.pose
        self._localize(self._gate.take(scan.stamp), scan)
        self._last_pose = pose = self.belief.pose
        self._states[self.belief.state] += 1
        if not is_same(np.array([predicted]), np.array(pose))[0]:
            self._move_unsure(compose(pose, inverse(predicted)))
        self._path.append(stamps=scan.stamp, poses=pose, ranges=scan.ranges)
        if self.belief.state == "localised":
            self._sure = len(self._path)
        else:
            self._stats.doubtful.append(scan.stamp)

    def _move_unsure(self, shift: Pose2D) -> None:
        """Put the scans since the robot was sure of its place at another one."""
        unsure = self._path["poses"][self._sure :]
        unsure[:] = transform_poses(shift, unsure)

    def _draw_path(self) -> None:
        self._map.follow(self.trajectory().poses, self._path["ranges"])

    def _localize(self, increments: FloatArray, scan: LaserScan) -> None:
        """Take a scan and the motion (steps, 3) since the one before, in the robot frame."""
        step = self._wheels.step(increments)
        distance = np.hypot(increments[:, 0], increments[:, 1]).sum()
        turned = np.abs(increments[:, 2]).sum()
        driven = float(distance + TURN_METRES * turned)
        seen = oriented_scan(scan.ranges, self._beams, np.inf)
        was_localised = self.belief.state == "localised"
        for hypothesis in self._hypotheses:
            hypothesis.move(step, self._wheels.variances(step.slips))
        self._seeker.append(step.moved, driven, ScanView(seen, scan.ranges.copy()))
        if len(seen.points) >= FEW_POINTS:
            self._hypotheses += self._seeker.find(self._hypotheses, was_localised)
            self._correct(seen, scan)
        self._hypotheses = distinct(self._hypotheses)
        self.belief = believe(
            scan.stamp, driven, self._hypotheses, self.belief.pose, self._config.localization
        )
        if self.belief.state == "localised":
            self._beyond.draw(np.array(self.belief.pose), seen)
        elif not (self._hypotheses and self._hypotheses[0].was_sure):
            self._beyond.clear()
        if was_localised and self.belief.state != "localised":
            self._seeker.forget()

    def _correct(self, seen: OrientedPoints, scan: LaserScan) -> None:
        """Align and weigh the hypotheses by a scan and its end points."""
        stride = min(len(self._hypotheses), max(1, len(seen.points) // MOST_BEAMS))
        taken = seen.every(stride)
        for hypothesis in self._hypotheses:
            # A place that was sure may lead out of the map; one that is sought must lie on it.
            excuses = hypothesis.was_sure
            shown = self._beyond if excuses else self._known_map
            hypothesis.align(shown.surfaces, taken)
            against, fit = self._seeker.evidence(
                hypothesis.pose, scan.ranges, excuses, hypothesis.missed
            )
            hypothesis.log_weight -= against
            if fit >= 0.0:
                hypothesis.fit += FIT_MEMORY * (fit - hypothesis.fit)
