"""A classifier of completeness: logistic regression on the logarithms of the five features.

The pretrained weights were fitted by ``benchmarks/dataset/completeness.py``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from slamgym.core.config import Within, from_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.portable import exp, product
from slamgym.core.provenance import check_origin
from slamgym.core.types import FloatArray
from slamgym.dataset.curate.completeness import FEATURES

PRETRAINED_MODEL = Path(__file__).parent / "pretrained" / "completeness.json"
_Weight = Annotated[float, Within(ge=-1e6, le=1e6)]
_SHARPNESS = 10.0
"""Factor before the logarithm: a tenth of a square metre, or of a metre, counts as next to nothing [1/m2, 1/m]."""


@dataclass(frozen=True)
class CompletenessModel:
    """Predicts from the features of a map how probable it is that the map is complete."""

    bias: _Weight
    weights: dict[str, _Weight]
    """Of the features, by their names, in their order."""
    about: dict[str, Any]
    """Where it comes from: coverage asked for, number of maps, version."""

    def probabilities(self, features: FloatArray) -> FloatArray:
        """Probability of being complete, shape (N,), for features of shape (N, 5); alike on every processor."""
        weights = np.array([self.bias, *self.weights.values()])
        terms = np.column_stack(
            [np.ones(len(features)), scaled(features.reshape(-1, len(FEATURES)))]
        )
        found = exp(-product(terms, weights[:, None])[:, 0])
        return np.asarray(1.0 / (1.0 + found), dtype=np.float64)

    @classmethod
    def read(cls, path: Path | str = PRETRAINED_MODEL) -> "CompletenessModel":
        """Read a model.

        Raises:
            InputFileError: If the file is missing, no model, or one of other features.
        """
        content = read_json(path)
        check_origin(path)
        try:
            model = from_dict(cls, content)
        except ConfigError as error:
            raise InputFileError(path, f"is no model of completeness ({error})") from error
        if tuple(model.weights) != FEATURES:
            raise InputFileError(
                path, "was trained on other features; train it again with this version"
            )
        return model


def scaled(features: FloatArray) -> FloatArray:
    """Logarithms to base 2 of 1 + 10 x, linear between powers of 2: that is exact, and so alike on every processor."""
    mantissa, exponent = np.frexp(1.0 + _SHARPNESS * features)
    return exponent - 2.0 + 2.0 * mantissa
