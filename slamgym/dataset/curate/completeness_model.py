"""A classifier of completeness: Extra Trees on the fifteen features, as in the paper.

What the trees learned is six arrays, stored as an npz file and read without executing anything: no pickle, and no
scikit-learn to use them. The pretrained model was trained by ``benchmarks/dataset/completeness.py``.
"""

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.documents import load_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes
from slamgym.core.provenance import check_origin
from slamgym.core.streams import DAMAGED_ZIP
from slamgym.core.types import FloatArray, IntArray
from slamgym.dataset.curate.completeness import FEATURES

PRETRAINED_MODEL = Path(__file__).parent / "pretrained" / "completeness.npz"
MAX_MODEL_BYTES = 64_000_000
"""Larger files are refused: the pretrained model has a hundredth of it."""
LEAF = -1
"""Feature index of a leaf."""
_ARRAYS = {"feature": np.int64, "threshold": np.float64, "left": np.int64, "right": np.int64}
_ARRAYS |= {"value": np.float64, "roots": np.int64}


@dataclass(frozen=True)
class CompletenessModel:
    """Predicts from the features of a map how probable it is that the map is complete.

    The trees are one list of nodes. A sample goes to the left child if its feature is at most the threshold, else to
    the right one. Children stand behind their parent, so every path down ends.
    """

    feature: IntArray  # (nodes,) index of the feature that a node asks for, LEAF at a leaf
    threshold: FloatArray  # (nodes,)
    left: IntArray  # (nodes,)
    right: IntArray  # (nodes,)
    value: FloatArray  # (nodes,) share of complete maps among the training samples of a leaf
    roots: IntArray  # (trees,)
    about: dict[str, Any] = field(default_factory=dict)
    """Where it comes from: criteria, number of maps, version."""

    def probabilities(self, features: FloatArray) -> FloatArray:
        """Probability of being complete, shape (N,), for features of shape (N, 15): the mean over the trees."""
        if len(features) == 0:
            return np.zeros(0)
        # scikit-learn grows its trees on single precision; thresholds are double.
        values = np.asarray(features, dtype=np.float32).reshape(-1, len(FEATURES))
        node = np.tile(self.roots, (len(values), 1))  # (N, trees)
        sample = np.arange(len(values))[:, None]
        inner = self.feature[node] != LEAF
        while inner.any():
            goes_left = values[sample, self.feature[node]] <= self.threshold[node]
            node = np.where(inner, np.where(goes_left, self.left[node], self.right[node]), node)
            inner = self.feature[node] != LEAF
        return self.value[node].mean(axis=1)

    @classmethod
    def read(cls, path: Path | str = PRETRAINED_MODEL) -> "CompletenessModel":
        """Read a model; nothing in the file is executed.

        Raises:
            InputFileError: If the file is missing, too large, no model, one of other features, or broken.
        """
        try:
            # From memory: where np.load fails it would leave a file open.
            content = io.BytesIO(read_bytes(path))
            with zipfile.ZipFile(content) as archive:
                expanded = sum(entry.file_size for entry in archive.infolist())
            if expanded > MAX_MODEL_BYTES:
                what = f"is larger than {MAX_MODEL_BYTES / 1e6:.0f} MB; it is no model of ours"
                raise InputFileError(path, what)
            check_origin(path)
            with np.load(content, allow_pickle=False) as file:
                arrays = {name: np.asarray(file[name]) for name in (*_ARRAYS, "about")}
            about = load_json(arrays.pop("about").tobytes())
        except (OSError, *DAMAGED_ZIP) as error:
            raise InputFileError(path, f"can't be read as a model of completeness ({error})") from error
        if not isinstance(about, dict) or not _are_trees(arrays):
            raise InputFileError(
                path, "is no model of completeness; take the one of the package, or train it again"
            )
        if about.get("features") != list(FEATURES) or arrays["feature"].max() >= len(FEATURES):
            raise InputFileError(path, "was trained on other features; train it again with this version")
        nodes: dict[str, Any] = {name: arrays[name].astype(kind) for name, kind in _ARRAYS.items()}
        return cls(**nodes, about=about)


def _are_trees(arrays: Mapping[str, np.ndarray]) -> bool:
    """True if the arrays of a file make trees."""
    kinds = (np.dtype(kind).kind for kind in _ARRAYS.values())
    if any(
        arrays[name].ndim != 1 or arrays[name].dtype.kind != kind
        for name, kind in zip(_ARRAYS, kinds, strict=True)
    ):
        return False
    feature, value, roots, nodes = arrays["feature"], arrays["value"], arrays["roots"], len(arrays["feature"])
    if not len(roots) or any(len(arrays[name]) != nodes for name in ("threshold", "left", "right", "value")):
        return False
    inner = np.flatnonzero(feature != LEAF)
    children = [arrays[side][inner] for side in ("left", "right")]
    return bool(
        feature.min() >= LEAF
        and 0 <= roots.min() <= roots.max() < nodes
        and all(((child > inner) & (child < nodes)).all() for child in children)  # behind their parents
        and ((value >= 0.0) & (value <= 1.0)).all()
        and np.isfinite(arrays["threshold"]).all()
    )
