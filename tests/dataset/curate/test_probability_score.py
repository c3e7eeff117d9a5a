import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.dataset.curate.completeness_model import roc_auc, score_probabilities

BAND = (0.4, 0.8)
predictions = st.lists(
    st.tuples(st.sampled_from([0.0, 0.1, 0.35, 0.4, 0.5, 0.79, 0.8, 0.97, 1.0]), st.booleans()), min_size=1
)


def split(pairs):
    return np.array([p for p, _ in pairs]), np.array([t for _, t in pairs])


@given(predictions)
def test_the_area_is_the_share_of_pairs_in_the_right_order(pairs):
    probabilities, truth = split(pairs)
    wins = [
        1.0 if p > n else 0.5 if p == n else 0.0 for p in probabilities[truth] for n in probabilities[~truth]
    ]
    area = roc_auc(probabilities, truth)
    assert area == pytest.approx(np.mean(wins)) if wins else math.isnan(area)


@given(predictions)
def test_bins_and_band_account_for_every_prediction(pairs):
    probabilities, truth = split(pairs)
    score = score_probabilities(probabilities, truth, BAND)
    assert sum(b.count for b in score.bins) == score.count == len(pairs)
    assert sum(b.count * b.observed for b in score.bins if b.count) == pytest.approx(score.positives)
    for b in score.bins:
        if b.count:
            assert b.low - 1e-12 <= b.predicted <= b.high + 1e-12
    assert score.band_share == pytest.approx(np.mean([0.4 <= p < 0.8 for p in probabilities]))
    assert 0.0 <= score.brier <= 1.0


def test_a_perfect_and_a_worthless_prediction():
    truth = np.array([True, True, False, False])
    perfect = score_probabilities(truth.astype(float), truth, BAND)
    assert (perfect.accuracy, perfect.roc_auc, perfect.brier, perfect.calibration_error) == (
        1.0,
        1.0,
        0.0,
        0.0,
    )
    assert (perfect.band_share, perfect.kept_purity, perfect.dropped_purity) == (0.0, 1.0, 1.0)
    coin = score_probabilities(np.full(4, 0.5), truth, BAND)
    assert (coin.roc_auc, coin.brier, coin.calibration_error, coin.band_share) == (0.5, 0.25, 0.0, 1.0)
    assert math.isnan(coin.accuracy_outside_band)


def test_calibrated_predictions_have_a_small_calibration_error():
    rng = np.random.default_rng(0)
    probabilities = rng.random(20_000)
    truth = rng.random(20_000) < probabilities
    # Each of 10 bins of 2,000 has a standard error of about 0.01.
    assert score_probabilities(probabilities, truth, BAND).calibration_error < 0.02
    assert score_probabilities(probabilities**3, truth, BAND).calibration_error > 0.1


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="don't fit"):
        score_probabilities(np.zeros(3), np.zeros(2, np.bool_), BAND)
    with pytest.raises(ValueError, match="don't fit"):
        score_probabilities(np.zeros(0), np.zeros(0, np.bool_), BAND)
