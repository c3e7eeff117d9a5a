"""Learn from one who knows the plan what each choice costs, before learning from rewards.

At half of the decisions the cost of every candidate is asked for (:mod:`slamgym.agents.hindsight`), and the network
learns to choose what costs least in the mean: it sees nothing but observations, so it averages over the plans that
look alike.
The policy itself drives, so that the data hold the situations that it gets itself into (AggreVaTe: Ross and Bagnell,
"Reinforcement and imitation learning via interactive no-regret learning", 2014; here every action has its cost, not
one a decision).
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from slamgym.agents.hindsight import HindsightCosts
from slamgym.agents.rl.choice_costs import ChoiceCosts, fit_choices, fit_value
from slamgym.agents.rl.train_config import FURNISHED, TrainConfig
from slamgym.agents.rl.training_envs import make_env
from slamgym.cad import FloorPlan
from slamgym.core.progress import show_progress
from slamgym.core.types import Observation
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES

_RANDOM_SHARE = 0.1
"""So many choices are drawn at random, so that the data hold other choices than the policy's, too."""
_ASKED_SHARE = 0.5
"""So many decisions are asked about: neighbouring ones are much alike, and asking costs as much as deciding."""

Answer = Callable[[Observation], int]
"""From an observation to the action that an expert would take."""


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
    """What costs least for one who knows the building. Privileged."""
    hindsight = HindsightCosts(env)
    return lambda _: int(hindsight.costs().argmin()) if len(env.loop.candidates) > 1 else 0


EXPERTS: dict[str, Callable[[ExploreFrontiersEnv], Answer]] = {
    "oracle": oracle,
    "gain_per_metre": gain_per_metre,
}
"""Who may choose where explorations are recorded, by name; each episode makes its own."""


def imitate(model: Any, config: TrainConfig, plans: Sequence[FloorPlan], folder: Path) -> None:
    """Fit a policy to what choices cost, and its value to the returns that its own choices brought.

    Interrupted, it goes on after the last round that was collected: the decisions are kept in the folder until all
    are fitted.

    Args:
        model: The learner; its policy is changed. In each round it drives, at first as its prior does.
        config: The run.
        plans: Where to explore.
        folder: Of the run.
    """
    envs = [make_env(config, list(plans))]
    if config.furnished:
        envs.append(make_env(config, list(plans), clutter=FURNISHED))
    network, settings = model.policy.features_extractor.network, config.imitation
    known, paths = ChoiceCosts(), []
    for number in range(settings.rounds):
        paths.append(folder / f"choices_{number}.npz")
        if paths[-1].exists():
            known.extend(ChoiceCosts.read(paths[-1]))
        else:
            missing = settings.decisions * (number + 1) // settings.rounds - len(known)
            own = _collect(envs, network, max(1, missing), config, seed=number)
            own.write(paths[-1])
            known.extend(own)
        fit_choices(network, known, settings.epochs, config.seed)
    fit_value(network, known, config.seed)
    for path in paths:
        path.unlink()


def _collect(
    envs: Sequence[ExploreFrontiersEnv], network: Any, wanted: int, config: TrainConfig, seed: int
) -> ChoiceCosts:
    """Let a network explore whole buildings until there are so many decisions with their costs."""
    rng, found = np.random.default_rng([config.seed, seed]), ChoiceCosts()
    with show_progress("choices with their costs", 0, wanted) as advance:
        while len(found) < wanted:
            before = len(found)
            env = envs[int(rng.random() < config.furnished) if len(envs) > 1 else 0]
            _explore(env, network, found, config.discount, rng)
            for _ in range(len(found) - before):
                advance()
    return found


def _explore(
    env: ExploreFrontiersEnv, network: Any, found: ChoiceCosts, discount: float, rng: np.random.Generator
) -> None:
    """Explore a building, and add half of the decisions to those that were found."""
    observation, _ = env.reset(seed=int(rng.integers(2**31)))
    hindsight = HindsightCosts(env)
    steps: list[tuple[float, float]] = []
    asked: list[int] = []  # steps whose decisions were added
    is_over, terminated = not env.loop.candidates, False
    while not is_over:
        count = len(env.loop.candidates)
        if count > 1 and rng.random() < _ASKED_SHARE:
            found.add(observation, hindsight.costs())
            asked.append(len(steps))
        is_random = count > 1 and rng.random() < _RANDOM_SHARE
        action = int(rng.integers(count)) if is_random else _best(network, observation)
        observation, reward, terminated, truncated, info = env.step(action)
        steps.append((float(reward), float(info["duration"])))
        is_over = terminated or truncated
    found.end_episode(steps, asked, discount, is_whole=terminated)


def _best(network: Any, observation: Observation) -> int:
    """The candidate that a network scores highest."""
    with torch.no_grad():
        scores, _ = network({key: torch.as_tensor(value)[None] for key, value in observation.items()})
    return int(scores[0].argmax())
