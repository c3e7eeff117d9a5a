"""The network that chooses among frontiers, as a policy of Stable-Baselines3.

The actor is the network of :mod:`slamgym.agents.scoring`, which runs it with numpy alone. The critic is one of its own,
so that it may see what only training knows (:data:`slamgym.agents.rl.whole_episodes.TRUTH`).
"""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn
from torch.nn.functional import scaled_dot_product_attention

from slamgym.agents.scoring import ATTENTION_BLOCKS, HEADS, LINEAR_LAYERS, NEARNESS_LENGTH, WIDTH
from slamgym.envs.frontier_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, LIMIT

MASKED = -1e8
"""Score of a row without frontier; finite, so that a row of nothing but these has a softmax."""
TOUR_WEIGHT = -5.0
"""A network that starts from ``tour`` scores the detour of the tour that begins with a frontier, times this."""
FIRST_DONE = -5.0
"""Log-odds of *done* before training: so seldom at random that most explorations last."""
_CRITIC_UNITS = 128


def _linear(name: str) -> nn.Linear:
    return nn.Linear(*LINEAR_LAYERS[name])


class AttentionBlock(nn.Module):
    """Tokens attend to one another, biased by the paths between them; then a perceptron for each."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.before = nn.LayerNorm(WIDTH)
        self.query_key_value = _linear(f"{name}.query_key_value")
        self.attended = _linear(f"{name}.attended")
        self.between = nn.LayerNorm(WIDTH)
        self.wide = _linear(f"{name}.wide")
        self.narrow = _linear(f"{name}.narrow")

    def forward(self, tokens: Tensor, bias: Tensor) -> Tensor:
        """Tokens (B, N, width), given a bias (B, heads, N, N)."""
        batch, count, width = tokens.shape
        parts = self.query_key_value(self.before(tokens))
        parts = parts.view(batch, count, 3, HEADS, width // HEADS).permute(2, 0, 3, 1, 4)
        query, key, value = parts  # each (B, heads, N, width / heads)
        attended = scaled_dot_product_attention(query, key, value, bias)
        joined = attended.transpose(1, 2).reshape(batch, count, width)
        tokens = tokens + self.attended(joined)
        return tokens + self.narrow(torch.relu(self.wide(self.between(tokens))))


class FrontierNetwork(nn.Module):
    """Scores frontiers, and says how much speaks for *done*."""

    def __init__(self) -> None:
        super().__init__()
        self.frontier = _linear("frontier")
        self.robot = _linear("robot")
        self.length_bias = _linear("length_bias")
        self.blocks = nn.ModuleList(AttentionBlock(f"blocks.{i}") for i in range(ATTENTION_BLOCKS))
        self.after = nn.LayerNorm(WIDTH)
        self.score = _linear("score")
        self.direct = _linear("direct")
        self.done = _linear("done")
        for layer in (self.score, self.direct, self.done):
            nn.init.orthogonal_(layer.weight, 0.01)
            nn.init.zeros_(layer.bias)
        nn.init.constant_(self.done.bias, FIRST_DONE)

    def follow_the_tour(self) -> None:
        """Begin as the rule ``tour`` (residual policy learning, Silver et al. 2018)."""
        with torch.no_grad():
            self.direct.weight[0, CANDIDATE_FEATURES.index("tour_detour")] = TOUR_WEIGHT

    def forward(self, observation: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Scores (B, K) and log-odds of *done* (B,) of a batch of observations."""
        rows = observation["mask"].shape[1]
        count = _most(observation["mask"])
        features = observation["frontiers"][:, :count]
        mask = observation["mask"][:, :count] > 0.5
        overall = observation["globals"]
        repeated = overall[:, None].expand(-1, count, -1)
        frontiers = self.frontier(torch.cat([features, repeated], dim=2))
        tokens = torch.cat([self.robot(overall)[:, None], frontiers], dim=1)
        bias = self._bias(observation["lengths"][:, : count + 1, : count + 1], mask)
        for i, block in enumerate(self.blocks):
            tokens = block(tokens, bias[:, HEADS * i : HEADS * (i + 1)])
        tokens = self.after(tokens)
        scores = self.score(tokens[:, 1:]) + self.direct(features)
        scores = scores[:, :, 0].masked_fill(~mask, MASKED)
        padded = nn.functional.pad(scores, (0, rows - count), value=MASKED)
        return padded, self.done(tokens[:, 0])[:, 0]

    def _bias(self, lengths: Tensor, mask: Tensor) -> Tensor:
        """Bias of the attentions' logits, shape (B, blocks * heads, N + 1, N + 1)."""
        is_apart = (lengths >= LIMIT).float()
        figures = torch.stack([lengths, torch.exp(-lengths / NEARNESS_LENGTH), is_apart], dim=-1)
        bias = self.length_bias(figures).permute(0, 3, 1, 2)
        there = nn.functional.pad(mask, (1, 0), value=True)
        return bias.masked_fill(~there[:, None, None], MASKED)


def _most(mask: Tensor) -> int:
    """The most frontiers of a batch, at least one: what all leave empty isn't computed."""
    return max(1, int(mask.sum(dim=1).max().item()))


class FrontierCritic(nn.Module):
    """Values a situation.

    Args:
        truth: Number of figures that only training knows.
    """

    def __init__(self, truth: int) -> None:
        super().__init__()
        self.frontier = nn.Linear(len(CANDIDATE_FEATURES), WIDTH)
        self.first = nn.Linear(2 * WIDTH + len(GLOBAL_FEATURES) + truth, _CRITIC_UNITS)
        self.second = nn.Linear(_CRITIC_UNITS, _CRITIC_UNITS)
        self.out = nn.Linear(_CRITIC_UNITS, 1)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(self, observation: dict[str, Tensor]) -> Tensor:
        """Values (B,)."""
        count = _most(observation["mask"])
        there = observation["mask"][:, :count, None]
        vectors = torch.relu(self.frontier(observation["frontiers"][:, :count])) * there
        parts = [vectors.sum(dim=1) / 8.0, vectors.amax(dim=1), observation["globals"]]
        if "truth" in observation:
            parts.append(observation["truth"])
        units = torch.relu(self.first(torch.cat(parts, dim=1)))
        return self.out(torch.relu(self.second(units)))[:, 0]


class _NetworkExtractor(BaseFeaturesExtractor):
    """Both networks in the place of a features extractor: scores, *done* and value in one vector (B, K + 2)."""

    def __init__(self, observation_space: spaces.Dict) -> None:
        count = int(observation_space["mask"].shape[0])  # type: ignore[index]
        super().__init__(observation_space, count + 2)
        self.network = FrontierNetwork()
        truth = observation_space.spaces.get("truth")
        # By this name TRPO knows what isn't the actor's.
        self.value = FrontierCritic(0 if truth is None else int(np.prod(truth.shape or ())))

    def forward(self, observation: dict[str, Tensor]) -> Tensor:
        scores, done = self.network(observation)
        # So that the chance of done is the logistic of its log-odds, whatever the number of frontiers.
        done = done + torch.logsumexp(scores, dim=1)
        values = self.value(observation)
        return torch.cat([scores, done[:, None], values[:, None]], dim=1)


class _Split(nn.Module):
    """Takes the place of the perceptrons that Stable-Baselines3 puts between extractor and heads."""

    def __init__(self, actions: int) -> None:
        super().__init__()
        self.latent_dim_pi = actions
        self.latent_dim_vf = 1

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Tensor) -> Tensor:
        return features[:, : self.latent_dim_pi]

    def forward_critic(self, features: Tensor) -> Tensor:
        return features[:, -1:]


class FrontierPolicy(ActorCriticPolicy):
    """For on-policy algorithms on ``slamgym/ExploreFrontiers``: the network masks its scores itself."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        kwargs |= {"features_extractor_class": _NetworkExtractor, "ortho_init": False}
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        assert isinstance(self.action_space, spaces.Discrete)
        self.mlp_extractor = _Split(int(self.action_space.n))

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = nn.Identity()
        self.value_net = nn.Identity()
        self.optimizer = self.optimizer_class(
            self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs
        )
