"""Reward-shaping experiments: the same learner with different rewards, over several seeds.

Main path: :func:`run_shaping` trains a driver of the wheels by every preset of an :class:`Experiment`, with every seed,
on a batch of environments, and explores held-out plans with each; :func:`write_shaping_report` sets the
:class:`ShapingRun` records against one another. After an interruption training resumes from its checkpoint, and the
test after its last exploration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.evaluation.evaluate import TrialLog
from slamgym.agents.evaluation.report import with_bounds
from slamgym.agents.evaluation.trial import Trial
from slamgym.agents.plan_splits import draw_plans
from slamgym.agents.rl.environments import explore_plan, figures_of
from slamgym.agents.rl.reward_presets import BASE, OWN, ShapingConfig
from slamgym.agents.rl.train_config import POLICY
from slamgym.cad import FloorPlan
from slamgym.core.config import to_dict
from slamgym.core.documents import json_text, read_json
from slamgym.core.errors import ConfigError
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
"""Says in the folder of a run what its results depend on."""
Term = tuple[str, float, RewardFunction]
"""Name, weight and function of a term of the user's own."""
REPORT = {
    "coverage": ("coverage", 3),
    "contacts": ("contacts in 5 min", 1),
    "path": ("path [m]", 1),
}
"""Heading and digits of the fields of the outcomes in the report; the first is set against the reference's, too."""


@dataclass(frozen=True)
class ShapingRun:
    """One trained policy and how it did."""

    preset: str
    seed: int
    outcomes: list[dict[str, float]]
    """:func:`~slamgym.agents.rl.environments.figures_of` each test plan."""


class Experiment:
    """Training with each preset and seed, and the test of the policies.

    Args:
        config: The experiment.
        learn: :func:`slamgym.agents.rl.wheels.train_wheels`; nothing is avoided, in training or test.
        term: A term of the user's own, for the preset ``own``.
    """

    def __init__(
        self, config: ShapingConfig, learn: Callable[..., Any], term: Term | None = None
    ) -> None:
        self.config = config
        self._learn = learn
        self._term = term

    def _own_term(self, preset: str) -> Term | None:
        """The term of the user's own, where the preset has it."""
        return self._term if preset == OWN else None

    def identity(self, preset: str, seed: int) -> dict[str, Any]:
        """What the results depend on."""
        term = self._own_term(preset)
        settings = to_dict(self.config.settings(preset, seed))
        return {"settings": settings, "term": list(term[:2]) if term else None}

    def learn(self, preset: str, seed: int, folder: Path) -> None:
        """Train, or go on."""
        term = self._own_term(preset)
        reward_terms = None
        if term is not None:
            name, weight, function = term
            reward_terms = {name: (weight, function)}
        settings = self.config.settings(preset, seed)
        self._learn(settings, folder, reward_terms=reward_terms, avoids=False)

    def explore(self, preset: str, seed: int, folder: Path, plan: FloorPlan) -> Trial:
        """Explore a plan with the trained policy; start and noise follow from the plan's id."""
        settings = self.config.settings(preset, seed)
        start = exploration_seed(0, plan.id, 0)
        return explore_plan(settings, folder / POLICY, plan, start, avoids=False)


def run_shaping(experiment: Experiment, out: Path) -> list[ShapingRun]:
    """Train and test every preset with every seed.

    Args:
        experiment: What and how.
        out: Its folder: one folder for each run.

    Raises:
        ConfigError: If the folder holds runs with other settings.
    """
    config = experiment.config
    plans = draw_plans(config.train.plans, "test", config.test_plans)
    return [
        _run_one(experiment, name, seed, out / name / f"seed_{seed}", plans)
        for name in config.presets
        for seed in range(config.seeds)
    ]


def _run_one(
    experiment: Experiment, preset: str, seed: int, folder: Path, plans: Sequence[FloorPlan]
) -> ShapingRun:
    """Train and test one preset with one seed, or what is left of that."""
    own_folder(own_folder(folder.parent) / folder.name)
    identity = experiment.identity(preset, seed)
    path = folder / RESULTS
    if not path.exists():
        write_text(path, json_text(identity))
    elif read_json(path, "delete the folder to begin that run again") != identity:
        raise ConfigError(f"{folder} holds a run with other settings; choose another folder")
    log = TrialLog(folder / "trials.jsonl", Trial)
    trials = {trial.plan: trial for trial in log.trials.values()}
    left = [plan for plan in plans if plan.id not in trials]
    if left:
        say(f"{preset}, seed {seed}")
        experiment.learn(preset, seed, folder)
        with show_progress("test explorations", len(plans) - len(left), len(plans)) as advance:
            for plan in left:
                trial = experiment.explore(preset, seed, folder, plan)
                trials[plan.id] = trial
                log.append(trial)
                advance()
    return ShapingRun(preset, seed, [figures_of(trials[plan.id]) for plan in plans])


def write_shaping_report(runs: Sequence[ShapingRun], out: Path) -> str:
    """Write ``shaping.md``; returns it."""
    text = table(runs)
    write_text(out / "shaping.md", text)
    return text


def table(runs: Sequence[ShapingRun]) -> str:
    """Means over seeds and plans with 95 % intervals, and what is set against the preset ``coverage``.

    Both are drawn again for an interval (:func:`slamgym.core.intervals.crossed_ratio`), so it holds for other plans
    and other seeds of the training. With one seed there is none: other plans alone would make it too narrow.
    """
    by_name: dict[str, list[ShapingRun]] = {}
    for run in runs:
        by_name.setdefault(run.preset, []).append(run)
    base = by_name.get(BASE, next(iter(by_name.values())))
    first, (heading, _) = next(iter(REPORT.items()))
    headings = [
        "preset",
        "seeds",
        *(column for column, _ in REPORT.values()),
        f"{heading} / {base[0].preset}",
    ]
    rows = []
    for name, own in by_name.items():
        cells = [
            _cell(crossed_mean(_outcomes(own, f)), digits, len(own))
            for f, (_, digits) in REPORT.items()
        ]
        ratio = crossed_ratio(_outcomes(own, first), _outcomes(base, first))
        rows.append([name, str(len(own)), *cells, _cell(ratio, 2, min(len(own), len(base)))])
    text = markdown(headings, rows)
    if any(len(own) < 2 for own in by_name.values()):
        text += (
            "\nNo interval where there is one seed: it would not show how much trainings differ.\n"
        )
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
