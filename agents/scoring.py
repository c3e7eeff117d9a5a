"""The network of :mod:`slamgym.agents.rl.policy` without torch: choosing doesn't wait for its start-up."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from slamgym.core.portable import exp, product
from slamgym.core.types import Float32Array

WIDTH = 64
"""Units of the vector of a candidate."""
CROP_UNITS = 32
"""Units that the crop about a candidate is reduced to."""
HEADS = 4
"""Heads of the attention."""


class FrontierScorer:
    """Scores the candidates of one observation.

    Args:
        weights: Arrays by the names of :class:`slamgym.agents.rl.policy.FrontierNetwork`'s parameters.
    """

    def __init__(self, weights: Mapping[str, Float32Array]) -> None:
        # Of layers (inputs, outputs), as products take them.
        self._weights = {
            name: np.ascontiguousarray(value.T, np.float32) for name, value in weights.items()
        }

    def scores(self, observation: Mapping[str, Any]) -> Float32Array:
        """Score of each candidate, shape (N,) for the N rows that the mask shows.

        Args:
            observation: Unbatched, of ``slamgym/ExploreFrontiers-v2`` with any K.
        """
        there = observation["mask"] > 0.5
        features = observation["candidates"][there]
        count = len(features)
        crops = observation["crops"][there].reshape(count, -1)
        crops = _relu(self._linear("crop", crops))
        joined = np.concatenate([features, crops, _repeated(observation["globals"], count)], axis=1)
        vectors = _relu(self._linear("embed_in", joined))
        vectors = _relu(self._linear("embed_out", vectors))
        vectors = self._normalise(vectors + self._attend(vectors))
        pooled = np.concatenate([vectors.mean(axis=0), vectors.max(axis=0)])
        own = np.concatenate([vectors, _repeated(pooled, count)], axis=1)
        learned = self._linear("score_out", _relu(self._linear("score_in", own)))
        prior = product(features, self._weights["prior.weight"])
        return (learned + prior)[:, 0]

    def _linear(self, name: str, values: Float32Array) -> Float32Array:
        weight = self._weights[f"{name}.weight"]
        bias = self._weights[f"{name}.bias"]
        return product(values, weight) + bias

    def _attend(self, vectors: Float32Array) -> Float32Array:
        units = WIDTH // HEADS
        parts = self._linear("query_key_value", vectors).reshape(len(vectors), 3, HEADS, units)
        attended = []
        for head in range(HEADS):
            query, key, value = parts[:, :, head].transpose(1, 0, 2)  # (N, units) each
            weights = product(query, key.T) / np.sqrt(np.float32(units))
            weights = exp(weights - weights.max(axis=1, keepdims=True))
            weights = weights / weights.sum(axis=1, keepdims=True)
            attended.append(product(weights, value))
        return self._linear("attended", np.concatenate(attended, axis=1))

    def _normalise(self, vectors: Float32Array) -> Float32Array:
        centred = vectors - vectors.mean(axis=1, keepdims=True)
        variance = (centred**2).mean(axis=1, keepdims=True)
        scale = np.sqrt(variance + np.float32(1e-5))
        normalised = centred / scale * self._weights["norm.weight"] + self._weights["norm.bias"]
        return normalised.astype(np.float32)


def _repeated(values: Float32Array, count: int) -> Float32Array:
    """The same values for each of some candidates, shape (count, values)."""
    return np.broadcast_to(values, (count, len(values)))


def _relu(values: Float32Array) -> Float32Array:
    return np.maximum(values, np.float32(0.0))
