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
def test_the_band_accounts_for_every_prediction(pairs):
    probabilities, truth = split(pairs)
    score = score_probabilities(probabilities, truth, BAND)
    assert score.count == len(pairs)
    assert score.band_share == pytest.approx(np.mean([0.4 <= p < 0.8 for p in probabilities]))
    assert 0.0 <= score.brier <= 1.0


def test_a_perfect_and_a_worthless_prediction():
    truth = np.array([True, True, False, False])
    perfect = score_probabilities(truth.astype(float), truth, BAND)
    assert (perfect.accuracy, perfect.roc_auc, perfect.brier) == (1.0, 1.0, 0.0)
    assert (perfect.band_share, perfect.accuracy_outside_band) == (0.0, 1.0)
    coin = score_probabilities(np.full(4, 0.5), truth, BAND)
    assert (coin.roc_auc, coin.brier, coin.band_share) == (0.5, 0.25, 1.0)
    assert math.isnan(coin.accuracy_outside_band)
