"""Reward-shaping experiments: the same learner with different rewards, over several seeds.

Main path: :func:`run_shaping` trains every preset with every seed and explores held-out plans with each policy;
:func:`write_shaping_report` sets the :class:`ShapingRun` records against one another. What is trained and measured is
an :class:`Experiment`: :class:`DecisionShaping` chooses frontiers, :class:`WheelsShaping` drives the wheels. After an
interruption training resumes from its checkpoint, and the test after its last exploration: ``shaping.json`` in the
folder of a run is written again, whole, after each.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.evaluation.report import with_bounds
from slamgym.agents.plan_splits import draw_plans
from slamgym.agents.rl.environments import explore_plan, figures_of
from slamgym.agents.rl.reward_presets import BASE, OWN, ShapingConfig, WheelsShapingConfig, reward_preset
from slamgym.agents.rl.train_config import HOLD, POLICY, TrainConfig, WheelsConfig
from slamgym.cad import FloorPlan
from slamgym.core.config import Measured, config_hash, from_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import own_folder, write_text
from slamgym.core.intervals import Interval, crossed_mean, crossed_ratio
from slamgym.core.names import exploration_seed, own_function
from slamgym.core.progress import say, show_progress
from slamgym.core.text import markdown
from slamgym.core.types import FloatArray
from slamgym.envs import RewardFunction

FEW_SEEDS = 3
"""Intervals over fewer trainings say little."""
RESULTS = "shaping.json"
Term = tuple[str, float, RewardFunction]
"""Name, weight and function of a term of the user's own."""
_TEST_RESOLUTION = 0.05
"""Cell size of maps in the test, as in explorations [m]."""


@dataclass(frozen=True)
class Column:
    """A field of the outcomes in the report."""

    field: str
    heading: str
    digits: int
    ratio: bool = False
    """True if its mean is set against the reference's, too."""


DECISION_REPORT: tuple[Column, ...] = (
    Column("time", "time until done [s]", 0, ratio=True),
    Column("path", "path until done [m]", 1),
    Column("time_99", "time to 99 % [s]", 0),
    Column("coverage", "coverage", 3),
    Column("map_error", "map error [m]", 4, ratio=True),
)
"""Shown where frontiers are chosen."""
WHEELS_REPORT: tuple[Column, ...] = (
    Column("coverage", "coverage", 3, ratio=True),
    Column("contacts", "contacts in 5 min", 1),
    Column("path", "path [m]", 1),
)
"""Shown where the wheels are driven."""


@dataclass(frozen=True)
class ShapingRun:
    """One trained policy and how it did."""

    preset: str
    seed: int
    outcomes: list[dict[str, float]]  # :func:`~slamgym.agents.rl.environments.figures_of` each test plan


@dataclass(frozen=True)
class _Results:
    """What is known of a run."""

    settings: str
    """Hash of its identity."""
    outcomes: dict[str, dict[str, Measured]]
    """Plan to figures."""


@dataclass(frozen=True)
class Identity:
    """What a run's results depend on, and by which they are known again."""

    train: TrainConfig | WheelsConfig
    particles: int = 0
    term: tuple[str, float] | None = None


class Experiment(ABC):
    """What is trained with each preset and seed, and how a policy is tested.

    Args:
        config: The experiment.
        learn: Trains; it needs torch.
    """

    def __init__(self, config: ShapingConfig | WheelsShapingConfig, learn: Callable[..., Any]) -> None:
        self.presets, self.seeds = config.presets, config.seeds
        self.test_plans = config.test_plans
        self._learn = learn

    @abstractmethod
    def settings(self, preset: str, seed: int) -> Any:
        """The training run of a preset and a seed."""

    def identity(self, preset: str, seed: int) -> Identity:
        """What the results of a preset and a seed depend on."""
        return Identity(self.settings(preset, seed))

    def learn(self, preset: str, seed: int, folder: Path) -> None:
        """Train, or go on."""
        self._learn(self.settings(preset, seed), folder)

    def explore(self, preset: str, seed: int, folder: Path, plan: FloorPlan) -> dict[str, float]:
        """Explore a plan with the trained policy; start and noise follow from the plan's id."""
        start = exploration_seed(0, plan.id, 0)
        settings = self.settings(preset, seed)
        return figures_of(explore_plan(settings, folder / POLICY, plan, start, **self._changes()))

    def _changes(self) -> dict[str, Any]:
        """Settings of the environment in the test that differ from the training's."""
        return {}


class DecisionShaping(Experiment):
    """Choose frontiers.

    Args:
        config: The experiment.
        learn: :func:`slamgym.agents.rl.train.train`.
        term: A term of the user's own, for the preset ``own``.
    """

    def __init__(self, config: ShapingConfig, learn: Callable[..., Any], term: Term | None = None) -> None:
        super().__init__(config, learn)
        self.config, self._term = config, term

    def settings(self, preset: str, seed: int) -> TrainConfig:
        """The training run of a preset and a seed."""
        # A term of one's own may charge errors that known poses don't have.
        needs_filter = any(other == OWN or reward_preset(other).needs_filter for other in self.presets)
        localization = "rbpf" if needs_filter else self.config.train.localization
        reward = reward_preset(BASE if preset == OWN else preset).reward
        return replace(self.config.train, seed=seed, localization=localization, reward=reward)

    def identity(self, preset: str, seed: int) -> Identity:
        """What the results depend on; the number of processes that train is not part of it."""
        term = self._term[:2] if preset == OWN and self._term else None
        return Identity(replace(self.settings(preset, seed), workers=1), self.config.particles, term)

    def learn(self, preset: str, seed: int, folder: Path) -> None:
        """Train, or go on."""
        terms = {self._term[0]: self._term[1:]} if preset == OWN and self._term else None
        self._learn(self.settings(preset, seed), folder, reward_terms=terms)

    def _changes(self) -> dict[str, Any]:
        """The particle filter, and maps of full resolution."""
        return {
            "localization": "rbpf",
            "slam": {"particles": self.config.particles, "resolution": _TEST_RESOLUTION},
            "observation": {"map_resolution": _TEST_RESOLUTION},
        }


class WheelsShaping(Experiment):
    """Drive the wheels, at known pose.

    Args:
        config: The experiment.
        learn: :func:`slamgym.agents.rl.wheels.train_wheels`.
    """

    def __init__(self, config: WheelsShapingConfig, learn: Callable[..., Any]) -> None:
        super().__init__(config, learn)
        self.config = config

    def settings(self, preset: str, seed: int) -> WheelsConfig:
        """The training run of a preset and a seed."""
        base = self.config.train
        # A potential is harmless with the learner's own discount alone, which is per decision, not per step.
        reward = replace(reward_preset(preset).reward, discount=base.discount ** (1.0 / HOLD))
        return replace(base, seed=seed, reward=reward)


def run_shaping(experiment: Experiment, out: Path) -> list[ShapingRun]:
    """Train and test every preset with every seed.

    Args:
        experiment: What and how.
        out: Its folder: one folder for each run.

    Raises:
        ConfigError: If the folder holds runs with other settings.
    """
    first = experiment.settings(experiment.presets[0], 0)
    plans = draw_plans(first.plans, "test", experiment.test_plans)
    return [
        _run_one(experiment, name, seed, out / name / f"seed_{seed}", plans)
        for name in experiment.presets
        for seed in range(experiment.seeds)
    ]


def _run_one(
    experiment: Experiment, preset: str, seed: int, folder: Path, plans: Sequence[FloorPlan]
) -> ShapingRun:
    """Train and test one preset with one seed, or what is left of that."""
    identity = config_hash(experiment.identity(preset, seed))
    outcomes = _read(folder, identity)
    left = [plan for plan in plans if plan.id not in outcomes]
    if left:
        say(f"{preset}, seed {seed}")
        own_folder(own_folder(folder.parent) / folder.name)
        _write(folder, identity, outcomes)  # before the training: a term's weight stands nowhere else
        experiment.learn(preset, seed, folder)
        with show_progress("test explorations", len(plans) - len(left), len(plans)) as advance:
            for plan in left:
                outcomes[plan.id] = experiment.explore(preset, seed, folder, plan)
                _write(folder, identity, outcomes)
                advance()
    return ShapingRun(preset, seed, [outcomes[plan.id] for plan in plans])


def write_shaping_report(runs: Sequence[ShapingRun], columns: Sequence[Column], out: Path) -> str:
    """Write ``shaping.md``; returns it."""
    text = table(runs, columns)
    write_text(out / "shaping.md", text)
    return text


def table(runs: Sequence[ShapingRun], columns: Sequence[Column]) -> str:
    """Means over seeds and plans with 95 % intervals, and what is set against the preset ``time``.

    Both are drawn again for an interval (:func:`slamgym.core.intervals.crossed_ratio`), so it holds for other plans
    and other seeds of the training. With one seed there is none: other plans alone would make it too narrow.
    """
    by_name: dict[str, list[ShapingRun]] = {}
    for run in runs:
        by_name.setdefault(run.preset, []).append(run)
    base = by_name.get(BASE, next(iter(by_name.values())))
    compared = [column for column in columns if column.ratio]
    headings = ["preset", "seeds", *(column.heading for column in columns)]
    headings += [f"{column.heading.partition(' [')[0]} / {base[0].preset}" for column in compared]
    rows = []
    for name, own in by_name.items():
        cells = [_cell(crossed_mean(_outcomes(own, c.field)), c.digits, len(own)) for c in columns]
        for c in compared:
            ratio = crossed_ratio(_outcomes(own, c.field), _outcomes(base, c.field))
            cells.append(_cell(ratio, 2, min(len(own), len(base))))
        rows.append([name, str(len(own)), *cells])
    text = markdown(headings, rows)
    if any(len(own) < 2 for own in by_name.values()):
        text += "\nNo interval where there is one seed: it would not show how much trainings differ.\n"
    return text


def _outcomes(runs: Sequence[ShapingRun], field_name: str) -> FloatArray:
    """A field of the outcomes, shape (runs, plans)."""
    return np.array([[outcome[field_name] for outcome in run.outcomes] for run in runs])


def _cell(interval: Interval, digits: int, seeds: int) -> str:
    return f"{interval.value:.{digits}f}" if seeds < 2 else with_bounds(interval, digits)


def own_term(spec: str, weight: float) -> Term:
    """A function of a :class:`~slamgym.envs.rewards.StepRecord` named as ``module:function``.

    Raises:
        ConfigError: If it can't be imported, or is no function.
    """
    return spec.partition(":")[2], weight, own_function(spec, "--term")


def _write(folder: Path, identity: str, outcomes: Mapping[str, Mapping[str, float]]) -> None:
    write_text(folder / RESULTS, json.dumps({"settings": identity, "outcomes": outcomes}, indent=1) + "\n")


def _read(folder: Path, identity: str) -> dict[str, dict[str, float]]:
    """What was tested of a run, by plan.

    Raises:
        ConfigError: If it was another run.
        InputFileError: If the file is damaged.
    """
    path = folder / RESULTS
    if not path.exists():
        return {}
    try:
        found = from_dict(_Results, read_json(path, "delete it to test that run again"))
    except ConfigError as error:
        raise InputFileError(path, f"is damaged ({error}); delete it to test that run again") from None
    if found.settings != identity:
        raise ConfigError(
            f"{folder} holds a run with other settings (training, particles, term or presets that need the "
            "filter); choose another folder"
        )
    return found.outcomes
