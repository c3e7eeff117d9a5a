"""The figures of an evaluation: every explorer on its own, and paired against a reference.

Times and paths to a coverage level are *censored*: where it wasn't reached, the time is the plan's time limit, and the
path what the robot would have driven until then at its mean speed, which punishes giving up. So are they in ratios of
means. Beside each stands the ratio over the explorations in which both explorers reached the level, which says how
fast, not how surely, and how many these are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from slamgym.agents.evaluation.coverage_curve import COVERAGE_LEVELS
from slamgym.agents.evaluation.trial import SUCCESS_COVERAGE, Trial, level_name
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.core.intervals import Interval, mean_interval, ratio_of_means
from slamgym.core.types import FloatArray

DONE = "done"
"""The level of an exploration that has succeeded, next to the shares of the floor."""

TAIL_FROM = "0.99"
"""The drive after this level is an explorer's tail."""


SHARES = (*map(level_name, COVERAGE_LEVELS), DONE)
"""Shares of the floor, and the end: what explorers are compared at."""

Quantity = Literal["time", "path"]
"""What it takes to reach a level: time [s] or path [m]."""

_Figure = Callable[[Trial], float]
"""A figure of a trial."""


@dataclass(frozen=True)
class ExplorerSummary:
    """One explorer on all plans."""

    explorer: str
    trials: int
    reached: dict[str, float]
    """Level to the share of explorations that reached it."""
    time_to: dict[str, Interval]
    """Level to the censored time [s]."""
    path_to: dict[str, Interval]
    """Level to the censored path [m]."""
    mean_coverage: Interval
    """Area under the coverage curve, as a share of the most possible."""
    coverage: Interval
    """At the end."""
    success: Interval
    """Share of explorations that succeeded."""
    collisions: Interval
    """Contacts per exploration."""
    map_error: Interval
    """[m]"""
    ate: Interval
    """[m]"""
    time: Interval
    """Until the explorer was done or the time up [s]."""
    path: Interval
    """[m]"""
    tail: Interval | None
    """From 99 % seen until done, over the explorations that succeeded [s]; None if none did."""
    decision_ms: float
    """Mean CPU time of a control step with a decision [ms]."""


@dataclass(frozen=True)
class LevelComparison:
    """An explorer against the reference, time or path to one level."""

    ratio: Interval | None
    """Of the censored means; None if the reference had every level from the first scan on."""
    both: int
    """Pairs in which both reached the level."""
    where_both: Interval | None
    """Ratio of means over these; None if there are none."""


@dataclass(frozen=True)
class Comparison:
    """An explorer against the reference."""

    explorer: str
    reference: str
    time_to: dict[str, LevelComparison]
    """By level."""
    path_to: dict[str, LevelComparison]
    map_error: Interval | None
    """Ratio of the means; None where the reference has no error."""


@dataclass(frozen=True)
class Summary:
    """All of it."""

    explorers: tuple[ExplorerSummary, ...]
    comparisons: tuple[Comparison, ...]
    """With the reference."""
    plans: int


def summarise_trials(trials: Sequence[Trial], against: str) -> Summary:
    """Measure explorers and compare them with one of them.

    Args:
        trials: Of all explorers on the same plans and seeds.
        against: Name of the reference explorer.

    Raises:
        ConfigError: If the reference is not among the explorers, or there are no trials.
    """
    names = list(dict.fromkeys(trial.explorer for trial in trials))
    if against not in names:
        raise ConfigError(f"no trials of the reference {against!r}; {suggest(against, names)}")
    by_name: dict[str, dict[tuple[str, int], Trial]] = {name: {} for name in names}
    for trial in trials:
        by_name[trial.explorer][trial.plan, trial.seed] = trial
    shared = [pair for pair in by_name[against] if all(pair in found for found in by_name.values())]
    if not shared:
        raise ConfigError("the explorers share no exploration")
    aligned = {name: [found[pair] for pair in shared] for name, found in by_name.items()}
    return Summary(
        tuple(_summary(name, aligned[name]) for name in names),
        tuple(compare(aligned[name], aligned[against]) for name in names if name != against),
        len({plan for plan, _ in shared}),
    )


def compare(trials: Sequence[Trial], reference: Sequence[Trial]) -> Comparison:
    """Compare two explorers on the same explorations.

    Args:
        trials: One of each pair of plan and seed.
        reference: The same pairs in the same order.
    """
    return Comparison(
        explorer=trials[0].explorer,
        reference=reference[0].explorer,
        time_to={level: _compare_level(trials, reference, "time", level) for level in SHARES},
        path_to={level: _compare_level(trials, reference, "path", level) for level in SHARES},
        map_error=_map_error_ratio(trials, reference),
    )


def _map_error_ratio(trials: Sequence[Trial], reference: Sequence[Trial]) -> Interval | None:
    """Ratio of the mean errors of the map; None where the reference has none."""
    ours = _by_plan(trials, lambda trial: trial.map_error)
    theirs = _by_plan(reference, lambda trial: trial.map_error)
    return ratio_of_means(ours, theirs) if theirs.any() else None


def succeeded(trial: Trial) -> bool:
    """True if the explorer ended by itself with :data:`SUCCESS_COVERAGE` seen."""
    return trial.finished and trial.coverage >= SUCCESS_COVERAGE


def reached_at(trial: Trial, quantity: Quantity, level: str) -> float | None:
    """Time [s] or path [m] to a level, :data:`DONE` too; None where it wasn't reached."""
    at_end = trial.time if quantity == "time" else trial.path
    if level == DONE:
        return float(at_end) if succeeded(trial) else None
    value = (trial.time_to if quantity == "time" else trial.path_to)[level]
    return None if value is None else float(value)


def censored(trial: Trial, quantity: Quantity, level: str) -> float:
    """Time [s] or path [m] to a level; where it wasn't reached, what the time limit makes of it."""
    value = reached_at(trial, quantity, level)
    if value is not None:
        return value
    if quantity == "time":
        return trial.time_limit
    speed = trial.path / trial.time if trial.time > 0.0 else 0.0
    return trial.path + speed * max(0.0, trial.time_limit - trial.time)


def tail(trial: Trial) -> float:
    """Time from :data:`TAIL_FROM` until done [s]; 0 for one that stopped before."""
    reached = trial.time_to[TAIL_FROM]
    return 0.0 if reached is None else max(0.0, trial.time - reached)


def _by_plan(trials: Sequence[Trial], figure: _Figure) -> FloatArray:
    """Mean of a figure on each plan, shape (plans,): repetitions on one plan are no independent draws."""
    by_plan: dict[str, list[float]] = {}
    for trial in trials:
        by_plan.setdefault(trial.plan, []).append(figure(trial))
    return np.array([np.mean(values) for values in by_plan.values()])


def _compare_level(
    trials: Sequence[Trial], reference: Sequence[Trial], quantity: Quantity, level: str
) -> LevelComparison:
    # A level that the very first scan shows takes no time, which has no ratio.
    pairs = [
        (one, other)
        for one, other in zip(trials, reference, strict=True)
        if censored(other, quantity, level) > 0.0
    ]
    both = [
        pair for pair in pairs if None not in [reached_at(one, quantity, level) for one in pair]
    ]
    return LevelComparison(
        ratio=_ratio(pairs, quantity, level),
        both=len(both),
        where_both=_ratio(both, quantity, level),
    )


def _ratio(pairs: Sequence[tuple[Trial, Trial]], quantity: Quantity, level: str) -> Interval | None:
    """Ratio of the censored means of the first of pairs and the second; None without pairs."""
    if not pairs:
        return None
    ours, theirs = (
        _by_plan(trials, lambda trial: censored(trial, quantity, level))
        for trials in zip(*pairs, strict=True)
    )
    return ratio_of_means(ours, theirs)


def _summary(name: str, trials: Sequence[Trial]) -> ExplorerSummary:
    def mean(figure: _Figure) -> Interval:
        return mean_interval(_by_plan(trials, figure))

    def mean_to(quantity: Quantity, level: str) -> Interval:
        return mean(lambda trial: censored(trial, quantity, level))

    def share_reached(level: str) -> float:
        return float(np.mean([reached_at(trial, "time", level) is not None for trial in trials]))

    successes = [trial for trial in trials if succeeded(trial)]
    decision_cpu = float(np.mean([trial.decision_cpu for trial in trials]))
    return ExplorerSummary(
        explorer=name,
        trials=len(trials),
        reached={level: share_reached(level) for level in SHARES},
        time_to={level: mean_to("time", level) for level in SHARES},
        path_to={level: mean_to("path", level) for level in SHARES},
        mean_coverage=mean(lambda trial: trial.mean_coverage),
        coverage=mean(lambda trial: trial.coverage),
        success=mean(succeeded),
        collisions=mean(lambda trial: trial.collisions),
        map_error=mean(lambda trial: trial.map_error),
        ate=mean(lambda trial: trial.ate),
        time=mean(lambda trial: trial.time),
        path=mean(lambda trial: trial.path),
        tail=mean_interval(_by_plan(successes, tail)) if successes else None,
        decision_ms=1e3 * decision_cpu,
    )
