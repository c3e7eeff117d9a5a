"""Imitate an expert before learning from rewards: behaviour cloning (Pomerleau 1989), then DAgger.

The experts are allowed to know the truth; what is learned from them is not: the network sees nothing but
observations.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from slamgym.agents.oracle import TrueBuilding
from slamgym.agents.rl.train_config import TrainConfig
from slamgym.agents.rl.training_envs import make_env
from slamgym.cad import FloorPlan
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.core.progress import say, show_progress
from slamgym.core.types import Float32Array, Observation
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES
from slamgym.planning.frontiers import Point


class TourExpert:
    """Knows the building of one environment's running episode.

    Args:
        env: After its reset; there has to be a new expert for every episode.
    """

    def __init__(self, env: ExploreFrontiersEnv) -> None:
        self._loop = env.loop
        self._building = TrueBuilding(env.inner)

    def choose(self) -> int:
        """The index of a candidate: the path over it to the first stop of the tour is the shortest."""
        building, candidates = self._building, self._loop.candidates
        if len(candidates) < 2:
            return 0
        tour = building.planner.plan(building.unseen, building.to_world(self._loop.pose[:2]))
        if not tour:
            return 0
        from_stop = building.paths.lengths_from(building.paths.place(tour[0].point))
        lengths = [
            candidate.path_length + self._onward(from_stop, building.to_world(candidate.path[-1]))
            for candidate in candidates
        ]
        return int(np.argmin(lengths))

    def _onward(self, from_stop: Float32Array, point: Point) -> float:
        place = self._building.paths.place(point)
        return float(from_stop[place]) if place >= 0 else math.inf


_BATCH = 256
_EPOCHS = 40
_PATIENCE = 4  # epochs without a better result on what is held out

Answer = Callable[[Observation], int]
"""From an observation to the action that the expert would take."""


def gain_per_metre(env: ExploreFrontiersEnv) -> Answer:
    """Unknown area in sight over one metre plus the path: next best view, without privileges."""
    del env
    column = CANDIDATE_FEATURES.index("gain_per_metre")

    def answer(observation: Observation) -> int:
        return int(
            np.where(observation["mask"] > 0.5, observation["candidates"][:, column], -np.inf).argmax()
        )

    return answer


def oracle(env: ExploreFrontiersEnv) -> Answer:
    """The short tour of one who knows the building. Privileged."""
    expert = TourExpert(env)
    return lambda _: expert.choose()


EXPERTS: dict[str, Callable[[ExploreFrontiersEnv], Answer]] = {
    "oracle": oracle,
    "gain_per_metre": gain_per_metre,
}
"""Experts to imitate, by name; each episode makes its own."""


def imitate(model: Any, config: TrainConfig, plans: Sequence[FloorPlan]) -> None:
    """Fit a policy to an expert's choices, and its value to the returns that came of them.

    In the first round the expert drives, but one choice in ten is drawn at random. In the rounds after it the
    policy drives and the expert is asked what it would have done (DAgger: Ross, Gordon and Bagnell, AISTATS
    2011): so the data hold answers to the situations that the policy gets itself into.

    Args:
        model: The learner; its policy is changed.
        config: The run.
        plans: Where to explore.

    Raises:
        ConfigError: If there is no expert of that name.
    """
    if config.imitation.expert not in EXPERTS:
        raise ConfigError(
            f"no expert {config.imitation.expert!r} to imitate; {suggest(config.imitation.expert, EXPERTS)}"
        )
    env = make_env(config, list(plans))
    assert isinstance(env, ExploreFrontiersEnv)
    network = model.policy.features_extractor.network
    demonstrations = _Demonstrations()
    rounds = config.imitation.rounds
    for number in range(rounds):
        wanted = (config.imitation.decisions * (number + 1)) // rounds
        choose = None if number == 0 else _student(network)
        _collect(env, EXPERTS[config.imitation.expert], choose, demonstrations, wanted, config, seed=number)
        _fit(network, demonstrations, config.imitation.value_weight, config.seed)


@dataclass
class _Demonstrations:
    """What the expert was asked, what it answered, and what the rest of the episode brought."""

    observations: list[Observation] = field(default_factory=list)
    answers: list[int] = field(default_factory=list)
    returns: list[float] = field(default_factory=list)  # nan where the episode was cut off

    def __len__(self) -> int:
        return len(self.answers)

    def end_episode(self, steps: list[tuple[float, float]], discount: float, is_whole: bool) -> None:
        """Add the returns of an episode from its (reward, duration) of each step."""
        following, returns = 0.0, []
        for reward, duration in reversed(steps):
            following = reward + discount**duration * following
            returns.append(following if is_whole else math.nan)
        self.returns += reversed(returns)


def _student(network: Any) -> Answer:
    def choose(observation: Observation) -> int:
        with torch.no_grad():
            scores, _ = network({key: torch.as_tensor(value)[None] for key, value in observation.items()})
        return int(scores[0].argmax())

    return choose


def _collect(
    env: ExploreFrontiersEnv,
    expert: Callable[[ExploreFrontiersEnv], Answer],
    choose: Answer | None,
    demonstrations: _Demonstrations,
    wanted: int,
    config: TrainConfig,
    seed: int,
) -> None:
    """Explore until there are as many demonstrations as wanted; the expert drives where ``choose`` is None."""
    rng = np.random.default_rng([config.seed, seed])
    observation, _ = env.reset(seed=int(rng.integers(2**31)))
    ask, steps = expert(env), []
    with show_progress("decisions of the expert", len(demonstrations), wanted) as advance:
        while len(demonstrations) < wanted:
            answer = ask(observation)
            demonstrations.observations.append(observation)
            demonstrations.answers.append(answer)
            advance()
            action = choose(observation) if choose else answer
            if choose is None and rng.random() < 0.1:
                action = int(rng.choice(np.flatnonzero(env.action_masks())))
            observation, reward, terminated, truncated, info = env.step(action)
            steps.append((float(reward), float(info["duration"])))
            if terminated or truncated:
                demonstrations.end_episode(steps, config.discount, is_whole=terminated)
                observation, _ = env.reset()
                ask, steps = expert(env), []
    demonstrations.end_episode(steps, config.discount, is_whole=False)


def _fit(network: Any, demonstrations: _Demonstrations, value_weight: float, seed: int) -> None:
    """Minimise cross-entropy and the value's squared error while the former falls on a tenth held out."""
    tensors = {
        key: torch.as_tensor(np.stack([o[key] for o in demonstrations.observations]))
        for key in demonstrations.observations[0]
    }
    answers = torch.as_tensor(demonstrations.answers)
    returns = torch.as_tensor(demonstrations.returns, dtype=torch.float32)
    # The last tenth is held out rather than a random one: neighbouring decisions are much alike.
    order = torch.arange(len(answers))
    held, rest = order[-max(1, len(order) // 10) :], order[: -max(1, len(order) // 10)]
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3)
    best, best_state, accuracy, waited = float("inf"), network.state_dict(), 0.0, 0
    for epoch in range(_EPOCHS):
        for batch in _batches(rest, tensors["mask"], np.random.default_rng([seed, epoch])):
            scores, values = network(_narrowed(tensors, batch))
            known = torch.isfinite(returns[batch])
            errors = (values[known] - returns[batch][known]) ** 2
            loss = cross_entropy(scores, answers[batch]) + value_weight * errors.sum() / len(batch)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
        with torch.no_grad():
            scores, _ = network(_narrowed(tensors, held))
            held_loss = float(cross_entropy(scores, answers[held]))
        waited = 0 if held_loss < best else waited + 1
        if held_loss < best:
            best, best_state = held_loss, {k: v.clone() for k, v in network.state_dict().items()}
            accuracy = float((scores.argmax(dim=1) == answers[held]).float().mean())
        if waited == _PATIENCE:
            break
    network.load_state_dict(best_state)
    say(
        f"imitation: {len(demonstrations)} decisions, cross-entropy {best:.3f}, the expert's choice in "
        f"{accuracy:.0%} of held-out decisions"
    )


def _batches(demonstrations: Tensor, mask: Tensor, rng: np.random.Generator) -> list[Tensor]:
    """Random minibatches of demonstrations with about as many candidates each, which spares computing empty rows."""
    shuffled = demonstrations[torch.as_tensor(rng.permutation(len(demonstrations)))]
    counts = mask[shuffled].sum(dim=1)
    batches = list(shuffled[torch.argsort(counts, stable=True)].split(_BATCH))
    return [batches[index] for index in rng.permutation(len(batches))]


def _narrowed(tensors: dict[str, Tensor], batch: Tensor) -> dict[str, Tensor]:
    """The observations of a batch without the rows that are empty in all of them."""
    count = max(1, int(tensors["mask"][batch].sum(dim=1).max()))
    return {
        key: value[batch] if key == "globals" else value[batch][:, :count] for key, value in tensors.items()
    }
