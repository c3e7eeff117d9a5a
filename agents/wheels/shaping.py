"""Reward shaping where the wheels are driven: every policy explores held-out plans for some time, at known pose."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slamgym.agents.rl.reward_presets import reward_preset
from slamgym.agents.rl.reward_shaping import Experiment
from slamgym.agents.rl.train_config import POLICY
from slamgym.agents.wheels.config import WheelsConfig, WheelsShapingConfig
from slamgym.agents.wheels.policy import read_wheels
from slamgym.agents.wheels.validation import DriveOutcome, drive_plans

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan


@dataclass(frozen=True)
class _Identity:
    train: WheelsConfig


class WheelsShaping(Experiment[WheelsConfig, DriveOutcome]):
    """Drive the wheels.

    Args:
        config: The experiment.
        learn: :func:`slamgym.agents.wheels.train.train_wheels`, which needs torch.
    """

    outcome = DriveOutcome
    curve = "rollout/coverage"

    def __init__(self, config: WheelsShapingConfig, learn: Callable[..., Any]) -> None:
        self.config, self._train = config, learn
        self.presets, self.seeds = config.presets, config.seeds

    def test_plans(self) -> Sequence[FloorPlan]:
        """Of the split ``test``."""
        from slamgym.agents.rl.training_envs import draw_plans

        return draw_plans(self.config.train.plans, "test", self.config.test_plans)

    def settings(self, preset: str, seed: int) -> WheelsConfig:
        """The training run of a preset and a seed."""
        base = self.config.train
        # A potential is harmless with the learner's own discount alone, which is per decision, not per step.
        discount = base.discount ** (1.0 / base.network.hold)
        reward = dataclasses.replace(reward_preset(preset).reward, discount=discount)
        return dataclasses.replace(base, seed=seed, reward=reward)

    def identity(self, preset: str, seed: int) -> _Identity:
        """Its whole configuration."""
        return _Identity(self.settings(preset, seed))

    def learn(self, preset: str, seed: int, folder: Path) -> None:
        """Train, or go on."""
        self._train(self.settings(preset, seed), folder)

    def explore(
        self, preset: str, seed: int, folder: Path, plans: Sequence[FloorPlan]
    ) -> Iterator[tuple[FloorPlan, DriveOutcome]]:
        """All in one batch; start and noise follow from a plan's id."""
        outcomes = drive_plans(self.settings(preset, seed), read_wheels(folder / POLICY).act, plans)
        yield from zip(plans, outcomes, strict=True)
