import builtins
import importlib
import io
import json

import numpy as np
import pytest

from slamgym.core.errors import ConfigError, InputFileError, SlamgymError
from slamgym.dataset.curate.completeness import FEATURES
from slamgym.dataset.curate.completeness_model import (
    CompletenessModel,
    TreesConfig,
    cross_fit,
    train_completeness,
)
from slamgym.dataset.curate.forest import Forest, read_forest, write_forest

SMALL = TreesConfig(trees=12, min_leaf=2)


def samples(count=200, seed=0):
    """Features of which the third alone decides, with some noise, in ten plans."""
    rng = np.random.default_rng(seed)
    features = rng.random((count, len(FEATURES)))
    complete = features[:, 2] + 0.1 * rng.standard_normal(count) > 0.5
    return features, complete, [f"plan {i % 10}" for i in range(count)]


@pytest.fixture(scope="module")
def model():
    pytest.importorskip("sklearn")
    features, complete, _ = samples()
    return train_completeness(features, complete, SMALL)


def test_the_arrays_answer_as_scikit_learn_does(model):
    ensemble = pytest.importorskip("sklearn.ensemble").ExtraTreesClassifier(
        n_estimators=SMALL.trees,
        min_samples_leaf=SMALL.min_leaf,
        max_features=SMALL.max_features,
        random_state=SMALL.seed,
    )
    features, complete, _ = samples()
    ensemble.fit(features.astype(np.float32), complete)
    fresh = samples(seed=1)[0]
    expected = ensemble.predict_proba(fresh.astype(np.float32))[:, 1]
    # Leaves are stored with single precision.
    np.testing.assert_allclose(model.probabilities(fresh), expected, atol=1e-6)


def test_what_was_written_reads_the_same_and_twice_the_same_bytes(model, tmp_path):
    model.write(tmp_path / "a.npz")
    model.write(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = CompletenessModel.read(tmp_path / "a.npz")
    features = samples(seed=2)[0]
    assert np.array_equal(again.probabilities(features), model.probabilities(features))
    assert again.about["maps"] == 200


def test_no_samples_give_no_probabilities(model):
    assert model.probabilities(np.zeros((0, 15))).shape == (0,)


def test_the_pretrained_model_reads_and_prefers_a_closed_room_to_an_open_one():
    from slamgym.dataset.curate.completeness import completeness_features

    closed = np.full((140, 180), 205, np.uint8)
    closed[20:120, 20:160] = 0
    closed[21:119, 21:159] = 254
    half = closed.copy()
    half[:, 90:] = 205  # the robot has not been there
    rows = np.stack([completeness_features(cells, 0.05) for cells in (closed, half)])
    whole, part = CompletenessModel.read().probabilities(rows)
    assert whole > 0.6 > 0.4 > part


def write_arrays(path, **changes):
    arrays = {
        "feature": np.array([0, -1, -1]),
        "threshold": np.array([0.5, 0.0, 0.0]),
        "left": np.array([1, 0, 0]),
        "right": np.array([2, 0, 0]),
        "value": np.array([0.0, 0.2, 0.9]),
        "roots": np.array([0]),
        "about": np.frombuffer(json.dumps({"features": list(FEATURES)}).encode(), np.uint8),
    } | changes
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    path.write_bytes(content.getvalue())


def test_a_hand_made_tree_goes_left_up_to_the_threshold(tmp_path):
    write_arrays(tmp_path / "tree.npz")
    forest = CompletenessModel.read(tmp_path / "tree.npz").forest
    points = np.zeros((3, 15))
    points[:, 0] = (0.4, 0.5, 0.6)
    np.testing.assert_allclose(forest.predict(points), [0.2, 0.2, 0.9])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"left": np.array([0, 0, 0])}, "behind its parent"),
        ({"right": np.array([3, 0, 0])}, "behind its parent"),
        ({"roots": np.array([7])}, "no roots"),
        ({"roots": np.zeros(0, np.int64)}, "no roots"),
        ({"value": np.array([0.0, 0.2, 1.9])}, "no share"),
        ({"value": np.array([0.0, np.nan, 0.9])}, "no share"),
        ({"threshold": np.array([np.inf, 0.0, 0.0])}, "not a number"),
        ({"threshold": np.array([0.5, 0.0])}, "differ in length"),
        ({"feature": np.array([-2, -1, -1])}, "no feature"),
        ({"feature": np.array([15, -1, -1])}, "other features"),
        ({"feature": np.array([0.0, -1.0, -1.0])}, "not a list of numbers"),
        ({"about": np.frombuffer(b"{}", np.uint8)}, "other features"),
        ({"about": np.frombuffer(b"[]", np.uint8)}, "no object"),
        ({"about": np.frombuffer(b"{", np.uint8)}, "can't be read"),
        ({"feature": np.array([object()])}, "can't be read"),  # a pickle inside
    ],
)
def test_a_broken_or_foreign_model_is_refused(tmp_path, changes, words):
    write_arrays(tmp_path / "tree.npz", **changes)
    with pytest.raises(InputFileError, match=words) as error:
        CompletenessModel.read(tmp_path / "tree.npz")
    assert "tree.npz" in str(error.value)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no zip at all", b"\x93NUMPY"])
def test_a_file_that_is_no_archive_is_refused(tmp_path, content):
    (tmp_path / "x.npz").write_bytes(content)
    with pytest.raises(InputFileError, match="can't be read as a model"):
        read_forest(tmp_path / "x.npz")
    with pytest.raises(InputFileError, match=r"missing\.npz: can't be read"):
        read_forest(tmp_path / "missing.npz")


def test_an_array_that_is_left_out_is_named(tmp_path):
    forest = Forest(*(np.zeros(1, kind) for kind in (int, float, int, int, float, int)))
    write_forest(tmp_path / "f.npz", forest, {})
    with np.load(tmp_path / "f.npz") as file:
        arrays = dict(file)
    del arrays["roots"]
    np.savez(tmp_path / "g.npz", **arrays)
    with pytest.raises(InputFileError, match="roots"):
        read_forest(tmp_path / "g.npz")


def test_held_out_plans_are_judged_by_models_that_have_not_seen_them():
    pytest.importorskip("sklearn")
    features, _, plan_ids = samples(400)
    # Labels that follow from the plan alone: whoever has seen the plan knows them, nobody else can.
    rng = np.random.default_rng(3)
    signature = {plan: rng.random(15) for plan in sorted(set(plan_ids))}
    features = np.stack([signature[plan] for plan in plan_ids]) + 1e-3 * features
    complete = np.array([int(plan.split()[1]) % 2 == 0 for plan in plan_ids])
    models = cross_fit(features, complete, plan_ids, SMALL)
    own = (models.whole.probabilities(features) >= 0.5) == complete
    held_out = (models.probabilities(features, plan_ids) >= 0.5) == complete
    assert own.mean() == 1.0
    assert held_out.mean() < 0.8
    others = models.probabilities(features, ["never seen"] * len(features))
    assert np.array_equal(others, models.whole.probabilities(features))


def test_every_plan_lies_in_one_part_and_the_parts_are_even():
    pytest.importorskip("sklearn")
    features, complete, plan_ids = samples()
    models = cross_fit(features, complete, plan_ids, SMALL, folds=5)
    assert set(models.part_of) == set(plan_ids)
    assert np.bincount(list(models.part_of.values())).tolist() == [2] * 5


def test_one_kind_of_maps_teaches_nothing():
    features, complete, plan_ids = samples()
    with pytest.raises(SlamgymError, match="all 200 maps are complete"):
        train_completeness(features, np.ones_like(complete), SMALL)
    with pytest.raises(SlamgymError, match="at least two plans"):
        cross_fit(features, complete, ["one"] * len(plan_ids), SMALL)


def test_without_scikit_learn_the_error_says_how_to_get_it(monkeypatch):
    def refuse(name, *arguments):
        if name.startswith("sklearn"):
            raise ImportError(name)
        return builtins.__import__(name, *arguments)

    monkeypatch.setattr(importlib, "import_module", refuse)
    features, complete, _ = samples()
    with pytest.raises(SlamgymError, match=r"pip install 'slamgym\[clean\]'"):
        train_completeness(features, complete, SMALL)


@pytest.mark.parametrize(
    "settings", [{"trees": 0}, {"min_leaf": 0}, {"max_features": 16}, {"max_features": 0}]
)
def test_senseless_settings_are_refused(settings):
    with pytest.raises(ConfigError):
        TreesConfig(**settings)
