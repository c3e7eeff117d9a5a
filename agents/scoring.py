"""The network of :mod:`slamgym.agents.rl.policy` without torch: choosing doesn't wait for its start-up."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.core.config import Count, Settings
from slamgym.core.errors import ConfigError
from slamgym.core.portable import exp, product
from slamgym.core.types import Float32Array

if TYPE_CHECKING:
    from slamgym.envs.frontier_features import ExtraFeatures


class NetworkConfig(Settings, section="network"):
    """Size of the network."""

    crop: int = 32
    """Units that the crop about a candidate is reduced to."""
    width: Count = 64
    """Units of the vector of a candidate."""
    heads: Count = 4
    """Heads of the attention."""
    prior_feature: str = "gain_per_metre"
    """The score begins as this feature times ``prior_weight``: an untrained network is the greedy rule of
    next best view, and learning goes on from there (residual policy learning, Silver et al. 2018)."""
    prior_weight: float = 16.0
    """0 begins from scratch."""
    foresight: bool = False
    """Whether it also sees what the map completed by :mod:`slamgym.agents.foresight` promises of each candidate, some
    10 ms a decision."""
    exposure_prior: float = 0.0
    """Added to the score for each 1.5 m that the path lies from walls, also on top of weights to start from: a
    negative one begins as a rule that keeps to the walls (coastal navigation, Roy et al. 1999)."""

    def _check(self) -> None:
        if self.width % self.heads:
            raise ConfigError(f"network.width {self.width} must be a multiple of network.heads {self.heads}")
        if self.prior_feature not in self.candidate_features:
            raise ConfigError(f"network.prior_feature: there is no feature {self.prior_feature!r}")

    @property
    def extra_features(self) -> "ExtraFeatures | None":
        """What it sees of each candidate beside the usual."""
        if not self.foresight:
            return None
        from slamgym.agents.foresight import FORESIGHT_FEATURES

        return FORESIGHT_FEATURES

    @property
    def candidate_features(self) -> tuple[str, ...]:
        """All that it sees of each candidate."""
        from slamgym.envs.frontier_features import CANDIDATE_FEATURES

        extra = self.extra_features
        return CANDIDATE_FEATURES + (extra.names if extra else ())


_FAR_BELOW = np.float32(-1e8)


class FrontierScorer:
    """Scores the candidates of one observation.

    Args:
        weights: Arrays by the names of :class:`slamgym.agents.rl.policy.FrontierNetwork`'s parameters.
        heads: Heads of the attention.
    """

    def __init__(self, weights: Mapping[str, Float32Array], heads: int) -> None:
        # Of layers (inputs, outputs), as products take them.
        self._weights = {name: np.ascontiguousarray(value.T, np.float32) for name, value in weights.items()}
        self._heads = heads

    def scores(self, observation: Mapping[str, Any]) -> Float32Array:
        """Score of each candidate, shape (N,) for the N rows that the mask shows.

        Args:
            observation: Unbatched, of ``slamgym/ExploreFrontiers-v1`` with any K.
        """
        there = observation["mask"] > 0.5
        features = observation["candidates"][there]
        crops = _relu(self._linear("crop", observation["crops"][there].reshape(len(features), -1)))
        overall = np.broadcast_to(observation["globals"], (len(features), len(observation["globals"])))
        vectors = _relu(self._linear("embed_in", np.concatenate([features, crops, overall], axis=1)))
        vectors = _relu(self._linear("embed_out", vectors))
        vectors = self._normalise(vectors + self._attend(vectors))
        pooled = np.concatenate([vectors.mean(axis=0), vectors.max(axis=0)])
        own = np.concatenate([vectors, np.broadcast_to(pooled, (len(features), len(pooled)))], axis=1)
        learned = self._linear("score_out", _relu(self._linear("score_in", own)))
        scores: Float32Array = (learned + product(features, self._weights["prior.weight"]))[:, 0]
        return scores

    def choose(self, observation: Mapping[str, Any]) -> int:
        """The candidate with the highest score; 0 where there is none."""
        if not (observation["mask"] > 0.5).any():
            return 0
        scores = np.full(len(observation["mask"]), _FAR_BELOW)
        scores[observation["mask"] > 0.5] = self.scores(observation)
        return int(scores.argmax())

    def _linear(self, name: str, values: Float32Array) -> Float32Array:
        return product(values, self._weights[f"{name}.weight"]) + self._weights[f"{name}.bias"]

    def _attend(self, vectors: Float32Array) -> Float32Array:
        count, width = vectors.shape
        parts = self._linear("query_key_value", vectors).reshape(count, 3, self._heads, width // self._heads)
        attended = []
        for query, key, value in parts.transpose(2, 1, 0, 3):  # of each head, (N, width / heads) each
            weights = product(query, key.T) / np.sqrt(np.float32(width // self._heads))
            weights = exp(weights - weights.max(axis=1, keepdims=True))
            attended.append(product(weights / weights.sum(axis=1, keepdims=True), value))
        return self._linear("attended", np.concatenate(attended, axis=1))

    def _normalise(self, vectors: Float32Array) -> Float32Array:
        centred = vectors - vectors.mean(axis=1, keepdims=True)
        scale = np.sqrt((centred**2).mean(axis=1, keepdims=True) + np.float32(1e-5))
        normalised: Float32Array = (
            centred / scale * self._weights["norm.weight"] + self._weights["norm.bias"]
        ).astype(np.float32)
        return normalised


def _relu(values: Float32Array) -> Float32Array:
    return np.maximum(values, np.float32(0.0))
