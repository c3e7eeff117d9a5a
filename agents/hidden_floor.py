"""Floor that frontiers hide, predicted from the map and from what the scans met there.

Many frontiers hide nothing: patches of wall that return no beam, slivers behind posts, noise. A small network tells
them from doors by figures of the frontier and of the unknown behind it, and by what became of the beams that were sent
there: lost without return, passed beyond it, or met something there, and from how near.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgym.agents.pretrained_policy import linear_shapes, read_weights
from slamgym.core.errors import InputFileError
from slamgym.core.portable import exp, product
from slamgym.core.types import Float32Array, FloatArray
from slamgym.envs.frontier_table import FRONTIER_FIGURES

HIDDEN_FLOOR = Path(__file__).parent / "pretrained" / "hidden_floor.safetensors"
"""The network that comes with the package."""
AREAS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""The network says how probable it is that a frontier hides at least so much floor [m2]."""
FLOOR_LAYERS = {"first": (len(FRONTIER_FIGURES), 64), "second": (64, 32), "out": (32, len(AREAS))}
"""Layers of the network: inputs and outputs."""
DESCRIPTION = ({"env": "hidden floor", "figures": list(FRONTIER_FIGURES)}, {"areas": list(AREAS)})
"""What the weights take in, and what they say."""


@dataclass(frozen=True)
class HiddenFloor:
    """The network, without torch."""

    weights: Mapping[str, Float32Array]
    """Arrays of the layers (:data:`FLOOR_LAYERS`)."""
    risk: float
    """Share of what a promise risks that what is passed over may take, calibrated on other plans."""

    @staticmethod
    def read(path: Path | str = HIDDEN_FLOOR) -> "HiddenFloor":
        """Read a file.

        Raises:
            InputFileError: If it is missing, damaged, or made for other figures.
        """
        shapes = linear_shapes(FLOOR_LAYERS)
        weights, about = read_weights(Path(path), "predictor of hidden floor", DESCRIPTION, shapes)
        risk = about.get("risk") if isinstance(about, dict) else None
        if not isinstance(risk, float) or not 0.0 < risk <= 1.0:
            raise InputFileError(
                Path(path), "doesn't say what share of a risk it may take; train it again"
            )
        return HiddenFloor(weights, risk)

    def chances(self, values: Float32Array) -> FloatArray:
        """Probabilities that frontiers of some figures (N, figures) hide at least :data:`AREAS`, shape (N, areas)."""
        for name in ("first", "second"):
            values = np.maximum(self._linear(name, values), np.float32(0.0))
        logits = self._linear("out", values).astype(np.float64)
        return 1.0 / (1.0 + exp(-logits))

    def _linear(self, name: str, values: Float32Array) -> Float32Array:
        weight = self.weights[f"{name}.weight"]
        return product(values, weight.T) + self.weights[f"{name}.bias"]


def moments(chances: FloatArray, most: float) -> FloatArray:
    """Mean and mean square of what frontiers hide, up to ``most`` [m2] each, shape (2, N) [m2, m4]."""
    # The integrals of the chance to hide more than x, and of 2x times that; between two areas it is their mean.
    ends = np.minimum((0.0, *AREAS, math.inf), most)
    widths = np.diff([ends, ends**2])
    below = np.hstack([chances[:, :1], chances])
    above = np.hstack([chances, chances[:, -1:]])
    between = 0.5 * (below + above)
    return np.cumsum(between * widths[:, None], axis=2)[..., -1]
