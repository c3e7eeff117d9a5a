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
        crops = _relu(self._linear("crop", observation["crops"][there].reshape(len(features), -1)))
        overall = np.broadcast_to(
            observation["globals"], (len(features), len(observation["globals"]))
        )
        vectors = _relu(
            self._linear("embed_in", np.concatenate([features, crops, overall], axis=1))
        )
        vectors = _relu(self._linear("embed_out", vectors))
        vectors = self._normalise(vectors + self._attend(vectors))
        pooled = np.concatenate([vectors.mean(axis=0), vectors.max(axis=0)])
        own = np.concatenate(
            [vectors, np.broadcast_to(pooled, (len(features), len(pooled)))], axis=1
        )
        learned = self._linear("score_out", _relu(self._linear("score_in", own)))
        return (learned + product(features, self._weights["prior.weight"]))[:, 0]

    def _linear(self, name: str, values: Float32Array) -> Float32Array:
        return product(values, self._weights[f"{name}.weight"]) + self._weights[f"{name}.bias"]

    def _attend(self, vectors: Float32Array) -> Float32Array:
        count = len(vectors)
        parts = self._linear("query_key_value", vectors).reshape(count, 3, HEADS, WIDTH // HEADS)
        attended = []
        for query, key, value in parts.transpose(
            2, 1, 0, 3
        ):  # of each head, (N, width / heads) each
            weights = product(query, key.T) / np.sqrt(np.float32(WIDTH // HEADS))
            weights = exp(weights - weights.max(axis=1, keepdims=True))
            attended.append(product(weights / weights.sum(axis=1, keepdims=True), value))
        return self._linear("attended", np.concatenate(attended, axis=1))

    def _normalise(self, vectors: Float32Array) -> Float32Array:
        centred = vectors - vectors.mean(axis=1, keepdims=True)
        scale = np.sqrt((centred**2).mean(axis=1, keepdims=True) + np.float32(1e-5))
        return (centred / scale * self._weights["norm.weight"] + self._weights["norm.bias"]).astype(
            np.float32
        )


def _relu(values: Float32Array) -> Float32Array:
    return np.maximum(values, np.float32(0.0))
