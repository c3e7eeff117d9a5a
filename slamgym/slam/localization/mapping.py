"""Mode ``map``: a robot that drives by a finished map, and draws what it sees."""

import dataclasses
import math
from collections import Counter
from typing import Any

import numpy as np

from slamgym.core.geometry import compose, inverse, transform_poses, wrap_angle
from slamgym.core.types import (
    Float32Array,
    FloatArray,
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Trajectory,
)
from slamgym.slam.config import SlamConfig
from slamgym.slam.localization.judge import Belief
from slamgym.slam.localization.localizer import Localizer
from slamgym.slam.mapper import GatedMapper

JUMP, JUMP_TURN = 0.5, 0.3
"""A pose further than this from what the odometry said is another place [m], [rad]."""


class MapLocalizer(GatedMapper):
    """A mapper whose poses come from a finished map; see :class:`slamgym.slam.mapper.Mapper`.

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
        settings = config.localization
        gate = dataclasses.replace(
            config,
            linear_update=settings.linear_update,
            angular_update=settings.angular_update,
            temporal_update=None,
        )
        super().__init__(config, geometry, gate)
        start = initial_pose if settings.start == "known" else None
        self._localizer = Localizer(finished, settings, geometry, config, rng, start)
        self._beliefs: list[Belief] = []
        self._unsure: list[tuple[FloatArray, Float32Array]] = []  # drawn since the robot was last localised

    @property
    def belief(self) -> Belief:
        """What is believed since the last processed scan."""
        return self._localizer.belief

    @property
    def pose(self) -> Pose2D:
        """The best hypothesis, by odometry since the last processed scan."""
        return compose(self.belief.pose, self._gate.since_processed)

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3, 3) within the best hypothesis at the last processed scan."""
        return self.belief.covariance

    def report(self) -> dict[str, Any]:
        """How many scans each state lasted."""
        return {"states": dict(sorted(Counter(belief.state for belief in self._beliefs).items()))}

    def trajectory(self) -> Trajectory:
        """The best hypothesis at each processed scan, as it was then."""
        poses = np.array([belief.pose for belief in self._beliefs], dtype=np.float64).reshape(-1, 3)
        return Trajectory(np.array([belief.stamp for belief in self._beliefs], dtype=np.float64), poses)

    def _process(self, scan: LaserScan) -> None:
        predicted = self.pose
        self._localizer.process(self._gate.take(scan.stamp), scan)
        self._beliefs.append(self.belief)
        pose = self.belief.pose
        jump = math.hypot(pose.x - predicted.x, pose.y - predicted.y)
        if self._unsure and (jump > JUMP or abs(wrap_angle(pose.theta - predicted.theta)) > JUMP_TURN):
            self._move_unsure(compose(pose, inverse(predicted)))
        self._unsure.append((np.array([pose]), scan.ranges[np.newaxis]))
        self._map.draw(*self._unsure[-1])
        if self.belief.state == "localised":
            self._unsure.clear()
        else:
            self._stats.doubtful.append(scan.stamp)

    def _move_unsure(self, shift: Pose2D) -> None:
        """Draw the scans since the robot was sure of its place at another one."""
        for index, (poses, ranges) in enumerate(self._unsure):
            self._map.draw(poses, ranges, sign=-1)
            self._unsure[index] = (transform_poses(shift, poses), ranges)
        for poses, ranges in self._unsure:
            self._map.draw(poses, ranges)

    def _draw_path(self) -> None:
        """Nothing is left to draw."""

    def _num_bytes(self) -> int:
        return 128 * len(self._beliefs)
