"""Rewards that ``slamgym agents shape`` compares, and the settings of such experiments.

Every preset is a :class:`~slamgym.envs.rewards.RewardConfig`.
Your own term needs no preset: ``slamgym agents shape --term my_module:my_function`` adds it to one.
"""

from dataclasses import field, replace
from typing import Literal

from slamgym.agents.rl.learner import LearnerConfig
from slamgym.agents.rl.train_config import DISCOUNT, HOLD, SCRATCH_PPO, TrainConfig, WheelsConfig
from slamgym.core.config import Count, Settings, suggest
from slamgym.core.errors import ConfigError
from slamgym.envs import RewardConfig

BASE = "coverage"
"""The preset that the others add to and are compared with."""

OWN = "own"
"""Preset that a term of the user's own makes on top of :data:`BASE`."""

_NOTHING = RewardConfig(coverage_gain=0.0, time=0.0, collision=0.0, completion=0.0)


REWARD_PRESETS: dict[str, RewardConfig] = {
    # A point for each new hundredth of the floor.
    "coverage": replace(_NOTHING, coverage_gain=100.0),
    # The same, less contacts.
    "collision": replace(_NOTHING, coverage_gain=100.0, collision=2.0),
    # The same, four times as much for a contact.
    "careful": replace(_NOTHING, coverage_gain=100.0, collision=8.0),
    # Square metres in place of shares: large buildings count more.
    "floor": replace(_NOTHING, floor_gain=1.0),
    # Coverage, less the path driven.
    "path_cost": replace(_NOTHING, coverage_gain=100.0, path_length=0.5),
    # A bonus at the end alone: sparse.
    "completion": replace(_NOTHING, completion=100.0),
    # The same with potential-based coverage (Ng, Harada and Russell 1999), which leaves the best policies as they are.
    "potential": replace(
        _NOTHING, completion=100.0, shaping=100.0, discount=DISCOUNT ** (1.0 / HOLD)
    ),
}
"""The presets by name."""


def reward_preset(name: str) -> RewardConfig:
    """A preset by its name.

    Raises:
        ConfigError: If there is none; the error suggests the nearest.
    """
    if name not in REWARD_PRESETS:
        raise ConfigError(f"no reward preset {name!r}; {suggest(name, REWARD_PRESETS)}")
    return REWARD_PRESETS[name]


class ShapingConfig(Settings):
    """An experiment."""

    level: Literal["wheels", "frontiers"] = "wheels"
    """What is learned: driving the wheels, or choosing frontiers."""
    presets: tuple[str, ...] = tuple(REWARD_PRESETS)
    """Names of :data:`REWARD_PRESETS`, or ``own``."""
    seeds: Count = 3
    """Runs of each preset."""
    test_plans: Count = 40
    """Held-out plans that every policy explores at the end."""
    train: WheelsConfig = field(
        default_factory=lambda: WheelsConfig(
            steps=150_000,
            num_envs=32,
            learner=LearnerConfig(hyperparameters=SCRATCH_PPO),
            start="scratch",
            evaluate_every=0,
            evaluate_seconds=90.0,
        )
    )
    """Each run that drives the wheels, but for its reward and seed."""
    frontiers: TrainConfig = field(
        default_factory=lambda: TrainConfig(steps=40_000, num_envs=32, evaluate_every=0)
    )
    """Each run that chooses frontiers, but for its reward and seed."""

    def _check(self) -> None:
        if not self.presets or len(set(self.presets)) < len(self.presets):
            raise ConfigError("name at least one preset, and none twice")
        for name in self.presets:
            if name != OWN:
                reward_preset(name)

    def settings(self, preset: str, seed: int) -> WheelsConfig | TrainConfig:
        """The training run of a preset and a seed."""
        run = self.train if self.level == "wheels" else self.frontiers
        return replace(run, seed=seed, reward=reward_preset(BASE if preset == OWN else preset))
