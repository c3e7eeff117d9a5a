"""Imitate an expert before learning from rewards: behaviour cloning (Pomerleau 1989) of frontier choices.

The experts are allowed to know the truth; what is learned from them is not: the network sees nothing but
observations.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from agents.learning_envs import make_env
from agents.tour_expert import TourExpert
from agents.train_config import TrainConfig
from slamgym.cad import FloorPlan
from slamgym.config import suggest
from slamgym.dataset.progress import say, show_progress
from slamgym.envs.frontier_actions import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES
from slamgym.errors import ConfigError

Answer = Callable[[dict[str, Any]], int]
"""From an observation to the action that the expert would take."""


def gain_per_way(env: ExploreFrontiersEnv) -> Answer:
    """Unknown area in sight over one metre plus the way: next best view, without privileges."""
    del env
    column = CANDIDATE_FEATURES.index("gain_per_way")

    def answer(observation: dict[str, Any]) -> int:
        return int(
            np.where(observation["mask"] > 0.5, observation["candidates"][:, column], -np.inf).argmax()
        )

    return answer


def full_knowledge(env: ExploreFrontiersEnv) -> Answer:
    """The short tour of one who knows the building. Privileged."""
    expert = TourExpert(env)
    return lambda _: expert.choose()


EXPERTS: dict[str, Callable[[ExploreFrontiersEnv], Answer]] = {
    "full_knowledge": full_knowledge,
    "gain_per_way": gain_per_way,
}
"""Whom to imitate, by name; an expert is made anew when an episode has begun."""


def imitate(model: Any, config: TrainConfig, plans: Sequence[FloorPlan], out: Path) -> None:
    """Fit a policy to an expert's choices by cross-entropy.

    The expert drives, but one choice in ten is drawn at random, so that the data hold its answers to
    situations that it would not get into by itself.

    Args:
        model: The learner; its policy is changed.
        config: The run.
        plans: Where the expert explores.
        out: Folder of the run; unused but for messages.
    """
    del out
    if config.imitation_expert not in EXPERTS:
        raise ConfigError(
            f"no expert {config.imitation_expert!r} to imitate; {suggest(config.imitation_expert, EXPERTS)}"
        )
    expert = EXPERTS[config.imitation_expert]
    env = make_env(config, list(plans))
    assert isinstance(env, ExploreFrontiersEnv)
    observations, answers = _collect(env, expert, config.imitation_decisions, config.seed)
    _fit(model.policy, observations, answers, config.seed)


def _collect(
    env: ExploreFrontiersEnv, expert: Callable[[ExploreFrontiersEnv], Answer], count: int, seed: int
) -> tuple[list[dict[str, Any]], list[int]]:
    rng = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    ask = expert(env)
    observations: list[dict[str, Any]] = []
    answers: list[int] = []
    with show_progress("decisions of the expert", 0, count) as advance:
        while len(answers) < count:
            answer = ask(observation)
            observations.append(observation)
            answers.append(answer)
            advance()
            valid = np.flatnonzero(env.action_masks())
            action = int(rng.choice(valid)) if rng.random() < 0.1 else answer
            observation, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                observation, _ = env.reset()
                ask = expert(env)
    return observations, answers


def _fit(policy: Any, observations: list[dict[str, Any]], answers: list[int], seed: int) -> None:
    """Minimise the cross-entropy on nine tenths of the data while it falls on the rest."""
    tensors = {key: torch.as_tensor(np.stack([o[key] for o in observations])) for key in observations[0]}
    target = torch.as_tensor(answers)
    network = policy.features_extractor.network
    order = torch.as_tensor(np.random.default_rng(seed).permutation(len(answers)))
    held = order[: max(1, len(order) // 10)]
    rest = order[len(held) :]
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3)
    best, best_state, waited = float("inf"), None, 0
    for epoch in range(40):
        shuffled = rest[torch.as_tensor(np.random.default_rng([seed, epoch]).permutation(len(rest)))]
        for batch in shuffled.split(256):
            scores, _ = network({key: value[batch] for key, value in tensors.items()})
            loss = torch.nn.functional.cross_entropy(scores, target[batch])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
        with torch.no_grad():
            scores, _ = network({key: value[held] for key, value in tensors.items()})
            held_loss = float(torch.nn.functional.cross_entropy(scores, target[held]))
            accuracy = float((scores.argmax(dim=1) == target[held]).float().mean())
        waited = 0 if held_loss < best else waited + 1
        if held_loss < best:
            best, best_state = held_loss, {k: v.clone() for k, v in network.state_dict().items()}
        if waited == 4:
            break
    if best_state is not None:
        network.load_state_dict(best_state)
    say(f"imitation: cross-entropy {best:.3f}, the expert's choice in {accuracy:.0%} of held-out decisions")
