"""Decisions with what each of their candidates costs, and how a network is fitted to them.

Two losses are added. The expected regret of a policy that draws its choice by the scores is what is to be small, and
falls only by what changes choices; a robust regression of all costs (Huber, "Robust estimation of a location
parameter", 1964) teaches faster, since every candidate has its say.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import huber_loss

from slamgym.core.errors import InputFileError
from slamgym.core.files import staged
from slamgym.core.progress import say
from slamgym.core.streams import DAMAGED_ZIP
from slamgym.core.types import ByteArray, Float32Array, FloatArray, IntArray, Observation

LARGEST_REGRET = 20.0
"""Costs count up to so much more than the least [m]: what lies beyond, such as what no path leads to, is as bad."""

_REGRESSION_WEIGHT = 0.3
_NEAR_BEST = 5.0  # a candidate that costs so much more counts 1/e in the regression [m]
_ROBUST = 2.0  # larger errors of the regression count linearly [m]
_BATCH = 256
_RATE = 1e-3
_HELD = 10  # every so many-th exploration is held out


class ChoiceCosts:
    """Decisions: what was observed, what each candidate costs, and what the rest of the episode brought."""

    def __init__(self) -> None:
        self.candidates: list[Float32Array] = []  # (N, features) each
        self.crops: list[ByteArray] = []  # (N, 2, crop, crop) each, in parts of 255
        self.overall: list[Float32Array] = []  # (features,) each
        self.regrets: list[Float32Array] = []  # (N,) each, above the least cost [m]
        self.returns: list[float] = []  # nan where the episode was cut off
        self.episodes: list[int] = []

    def __len__(self) -> int:
        return len(self.regrets)

    def add(self, observation: Observation, costs: FloatArray) -> None:
        """Add a decision of the running episode, with the costs of its candidates, shape (N,) [m]."""
        count = len(costs)
        self.candidates.append(observation["candidates"][:count].copy())
        self.crops.append(np.round(255.0 * observation["crops"][:count]).astype(np.uint8))
        self.overall.append(observation["globals"].copy())
        self.regrets.append(np.minimum(costs - costs.min(), LARGEST_REGRET).astype(np.float32))

    def end_episode(
        self, steps: Sequence[tuple[float, float]], asked: Sequence[int], discount: float, is_whole: bool
    ) -> None:
        """Add the returns of an episode.

        Args:
            steps: Reward and duration [s] of each.
            asked: Those whose decisions were added.
            discount: Per second.
            is_whole: Whether it wasn't cut off.
        """
        following, returns = 0.0, []
        for reward, duration in reversed(steps):
            following = reward + discount**duration * following
            returns.append(following if is_whole else math.nan)
        self.returns += [returns[len(steps) - 1 - index] for index in asked]
        self.episodes += [self.episodes[-1] + 1 if self.episodes else 0] * len(asked)

    def extend(self, others: "ChoiceCosts") -> None:
        """Add the decisions of others, as later episodes."""
        first = self.episodes[-1] + 1 if self.episodes else 0
        self.episodes += [first + episode for episode in others.episodes]
        for name in ("candidates", "crops", "overall", "regrets", "returns"):
            getattr(self, name).extend(getattr(others, name))

    def batch(self, indices: IntArray) -> tuple[dict[str, Tensor], Tensor]:
        """Observations (B, N) and regrets (B, N) of some decisions; N is the most candidates of them."""
        regrets = [self.regrets[i] for i in indices]
        most = max(len(one) for one in regrets)
        tensors = {
            "candidates": _stacked([self.candidates[i] for i in indices], most),
            "crops": _stacked([self.crops[i] for i in indices], most).float() / 255.0,
            "globals": torch.from_numpy(np.stack([self.overall[i] for i in indices])),
            "mask": _stacked([np.ones(len(one), np.float32) for one in regrets], most),
        }
        return tensors, _stacked(regrets, most)

    def write(self, path: Path) -> None:
        """Write them to a file."""
        counts = [len(one) for one in self.regrets]
        with staged(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file,
                counts=np.array(counts, np.int64),
                candidates=np.concatenate(self.candidates),
                crops=np.concatenate(self.crops),
                overall=np.stack(self.overall),
                regrets=np.concatenate(self.regrets),
                returns=np.array(self.returns),
                episodes=np.array(self.episodes, np.int64),
            )

    @staticmethod
    def read(path: Path) -> "ChoiceCosts":
        """Read what :meth:`write` wrote.

        Raises:
            InputFileError: If the file is damaged.
        """
        found = ChoiceCosts()
        try:
            with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                ends = np.cumsum(file["counts"])[:-1]
                for name in ("candidates", "crops", "regrets"):
                    setattr(found, name, np.split(file[name], ends))
                found.overall = list(file["overall"])
                found.returns, found.episodes = file["returns"].tolist(), file["episodes"].tolist()
        except (OSError, *DAMAGED_ZIP) as error:
            raise InputFileError(path, f"is damaged ({error}); delete it to collect it again") from None
        return found


def fit_choices(network: Any, known: ChoiceCosts, epochs: int, seed: int) -> None:
    """Fit the scores of a network.

    The rate falls to nothing (Smith and Topin, "Super-convergence", 2019), so the last weights are kept: which epoch
    did best on the few explorations that are held out is chance.

    Args:
        network: Is changed.
        known: Decisions.
        epochs: Passes over them.
        seed: Of their order.
    """
    is_held = np.array(known.episodes) % _HELD == _HELD - 1
    rest, held = np.flatnonzero(~is_held), np.flatnonzero(is_held)
    before = mean_regret(network, known, held)
    optimiser = torch.optim.Adam(network.parameters(), lr=_RATE)
    total = max(1, epochs * math.ceil(len(rest) / _BATCH))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, _RATE, total_steps=total, pct_start=0.1)
    for epoch in range(epochs):
        for indices in _batches(rest, known, np.random.default_rng([seed, epoch])):
            observations, regrets = known.batch(indices)
            scores, _ = network(observations)
            loss = choice_loss(scores, regrets, observations["mask"])
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            schedule.step()
    after = mean_regret(network, known, held)
    say(
        f"imitation: {len(known)} decisions; on those held out a choice costs {after:.2f} m too much, "
        f"before {before:.2f}"
    )


def fit_value(network: Any, known: ChoiceCosts, seed: int, epochs: int = 10) -> None:
    """Fit the head of the value to the returns; what it shares with the scores stays as it is."""
    indices = np.flatnonzero(np.isfinite(known.returns))
    head = [*network.value_in.parameters(), *network.value_out.parameters()]
    optimiser = torch.optim.Adam(head, lr=_RATE)
    for epoch in range(epochs):
        for batch in _batches(indices, known, np.random.default_rng([seed, epoch])):
            _, values = network(known.batch(batch)[0])
            loss = ((values - torch.tensor([known.returns[i] for i in batch])) ** 2).mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()


def choice_loss(scores: Tensor, regrets: Tensor, mask: Tensor) -> Tensor:
    """Expected regret of a draw by the scores, and the error of the scores as costs [m].

    Args:
        scores: Shape (B, N).
        regrets: Shape (B, N) [m].
        mask: 1 for candidates, shape (B, N).
    """
    expected = (scores.softmax(dim=1) * regrets).sum(dim=1)
    weights = mask * torch.exp(-regrets / _NEAR_BEST)
    weights = weights / weights.sum(dim=1, keepdim=True)
    costs = torch.where(mask > 0.5, -scores, torch.zeros_like(scores))
    # Only differences between candidates count.
    costs = costs - (weights * costs).sum(dim=1, keepdim=True)
    wanted = regrets - (weights * regrets).sum(dim=1, keepdim=True)
    errors = (weights * huber_loss(costs, wanted, reduction="none", delta=_ROBUST)).sum(dim=1)
    return (expected + _REGRESSION_WEIGHT * errors).mean()


def mean_regret(network: Any, known: ChoiceCosts, indices: IntArray) -> float:
    """What the choices of a network cost more than the best in the mean [m]; 0 for no decisions."""
    regrets: list[float] = []
    for batch in np.array_split(indices, math.ceil(len(indices) / _BATCH)) if len(indices) else []:
        observations, costs = known.batch(batch)
        with torch.no_grad():
            scores, _ = network(observations)
        regrets += costs[torch.arange(len(batch)), scores.argmax(dim=1)].tolist()
    return float(np.mean(regrets)) if regrets else 0.0


def _batches(indices: IntArray, known: ChoiceCosts, rng: np.random.Generator) -> list[IntArray]:
    """Random batches of decisions with about as many candidates each, which spares computing empty rows."""
    shuffled = rng.permutation(indices)
    counts = np.array([len(known.regrets[i]) for i in shuffled])
    ordered = shuffled[np.argsort(counts, kind="stable")]
    batches = np.split(ordered, range(_BATCH, len(ordered), _BATCH))
    return [batches[i] for i in rng.permutation(len(batches)) if len(batches[i])]


def _stacked(arrays: Sequence[Any], most: int) -> Tensor:
    """Arrays of up to ``most`` rows as one, the missing rows 0."""
    stacked = np.zeros((len(arrays), most, *arrays[0].shape[1:]), arrays[0].dtype)
    for index, array in enumerate(arrays):
        stacked[index, : len(array)] = array
    return torch.from_numpy(stacked)
