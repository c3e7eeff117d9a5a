import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from slamgym.core.geometry import transform_poses
from slamgym.core.types import Pose2D, Trajectory
from slamgym.metrics import (
    absolute_trajectory_error,
    align_se2,
    normalised_estimation_error_squared,
    poses_at,
    relation_error,
    relative_pose_error,
    relative_poses,
)  # fmt: skip

moves = st.builds(Pose2D, st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1))


def wiggle(number=60):
    t = np.linspace(0.0, 12.0, number)
    return Trajectory(t, np.column_stack([t, np.sin(t), 0.3 * np.cos(t)]))


@given(moves)
def test_ate_ignores_a_rigid_motion_and_unaligned_ate_sees_it(motion):
    truth = wiggle()
    moved = Trajectory(truth.stamps, transform_poses(motion, truth.poses))
    aligned = absolute_trajectory_error(moved, truth)
    # Coordinates up to 60 m in doubles.
    assert aligned.translation.rmse < 1e-9
    assert aligned.rotation.rmse < 1e-9
    plain = absolute_trajectory_error(moved, truth, align=False).translation.rmse
    assert plain == pytest.approx(
        np.sqrt(np.mean(np.sum((moved.poses - truth.poses)[:, :2] ** 2, axis=1)))
    )


@given(moves, st.integers(0, 99))
def test_alignment_is_the_least_squares_motion(motion, seed):
    rng = np.random.default_rng(seed)
    points, noise = rng.normal(size=(30, 2)), 0.1 * rng.normal(size=(30, 2))
    target = transform_poses(motion, np.column_stack([points, np.zeros(30)]))[:, :2] + noise

    def cost(pose):
        return np.sum(
            (transform_poses(pose, np.column_stack([points, np.zeros(30)]))[:, :2] - target) ** 2
        )

    best = align_se2(points, target)
    for shift in np.eye(3) * 1e-3:
        assert cost(best) <= cost(Pose2D(*(np.array(best) + shift))) + 1e-12
        assert cost(best) <= cost(Pose2D(*(np.array(best) - shift))) + 1e-12


def test_rpe_of_a_scale_error_is_that_share_of_the_stretch():
    t = np.linspace(0, 10, 101)
    truth = Trajectory(t, np.column_stack([t, 0 * t, 0 * t]))
    estimate = Trajectory(t, np.column_stack([1.02 * t, 0 * t, 0 * t]))
    assert relative_pose_error(estimate, truth, delta=2.0).translation.mean == pytest.approx(0.04)


def test_interpolation_takes_the_shorter_arc():
    trajectory = Trajectory(np.array([0.0, 1.0]), np.array([[0, 0, 3.1], [2, 0, -3.1]]))
    poses, valid = poses_at(trajectory, np.array([0.5, 2.0]))
    assert poses[0, 0] == 1.0
    assert abs(poses[0, 2]) == pytest.approx(np.pi)
    assert valid.tolist() == [True, False]


class TestRelations:
    def test_a_perfect_path_has_no_error_in_any_frame(self):
        truth = wiggle()
        a, b = np.array([3, 10, 20]), np.array([5, 40, 21])
        relative = relative_poses(truth.poses[a], truth.poses[b])
        moved = Trajectory(truth.stamps, transform_poses(Pose2D(5.0, -2.0, 2.0), truth.poses))
        error = relation_error(moved, truth.stamps[a], truth.stamps[b], relative)
        assert error.translation.rmse < 1e-12
        assert error.missing == 0

    def test_error_and_deviation_of_known_relations(self):
        path = Trajectory(np.arange(3.0), np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.1]]))
        relative = np.array([[1.1, 0, 0], [1.0, 0, 0]])
        error = relation_error(path, np.array([0.0, 1.0]), np.array([1.0, 2.0]), relative)
        assert error.translation.mean == pytest.approx(0.05)
        assert error.translation.deviation == pytest.approx(0.05)
        assert error.rotation.mean == pytest.approx(0.05)

    def test_the_nearest_pose_counts_and_moments_without_one_do_not(self):
        path = Trajectory(np.arange(3.0), np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]]))
        starts, ends = np.array([0.0, 0.5]), np.array([1.04, 1.5])
        error = relation_error(path, starts, ends, np.array([[1.0, 0, 0], [1.0, 0, 0]]))
        assert (error.translation.count, error.missing) == (1, 1)
        assert error.translation.mean == pytest.approx(0.0)

    def test_revisits_are_relations_over_a_long_time(self):
        path = Trajectory(
            np.arange(40.0), np.column_stack([np.arange(40.0), np.zeros(40), np.zeros(40)])
        )
        starts, ends = np.array([0.0, 0.0]), np.array([1.0, 30.0])
        relative = np.array([[1.0, 0, 0], [30.5, 0, 0]])
        backwards = (ends, starts, -relative)
        for relations in ((starts, ends, relative), backwards):
            every, revisits = (
                relation_error(path, *relations, revisits=only) for only in (False, True)
            )
            assert every.translation.mean == pytest.approx(0.25)
            assert revisits.translation.mean == pytest.approx(0.5)
            assert (every.translation.count, revisits.translation.count) == (2, 1)

    def test_relations_of_another_log_are_refused(self):
        with pytest.raises(ValueError, match="same log"):
            relation_error(wiggle(), np.array([1e9]), np.array([1e9 + 1]), np.zeros((1, 3)))


class TestConsistency:
    def test_nees_of_honest_gaussians_lies_in_its_interval(self):
        rng = np.random.default_rng(1)
        covariance = np.diag([0.04, 0.01, 0.0025])
        errors = rng.multivariate_normal(np.zeros(3), covariance, size=400)
        nees = normalised_estimation_error_squared(
            errors, np.zeros((400, 3)), np.tile(covariance, (400, 1, 1)), 0.0
        )
        low, high = chi2.interval(0.999, 3 * 400)
        assert low < nees.sum() < high

    def test_a_heading_a_little_across_half_a_turn_errs_a_little(self):
        there, here = np.array([[1.0, 2.0, np.pi - 0.01]]), np.array([[1.0, 2.0, 0.01 - np.pi]])
        nees = normalised_estimation_error_squared(there, here, np.eye(3)[None] * 0.01, 0.0)
        assert nees == pytest.approx([0.02**2 / 0.01])

    def test_an_overconfident_filter_lies_above(self):
        nees = normalised_estimation_error_squared(
            np.full((5, 3), 0.3), np.zeros((5, 3)), np.tile(np.eye(3) * 1e-3, (5, 1, 1))
        )
        assert nees.sum() > chi2.interval(0.95, 3 * 5)[1]
