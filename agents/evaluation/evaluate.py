"""Explorers on the same plans, starts and seeds; what is done already is not done again.

Trials are kept as one JSON object a line. A line is written with one call and synced, so a kill loses at most the
explorations in flight; a line that was cut short is dropped when the file is opened again.
"""

import contextlib
import dataclasses
import functools
import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from slamgym.agents.evaluation.team_trial import TeamName, run_team_trial
from slamgym.agents.evaluation.trial import (
    ORACLE,
    FailedTrial,
    Key,
    Task,
    Trial,
    TrialConfig,
    bound_trial,
    explorer_in,
    run_trial,
    trial_hash,
)
from slamgym.agents.plan_splits import PlanSplit, ids_of
from slamgym.cad import FloorPlan, PlanSource, check_plan
from slamgym.cad.plan_filter import PlanFilter, passes
from slamgym.core.config import Count, Seed, Settings, from_dict, to_dict
from slamgym.core.documents import json_text, parse_json
from slamgym.core.errors import ConfigError, InputFileError, PlanError
from slamgym.core.files import (
    append_line,
    byte_lines,
    drop_torn_line,
    exclusive_lock,
    replace_file,
    require_file,
    storage_errors,
)
from slamgym.core.names import exploration_seed, shuffled
from slamgym.core.parallel.backlog import Lost, tried
from slamgym.core.parallel.engine import Execution, try_out
from slamgym.core.progress import show_progress
from slamgym.envs import ExploreEnv
from slamgym.envs.warmup import compile_for

_Entry = TypeVar("_Entry", Trial, FailedTrial)


class TrialLog(Generic[_Entry]):
    """The trials in a file, or those that failed.

    Args:
        path: The file; made with the first trial.
        kind: Class of its entries.

    Raises:
        InputFileError: If the file holds something else than trials.
    """

    def __init__(self, path: Path, kind: type[_Entry]) -> None:
        self.path = path
        self.trials: dict[Key, _Entry] = {}
        if path.exists():
            require_file(path)
            drop_torn_line(path)
            for line, where in byte_lines(path):
                try:
                    trial = from_dict(kind, parse_json(line, where))
                except (InputFileError, ConfigError, ValueError) as error:
                    raise InputFileError(
                        where, f"is no trial of this version ({error}); move the file away"
                    ) from error
                self.trials[trial.key] = trial

    def append(self, trial: _Entry) -> None:
        """Add a trial and wait until the disk has it.

        Raises:
            StorageError: If it can't be written.
        """
        line = json.dumps(dataclasses.asdict(trial), separators=(",", ":")) + "\n"
        append_line(self.path, line, durable=True)
        self.trials[trial.key] = trial


class EvaluationConfig(Settings):
    """Explorers and the plans that they are evaluated on."""

    explorers: tuple[str, ...]
    """Names of explorers."""
    count: Count = 200
    """Number of plans."""
    split: PlanSplit | None = "test"
    """Split of the plans; None takes all."""
    plans_filter: PlanFilter = "useful"
    """Which plans are worth exploring."""
    repetitions: Count = 1
    """Explorations per plan and explorer, each from another start."""
    seed: Seed = 0
    """Decides which plans, starts and noise."""
    oracle: bool = False
    """Privileged: also plan what one who knows the floor plan would need at least."""
    trial: TrialConfig = field(default_factory=TrialConfig)
    """Settings of each exploration."""

    def _check(self) -> None:
        if not self.names:
            raise ConfigError("name at least one explorer, such as tour")
        if ORACLE in self.explorers:
            raise ConfigError(
                f"{ORACLE} knows the floor plan, so it isn't called by name; set oracle"
            )
        if len(set(self.explorers)) < len(self.explorers):
            raise ConfigError(f"an explorer is named twice in {', '.join(self.explorers)}")

    @property
    def names(self) -> tuple[str, ...]:
        """All explorers, the privileged one too."""
        return (*self.explorers, ORACLE) if self.oracle else self.explorers


class Skipped(NamedTuple):
    """A plan that was left out."""

    plan: str
    reason: str


@dataclass(frozen=True)
class Evaluation:
    """Outcome of an evaluation."""

    trials: list[Trial]
    """Those of the plans and explorers asked for, by explorer in the order asked for, then by plan."""
    skipped: list[Skipped]
    """Plans that can't be explored."""
    failed: list[FailedTrial]
    """Explorations that crashed, hung or failed, now or in an earlier run."""
    fresh: int
    """Number of trials that were done just now; the others had been done before."""


def evaluate(
    source: PlanSource, config: EvaluationConfig, out: Path, execution: Execution = Execution()
) -> Evaluation:
    """Run every explorer on every plan, or what is left of that from an earlier run.

    Args:
        source: Floor plans.
        config: What to evaluate.
        out: Folder of the results: ``trials.jsonl``, ``failed.jsonl``, ``config.json``.
        execution: Where the explorations run.

    Raises:
        ConfigError: If there is no explorer of a name, or no plan passes split and filter.
        StorageError: If the folder can't be written, or another run is at work in it.
        WorkerLostError: If exploration after exploration fails.
    """
    plans, skipped = choose_plans(source, config)
    seeds = range(config.repetitions)
    wanted = [
        Task(name, plan, exploration_seed(config.seed, plan.id, k))
        for plan, k, name in itertools.product(plans, seeds, config.names)
    ]
    evaluation = run_trials(wanted, config, out, execution)
    return dataclasses.replace(evaluation, skipped=skipped)


def run_trials(
    wanted: Sequence[Task], config: EvaluationConfig, out: Path, execution: Execution = Execution()
) -> Evaluation:
    """Run explorations, at least one, by any of the explorers of ``config``; :func:`evaluate` says the rest."""
    workers = max(1, min(execution.workers, len(wanted)))
    with contextlib.ExitStack() as stack:
        pool = stack.enter_context(dataclasses.replace(execution, workers=workers).open())
        hashes = try_out(pool, functools.partial(_hash, config, wanted[0].plan), config.names)
        with storage_errors(out):
            out.mkdir(parents=True, exist_ok=True)
        stack.enter_context(exclusive_lock(out / ".lock"))
        log = TrialLog(out / "trials.jsonl", Trial)
        failures = TrialLog(out / "failed.jsonl", FailedTrial)
        over = log.trials.keys() | failures.trials.keys()
        tasks = [task for task in wanted if _key(task, hashes) not in over]
        with storage_errors(out):
            replace_file(out / "config.json", json_text(to_dict(config)).encode())
        if tasks:
            compile_for(config.trial.env, execution)
        advance = stack.enter_context(
            show_progress("explorations", len(wanted) - len(tasks), len(wanted))
        )
        explore = functools.partial(_explore, config)
        for outcome in pool.run(functools.partial(tried, explore), tasks):
            if isinstance(outcome, Lost):
                failures.append(_failed(outcome, hashes))
            else:
                log.append(outcome)
            advance()
    order = sorted(wanted, key=lambda task: config.names.index(task.explorer))
    keys = [_key(task, hashes) for task in order]
    return Evaluation(
        trials=[log.trials[key] for key in keys if key in log.trials],
        skipped=[],
        failed=[failures.trials[key] for key in keys if key in failures.trials],
        fresh=len(tasks),
    )


def choose_plans(
    source: PlanSource, config: EvaluationConfig
) -> tuple[list[FloorPlan], list[Skipped]]:
    """The first plans in the seed's order that belong to the split, pass the filter and can be explored.

    Returns:
        The plans, and those that were skipped because the robot can't explore them.

    Raises:
        ConfigError: If there is none.
    """
    ids = source.ids if config.split is None else ids_of(source.ids, config.split)
    if not ids:
        raise ConfigError(
            f"none of the {len(source)} plans belongs to the split {config.split!r}; give more plans, or take all"
        )
    env = config.trial.env
    plans: list[FloorPlan] = []
    skipped: list[Skipped] = []
    for plan_id in shuffled(ids, config.seed):
        try:
            plan = source.load(plan_id)
            if not passes(plan, config.plans_filter):
                continue
            check_plan(plan, env.robot.radius, env.observation.largest_extent)
        except PlanError as error:
            skipped.append(Skipped(plan_id, error.reason))
            continue
        plans.append(plan)
        if len(plans) == config.count:
            break
    if not plans:
        first = f" (the first, {skipped[0].plan}: {skipped[0].reason})" if skipped else ""
        raise ConfigError(
            f"no plan can be used: of {len(ids)}, {len(skipped)} can't be explored by this robot{first}, the "
            f"filter {config.plans_filter!r} left out the others"
        )
    return plans, skipped


def _key(task: Task, hashes: dict[str, str]) -> Key:
    return Key(task.explorer, task.plan.id, task.seed, hashes[task.explorer])


def _failed(lost: Lost, hashes: dict[str, str]) -> FailedTrial:
    key = _key(lost.item, hashes)
    return FailedTrial(key.explorer, key.plan, key.seed, key.settings, lost.error, lost.reason)


def _hash(config: EvaluationConfig, plan: FloorPlan, name: str) -> str:
    """Settings hash of an explorer; finds a wrong name or unfit weights before any work is done."""
    if name == ORACLE:
        return trial_hash(config.trial, ORACLE)
    env = ExploreEnv(plan, config.trial.env)
    explorer = TeamName.read(name).explorer
    return trial_hash(config.trial, explorer_in(env, explorer, config.trial).fingerprint)


def _explore(config: EvaluationConfig, task: Task) -> Trial:
    """One task; runs in a worker."""
    if task.explorer == ORACLE:
        return bound_trial(task, config.trial)
    if TeamName.read(task.explorer).robots > 1:
        return run_team_trial(task, config.trial)
    return run_trial(task, config.trial)
