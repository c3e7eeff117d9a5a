import json

import numpy as np
import pytest

from slamgym.core.errors import InputFileError
from slamgym.dataset.curate.completeness import FEATURES, completeness_features
from slamgym.dataset.curate.completeness_model import CompletenessModel, scaled

WEIGHTS = dict.fromkeys(FEATURES, 0.0) | {"floor": 1.0}


def test_no_samples_give_no_probabilities():
    assert CompletenessModel.read().probabilities(np.array([])).shape == (0,)


def test_the_pretrained_model_reads_and_prefers_a_closed_room_to_an_open_one():
    closed = np.full((140, 180), 205, np.uint8)
    closed[20:120, 20:160] = 0
    closed[21:119, 21:159] = 254
    half = closed.copy()
    half[:, 90:] = 205  # the robot has not been there
    rows = np.stack([completeness_features(cells, 0.05) for cells in (closed, half)])
    whole, part = CompletenessModel.read().probabilities(rows)
    assert whole > 0.6 > 0.4 > part


def test_features_are_scaled_by_logarithms_that_are_exact_at_powers_of_2():
    powers = 2.0 ** np.arange(12)
    assert np.allclose(scaled((powers - 1.0) / 10.0), np.arange(12), atol=1e-12)
    values = np.linspace(0.0, 300.0, 1000)
    assert (np.diff(scaled(values)) > 0.0).all()
    assert np.abs(scaled(values) - np.log2(1.0 + 10.0 * values)).max() < 0.09


def test_probabilities_are_those_of_logistic_regression():
    rows = np.zeros((2, 5))
    rows[1, 0] = 0.7  # 8, to base 2 3
    found = CompletenessModel(-1.0, WEIGHTS, {}).probabilities(rows)
    assert found == pytest.approx(1.0 / (1.0 + np.exp([1.0, -2.0])))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bias": "1"}, "is no model of completeness"),
        ({"bias": 1e300}, "is no model of completeness"),
        ({"weights": [1.0]}, "is no model of completeness"),
        ({"weights": WEIGHTS | {"floor": None}}, "is no model of completeness"),
        ({"about": 3}, "is no model of completeness"),
        ({"trees": 3}, "is no model of completeness"),
        ({"weights": {"frontier": 1.0}}, "other features"),
    ],
)
def test_a_broken_or_foreign_model_is_refused(tmp_path, changes, words):
    path = tmp_path / "model.json"
    path.write_text(json.dumps({"bias": 0.0, "weights": WEIGHTS, "about": {}} | changes))
    with pytest.raises(InputFileError, match=rf"model\.json: .*{words}"):
        CompletenessModel.read(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"{", b"[]"])
def test_a_file_that_is_no_model_is_refused(tmp_path, content):
    (tmp_path / "x.json").write_bytes(content)
    with pytest.raises(InputFileError, match=r"x\.json"):
        CompletenessModel.read(tmp_path / "x.json")
    with pytest.raises(InputFileError, match=r"missing\.json"):
        CompletenessModel.read(tmp_path / "missing.json")
