"""Reward shaping where frontiers are chosen: every policy explores held-out plans with the particle filter."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slamgym.agents.rl.reward_presets import BASE, REWARD_PRESETS, reward_preset
from slamgym.agents.rl.reward_shaping import Experiment
from slamgym.agents.rl.train_config import POLICY, Curriculum, TrainConfig
from slamgym.agents.rl.validation import PolicyOutcome, explore_plan
from slamgym.core.config import Count, Settings
from slamgym.core.names import exploration_seed, own_function
from slamgym.envs import RewardFunction

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan

Term = tuple[str, float, RewardFunction]
"""Name, weight and function of a term of the user's own."""

OWN = "own"
"""RewardPreset that a term of the user's own makes on top of :data:`~slamgym.agents.rl.reward_presets.BASE`."""


class ShapingConfig(Settings):
    """An experiment."""

    presets: tuple[str, ...] = tuple(REWARD_PRESETS)
    """Names of presets; ``slamgym agents shape --list`` explains them. If one of them needs the particle filter,
    or may, as ``own``, all are trained with it, so that they differ in the reward alone."""
    seeds: Count = 3
    """Runs of each preset."""
    test_plans: Count = 20
    """Held-out plans that every policy explores at the end."""
    particles: Count = 30
    """Particles of the filter in that test."""
    train: TrainConfig = field(
        default_factory=lambda: TrainConfig(
            steps=15_000, plan_count=300, evaluate_every=0, curriculum=Curriculum(areas=(), shares=())
        )
    )
    """Each run, but for its reward and seed. Without a curriculum, so that the curves don't show its stages."""

    def _check(self) -> None:
        for name in self.presets:
            if name != OWN:
                reward_preset(name)


@dataclass(frozen=True)
class _Identity:
    train: TrainConfig
    particles: int
    term: tuple[str, float] | None


class DecisionShaping(Experiment[TrainConfig, PolicyOutcome]):
    """Choose frontiers.

    Args:
        config: The experiment.
        learn: :func:`slamgym.agents.rl.train.train`, which needs torch.
        term: A term of the user's own, for the preset ``own``.
    """

    outcome = PolicyOutcome
    curve = "rollout/episode_seconds"

    def __init__(self, config: ShapingConfig, learn: Callable[..., Any], term: Term | None = None) -> None:
        self.config, self._train, self._term = config, learn, term
        self.presets, self.seeds = config.presets, config.seeds

    def test_plans(self) -> Sequence[FloorPlan]:
        """Of the split ``test``."""
        from slamgym.agents.rl.training_envs import draw_plans

        return draw_plans(self.config.train.plans, "test", self.config.test_plans)

    def settings(self, preset: str, seed: int) -> TrainConfig:
        """The training run of a preset and a seed."""
        # A term of one's own may charge errors that known poses don't have.
        needs_filter = any(other == OWN or reward_preset(other).needs_filter for other in self.presets)
        localization = "rbpf" if needs_filter else self.config.train.localization
        base = dataclasses.replace(self.config.train, seed=seed, localization=localization)
        chosen = reward_preset(BASE if preset == OWN else preset)
        network = dataclasses.replace(
            base.network, exposure_prior=base.network.exposure_prior + chosen.exposure_prior
        )
        return dataclasses.replace(base, reward=chosen.reward, network=network)

    def identity(self, preset: str, seed: int) -> _Identity:
        """However many processes train."""
        term = self._term[:2] if preset == OWN and self._term else None
        settings = dataclasses.replace(self.settings(preset, seed), workers=1)
        return _Identity(settings, self.config.particles, term)

    def learn(self, preset: str, seed: int, folder: Path) -> None:
        """Train, or go on."""
        if preset == OWN:
            terms = {self._term[0]: self._term[1:]} if self._term else None
        else:
            terms = dict(reward_preset(preset).terms) or None
        self._train(self.settings(preset, seed), folder, reward_terms=terms)

    def explore(
        self, preset: str, seed: int, folder: Path, plans: Sequence[FloorPlan]
    ) -> Iterator[tuple[FloorPlan, PolicyOutcome]]:
        """Explore with the particle filter and maps of full resolution; start and noise follow from a plan's id."""
        from slamgym.agents.pretrained_policy import read_policy
        from slamgym.agents.rl.training_envs import make_env
        from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv

        scorer = read_policy(folder / POLICY).scorer()
        env = make_env(
            dataclasses.replace(self.settings(preset, seed), resolution=0.05), plans,
            localization="rbpf", slam={"particles": self.config.particles}, coverage_goal=None,
        )  # fmt: skip
        assert isinstance(env, ExploreFrontiersEnv)
        for plan in plans:
            yield plan, explore_plan(env, scorer.choose, plan, exploration_seed(0, plan.id, 0))


def own_term(spec: str, weight: float) -> Term:
    """A function of a :class:`~slamgym.envs.rewards.StepRecord` named as ``module:function``.

    Raises:
        ConfigError: If it can't be imported, or is no function.
    """
    return spec.partition(":")[2], weight, own_function(spec, "--term")
