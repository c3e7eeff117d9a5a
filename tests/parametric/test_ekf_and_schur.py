"""The batched filter and the batch solution are two ways to one answer."""

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, GridFrame
from slamgym.parametric.config import EkfConfig, MotionConfig, ScannerConfig
from slamgym.parametric.ekf_slam import BatchedEkf, landmark_problem, observation_model, run_ekf
from slamgym.parametric.lidar_error import LidarErrors
from slamgym.parametric.odometry_error import (
    Increments,
    WheelErrors,
    believed_increments,
    increments_of,
    integrate,
)
from slamgym.parametric.paths import pick_scans
from slamgym.parametric.schur_slam import solve_schur
from slamgym.parametric.visibility import observe

ERRORS = WheelErrors(kappa=0.002, alpha_eb=0.01, scale=1.001)


def problem_of(flat, tour, resolution=0.3, wheels=ERRORS, noise=1.0):
    frame = GridFrame.covering(flat.bounds, resolution, 0.5)
    occupied = flat.raster(resolution, frame).cells != FREE
    scans = pick_scans(tour, MotionConfig(scan_spacing=0.3, scan_angle=0.5))
    scanner = ScannerConfig()
    visibility = observe(occupied, frame, scans.poses, scanner)
    motion = increments_of(scans.poses)
    controls = believed_increments(motion, wheels)
    config = EkfConfig(sigma_range=0.02, sigma_bearing_deg=0.5, landmarks_per_scan=0)
    return landmark_problem(
        scans.poses, controls, visibility, scanner.mount_x, LidarErrors(), config,
        np.random.default_rng(0), noise,
    )  # fmt: skip


def test_schur_and_the_filter_agree_within_five_percent(flat, tour) -> None:
    # The two linearise at different points, so they differ in second order of the noise.
    problem = problem_of(flat, tour, resolution=0.2)
    filtered = run_ekf(problem).landmarks - problem.points
    solved = solve_schur(problem).landmarks - problem.points
    assert np.sqrt((solved**2).mean()) > 0.005
    assert np.sqrt(((filtered - solved) ** 2).mean()) < 0.05 * np.sqrt((solved**2).mean())


def test_both_find_the_truth_when_nothing_errs(flat, tour) -> None:
    problem = problem_of(flat, tour, wheels=WheelErrors(), noise=0.0)
    for estimate in (run_ekf(problem), solve_schur(problem)):
        np.testing.assert_allclose(estimate.landmarks, problem.points, atol=1e-9)
        np.testing.assert_allclose(estimate.poses, problem.true_poses, atol=1e-9)


def test_slam_removes_most_of_the_odometry_error(flat, tour) -> None:
    problem = problem_of(flat, tour)
    odometry_end = integrate(problem.true_poses[0], Increments(*problem.controls.T))[-1, :2]
    drift = np.hypot(*(odometry_end - problem.true_poses[-1, :2]))
    left = np.hypot(*(solve_schur(problem).poses[-1, :2] - problem.true_poses[-1, :2]))
    assert left < 0.3 * drift


def test_covariance_stays_positive_semidefinite_over_200_steps() -> None:
    rng = np.random.default_rng(0)
    ekf = BatchedEkf(np.zeros(3), 12, -0.064, np.array([0.02, 0.01]))
    pose = np.zeros(3)
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    landmarks = np.column_stack([3.0 * np.cos(angles), 3.0 * np.sin(angles)])
    for step in range(200):
        motion = np.array([0.05, 0.0, 0.03])
        middle = pose[2] + 0.015
        pose += np.array([0.05 * np.cos(middle), 0.05 * np.sin(middle), 0.03])
        ekf.predict(
            motion + rng.standard_normal(3) * [0.002, 0.0005, 0.002], np.array([0.002, 0.0005, 0.002])
        )
        measured, _, _ = observation_model(np.tile(pose, (12, 1)), landmarks, -0.064)
        measured += rng.standard_normal((12, 2)) * [0.02, 0.01]
        if step == 0:
            ekf.add_landmarks(measured)
        else:
            ekf.update(np.arange(12), measured)
    covariance = ekf.covariance
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    assert np.hypot(*(ekf.mean[:3] - pose)[:2]) < 0.1


@pytest.mark.parametrize("index", range(3))
def test_observation_jacobians_match_finite_differences(index) -> None:
    rng = np.random.default_rng(index)
    poses, points = rng.uniform(-1, 1, (5, 3)), rng.uniform(2, 4, (5, 2))
    _, by_pose, by_point = observation_model(poses, points, -0.064)
    step = 1e-6
    moved = poses.copy()
    moved[:, index] += step
    change = observation_model(moved, points, -0.064)[0] - observation_model(poses, points, -0.064)[0]
    np.testing.assert_allclose(by_pose[:, :, index], change / step, atol=1e-4)
    if index < 2:
        moved = points.copy()
        moved[:, index] += step
        change = observation_model(poses, moved, -0.064)[0] - observation_model(poses, points, -0.064)[0]
        np.testing.assert_allclose(by_point[:, :, index], change / step, atol=1e-4)


def test_too_many_landmarks_for_the_dense_filter_are_refused(flat, tour) -> None:
    with pytest.raises(ConfigError, match="ekf_schur"):
        run_ekf(problem_of(flat, tour), 10)


def test_a_limit_on_landmarks_per_scan_holds(flat, tour) -> None:
    frame = GridFrame.covering(flat.bounds, 0.1, 0.5)
    occupied = flat.raster(0.1, frame).cells != FREE
    scans = pick_scans(tour, MotionConfig())
    visibility = observe(occupied, frame, scans.poses, ScannerConfig())
    motion = increments_of(scans.poses)
    problem = landmark_problem(
        scans.poses, motion, visibility, -0.064, LidarErrors(),
        EkfConfig(landmarks_per_scan=8), np.random.default_rng(0),
    )  # fmt: skip
    counts = np.bincount(problem.scan, minlength=len(scans))
    assert counts.max() == 8
    first_use = [int(np.flatnonzero(problem.landmark == i)[0]) for i in range(len(problem.cells))]
    assert first_use == sorted(first_use)
