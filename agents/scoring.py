"""The network that chooses among frontiers, with numpy alone; :mod:`slamgym.agents.rl.policy` trains it.

The robot and every frontier are a token. Tokens attend to one another (Vaswani et al. 2017), with the path lengths
between them as a bias of the attention's logits. Each frontier's score comes out of its token, and how much speaks for
*done* out of the robot's.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.portable import exp, product
from slamgym.core.types import Float32Array
from slamgym.envs.frontier_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, LIMIT

WIDTH = 64
"""Units of a token."""
HEADS = 4
"""Heads of an attention."""
ATTENTION_BLOCKS = 2
"""Attentions, each followed by a perceptron."""
NEARNESS_LENGTH = 0.3
"""The nearness of two tokens falls to a third over such a length [10 m]."""
_INPUTS = len(CANDIDATE_FEATURES)
_OVERALL = len(GLOBAL_FEATURES)
LINEAR_LAYERS: dict[str, tuple[int, int]] = {
    "frontier": (_INPUTS + _OVERALL, WIDTH),
    "robot": (_OVERALL, WIDTH),
    "length_bias": (3, ATTENTION_BLOCKS * HEADS),
    **{
        f"blocks.{block}.{name}": size
        for block in range(ATTENTION_BLOCKS)
        for name, size in {
            "query_key_value": (WIDTH, 3 * WIDTH),
            "attended": (WIDTH, WIDTH),
            "wide": (WIDTH, 2 * WIDTH),
            "narrow": (2 * WIDTH, WIDTH),
        }.items()
    },
    "score": (WIDTH, 1),
    "direct": (_INPUTS, 1),
    "done": (WIDTH, 1),
}
"""Inputs and outputs of the linear layers."""
NORMS = (
    *(
        f"blocks.{block}.{name}"
        for block in range(ATTENTION_BLOCKS)
        for name in ("before", "between")
    ),
    "after",
)
"""Normalisations of tokens."""


class FrontierScores(NamedTuple):
    """What the network says of a decision."""

    scores: Float32Array  # of the frontiers, shape (N,); the highest is the best
    done: float  # log-odds that nothing is worth a visit any more


class FrontierScorer:
    """Scores frontiers.

    Args:
        weights: By the names of the network's parameters.
    """

    def __init__(self, weights: Mapping[str, Float32Array]) -> None:
        # Transposed once: products of contiguous arrays are the fast ones.
        self._weights = {
            name: np.ascontiguousarray(value.T, np.float32) for name, value in weights.items()
        }

    def decide(self, observation: Mapping[str, Any]) -> FrontierScores:
        """Scores of the N frontiers that the mask shows, and log-odds of *done*.

        Args:
            observation: Unbatched, of ``slamgym/ExploreFrontiers`` with any K.
        """
        count = int((observation["mask"] > 0.5).sum())
        features = observation["frontiers"][:count]
        overall = np.asarray(observation["globals"])
        repeated = np.broadcast_to(overall, (count, len(overall)))
        frontiers = self._linear("frontier", np.concatenate([features, repeated], axis=1))
        tokens = np.concatenate([self._linear("robot", overall[np.newaxis]), frontiers])
        bias = self._linear(
            "length_bias", length_figures(observation["lengths"][: count + 1, : count + 1])
        )
        for block in range(ATTENTION_BLOCKS):
            name = f"blocks.{block}"
            heads = bias[:, :, HEADS * block : HEADS * (block + 1)]
            tokens = tokens + self._attend(name, self._normalise(f"{name}.before", tokens), heads)
            wide = _relu(self._linear(f"{name}.wide", self._normalise(f"{name}.between", tokens)))
            tokens = tokens + self._linear(f"{name}.narrow", wide)
        tokens = self._normalise("after", tokens)
        scores = self._linear("score", tokens[1:]) + self._linear("direct", features)
        return FrontierScores(scores[:, 0], float(self._linear("done", tokens[:1])[0, 0]))

    def _linear(self, name: str, values: Float32Array) -> Float32Array:
        weight = self._weights[f"{name}.weight"]
        flat = values.reshape(-1, values.shape[-1])
        out = product(flat, weight) + self._weights[f"{name}.bias"]
        return out.reshape(*values.shape[:-1], -1)

    def _attend(self, name: str, tokens: Float32Array, bias: Float32Array) -> Float32Array:
        """Attend with a bias of shape (N, N, heads)."""
        units = WIDTH // HEADS
        parts = self._linear(f"{name}.query_key_value", tokens)
        parts = parts.reshape(len(tokens), 3, HEADS, units)
        attended = []
        for head in range(HEADS):
            query, key, value = np.ascontiguousarray(parts[:, :, head].transpose(1, 0, 2))
            weights = product(query, key.T) / np.sqrt(np.float32(units)) + bias[:, :, head]
            weights = exp(weights - weights.max(axis=1, keepdims=True))
            weights = weights / weights.sum(axis=1, keepdims=True)
            attended.append(product(weights, value))
        return self._linear(f"{name}.attended", np.concatenate(attended, axis=1))

    def _normalise(self, name: str, tokens: Float32Array) -> Float32Array:
        centred = tokens - tokens.mean(axis=1, keepdims=True)
        variance = (centred**2).mean(axis=1, keepdims=True)
        scale = np.sqrt(variance + np.float32(1e-5))
        normalised = centred / scale * self._weights[f"{name}.weight"]
        return (normalised + self._weights[f"{name}.bias"]).astype(np.float32)


def length_figures(lengths: Float32Array) -> Float32Array:
    """What a bias is made of: length, nearness, and whether no path leads there; shape (N, N, 3)."""
    nearness = exp(-lengths / np.float32(NEARNESS_LENGTH))
    is_apart = (lengths >= LIMIT).astype(np.float32)
    return np.stack([lengths, nearness, is_apart], axis=-1).astype(np.float32)


def _relu(values: Float32Array) -> Float32Array:
    return np.maximum(values, np.float32(0.0))
