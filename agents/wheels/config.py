"""Everything that decides a training run of the wheels; saved beside it as JSON."""

from dataclasses import field
from typing import Literal

from slamgym.agents.rl.train_config import PPOConfig
from slamgym.agents.wheels.policy import WheelsNetwork
from slamgym.core.config import Count, CountOrZero, Positive, PositiveShare, Settings
from slamgym.core.errors import ConfigError
from slamgym.envs.rewards import RewardConfig
from slamgym.sim import OdometryLevel

WHEELS_REWARD = RewardConfig(coverage_gain=0.0, floor_gain=1.0, time=0.0, collision=1.0, completion=0.0)
"""A point for each new square metre of floor, one off for each control step in contact."""


def _ppo() -> PPOConfig:
    return PPOConfig(n_steps=256, batch_size=1024, n_epochs=5, learning_rate=5e-4, ent_coef=0.001)


class WheelsConfig(Settings):
    """A training run on ``slamgym/Explore-v1`` with the observations ``compact``."""

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
