"""Reward-shaping experiments: the same learner with different rewards, over several seeds.

Main path: :func:`run_shaping` trains every preset with every seed, explores held-out plans with each policy, and hands
the :class:`ShapingRun` records to :mod:`slamgym.agents.rl.shaping_report`. What is trained and measured is an
:class:`Experiment`: :mod:`slamgym.agents.rl.decision_shaping` chooses frontiers, :mod:`slamgym.agents.wheels.shaping`
drives the wheels. Training goes on from its checkpoint after an interruption, and the test from its last exploration:
``shaping.json`` in the folder of a run is written again, whole, after each.
"""

from __future__ import annotations

import contextlib
import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from slamgym.core.config import config_hash, from_dict, to_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import own_folder, read_text, write_text
from slamgym.core.progress import say, show_progress

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan

FEW_SEEDS = 3
"""Intervals over fewer trainings say little."""

RESULTS = "shaping.json"

_SettingsT = TypeVar("_SettingsT")
_OutcomeT = TypeVar("_OutcomeT")


@dataclass(frozen=True)
class ShapingRun(Generic[_OutcomeT]):
    """One trained policy and how it did."""

    preset: str
    seed: int
    curve: list[
        tuple[float, float]
    ]  # (steps, mean of what the experiment logs of the training's latest episodes)
    outcomes: list[_OutcomeT]  # one of each test plan


class Experiment(ABC, Generic[_SettingsT, _OutcomeT]):
    """What is trained with each preset and seed, and how a policy is tested."""

    presets: tuple[str, ...]
    seeds: int
    outcome: ClassVar[type]
    """A dataclass: what is known of an exploration."""
    curve: ClassVar[str]
    """Column of the training's log that the learning curves show."""

    @abstractmethod
    def test_plans(self) -> Sequence[FloorPlan]:
        """Held-out plans that every policy explores."""

    @abstractmethod
    def settings(self, preset: str, seed: int) -> _SettingsT:
        """The training run of a preset and a seed."""

    @abstractmethod
    def identity(self, preset: str, seed: int) -> Any:
        """What a run's results depend on, and by which they are known again."""

    @abstractmethod
    def learn(self, preset: str, seed: int, folder: Path) -> None:
        """Train, or go on."""

    @abstractmethod
    def explore(
        self, preset: str, seed: int, folder: Path, plans: Sequence[FloorPlan]
    ) -> Iterator[tuple[FloorPlan, _OutcomeT]]:
        """Explore plans with the trained policy; whatever the other plans, a plan's outcome is the same."""


def run_shaping(experiment: Experiment[Any, _OutcomeT], out: Path) -> list[ShapingRun[_OutcomeT]]:
    """Train and test every preset with every seed.

    Args:
        experiment: What and how.
        out: Its folder: one folder for each run.

    Raises:
        ConfigError: If the folder holds runs with other settings.
    """
    plans = experiment.test_plans()
    return [
        _run_one(experiment, name, seed, out / name / f"seed_{seed}", plans)
        for name in experiment.presets
        for seed in range(experiment.seeds)
    ]


def _run_one(
    experiment: Experiment[Any, _OutcomeT], preset: str, seed: int, folder: Path, plans: Sequence[FloorPlan]
) -> ShapingRun[_OutcomeT]:
    """Train and test one preset with one seed, or what is left of that."""
    identity = config_hash(experiment.identity(preset, seed))
    outcomes: dict[str, _OutcomeT] = _read(folder, identity, experiment.outcome)
    left = [plan for plan in plans if plan.id not in outcomes]
    if left:
        say(f"{preset}, seed {seed}")
        own_folder(own_folder(folder.parent) / folder.name)
        _write(folder, identity, outcomes)  # before the training: a term's weight stands nowhere else
        experiment.learn(preset, seed, folder)
        with show_progress("test explorations", len(plans) - len(left), len(plans)) as advance:
            for plan, outcome in experiment.explore(preset, seed, folder, left):
                outcomes[plan.id] = outcome
                _write(folder, identity, outcomes)
                advance()
    curve = read_curve(folder, experiment.curve)
    return ShapingRun(preset, seed, curve, [outcomes[plan.id] for plan in plans])


def read_curve(folder: Path, column: str) -> list[tuple[float, float]]:
    """Steps, and a column of the training's log then, mean over the latest hundred episodes."""
    rows = []
    for path in sorted(folder.glob("log/*/progress.csv")):
        lines = read_text(path).splitlines()
        if not lines:
            continue
        names = lines[0].split(",")
        for line in lines[1:]:
            row = dict(zip(names, line.split(","), strict=False))
            if row.get(column) and row.get("time/total_timesteps"):
                with contextlib.suppress(ValueError):  # a killed run may leave half a line
                    rows.append((float(row["time/total_timesteps"]), float(row[column])))
    return rows


def _write(folder: Path, identity: str, outcomes: Mapping[str, Any]) -> None:
    document = {"settings": identity, "outcomes": {plan: to_dict(o) for plan, o in outcomes.items()}}
    write_text(folder / RESULTS, json.dumps(document, indent=1) + "\n")


def _read(folder: Path, identity: str, kind: type[_OutcomeT]) -> dict[str, _OutcomeT]:
    """What was tested of a run, by plan.

    Raises:
        ConfigError: If it was another run.
        InputFileError: If the file is damaged.
    """
    path = folder / RESULTS
    if not path.exists():
        return {}
    document = read_json(path, "delete it to test that run again")
    try:
        found = str(document["settings"])
        outcomes = {plan: from_dict(kind, values) for plan, values in document["outcomes"].items()}
    except (KeyError, TypeError, AttributeError, ConfigError) as error:
        raise InputFileError(path, f"is damaged ({error}); delete it to test that run again") from None
    if found != identity:
        raise ConfigError(
            f"{folder} holds a run with other settings (training, particles, term or presets that need the "
            "filter); choose another folder"
        )
    return outcomes
