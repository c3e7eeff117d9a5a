"""Explorations with a laser that takes its time: stamps, odometry, observations and maps are as of one that doesn't."""

import numpy as np
import pytest

from slamgym.core.geometry import between, compose, part_of
from slamgym.core.types import LaserScan, Pose2D
from slamgym.envs import ExploreEnv
from slamgym.interop import LogRecord, open_log, write_carmen
from slamgym.sim import LidarConfig, lidar_level

ACTIONS = [np.array([0.2, 1.4 * (-1) ** (step // 9)]) for step in range(45)]
STEP = 0.2


def drive(sweep, odometry="ideal", localization="pose_graph"):
    """An environment after a drive with many turns, and its observations."""
    laser = lidar_level("exact", LidarConfig(sweep=sweep, range_max=8.0))
    env = ExploreEnv(
        "bundled",
        lidar=laser,
        odometry=odometry,
        localization=localization,
        actions="physical",
        record=True,
    )
    first, _ = env.reset(seed=4, options={"plan": "home_000007"})
    seen = [first] + [env.step(action)[0] for action in ACTIONS]
    return env, seen


@pytest.fixture(scope="module")
def swept():
    return drive(0.1)


@pytest.fixture(scope="module")
def at_once():
    return drive(0.0)


def test_a_scan_is_stamped_by_its_first_beam(swept):
    env, seen = swept
    ends = STEP * np.arange(len(seen))
    assert env.log.stamps == pytest.approx(ends - 0.1)
    assert [observation["time"][0] for observation in seen] == pytest.approx(ends)
    scan = env.simulation.scan
    assert scan.geometry.scan_time == pytest.approx(0.1)
    assert scan.stamp == env.log.stamps[-1]


def test_odometry_and_truth_are_those_of_the_stamp(swept, at_once):
    """The same drive: half a step back from what the other has."""
    ours, theirs = swept[0].log, at_once[0].log
    for name in ("odometry", "true_poses"):
        ends = [Pose2D(*pose) for pose in theirs[name].tolist()]
        for step in range(1, len(ends)):
            driven = between(ends[step - 1], ends[step])
            begin = compose(ends[step - 1], part_of(driven, 0.5))
            assert ours[name][step] == pytest.approx(begin, abs=1e-6)
    motions = [Pose2D(*motion) for motion in ours.motions.tolist()]
    begins = [Pose2D(*pose) for pose in ours.odometry.tolist()]
    ends = [compose(*pair) for pair in zip(begins, motions, strict=True)]
    assert np.array(ends) == pytest.approx(np.asarray(theirs.odometry), abs=1e-6)


def test_pose_and_scan_of_an_observation_are_of_now(swept, at_once):
    errors = []
    for ours, theirs in zip(swept[1], at_once[1], strict=True):
        assert ours["pose"] == pytest.approx(theirs["pose"], abs=0.03)
        errors.append(np.abs(ours["scan"] - theirs["scan"]))
    # Beside edges, and where the last beams turned away from the first, there are others.
    assert np.median(errors) < 1e-3
    assert np.mean(np.array(errors) < 0.05) > 0.9
    assert np.isfinite([observation["scan"] for observation in swept[1]]).all()


def test_the_map_is_as_good(swept, at_once):
    assert swept[0].map_error() < 1.1 * at_once[0].map_error()


def test_by_the_truth_it_is_the_true_pose():
    env, seen = drive(0.2, "high", "ground_truth")
    assert seen[-1]["pose"] == pytest.approx(env.simulation.true_map_pose, abs=1e-6)


def test_its_log_holds_all_of_it(swept, tmp_path):
    log, laser = swept[0].log, swept[0].simulation.scan.geometry
    rows = zip(
        log.stamps.tolist(), log.odometry.tolist(), log.motions.tolist(), log.ranges, strict=True
    )
    records = [
        LogRecord(stamp, Pose2D(*pose), LaserScan(stamp, ranges, laser, Pose2D(*motion)))
        for stamp, pose, motion, ranges in rows
    ]
    write_carmen(tmp_path / "a.log", records, laser)
    read = open_log(tmp_path / "a.log")
    assert not read.findings
    assert [record.stamp for record in read] == pytest.approx(log.stamps, abs=1e-6)
    motions = np.array([record.scan.motion for record in read])
    assert motions == pytest.approx(np.asarray(log.motions), abs=1e-5)
