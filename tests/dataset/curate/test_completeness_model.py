import io
import json

import numpy as np
import pytest

from slamgym.core.errors import InputFileError
from slamgym.dataset.curate.completeness import FEATURES
from slamgym.dataset.curate.completeness_model import CompletenessModel


def test_no_samples_give_no_probabilities():
    model = CompletenessModel.read()
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
    model = CompletenessModel.read(tmp_path / "tree.npz")
    points = np.zeros((3, 15))
    points[:, 0] = (0.4, 0.5, 0.6)
    np.testing.assert_allclose(model.probabilities(points), [0.2, 0.2, 0.9])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"left": np.array([0, 0, 0])}, "is no model of completeness"),
        ({"right": np.array([3, 0, 0])}, "is no model of completeness"),
        ({"roots": np.array([7])}, "is no model of completeness"),
        ({"roots": np.zeros(0, np.int64)}, "is no model of completeness"),
        ({"value": np.array([0.0, 0.2, 1.9])}, "is no model of completeness"),
        ({"value": np.array([0.0, np.nan, 0.9])}, "is no model of completeness"),
        ({"threshold": np.array([np.inf, 0.0, 0.0])}, "is no model of completeness"),
        ({"threshold": np.array([0.5, 0.0])}, "is no model of completeness"),
        ({"feature": np.array([-2, -1, -1])}, "is no model of completeness"),
        ({"feature": np.array([15, -1, -1])}, "other features"),
        ({"feature": np.array([0.0, -1.0, -1.0])}, "is no model of completeness"),
        ({"about": np.frombuffer(b"{}", np.uint8)}, "other features"),
        ({"about": np.frombuffer(b"[]", np.uint8)}, "is no model of completeness"),
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
        CompletenessModel.read(tmp_path / "x.npz")
    with pytest.raises(InputFileError, match=r"missing\.npz: can't be read"):
        CompletenessModel.read(tmp_path / "missing.npz")


def test_an_array_that_is_left_out_is_named(tmp_path):
    write_arrays(tmp_path / "f.npz")
    with np.load(tmp_path / "f.npz") as file:
        arrays = dict(file)
    del arrays["roots"]
    np.savez(tmp_path / "g.npz", **arrays)
    with pytest.raises(InputFileError, match="roots"):
        CompletenessModel.read(tmp_path / "g.npz")
