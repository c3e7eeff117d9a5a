"""The network that chooses among frontiers, as a policy of Stable-Baselines3.

Every candidate is scored by the same weights, so their number K may vary: features and crop of a candidate
pass a small perceptron, candidates attend to one another (Vaswani et al. 2017; masked rows are left out), and
the score is made of a candidate's own vector and the mean and the largest of all. The value is made of the
pooled vectors. :mod:`slamgym.agents.scoring` runs the same network with numpy alone.

An untrained network is the rule ``tour``, and learning continues from there (residual policy learning, Silver et al.
2018).
"""

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn
from torch.nn.functional import scaled_dot_product_attention

from slamgym.agents.scoring import CROP_UNITS, HEADS, WIDTH
from slamgym.envs.frontier_features import CANDIDATE_FEATURES, CROP_PX, GLOBAL_FEATURES

MASKED = -1e8
"""Score of a row without candidate; finite, so that a row of nothing but these has a softmax."""
_PRIOR_WEIGHT = -5.0
"""The score begins as the detour of the tour that begins with a candidate, times this."""


class FrontierNetwork(nn.Module):
    """Scores candidates and values the situation."""

    def __init__(self) -> None:
        super().__init__()
        features = len(CANDIDATE_FEATURES)
        num_globals = len(GLOBAL_FEATURES)
        width = WIDTH
        self.crop = nn.Linear(2 * CROP_PX * CROP_PX, CROP_UNITS)
        self.embed_in = nn.Linear(features + CROP_UNITS + num_globals, width)
        self.embed_out = nn.Linear(width, width)
        self.query_key_value = nn.Linear(width, 3 * width)
        self.attended = nn.Linear(width, width)
        self.norm = nn.LayerNorm(width)
        self.score_in = nn.Linear(3 * width, width)
        self.score_out = nn.Linear(width, 1)
        self.prior = nn.Linear(features, 1, bias=False)
        self.value_in = nn.Linear(2 * width + num_globals, width)
        self.value_out = nn.Linear(width, 1)
        nn.init.zeros_(self.score_out.weight)
        nn.init.zeros_(self.score_out.bias)
        nn.init.zeros_(self.prior.weight)
        with torch.no_grad():
            self.prior.weight[0, CANDIDATE_FEATURES.index("tour_detour")] = _PRIOR_WEIGHT

    def forward(self, observation: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Scores (B, K) and values (B,) of a batch of observations."""
        features = observation["candidates"]
        overall = observation["globals"]
        mask = observation["mask"] > 0.5
        crops = torch.relu(self.crop(observation["crops"].flatten(2)))
        joined = torch.cat([features, crops, _repeated(overall, mask)], dim=2)
        vectors = torch.relu(self.embed_in(joined))
        vectors = torch.relu(self.embed_out(vectors))
        vectors = self.norm(vectors + self._attend(vectors, mask))
        pooled = _pooled(vectors, mask)
        own = torch.cat([vectors, _repeated(pooled, mask)], dim=2)
        scores = self.score_out(torch.relu(self.score_in(own))) + self.prior(features)
        situation = torch.cat([pooled, overall], dim=1)
        values = self.value_out(torch.relu(self.value_in(situation)))
        return scores[:, :, 0].masked_fill(~mask, MASKED), values[:, 0]

    def _attend(self, vectors: Tensor, mask: Tensor) -> Tensor:
        batch, count, width = vectors.shape
        parts = self.query_key_value(vectors).view(batch, count, 3, HEADS, width // HEADS)
        query, key, value = parts.permute(2, 0, 3, 1, 4)  # each (B, HEADS, K, width / HEADS)
        bias = torch.where(mask, 0.0, MASKED)[:, None, None]
        attended = scaled_dot_product_attention(query, key, value, bias)
        return self.attended(attended.transpose(1, 2).reshape(batch, count, width))


def _repeated(values: Tensor, mask: Tensor) -> Tensor:
    """Values of each situation, shape (B, n), for each of its candidates, shape (B, K, n)."""
    return values[:, None].expand(-1, mask.shape[1], -1)


def _pooled(vectors: Tensor, mask: Tensor) -> Tensor:
    """The mean and the largest of the candidates' vectors, shape (B, 2 width)."""
    there = mask[:, :, None]
    count = there.sum(dim=1).clamp(min=1)
    mean = (vectors * there).sum(dim=1) / count
    masked = torch.where(there, vectors, torch.full_like(vectors, -1e3))
    largest = masked.amax(dim=1).clamp(min=-1e2)
    return torch.cat([mean, largest], dim=1)


class _NetworkExtractor(BaseFeaturesExtractor):
    """The whole network in the place of a features extractor: scores and value in one vector (B, K + 1)."""

    def __init__(self, observation_space: spaces.Dict) -> None:
        count = int(observation_space["candidates"].shape[0])  # type: ignore[index]
        super().__init__(observation_space, count + 1)
        self.network = FrontierNetwork()

    def forward(self, observation: dict[str, Tensor]) -> Tensor:
        scores, values = self.network(observation)
        return torch.cat([scores, values[:, None]], dim=1)


class _Split(nn.Module):
    """Takes the place of the perceptrons that Stable-Baselines3 puts between extractor and heads."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self.latent_dim_pi = count
        self.latent_dim_vf = 1

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Tensor) -> Tensor:
        return features[:, :-1]

    def forward_critic(self, features: Tensor) -> Tensor:
        return features[:, -1:]


class FrontierPolicy(ActorCriticPolicy):
    """For ``PPO`` on ``slamgym/ExploreFrontiers-v2``: the network masks its scores itself."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        kwargs |= {"features_extractor_class": _NetworkExtractor, "ortho_init": False}
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _Split(self.features_dim - 1)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = nn.Identity()
        self.value_net = nn.Identity()
        self.optimizer = self.optimizer_class(
            self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs
        )
