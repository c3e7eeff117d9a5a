"""``slamgym agents evaluate``: explorers on the same plans, starts and seeds."""

from __future__ import annotations

import sys
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from slamgym.agents.registry import EXPLORERS
from slamgym.cad.plan_filter import PlanFilter
from slamgym.commands.exploration_options import ExplorationOptions
from slamgym.commands.extras import Extra, require
from slamgym.core.config import Arguments, Count, CountOrZero, Positive
from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import TASK_TIMEOUT, available_cores
from slamgym.core.parallel.engine import Execution
from slamgym.core.progress import counted, say, tell

if TYPE_CHECKING:
    from slamgym.agents.evaluation.evaluate import EvaluationConfig
    from slamgym.agents.plan_splits import PlanSplit
    from slamgym.cad.plan_index import PlanSource

OFFICES = "offices"


class EvaluateArguments(Arguments):
    """Compare explorers on the same floor plans, starts and noise.

    Every exploration runs until the explorer is done or the time limit is over. What is done is kept in
    ``trials.jsonl``: after Ctrl-C or a kill the same command goes on, and with more plans or explorers it does
    only what is new. Tables are printed and written to ``results.md`` and ``results.json``.
    """

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the results; made if it is missing, continued if it is there."""
    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them; also ``offices`` or ``offices:SEED``, generated offices
    with loops."""
    count: Count = 200
    """Number of plans, drawn by the seed."""
    split: Literal["test", "validation", "train", "all"] = "test"
    """Plans by their ids: ``test`` plans were never trained on."""
    plans_filter: PlanFilter = "useful"
    """``useful`` takes plans that are worth exploring; ``none`` all."""
    explorers: str = ",".join(EXPLORERS)
    """Names of explorers, with commas between them."""
    against: str = ""
    """The reference explorer, one of them; by default ``explore_lite``, or the first where it is not among them."""
    oracle: bool = False
    """Privileged: also plan what one who knows the floor plan would need at least, for each share of the floor."""
    oracle_budget: Count = 100
    """How often its tour for each share is taken apart and put together again."""
    promise: str = "98%:95%"
    """Explorers stop once the map keeps it: so much seen, and how sure that is; also ``2m2:90%`` for what may be left.
    ``none``: when nothing is left to try. `explore_lite` ends as its source does."""
    repetitions: Count = 1
    """Explorations of each plan by every explorer, each from another start."""
    minutes: Literal["auto"] | Positive = "auto"
    """Limit of robot time [min]; ``auto`` grows with the floor area."""
    workers: CountOrZero = 0
    """Processes; 0 takes one per core."""
    task_timeout: Positive = TASK_TIMEOUT
    """Longest wall time of an exploration [s]; one that hangs is ended and noted in ``failed.jsonl``."""
    plot: bool = True
    """Draw ``coverage_over_time.png`` (needs matplotlib, which the extra ``agents`` has)."""
    film: str = ""
    """Two explorers with a comma between them: film them side by side on the plan on which the first gains
    most over the second, as ``film.mp4``."""
    film_plan: str = ""
    """Id of the plan to film instead."""
    exploration: Annotated[ExplorationOptions, tyro.conf.arg(name="")] = field(
        default_factory=ExplorationOptions
    )
    """Robot, sensors, SLAM, furniture and people."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(EvaluateArguments, args=argv, prog="slamgym agents evaluate")
    from slamgym.agents.evaluation.evaluate import evaluate
    from slamgym.agents.evaluation.report import write_report

    if arguments.plot:
        require(Extra("agents", ("matplotlib",)), "--plot (or give --no-plot)")
    config = evaluation_config(arguments)
    filmed = _filmed(arguments, config)
    source = open_source(arguments.plans)
    evaluation = evaluate(
        source,
        config,
        arguments.out,
        Execution(arguments.workers or available_cores(), task_timeout=arguments.task_timeout),
    )
    if evaluation.skipped:
        say(f"skipped {counted(len(evaluation.skipped), 'plan')}, the first: {evaluation.skipped[0].reason}")
    if evaluation.failed:
        say(
            f"{counted(len(evaluation.failed), 'exploration')} crashed, hung or failed; "
            f"{arguments.out / 'failed.jsonl'} says which"
        )
    sys.stdout.write(write_report(arguments.out, evaluation, config, _reference(arguments.against, config)))
    if arguments.plot:
        from slamgym.agents.evaluation.report import draw_coverage

        path = arguments.out / "coverage_over_time.png"
        draw_coverage(evaluation.trials, path)
        tell(f"plot: {path}")
    if filmed:
        from slamgym.agents.evaluation.side_by_side_video import film_side_by_side

        path = arguments.out / "film.mp4"
        film_side_by_side(source, evaluation.trials, filmed, config.trial, path, arguments.film_plan or None)
        tell(f"film: {path}")
    return 0


def evaluation_config(arguments: EvaluateArguments) -> EvaluationConfig:
    """The settings, with the short options put in their places.

    Raises:
        ConfigError: If a setting makes no sense, or the reference is not among the explorers.
    """
    from slamgym.agents.evaluation.evaluate import EvaluationConfig
    from slamgym.agents.evaluation.trial import TrialConfig
    from slamgym.agents.oracle import OracleConfig
    from slamgym.planning.promise import Promise

    explorers = tuple(name.strip() for name in arguments.explorers.split(",") if name.strip())
    promise = None if arguments.promise == "none" else Promise.parse(arguments.promise)
    split: PlanSplit | None = None if arguments.split == "all" else arguments.split
    env = arguments.exploration.env()
    config = EvaluationConfig(
        explorers=explorers,
        count=arguments.count,
        split=split,
        plans_filter=arguments.plans_filter,
        repetitions=arguments.repetitions,
        seed=arguments.exploration.seed,
        oracle=arguments.oracle,
        bound=OracleConfig(iterations=arguments.oracle_budget),
        trial=TrialConfig(arguments.minutes, promise, env),
    )
    _reference(arguments.against, config)
    return config


def _reference(against: str, config: EvaluationConfig) -> str:
    """The reference explorer.

    Raises:
        ConfigError: If it is not among the explorers.
    """
    if not against:
        return "explore_lite" if "explore_lite" in config.names else config.names[0]
    if against not in config.names:
        raise ConfigError(f"--against {against} is not among the explorers {', '.join(config.names)}; add it")
    return against


def open_source(spec: str) -> PlanSource:
    """Plans as :func:`slamgym.cad.open_plans` opens them, or generated offices."""
    from slamgym.cad import open_plans
    from slamgym.cad.generator import PlanGeneratorConfig
    from slamgym.cad.sources import generated_plans

    name, _, seed = spec.partition(":")
    if name != OFFICES:
        return open_plans(spec)
    if seed and not (seed.isascii() and seed.isdigit()):
        raise ConfigError(f"the seed in {spec!r} must be a whole number, as in 'offices:7'")
    return generated_plans(int(seed or 0), PlanGeneratorConfig(kind="office"), name="office")


def _filmed(arguments: EvaluateArguments, config: EvaluationConfig) -> tuple[str, str] | None:
    """The two explorers to film, checked before any work is done."""
    if not arguments.film:
        if arguments.film_plan:
            raise ConfigError("--film-plan needs --film with two explorers")
        return None
    names = [name.strip() for name in arguments.film.split(",")]
    if len(names) != 2 or names[0] == names[1] or any(name not in config.explorers for name in names):
        raise ConfigError(
            f"--film {arguments.film} must name two of the explorers {', '.join(config.explorers)}, with a comma"
        )
    return names[0], names[1]
