"""Everything that decides a training run of the wheels, saved beside it as JSON, and an experiment of such runs."""

from dataclasses import field
from typing import Literal

from slamgym.agents.rl.reward_presets import REWARD_PRESETS, reward_preset
from slamgym.agents.rl.train_config import PPOConfig
from slamgym.agents.wheels.policy import WheelsNetwork
from slamgym.core.config import Count, CountOrZero, Positive, PositiveShare, Settings
from slamgym.core.errors import ConfigError
from slamgym.envs.rewards import RewardConfig
from slamgym.sim import OdometryLevel

WHEELS_REWARD = RewardConfig(coverage_gain=100.0, time=0.0, collision=2.0, completion=0.0)
"""A point for each new hundredth of the floor, two off for each control step in contact."""


def _ppo() -> PPOConfig:
    return PPOConfig(n_steps=256, batch_size=1024, n_epochs=5, learning_rate=5e-4, ent_coef=0.001)


class WheelsConfig(Settings):
    """A training run on ``slamgym/Explore-v1`` with the observations ``compact_far``."""

    plans: tuple[str, ...] = ("procedural",)
    """Floor plans: ``procedural``, or a HouseExpo archive, ...; as many are drawn from each. Only those of the
    split ``train`` are learned on."""
    plan_count: Count = 1500
    """So many plans are learned on."""
    steps: Count = 6_000_000
    """Decisions of all environments together."""
    seed: int = 0
    """Seed of everything random."""
    num_envs: Count = 32
    """Environments, all in one batch."""
    localization: Literal["ground_truth", "scan_matching", "dead_reckoning"] = "ground_truth"
    """Where the pose comes from while training."""
    odometry: OdometryLevel = "medium"
    """Errors of the wheel odometry."""
    episode_seconds: tuple[Positive, Positive] = (90.0, 180.0)
    """Shortest and longest episode [s]; each is cut off at a time drawn evenly between, and the value of what would
    have followed counts."""
    coverage_goal: PositiveShare = 0.98
    """An episode ends at this true coverage; privileged, never observed."""
    discount: PositiveShare = 0.99
    """Per decision."""
    reward: RewardConfig = WHEELS_REWARD
    """Weights of the reward terms."""
    ppo: PPOConfig = field(default_factory=_ppo)
    """The learner."""
    network: WheelsNetwork = field(default_factory=WheelsNetwork)
    """The network."""
    evaluate_every: CountOrZero = 250_000
    """Decisions between two evaluations on validation plans; 0 for none."""
    evaluate_plans: Count = 64
    """Plans of an evaluation."""
    evaluate_seconds: Positive = 90.0
    """How long each is explored [s]."""
    checkpoint_every: Count = 20_000
    """Decisions between two checkpoints."""

    def _check(self) -> None:
        if self.episode_seconds[0] > self.episode_seconds[1]:
            raise ConfigError(f"episode_seconds must be (shortest, longest), not {self.episode_seconds}")


WHEELS_PRESETS = tuple(name for name, preset in REWARD_PRESETS.items() if preset.in_batch)
"""Those that a batch of environments can pay: nothing about the map, the filter or a chosen path."""


class WheelsShapingConfig(Settings):
    """An experiment on the wheels."""

    presets: tuple[str, ...] = WHEELS_PRESETS
    """Names of presets; ``slamgym agents shape --list`` explains them."""
    seeds: Count = 3
    """Runs of each preset."""
    test_plans: Count = 60
    """Held-out plans that every policy explores at the end, for ``train.evaluate-seconds`` each."""
    train: WheelsConfig = field(default_factory=lambda: WheelsConfig(steps=600_000, evaluate_every=0))
    """Each run, but for its reward and seed."""

    def _check(self) -> None:
        for name in self.presets:
            if not reward_preset(name).in_batch:
                raise ConfigError(
                    f"the preset {name!r} can't be paid on the wheels, whose environments are a batch without map "
                    f"error, filter and paths; choose from {', '.join(WHEELS_PRESETS)}"
                )
