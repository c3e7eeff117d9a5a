"""How good predicted probabilities are: accuracy, ranking, calibration."""

from dataclasses import dataclass

import numpy as np

from slamgym.core.types import BoolArray, FloatArray

BINS = 10
"""Bins of the reliability table, of equal width."""


@dataclass(frozen=True)
class ReliabilityBin:
    """Predictions of about the same probability."""

    low: float
    high: float
    count: int
    predicted: float
    """Mean probability; nan without predictions."""
    observed: float
    """Share that was true; nan without predictions."""


@dataclass(frozen=True)
class ProbabilityScore:
    """Predicted probabilities beside what was true."""

    count: int
    positives: int
    accuracy: float
    """Share of predictions on the right side of 1/2."""
    roc_auc: float
    """Probability that a true sample ranks before a false one; nan if there is but one kind."""
    brier: float
    """Mean squared difference of probability and truth (Brier 1950); 0.25 for a coin."""
    calibration_error: float
    """Mean difference of predicted and observed share over the bins, weighed by their counts."""
    band_share: float
    """Share of the predictions in the band that goes to a person."""
    accuracy_outside_band: float
    """Share of the others that are right; nan if there are none."""
    kept_purity: float
    """Share of true ones among those above the band; nan if there are none."""
    dropped_purity: float
    """Share of false ones among those below the band; nan if there are none."""
    bins: tuple[ReliabilityBin, ...]


def score_probabilities(
    probabilities: FloatArray, truth: BoolArray, band: tuple[float, float]
) -> ProbabilityScore:
    """Judge predictions.

    Args:
        probabilities: (N,), N at least 1.
        truth: (N,).
        band: Probabilities from the first up to, but not including, the second go to a person.

    Raises:
        ValueError: If there are no predictions or the shapes differ.
    """
    if probabilities.shape != truth.shape or probabilities.size == 0:
        raise ValueError(f"{probabilities.shape} probabilities don't fit {truth.shape} truths")
    bins = reliability(probabilities, truth)
    below, above = probabilities < band[0], probabilities >= band[1]
    right = (above & truth) | (below & ~truth)
    return ProbabilityScore(
        count=len(truth),
        positives=int(truth.sum()),
        accuracy=float(((probabilities >= 0.5) == truth).mean()),
        roc_auc=roc_auc(probabilities, truth),
        brier=float(((probabilities - truth) ** 2).mean()),
        calibration_error=sum(b.count * abs(b.predicted - b.observed) for b in bins if b.count) / len(truth),
        band_share=float((~below & ~above).mean()),
        accuracy_outside_band=_mean(right[below | above]),
        kept_purity=_mean(truth[above]),
        dropped_purity=_mean(~truth[below]),
        bins=bins,
    )


def roc_auc(probabilities: FloatArray, truth: BoolArray) -> float:
    """Area under the ROC curve, as the Mann-Whitney statistic; ties count half; nan with one class only."""
    from scipy.stats import rankdata

    positives, negatives = int(truth.sum()), int((~truth).sum())
    if positives == 0 or negatives == 0:
        return float("nan")
    rank_sum = float(rankdata(probabilities)[truth].sum())
    return (rank_sum - positives * (positives + 1) / 2.0) / (positives * negatives)


def reliability(probabilities: FloatArray, truth: BoolArray) -> tuple[ReliabilityBin, ...]:
    """The reliability table: what share was true among predictions of about the same probability."""
    place = np.minimum((probabilities * BINS).astype(np.int64), BINS - 1)
    table = []
    for i in range(BINS):
        chosen = place == i
        table.append(
            ReliabilityBin(
                low=i / BINS,
                high=(i + 1) / BINS,
                count=int(chosen.sum()),
                predicted=_mean(probabilities[chosen]),
                observed=_mean(truth[chosen]),
            )
        )
    return tuple(table)


def _mean(values: FloatArray | BoolArray) -> float:
    return float(values.mean()) if len(values) else float("nan")
