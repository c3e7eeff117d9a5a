"""EKF-SLAM as one least-squares problem."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FREE, GridFrame
from slamgym.parametric.config import EkfConfig, MotionConfig, ScannerView
from slamgym.parametric.ekf_slam import landmark_problem, observation_model
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
    scanner = ScannerView()
    visibility = observe(occupied, frame, scans.poses, scanner)
    motion = increments_of(scans.poses)
    controls = believed_increments(motion, wheels)
    config = EkfConfig(sigma_range=0.02, sigma_bearing_deg=0.5, landmarks_per_scan=0)
    return landmark_problem(
        scans.poses, controls, visibility, scanner.mount_x, LidarErrors(), config,
        np.random.default_rng(0), noise,
    )  # fmt: skip


def test_two_steps_from_the_truth_reach_the_least_squares_estimate(flat, tour) -> None:
    problem = problem_of(flat, tour, resolution=0.5)
    count = 3 * (len(problem.true_poses) - 1)

    def residuals(state):
        poses = np.vstack([problem.true_poses[:1], state[:count].reshape(-1, 3)])
        points = state[count:].reshape(-1, 2)
        moved = (problem.controls - np.column_stack(increments_of(poses))) / problem.control_sigmas
        seen = observation_model(poses[problem.scan], points[problem.landmark], problem.mount_x)[0]
        off = problem.measured - seen
        off[:, 1] = wrap_angle(off[:, 1])
        return np.concatenate([moved.ravel(), (off / problem.sigmas).ravel()])

    truth = np.concatenate([problem.true_poses[1:].ravel(), problem.points.ravel()])
    best = (
        least_squares(residuals, truth, x_scale="jac", max_nfev=8).x[count:].reshape(-1, 2)
        - problem.points
    )
    solved = solve_schur(problem).landmarks - problem.points
    assert np.sqrt((best**2).mean()) > 0.005
    assert np.sqrt(((best - solved) ** 2).mean()) < 0.01 * np.sqrt((best**2).mean())


def test_the_truth_is_found_when_nothing_errs(flat, tour) -> None:
    problem = problem_of(flat, tour, wheels=WheelErrors(), noise=0.0)
    estimate = solve_schur(problem)
    np.testing.assert_allclose(estimate.landmarks, problem.points, atol=1e-9)
    np.testing.assert_allclose(estimate.poses, problem.true_poses, atol=1e-9)


def test_slam_removes_most_of_the_odometry_error(flat, tour) -> None:
    problem = problem_of(flat, tour)
    odometry_end = integrate(problem.true_poses[0], Increments(*problem.controls.T))[-1, :2]
    drift = np.hypot(*(odometry_end - problem.true_poses[-1, :2]))
    left = np.hypot(*(solve_schur(problem).poses[-1, :2] - problem.true_poses[-1, :2]))
    assert left < 0.3 * drift


@pytest.mark.parametrize("index", range(3))
def test_observation_jacobians_match_finite_differences(index) -> None:
    rng = np.random.default_rng(index)
    poses = rng.uniform(-1, 1, (5, 3))
    points = rng.uniform(2, 4, (5, 2))
    _, by_pose, by_point = observation_model(poses, points, -0.064)
    step = 1e-6
    moved = poses.copy()
    moved[:, index] += step
    change = (
        observation_model(moved, points, -0.064)[0] - observation_model(poses, points, -0.064)[0]
    )
    np.testing.assert_allclose(by_pose[:, :, index], change / step, atol=1e-4)
    if index < 2:
        moved = points.copy()
        moved[:, index] += step
        change = (
            observation_model(poses, moved, -0.064)[0] - observation_model(poses, points, -0.064)[0]
        )
        np.testing.assert_allclose(by_point[:, :, index], change / step, atol=1e-4)


def test_a_limit_on_landmarks_per_scan_holds(flat, tour) -> None:
    frame = GridFrame.covering(flat.bounds, 0.1, 0.5)
    occupied = flat.raster(0.1, frame).cells != FREE
    scans = pick_scans(tour, MotionConfig())
    visibility = observe(occupied, frame, scans.poses, ScannerView())
    motion = increments_of(scans.poses)
    problem = landmark_problem(
        scans.poses, motion, visibility, -0.064, LidarErrors(),
        EkfConfig(landmarks_per_scan=8), np.random.default_rng(0),
    )  # fmt: skip
    counts = np.bincount(problem.scan, minlength=len(scans))
    assert counts.max() == 8
    first_use = [int(np.flatnonzero(problem.landmark == i)[0]) for i in range(len(problem.cells))]
    assert first_use == sorted(first_use)
