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

from slamgym.agents.coverage_tour import SightPlanner
from slamgym.agents.rl.train_config import TrainConfig
from slamgym.agents.rl.training_envs import make_env
from slamgym.cad import FloorPlan
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.core.progress import say, show_progress
from slamgym.core.types import BoolArray, OccupancyGrid
from slamgym.envs.coverage import ReachableFloor
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES
from slamgym.planning import Costmap, CostmapConfig, make_costmap, reachable_space
from slamgym.planning.coarse_paths import CoarsePaths


class TourExpert:
    """Knows the building of one environment's running episode.

    Args:
        env: After its reset; there has to be a new expert for every episode.
    """

    def __init__(self, env: ExploreFrontiersEnv) -> None:
        inner = env.inner
        self._env = env
        plan, start = inner.plan, inner.start
        costmap = _true_costmap(env)
        space = reachable_space(costmap, start)
        assert space is not None, "the robot stands in the building"
        floor = ReachableFloor(plan, inner.config.robot.radius, inner.clutter.furniture)
        segments = np.vstack([plan.segments(), inner.clutter.segments()])
        self._planner = SightPlanner(
            costmap, space, floor.mask(start.x, start.y), floor.frame, segments, inner.config.usable_range
        )
        self._paths = CoarsePaths(costmap, space)

    @property
    def unseen(self) -> BoolArray:
        """Which of the planner's cells have truly not been seen."""
        seen = self._env.inner.coverage.seen[::-1].reshape(-1)[self._planner.cells]
        unseen: BoolArray = self._planner.coverable & ~seen
        return unseen

    def choose(self) -> int:
        """The index of a candidate."""
        driver, origin = self._env.driver, self._env.inner.start
        if len(driver.candidates) < 2:
            return 0
        here = driver.pose.x + origin.x, driver.pose.y + origin.y
        tour = self._planner.plan(self.unseen, here)
        if not tour:
            return 0
        from_stop = self._paths.lengths_from(self._paths.place(tour[0].point))
        ends = np.array([candidate.path[-1] for candidate in driver.candidates]) + np.array(
            [origin.x, origin.y]
        )
        onward = np.array([self._onward(from_stop, (float(x), float(y))) for x, y in ends])
        ways = np.array([candidate.path_length for candidate in driver.candidates])
        return int(np.argmin(ways + onward))

    def _onward(self, from_stop: np.ndarray, point: tuple[float, float]) -> float:
        place = self._paths.place(point)
        return float(from_stop[place]) if place >= 0 else np.inf


def _true_costmap(env: ExploreFrontiersEnv) -> Costmap:
    """The true building with the robot's body, world frame."""
    plan, radius = env.inner.plan, env.inner.config.robot.circumscribed_radius
    drawn = plan.raster(0.05)
    return make_costmap(
        OccupancyGrid(drawn.cells, drawn.frame),
        CostmapConfig(inscribed_radius=radius, inflation_radius=radius),
    )


_BATCH = 256
_EPOCHS = 40
_PATIENCE = 4  # epochs without a better result on what is held out

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


def oracle(env: ExploreFrontiersEnv) -> Answer:
    """The short tour of one who knows the building. Privileged."""
    expert = TourExpert(env)
    return lambda _: expert.choose()


EXPERTS: dict[str, Callable[[ExploreFrontiersEnv], Answer]] = {
    "oracle": oracle,
    "gain_per_way": gain_per_way,
}
"""Whom to imitate, by name; an expert is made anew when an episode has begun."""


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
    if config.imitation_expert not in EXPERTS:
        raise ConfigError(
            f"no expert {config.imitation_expert!r} to imitate; {suggest(config.imitation_expert, EXPERTS)}"
        )
    env = make_env(config, list(plans))
    assert isinstance(env, ExploreFrontiersEnv)
    network = model.policy.features_extractor.network
    demonstrations = _Demonstrations()
    rounds = max(1, config.imitation_rounds)
    for number in range(rounds):
        wanted = (config.imitation_decisions * (number + 1)) // rounds
        choose = None if number == 0 else _student(network)
        _collect(env, EXPERTS[config.imitation_expert], choose, demonstrations, wanted, config, seed=number)
        _fit(network, demonstrations, config.imitation_value_weight, config.seed)


@dataclass
class _Demonstrations:
    """What the expert was asked, what it answered, and what the rest of the episode brought."""

    observations: list[dict[str, Any]] = field(default_factory=list)
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
    def choose(observation: dict[str, Any]) -> int:
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
    """Explore until there are as many lessons as wanted; the expert drives where ``choose`` is None."""
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
    """Random minibatches of lessons with about as many candidates each, which spares computing empty rows."""
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
