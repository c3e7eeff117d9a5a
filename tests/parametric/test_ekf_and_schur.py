"""EKF-SLAM: the filter, its answer as one least-squares problem, and what both measure."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FREE, GridFrame, Trajectory
from slamgym.parametric.config import EkfConfig, MotionConfig, ScannerView
from slamgym.parametric.ekf_slam import EkfSlam, run_ekf
from slamgym.parametric.landmarks import control_sigmas, landmark_problem, observation_model
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

NO_ERRORS = LidarErrors()
ERRORS = WheelErrors(kappa=0.002, alpha_eb=0.01, scale=1.001)


def problem_of(flat, tour, resolution=0.3, wheels=ERRORS, noise=1.0, errors=NO_ERRORS, field=None):
    frame = GridFrame.covering(flat.bounds, resolution, 0.5)
    occupied = flat.raster(resolution, frame).cells != FREE
    scans = pick_scans(tour, MotionConfig(scan_spacing=0.3, scan_angle=0.5))
    scanner = ScannerView()
    visibility = observe(occupied, frame, scans.poses, scanner)
    motion = increments_of(scans.poses)
    controls = believed_increments(motion, wheels)
    config = EkfConfig(sigma_range=0.02, sigma_bearing_deg=0.5, landmarks_per_scan=0)
    return landmark_problem(
        scans.poses, controls, visibility, errors, config, np.random.default_rng(0), noise, field,
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


SOLVERS = pytest.mark.parametrize("solve", [run_ekf, solve_schur])


@SOLVERS
def test_the_truth_is_found_when_nothing_errs(flat, tour, solve) -> None:
    problem = problem_of(flat, tour, wheels=WheelErrors(), noise=0.0)
    estimate = solve(problem)
    np.testing.assert_allclose(estimate.landmarks, problem.points, atol=1e-9)
    np.testing.assert_allclose(estimate.poses, problem.true_poses, atol=1e-9)


@SOLVERS
def test_slam_removes_most_of_the_odometry_error(flat, tour, solve) -> None:
    problem = problem_of(flat, tour)
    odometry_end = integrate(problem.true_poses[0], Increments(*problem.controls.T))[-1, :2]
    drift = np.hypot(*(odometry_end - problem.true_poses[-1, :2]))
    left = np.hypot(*(solve(problem).poses[-1, :2] - problem.true_poses[-1, :2]))
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
        scans.poses, motion, visibility, LidarErrors(),
        EkfConfig(landmarks_per_scan=8), np.random.default_rng(0),
    )  # fmt: skip
    counts = np.bincount(problem.scan, minlength=len(scans))
    assert counts.max() == 8
    first_use = [int(np.flatnonzero(problem.landmark == i)[0]) for i in range(len(problem.cells))]
    assert first_use == sorted(first_use)


@pytest.mark.parametrize("resolution", [0.1, 0.2, 0.3, 0.5])
def test_the_filter_and_the_batch_move_the_landmarks_alike(flat, tour, resolution) -> None:
    problem = problem_of(flat, tour, resolution)
    filtered = run_ekf(problem).landmarks - problem.points
    batch = solve_schur(problem).landmarks - problem.points
    size = np.sqrt((batch**2).mean())
    assert size > 0.005
    # The filter linearises where it believes to be, the batch at the solution: over cells of 0.1 to 0.5 m that was
    # measured to move landmarks by 0.25 to 1.6 mm, 2 to 10 % of what the odometry's error moves them by.
    difference = np.sqrt(((filtered - batch) ** 2).mean())
    assert difference < 0.11 * size
    assert difference < 0.002


def run_of(problem, steps):
    """A filter after so many scans of a run, its covariance looked at after each."""
    ekf = EkfSlam(problem.true_poses[0], len(problem.cells), problem.mount_x, problem.sigmas)
    for k in range(steps):
        if k:
            ekf.predict(problem.controls[k - 1], problem.control_sigmas[k - 1])
        now = problem.scan == k
        known = now & (3 + 2 * problem.landmark < ekf.size)
        if known.any():
            ekf.update(problem.landmark[known], problem.measured[known])
        new = now & ~known
        if new.any():
            order = np.argsort(problem.landmark[new])
            ekf.add_landmarks(problem.measured[new][order])
    return ekf


def test_the_covariance_stays_positive_semi_definite_for_200_steps(flat, tour) -> None:
    there_and_back = np.concatenate([tour.poses, tour.poses[::-1], tour.poses])
    problem = problem_of(flat, Trajectory(np.arange(3.0 * len(tour)), there_and_back))
    assert len(problem.true_poses) >= 200
    ekf = run_of(problem, 200)
    P = ekf.covariance[: ekf.size, : ekf.size]
    np.testing.assert_allclose(P, P.T, atol=1e-12)
    eigenvalues = np.linalg.eigvalsh(P)
    # Rounding: float64 has 16 digits of the largest.
    assert eigenvalues.min() > -1e-12 * eigenvalues.max()
    assert ekf.size == 3 + 2 * len(np.unique(problem.landmark[problem.scan < 200]))


def test_prediction_moves_mean_and_covariance_as_many_noisy_robots_move() -> None:
    start = np.array([1.0, 2.0, 0.6])
    sigmas = np.array([0.02, 0.001, 0.03])
    ekf = EkfSlam(start, 1, -0.064, np.array([0.02, 0.01]))
    ekf.add_landmarks(np.array([[2.0, 0.4]]))
    first, second = np.array([0.5, 0.0, 0.3]), np.array([0.4, 0.0, -0.2])
    ekf.predict(first, sigmas)
    ekf.predict(second, sigmas)
    rng = np.random.default_rng(0)
    ends = []
    for _ in range(4000):
        noisy = np.stack([first, second]) + sigmas * rng.standard_normal((2, 3))
        ends.append(integrate(start, Increments(*noisy.T))[-1])
    ends = np.array(ends)
    np.testing.assert_allclose(ekf.mean[:3], ends.mean(axis=0), atol=3e-3)
    # Four standard errors of a variance of 4000 samples, and the curvature that a linear filter leaves out.
    spread = np.cov(ends.T)
    scale = np.sqrt(np.outer(np.diag(spread), np.diag(spread)))
    np.testing.assert_allclose(ekf.covariance[:3, :3] / scale, spread / scale, atol=0.1)


def test_a_sight_pulls_robot_and_landmark_towards_each_other() -> None:
    ekf = EkfSlam(np.zeros(3), 1, 0.0, np.array([0.02, 0.01]))
    ekf.add_landmarks(np.array([[2.0, 0.0]]))
    ekf.predict(np.array([1.0, 0.0, 0.0]), np.array([0.1, 1e-4, 1e-4]))
    before = ekf.covariance[0, 0]
    ekf.update(np.array([0]), np.array([[0.9, 0.0]]))
    # It sees the landmark nearer than the metre that odometry leaves: so it has driven further.
    assert ekf.mean[0] == pytest.approx(1.1, abs=0.02)
    assert ekf.covariance[0, 0] < 0.1 * before


def test_the_noise_of_odometry_is_the_size_of_its_bias_and_a_floor() -> None:
    true = np.array([[0.3, 0.0, 0.2], [0.3, 0.0, 0.2]])
    believed = true + np.array([[0.05, 0.0, -0.04], [-0.05, 0.0, 0.04]])
    sigmas = control_sigmas(believed, true)
    np.testing.assert_allclose(sigmas[:, 0], 0.05 + 0.002)
    np.testing.assert_allclose(sigmas[:, 2], 0.04 + np.radians(0.1))
    assert (control_sigmas(true, true) > 0.0).all()


def test_measurements_follow_the_systematic_errors(flat, tour) -> None:
    exact = problem_of(flat, tour, noise=0.0)
    off = problem_of(flat, tour, noise=0.0, errors=LidarErrors(a0=0.1, b2=0.02))
    bearing = exact.measured[:, 1]
    np.testing.assert_allclose(off.measured[:, 0], exact.measured[:, 0] - 0.1, atol=1e-9)
    turned = wrap_angle(off.measured[:, 1] - bearing + 0.02 * np.sin(bearing))
    np.testing.assert_allclose(turned, 0.0, atol=1e-9)


def test_a_given_field_displaces_what_is_measured(flat, tour) -> None:
    exact = problem_of(flat, tour, noise=0.0)
    shape = GridFrame.covering(flat.bounds, 0.3, 0.5).shape
    field = np.zeros((2, *shape), np.float32)
    field[0] = 0.25
    off = problem_of(flat, tour, noise=0.0, field=field)
    heading = exact.true_poses[exact.scan, 2]

    def placed(problem):
        direction = heading + problem.measured[:, 1]
        return problem.measured[:, 0] * np.exp(1j * direction)

    # True minus measured is a quarter of a metre to the right: all is measured that much to the left.
    np.testing.assert_allclose(placed(off) - placed(exact), -0.25, atol=1e-6)
