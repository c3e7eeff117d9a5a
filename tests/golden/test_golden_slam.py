"""Map and path that each kind of mapper makes of one drive through a small flat; what dead reckoning makes of it."""

import numpy as np
import pytest
from drawn_drives import FLAT, drive

from slamgym.core.geometry import between
from slamgym.core.types import Pose2D
from slamgym.slam import SlamConfig
from slamgym.slam.replay import replay

WAY = [
    (1.0, 1.0),
    (2.2, 1.0),
    (2.2, 2.3),
    (4.7, 2.3),
    (4.7, 3.7),
    (7.0, 3.7),
    (4.7, 3.7),
    (4.7, 2.3),
]
BACK = [(1.5, 2.3), (1.0, 1.0)]
MAPPERS = {
    "rbpf": SlamConfig(mode="rbpf", particles=8),
    "pose_graph": SlamConfig(mode="pose_graph"),
}


@pytest.fixture(scope="module")
def log():
    return drive(FLAT, WAY + BACK, seed=3)[0]


@pytest.mark.parametrize("mode", MAPPERS)
def test_replay(log, golden, mode):
    result = replay(log, MAPPERS[mode], np.random.default_rng(7))
    frame = result.grid.frame
    measured = {
        "map": golden.of_cells(result.grid.cells),
        "origin": [round(frame.origin_x, 6), round(frame.origin_y, 6)],
        "path": golden.of_path(result.trajectory.poses),
        "report": dict(result.extra),
    }
    golden.check(f"slam/{mode}", measured)


def test_dead_reckoning_believes_the_odometry(log):
    result = replay(log, SlamConfig(mode="dead_reckoning"), np.random.default_rng(7))
    records = list(log)
    start, end = (Pose2D(*result.trajectory.poses[index].tolist()) for index in (0, -1))
    driven = between(records[0].odometry, records[-1].odometry)
    assert between(start, end) == pytest.approx(driven, abs=1e-9)


def test_one_particle_draws_the_same_map_whatever_the_seed(log):
    config = SlamConfig(mode="rbpf", particles=1)
    maps = [replay(log, config, np.random.default_rng(seed)).grid.cells for seed in (1, 2)]
    assert np.array_equal(*maps)
