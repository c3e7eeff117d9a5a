"""Reward-shaping experiments: the same learner with different rewards, over several seeds.

Main path: :func:`run_shaping` trains a driver of the wheels, or a policy that chooses frontiers, by every preset of an
:class:`Experiment`, with every seed, and explores held-out plans with each; :func:`write_shaping_report` sets the
:class:`ShapingRun` records against one another. After an interruption training resumes from its checkpoint, and the
test after its last exploration.
"""

from __future__ import annotations

import itertools
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.agents.evaluation.evaluate import TrialLog
from slamgym.agents.evaluation.report import with_bounds
from slamgym.agents.evaluation.trial import Trial
from slamgym.agents.plan_splits import draw_plans
from slamgym.agents.rl.environments import explore_plan, figures_of
from slamgym.agents.rl.reward_presets import BASE, OWN, ShapingConfig
from slamgym.agents.rl.train_config import POLICY
from slamgym.cad import FloorPlan
from slamgym.core.config import changed_settings, to_dict
from slamgym.core.documents import json_text, read_json
from slamgym.core.errors import ConfigError
from slamgym.core.files import exclusive_lock, own_folder, write_text
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


class Measure(NamedTuple):
    """A figure of the outcomes in the report."""

    heading: str
    digits: int
    better: int
    """1 where more is better, -1 where less is, 0 where that isn't judged."""


REPORT: dict[str, dict[str, Measure]] = {
    "wheels": {
        "coverage": Measure("coverage", 3, 1),
        "contacts": Measure("contacts in 5 min", 1, -1),
        "path": Measure("path [m]", 1, 0),
    },
    "frontiers": {
        "time_done": Measure("time until done [s]", 0, -1),
        "coverage": Measure("coverage", 3, 1),
        "path": Measure("path [m]", 1, 0),
    },
}
"""What the outcomes of each level are judged by; the first is set against the reference's, too."""


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
        learn: :func:`slamgym.agents.rl.wheels.train_wheels`, which avoids nothing in training or test, or
            :func:`slamgym.agents.rl.train.train`.
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
        options = {"avoids": False} if self.config.level == "wheels" else {}
        self._learn(settings, folder, reward_terms=reward_terms, **options)

    def explore(self, preset: str, seed: int, folder: Path, plan: FloorPlan) -> Trial:
        """Explore a plan with the trained policy; start and noise follow from the plan's id."""
        settings = self.config.settings(preset, seed)
        start = exploration_seed(0, plan.id, 0)
        return explore_plan(settings, folder / POLICY, plan, start, avoids=False)


def run_shaping(experiment: Experiment, out: Path, workers: int = 1) -> list[ShapingRun]:
    """Train and test every preset with every seed.

    Args:
        experiment: What and how.
        out: Its folder: one folder for each run.
        workers: So many runs at a time, each in a process.

    Raises:
        ConfigError: If the folder holds runs with other settings.
        StorageError: If another process works in the folder.
    """
    config = experiment.config
    source = config.settings(config.presets[0], 0)
    plans = draw_plans(source.plans, "test", config.test_plans)
    runs = [
        (name, seed, out / name / f"seed_{seed}")
        for name in config.presets
        for seed in range(config.seeds)
    ]
    with exclusive_lock(own_folder(out) / "running.lock"):
        if workers == 1:
            return [_run_one(experiment, *run, plans) for run in runs]
        # Forked: what a term of the user's own was imported from is there, too.
        context = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            waiting = [pool.submit(_run_one, experiment, *run, plans) for run in runs]
            return [one.result() for one in waiting]


def _run_one(
    experiment: Experiment, preset: str, seed: int, folder: Path, plans: Sequence[FloorPlan]
) -> ShapingRun:
    """Train and test one preset with one seed, or what is left of that."""
    own_folder(own_folder(folder.parent) / folder.name)
    identity = experiment.identity(preset, seed)
    path = folder / RESULTS
    if not path.exists():
        write_text(path, json_text(identity))
    else:
        before = read_json(path, "delete the folder to begin that run again")
        changes = changed_settings(before, identity)
        if changes:
            raise ConfigError(
                f"{folder} holds a run with other settings ({changes}); choose another folder"
            )
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


def write_shaping_report(runs: Sequence[ShapingRun], out: Path, level: str = "wheels") -> str:
    """Write ``shaping.md``; returns it."""
    text = table(runs, level) + "\n" + verdicts(runs, level)
    write_text(out / "shaping.md", text)
    return text


def table(runs: Sequence[ShapingRun], level: str = "wheels") -> str:
    """Means over seeds and plans with 95 % intervals, and what is set against the preset ``coverage``.

    Both are drawn again for an interval (:func:`slamgym.core.intervals.crossed_ratio`), so it holds for other plans
    and other seeds of the training. With one seed there is none: other plans alone would make it too narrow.
    """
    measures = REPORT[level]
    by_name = _by_preset(runs)
    base = by_name.get(BASE, next(iter(by_name.values())))
    first, measure = next(iter(measures.items()))
    headings = [
        "preset",
        "seeds",
        *(one.heading for one in measures.values()),
        f"{measure.heading} / {base[0].preset}",
    ]
    rows = []
    for name, own in by_name.items():
        cells = [
            _cell(crossed_mean(_outcomes(own, f)), one.digits, len(own))
            for f, one in measures.items()
        ]
        ratio = crossed_ratio(_outcomes(own, first), _outcomes(base, first))
        rows.append([name, str(len(own)), *cells, _cell(ratio, 2, min(len(own), len(base)))])
    text = markdown(headings, rows)
    if any(len(own) < 2 for own in by_name.values()):
        text += (
            "\nNo interval where there is one seed: it would not show how much trainings differ.\n"
        )
    return text


def verdicts(runs: Sequence[ShapingRun], level: str = "wheels") -> str:
    """For each pair of presets whether the first is better, worse, or it can't be told, by each measure.

    By the ratio of means on the same plans, as in :func:`table`: told where its interval lies on one side of 1.
    """
    by_name = _by_preset(runs)
    judged = {name: one for name, one in REPORT[level].items() if one.better}
    rows = []
    for (name, own), (other_name, other) in itertools.combinations(by_name.items(), 2):
        cells = []
        for key, measure in judged.items():
            cells.append(_verdict(_outcomes(own, key), _outcomes(other, key), measure.better))
        rows.append([f"{name} / {other_name}", *cells])
    return markdown(["pair", *(one.heading for one in judged.values())], rows) if rows else ""


def _verdict(own: FloatArray, other: FloatArray, better: int) -> str:
    """What can be said of a pair, shapes (runs, plans)."""
    if min(len(own), len(other)) < 2 or not other.any():
        return "can't be told"
    ratio = crossed_ratio(own, other)
    if not np.isfinite([ratio.low, ratio.high]).all():  # in some draws the other has none
        return "can't be told"
    side = (ratio.low > 1.0) - (ratio.high < 1.0)
    word = {1: "better", -1: "worse", 0: "can't be told"}[better * side]
    return f"{word}: {with_bounds(ratio, 2)}"


def _by_preset(runs: Sequence[ShapingRun]) -> dict[str, list[ShapingRun]]:
    by_name: dict[str, list[ShapingRun]] = {}
    for run in runs:
        by_name.setdefault(run.preset, []).append(run)
    return by_name


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
