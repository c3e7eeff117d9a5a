"""Is the covariance that a filter reports honest? (Bar-Shalom, Li, Kirubarajan 2001, section 5.4)."""

import numpy as np
from scipy.stats import chi2

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray


def normalised_estimation_error_squared(
    poses: FloatArray, truth: FloatArray, covariances: FloatArray, floor: float = 1e-6
) -> FloatArray:
    """NEES of each pose: ``e^T P^-1 e`` (eq. 5.4.2-1).

    Args:
        poses: Estimates, shape (N, 3).
        truth: True poses in the same frame, shape (N, 3).
        covariances: Reported covariances, shape (N, 3, 3).
        floor: Variance added to each axis, so that a filter whose particles agree to the last digit (a
            covariance of zero) gets a large but finite value [m^2, rad^2].

    Returns:
        Shape (N,). A consistent filter has a mean of 3, the number of dimensions; more means overconfident.
    """
    error: FloatArray = np.asarray(poses, dtype=np.float64) - truth
    error[:, 2] = wrap_angle(error[:, 2])
    inflated = np.asarray(covariances, dtype=np.float64) + floor * np.eye(3)
    solved = np.linalg.solve(inflated, error[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ni,ni->n", error, solved), dtype=np.float64)


def nees_interval(num_runs: int, dimensions: int = 3, probability: float = 0.95) -> tuple[float, float]:
    """Where the NEES of a consistent filter, averaged over independent runs, lies (eq. 5.4.2-10).

    Args:
        num_runs: Number of independent runs that are averaged.
        dimensions: Of the error.
        probability: Of a consistent filter lying inside.
    """
    tail = 0.5 * (1.0 - probability)
    degrees = num_runs * dimensions
    return float(chi2.ppf(tail, degrees)) / num_runs, float(chi2.ppf(1.0 - tail, degrees)) / num_runs
