"""Reward presets for ``slamgym agents shape``, with their weights, and the settings of experiments that compare them.

Every preset is a :class:`~slamgym.envs.rewards.RewardConfig`.
Your own term needs no preset: ``slamgym agents shape --term my_module:my_function`` adds it to one.
"""

from dataclasses import field, replace
from typing import Any

from slamgym.agents.rl.train_config import TrainConfig
from slamgym.core.config import Count, Settings, suggest
from slamgym.core.errors import ConfigError
from slamgym.envs import ExploreConfig, RewardConfig

BASE = "time"
"""The preset that the others add to and are compared with."""

OWN = "own"
"""Preset that a term of the user's own makes on top of :data:`BASE`."""

_TEST_RESOLUTION = 0.05
"""Cell size of maps in the test, as in explorations [m]."""
_NOTHING = RewardConfig(coverage_gain=0.0, time=0.0, collision=0.0, completion=0.0)


REWARD_PRESETS: dict[str, RewardConfig] = {
    # Square metres truly seen, less contacts.
    "floor": replace(_NOTHING, floor_gain=1.0, collision=1.0),
    # Coverage, less the path driven.
    "path_cost": replace(_NOTHING, coverage_gain=2.0, path_length=0.08),
    # Coverage, less the time taken.
    "time": replace(_NOTHING, coverage_gain=2.0, time=0.02),
    # The same, less contacts.
    "collision": replace(_NOTHING, coverage_gain=2.0, time=0.02, collision=0.1),
    # As time, less the growth of the map's true error (Daher et al. assess maps by it).
    "map_error": replace(_NOTHING, coverage_gain=2.0, time=0.02, map_error=40.0),
    # Time, and potential-based coverage (Ng, Harada and Russell 1999): the optimal policies are those of time alone.
    "potential": replace(_NOTHING, time=0.02, shaping=2.0),
    # Time, and a bonus at the end: sparse.
    "completion": replace(_NOTHING, time=0.02, completion=5.0),
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


class ShapingConfig(Settings, dropped={"particles": 30}):
    """An experiment."""

    presets: tuple[str, ...] = tuple(REWARD_PRESETS)
    """Names of presets (docs/learning.md). If one of them needs the particle filter,
    or may, as ``own``, all are trained with it, so that they differ in the reward alone."""
    seeds: Count = 3
    """Runs of each preset."""
    test_plans: Count = 20
    """Held-out plans that every policy explores at the end."""
    train: TrainConfig = field(
        default_factory=lambda: TrainConfig(steps=15_000, plan_count=300, evaluate_every=0)
    )
    """Each run, but for its reward and seed."""

    def _check(self) -> None:
        for name in self.presets:
            if name != OWN:
                reward_preset(name)

    def settings(self, preset: str, seed: int) -> TrainConfig:
        """The training run of a preset and a seed."""
        # Known poses have no error to pay for, and a user's term may charge any.
        needs_filter = any(name == OWN or reward_preset(name).map_error > 0.0 for name in self.presets)
        localization = "rbpf" if needs_filter else self.train.localization
        reward = reward_preset(BASE if preset == OWN else preset)
        return replace(self.train, seed=seed, localization=localization, reward=reward)

    @property
    def changes(self) -> dict[str, Any]:
        """Differences between test and training: the particle filter, and maps of full resolution."""
        return {
            "localization": "rbpf",
            "slam": {"particles": ExploreConfig().slam.particles, "resolution": _TEST_RESOLUTION},
            "observation": {"map_resolution": _TEST_RESOLUTION},
        }
