"""How far apart two samples of map statistics lie: maximum mean discrepancy, and Wasserstein distances.

Beside the classifier two-sample test (:mod:`slamgym.metrics.two_sample`), which says whether two kinds of maps
can be told apart, these say by how much and in what.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist
from scipy.stats import wasserstein_distance

from slamgym.core.types import FloatArray


@dataclass(frozen=True)
class KernelDistance:
    """Squared maximum mean discrepancy of two samples."""

    mmd2: float
    """The unbiased estimate; around 0, also below it, if the samples have one distribution."""
    p: float
    """Share of random relabellings that give at least this distance."""


def kernel_distance(
    first: list[dict[str, float]],
    second: list[dict[str, float]],
    permutations: int = 500,
    seed: int = 0,
) -> KernelDistance:
    """Kernel two-sample test (Gretton et al., *A Kernel Two-Sample Test*, JMLR 2012, eq. 3).

    The kernel is Gaussian on standardised statistics, as wide as their median distance.

    Args:
        first: Statistics of each map of one kind, at least 2; all with the same names.
        second: Those of the other kind, at least 2.
        permutations: Relabellings that are tried.
        seed: Of the relabellings.

    Raises:
        ValueError: If a sample has fewer than 2 maps.
    """
    if min(len(first), len(second)) < 2:
        raise ValueError("a kernel distance needs at least 2 maps of each kind")
    values = _standardised(first, second)
    distances = cdist(values, values, "sqeuclidean")
    width = np.median(distances[np.triu_indices(len(values), 1)])
    kernel = np.exp(-distances / max(float(width), 1e-12))
    np.fill_diagonal(kernel, 0.0)
    labels = np.arange(len(values)) < len(first)
    found = _mmd2(kernel, labels)
    rng = np.random.default_rng(seed)
    # The labelling itself counts as one of the permutations, so that p is never 0.
    beyond = sum(_mmd2(kernel, rng.permutation(labels)) >= found for _ in range(permutations))
    return KernelDistance(found, (1 + beyond) / (1 + permutations))


def statistic_distances(first: list[dict[str, float]], second: list[dict[str, float]]) -> dict[str, float]:
    """Wasserstein-1 distance of each statistic, in standard deviations of the first sample.

    Args:
        first: Statistics of each map of the reference; all with the same names.
        second: Those of the other kind.
    """
    distances = {}
    for name in first[0]:
        a, b = np.array([row[name] for row in first]), np.array([row[name] for row in second])
        # Of a statistic that is the same in the whole reference, the spread over both counts: always finite.
        spread = float(a.std()) or float(np.concatenate([a, b]).std())
        distances[name] = float(wasserstein_distance(a, b)) / spread if spread > 0.0 else 0.0
    return distances


def _standardised(first: list[dict[str, float]], second: list[dict[str, float]]) -> FloatArray:
    names = list(first[0])
    values = np.array([[row[name] for name in names] for row in [*first, *second]], dtype=np.float64)
    spread = values.std(axis=0)
    varying = spread > 1e-12
    standardised: FloatArray = (values[:, varying] - values[:, varying].mean(axis=0)) / spread[varying]
    return standardised


def _mmd2(kernel: FloatArray, labels: np.ndarray) -> float:
    """The unbiased estimate from a kernel matrix with a diagonal of 0."""
    m, n = int(labels.sum()), int((~labels).sum())
    within = float(kernel[np.ix_(labels, labels)].sum()) / (m * (m - 1))
    other = float(kernel[np.ix_(~labels, ~labels)].sum()) / (n * (n - 1))
    return within + other - 2.0 * float(kernel[np.ix_(labels, ~labels)].mean())
