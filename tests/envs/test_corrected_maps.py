"""Explorations on maps that are corrected on the way, as mappers with loop closures do."""

import numpy as np
import pytest

from slamgym.agents.registry import make_explorer
from slamgym.cad import open_plans
from slamgym.core.geometry import compose
from slamgym.core.types import Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.batch import beliefs
from slamgym.slam import SlamConfig
from slamgym.slam.hit_counts import HitCountMap
from slamgym.slam.mapper import PoseTracker


class BendingMapper(PoseTracker):
    """Draws scans where it drifts to; every so many scans it knows better and draws all of them again."""

    def __init__(self, config, geometry, initial, rng, every, drift):
        super().__init__(config, geometry, initial, rng)
        self.true_poses = [initial]
        self.scans = []
        self.every = every
        self.drift = drift
        self.corrections = 0

    def _process(self, scan):
        self.true_poses.append(compose(self.true_poses[-1], self._gate.since_processed))
        self.scans.append(scan.ranges)
        super()._process(scan)
        self._last_pose = compose(self._last_pose, self.drift)
        if len(self.scans) % self.every == 0:
            self.corrections += 1
            self._last_pose = self.true_poses[-1]
            self._map = HitCountMap(self._beams, self._config)
            self._map.draw(np.array(self.true_poses[1:]), np.array(self.scans))


@pytest.fixture
def bend(monkeypatch):
    def with_drift(every, drift):
        def make(config, geometry, initial, rng, finished=None):
            return BendingMapper(config, geometry, initial, rng, every, drift)

        monkeypatch.setattr(beliefs, "make_mapper", make)

    return with_drift


@pytest.mark.parametrize(
    ("plan_id", "every", "drift"),
    [
        ("home_000088", 60, Pose2D(0.012, 0.004, 0.0005)),
        ("home_000066", 200, Pose2D(0.008, 0.004, 0.001)),
    ],
)
def test_the_whole_floor_is_seen_though_the_map_is_moved_by_metres(bend, plan_id, every, drift):
    bend(every, drift)
    config = ExploreConfig(slam=SlamConfig(mode="ground_truth"), time_limit=1500.0).for_explorer()
    env = ExploreEnv(open_plans("bundled").load(plan_id), config)
    explorer = make_explorer("nearest", env.explorer_context(), 3)
    observation, info = env.reset(seed=3)
    moved = [0.0]
    is_over = False
    while not is_over:
        action, _ = explorer.predict(observation)
        if explorer.finished:
            break
        error = info["pose_error"]
        observation, _, _, is_over, info = env.step(action)
        moved.append(error - info["pose_error"])
    assert explorer.finished
    assert info["coverage"] > 0.99
    assert env.mapper.corrections >= 2
    assert max(moved) > 0.5  # the pose has jumped
