"""An ensemble of decision trees as plain arrays: no pickle, and no scikit-learn to use it.

scikit-learn grows the trees (:mod:`slamgym.dataset.curate.completeness_model`); what they learned is five arrays,
which are stored as an npz file and read without executing anything.
"""

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.compression import DAMAGED_ZIP
from slamgym.core.documents import load_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes, write_bytes
from slamgym.core.provenance import check_origin
from slamgym.core.types import FloatArray, IntArray

MAX_FILE_BYTES = 64_000_000
"""Larger files are refused: the pretrained model has a hundredth of it."""
LEAF = -1
"""Feature index of a leaf."""
_ARRAYS = {"feature": np.int64, "threshold": np.float64, "left": np.int64, "right": np.int64}
_ARRAYS |= {"value": np.float64, "roots": np.int64}


@dataclass(frozen=True)
class Forest:
    """Trees in one list of nodes.

    A sample goes to the left child if its feature is at most the threshold, else to the right one. Children
    stand behind their parent, so every path down ends.
    """

    feature: IntArray  # (nodes,) index of the feature that a node asks for, LEAF at a leaf
    threshold: FloatArray  # (nodes,)
    left: IntArray  # (nodes,)
    right: IntArray  # (nodes,)
    value: FloatArray  # (nodes,) share of the positive class among the training samples of a leaf
    roots: IntArray  # (trees,)

    def predict(self, samples: FloatArray) -> FloatArray:
        """Probability of the positive class: the mean of the leaves' shares over the trees.

        Args:
            samples: (N, features).

        Returns:
            (N,), in [0, 1].
        """
        if len(samples) == 0:
            return np.zeros(0)
        # scikit-learn grows its trees on single precision; thresholds are double.
        values = np.asarray(samples, dtype=np.float32)
        node = np.tile(self.roots, (len(values), 1))  # (N, trees)
        sample = np.arange(len(values))[:, None]
        inner = self.feature[node] != LEAF
        while inner.any():
            goes_left = values[sample, self.feature[node]] <= self.threshold[node]
            node = np.where(inner, np.where(goes_left, self.left[node], self.right[node]), node)
            inner = self.feature[node] != LEAF
        mean: FloatArray = self.value[node].mean(axis=1)
        return mean


def write_forest(path: Path | str, forest: Forest, about: Mapping[str, Any]) -> None:
    """Write an npz file with the trees and a description; the same content gives the same bytes.

    Raises:
        InputFileError: If the file can't be written.
    """
    arrays: dict[str, Any] = {
        "feature": forest.feature.astype(np.int8),
        "threshold": forest.threshold,
        "left": forest.left.astype(np.int32),
        "right": forest.right.astype(np.int32),
        "value": forest.value.astype(np.float32),
        "roots": forest.roots.astype(np.int32),
        "about": np.frombuffer(json.dumps(dict(about)).encode(), dtype=np.uint8),
    }
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    write_bytes(path, content.getvalue())


def read_forest(path: Path | str) -> tuple[Forest, dict[str, Any]]:
    """Read and check what :func:`write_forest` wrote.

    Returns:
        The trees and the description.

    Raises:
        InputFileError: If the file is missing, too large, holds something else, or the trees are broken.
    """
    try:
        # From memory: where np.load fails it would leave a file open.
        content = io.BytesIO(read_bytes(path))
        with zipfile.ZipFile(content) as archive:
            expanded = sum(entry.file_size for entry in archive.infolist())
        if expanded > MAX_FILE_BYTES:
            raise InputFileError(
                path, f"is larger than {MAX_FILE_BYTES / 1e6:.0f} MB; it is no model of ours"
            )
        check_origin(path)
        with np.load(content, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in (*_ARRAYS, "about")}
        about = load_json(arrays.pop("about").tobytes())
    except (OSError, *DAMAGED_ZIP) as error:
        raise InputFileError(path, f"can't be read as a model of completeness ({error})") from error
    fault = _fault(arrays)
    if fault or not isinstance(about, dict):
        raise InputFileError(path, f"is no model of completeness ({fault or 'its description is no object'})")
    nodes: dict[str, Any] = {name: arrays[name].astype(kind) for name, kind in _ARRAYS.items()}
    return Forest(**nodes), about


def _fault(arrays: Mapping[str, np.ndarray]) -> str:
    """What is wrong with the arrays of a file; nothing if they make trees."""
    for name, kind in _ARRAYS.items():
        if arrays[name].ndim != 1 or arrays[name].dtype.kind != np.dtype(kind).kind:
            return f"{name} is not a list of numbers of its kind"
    nodes = len(arrays["feature"])
    if any(len(arrays[name]) != nodes for name in ("threshold", "left", "right", "value")):
        return "the lists of nodes differ in length"
    roots, inner = arrays["roots"], arrays["feature"] != LEAF
    if len(roots) == 0 or roots.min() < 0 or roots.max() >= nodes:
        return "the trees have no roots"
    if arrays["feature"].min() < LEAF:
        return "a node asks for no feature"
    for side in ("left", "right"):
        child = arrays[side][inner]
        if (child <= np.flatnonzero(inner)).any() or (child >= nodes).any():
            return f"a {side} child doesn't stand behind its parent"
    values = arrays["value"]
    if not (np.isfinite(values).all() and values.min() >= 0.0 and values.max() <= 1.0):
        return "a leaf holds no share"
    return "" if np.isfinite(arrays["threshold"]).all() else "a threshold is not a number"
