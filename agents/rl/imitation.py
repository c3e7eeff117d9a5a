"""Learn from one who knows the plan what each choice costs, before learning from rewards.

At half of the decisions the cost of every candidate is asked for (:mod:`slamgym.agents.hindsight`), and the network
learns to choose what costs least in the mean: it sees nothing but observations, so it averages over the plans that
look alike.
The policy itself drives, so that the data hold the situations that it gets itself into (AggreVaTe: Ross and Bagnell,
"Reinforcement and imitation learning via interactive no-regret learning", 2014; here every action has its cost, not
one a decision).

The loss is the expected regret of a policy that draws its choice by the scores.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from slamgym.agents.hindsight import HindsightCosts
from slamgym.agents.rl.environments import make_env
from slamgym.agents.rl.train_config import FURNISHED, TrainConfig
from slamgym.cad import FloorPlan
from slamgym.core.progress import say, show_progress
from slamgym.core.types import ByteArray, Float32Array, FloatArray, Observation
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES

_RANDOM_SHARE = 0.1
"""So many choices are drawn at random, so that the data hold other choices than the policy's, too."""
_ASKED_SHARE = 0.5
"""So many decisions are asked about: neighbouring ones are much alike, and asking costs as much as deciding."""
_EPOCHS = 12
"""Passes over the decisions after each round."""
LARGEST_REGRET = 20.0
"""Costs count up to so much more than the least [m]: what lies beyond, such as what no path leads to, is as bad."""
_BATCH = 256
_RATE = 1e-3
_HELD = 0.1  # share of the decisions, those of the first explorations, that is held out

Answer = Callable[[Observation], int]
"""From an observation to the action that an expert would take."""


def gain_per_metre(env: ExploreFrontiersEnv) -> Answer:
    """Unknown area in sight over one metre plus the path: next best view, without privileges."""
    del env
    column = CANDIDATE_FEATURES.index("gain_per_metre")
    return lambda seen: int(np.where(seen["mask"] > 0.5, seen["candidates"][:, column], -np.inf).argmax())


def oracle(env: ExploreFrontiersEnv) -> Answer:
    """The least cost for one who knows the building. Privileged."""
    hindsight = HindsightCosts(env)
    return lambda _: int(hindsight.costs().argmin()) if len(env.loop.candidates) > 1 else 0


EXPERTS: dict[str, Callable[[ExploreFrontiersEnv], Answer]] = {
    "oracle": oracle,
    "gain_per_metre": gain_per_metre,
}
"""Who may choose where explorations are recorded, by name; each episode makes its own."""


class CostedChoice(NamedTuple):
    """A decision: what was observed, and what each candidate costs."""

    candidates: Float32Array  # (N, features)
    crops: ByteArray  # (N, 2, crop, crop), in parts of 255
    overall: Float32Array  # (features,)
    regrets: Float32Array  # (N,) above the least cost [m]

    @staticmethod
    def of(observation: Observation, costs: FloatArray) -> "CostedChoice":
        """A decision with the costs of its candidates, shape (N,) [m]."""
        count = len(costs)
        return CostedChoice(
            observation["candidates"][:count].copy(),
            np.round(255.0 * observation["crops"][:count]).astype(np.uint8),
            observation["globals"].copy(),
            np.minimum(costs - costs.min(), LARGEST_REGRET).astype(np.float32),
        )


def imitate(model: Any, config: TrainConfig, plans: Sequence[FloorPlan]) -> None:
    """Fit a policy to what choices cost.

    Args:
        model: The learner; its policy is changed. In each round it drives, at first as its prior does.
        config: The run.
        plans: Where to explore.
    """
    envs = [make_env(config, list(plans))]
    if config.furnished:
        envs.append(make_env(config, list(plans), clutter=FURNISHED))
    network, settings = model.policy.features_extractor.network, config.imitation
    known: list[CostedChoice] = []
    for number in range(settings.rounds):
        rng = np.random.default_rng([config.seed, number])
        wanted = max(len(known) + 1, settings.decisions * (number + 1) // settings.rounds)
        with show_progress("choices with their costs", len(known), wanted) as advance:
            while len(known) < wanted:
                env = envs[int(rng.random() < config.furnished) if len(envs) > 1 else 0]
                for choice in _explored(env, network, rng):
                    known.append(choice)
                    advance()
        fit_choices(network, known, _EPOCHS, config.seed)


def _explored(env: ExploreFrontiersEnv, network: Any, rng: np.random.Generator) -> list[CostedChoice]:
    """Explore a whole building by a network; half of the decisions."""
    observation, _ = env.reset(seed=int(rng.integers(2**31)))
    hindsight, found = HindsightCosts(env), []
    is_over = not env.loop.candidates
    while not is_over:
        count = len(env.loop.candidates)
        if count > 1 and rng.random() < _ASKED_SHARE:
            found.append(CostedChoice.of(observation, hindsight.costs()))
        is_random = count > 1 and rng.random() < _RANDOM_SHARE
        action = int(rng.integers(count)) if is_random else _best(network, observation)
        observation, _, terminated, truncated, _ = env.step(action)
        is_over = terminated or truncated
    return found


def _best(network: Any, observation: Observation) -> int:
    """The candidate that a network scores highest."""
    with torch.no_grad():
        scores, _ = network({key: torch.as_tensor(value)[None] for key, value in observation.items()})
    return int(scores[0].argmax())


def fit_choices(network: Any, known: Sequence[CostedChoice], epochs: int, seed: int) -> None:
    """Fit the scores of a network.

    The rate falls to nothing (Smith and Topin, "Super-convergence", 2019), so the last weights are kept: which epoch
    did best on the few explorations that are held out is chance.

    Args:
        network: Is changed.
        known: Decisions.
        epochs: Passes over them.
        seed: Of their order.
    """
    count = round(_HELD * len(known))
    held, rest = known[:count], known[count:]
    before = mean_regret(network, held)
    optimiser = torch.optim.Adam(network.parameters(), lr=_RATE)
    total = max(1, epochs * math.ceil(len(rest) / _BATCH))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, _RATE, total_steps=total, pct_start=0.1)
    for epoch in range(epochs):
        order = np.random.default_rng([seed, epoch]).permutation(len(rest))
        for first in range(0, len(rest), _BATCH):
            observations, regrets = batch([rest[i] for i in order[first : first + _BATCH]])
            scores, _ = network(observations)
            loss = (scores.softmax(dim=1) * regrets).sum(dim=1).mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            schedule.step()
    after = mean_regret(network, held)
    say(
        f"imitation: {len(known)} decisions; on those held out a choice costs {after:.2f} m too much, "
        f"before {before:.2f}"
    )


def batch(choices: Sequence[CostedChoice]) -> tuple[dict[str, Tensor], Tensor]:
    """Observations (B, N) and regrets (B, N) of some decisions; N is the most candidates of them."""
    tensors = {
        "candidates": _stacked([one.candidates for one in choices]),
        "crops": _stacked([one.crops for one in choices]).float() / 255.0,
        "globals": torch.from_numpy(np.stack([one.overall for one in choices])),
        "mask": _stacked([np.ones(len(one.regrets), np.float32) for one in choices]),
    }
    return tensors, _stacked([one.regrets for one in choices])


def mean_regret(network: Any, choices: Sequence[CostedChoice]) -> float:
    """Mean cost of the choices of a network above the best [m]; 0 for no decisions."""
    regrets: list[float] = []
    for first in range(0, len(choices), _BATCH):
        observations, costs = batch(choices[first : first + _BATCH])
        with torch.no_grad():
            scores, _ = network(observations)
        regrets += costs[torch.arange(len(costs)), scores.argmax(dim=1)].tolist()
    return float(np.mean(regrets)) if regrets else 0.0


def _stacked(arrays: Sequence[Any]) -> Tensor:
    """Arrays of some rows each as one, missing rows 0."""
    return pad_sequence([torch.from_numpy(array) for array in arrays], batch_first=True)
