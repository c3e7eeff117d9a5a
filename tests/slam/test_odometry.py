"""What the mappers do with odometry: which scans are due, how particles spread, whose path is followed back."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.geometry import compose
from slamgym.core.types import Pose2D
from slamgym.slam.config import MotionNoise, SlamConfig
from slamgym.slam.motion_model import OdometryGate, noise_array, sample_motion, update_thresholds
from slamgym.slam.particles import TrajectoryTree

CONFIG = SlamConfig(linear_update=0.5, angular_update=0.4, temporal_update=None)
steps = st.builds(Pose2D, st.floats(-0.2, 0.2), st.floats(-0.05, 0.05), st.floats(-0.3, 0.3))


@given(st.lists(steps, min_size=1, max_size=30))
def test_the_gate_loses_no_motion_and_opens_at_its_thresholds(path):
    gate = OdometryGate(update_thresholds(CONFIG))
    odometry = Pose2D(3.0, -2.0, 1.0)
    assert gate.must_process(odometry, 0.0)
    assert gate.take(0.0).shape == (0, 3)
    since, distance, turn = Pose2D(0.0, 0.0, 0.0), 0.0, 0.0
    for k, step in enumerate(path):
        odometry, since = compose(odometry, step), compose(since, step)
        distance, turn = distance + np.hypot(step.x, step.y), turn + abs(step.theta)
        due = gate.must_process(odometry, float(k))
        if min(abs(distance - 0.5), abs(turn - 0.4)) > 1e-9:
            assert due == (distance > 0.5 or turn > 0.4)
        assert gate.since_processed == pytest.approx(since, abs=1e-9)
        if due:
            taken = functools.reduce(compose, (Pose2D(*row) for row in gate.take(float(k))))
            assert taken == pytest.approx(since, abs=1e-9)
            assert gate.since_processed == (0.0, 0.0, 0.0)
            since, distance, turn = Pose2D(0.0, 0.0, 0.0), 0.0, 0.0


def test_there_and_back_again_is_motion_too():
    gate = OdometryGate(update_thresholds(CONFIG))
    there_and_back = [Pose2D(0.2 * (k % 2), 0.0, 0.0) for k in range(5)]
    assert [gate.must_process(pose, 0.0) for pose in there_and_back] == [
        True,
        False,
        False,
        True,
        True,
    ]


@given(st.lists(steps, min_size=1, max_size=5), st.floats(-3.0, 3.0))
def test_without_noise_the_particles_go_where_odometry_goes(path, heading):
    poses = np.tile([1.0, 2.0, heading], (3, 1))
    noise = np.zeros(4)
    sample_motion(poses, np.array(path), np.ones((len(path), 3, 3)), noise)
    expected = functools.reduce(compose, path, Pose2D(1.0, 2.0, heading))
    assert poses[:, :2] == pytest.approx(np.tile(expected[:2], (3, 1)))
    assert np.cos(poses[:, 2] - expected.theta) == pytest.approx(1.0)


def test_the_particles_spread_as_far_as_the_model_says():
    rng = np.random.default_rng(0)
    poses, path = np.zeros((20_000, 3)), np.tile([0.1, 0.0, 0.0], (10, 1))
    normals = rng.standard_normal((10, 20_000, 3))
    sample_motion(poses, path, normals, noise_array(MotionNoise()))
    variance, turn_variance = 10 * (0.1 * 0.1) ** 2, 10 * (0.2 * 0.1) ** 2
    # 20,000 draws give a variance to 1 %; three standard deviations are allowed.
    assert poses[:, 2].var() == pytest.approx(turn_variance, rel=0.03)
    assert poses[:, 0].mean() == pytest.approx(1.0, abs=0.01)
    assert poses[:, 0].var() == pytest.approx(
        variance, rel=0.1
    )  # turning takes a little of the distance
    assert np.abs(poses.mean(axis=0)[1:]).max() < 0.005


@pytest.mark.parametrize(
    ("step", "moved"),
    [
        ([1.0, 0.0, 0.0], [1.1, 0.03, 0.02]),
        ([0.0, 1.0, 0.0], [0.03, 1.1, 0.02]),
        ([0.0, 0.0, 1.0], [0.05, 0.05, 1.4]),
    ],
)
def test_each_noise_enters_where_its_name_says(step, moved):
    """The first letters of srr, srt, str and stt are of what is moved, the last of what errs by it."""
    noise = noise_array(MotionNoise(srr=0.1, srt=0.02, str=0.05, stt=0.4))
    poses = np.zeros((1, 3))
    sample_motion(poses, np.array([step]), np.ones((1, 1, 3)), noise)
    assert poses[0] == pytest.approx(moved)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 80))
def test_every_particles_path_is_its_ancestors(seed, length):
    """Poses are labels: each particle's own history, kept as whole lists, must be found again in the tree."""
    rng, particles = np.random.default_rng(seed), 5
    tree, histories = TrajectoryTree(particles, 2), [[] for _ in range(particles)]
    for step in range(length):
        poses = rng.random((particles, 3))
        tree.add(float(step), poses, np.zeros(2, np.float32))
        histories = [
            [*history, tuple(pose)] for history, pose in zip(histories, poses, strict=True)
        ]
        best = int(rng.integers(particles))
        assert [tuple(pose) for pose in tree.path(best)] == histories[best]
        for _ in range(int(rng.integers(3))):
            ancestors = rng.integers(particles, size=particles)
            tree.resample(ancestors)
            histories = [histories[ancestor] for ancestor in ancestors]
