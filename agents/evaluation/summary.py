"""The figures of an evaluation: every explorer on its own, and paired against a reference.

Means of times and paths to a coverage level are *censored*: where it wasn't reached, the time is the plan's time limit,
and the path what the robot would have driven until then at its mean speed, which punishes giving up. Ratios are over
the explorations in which both explorers reached the level: they say how fast, not how surely, so with each stands how
many these are.
"""

import functools
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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

    both: int
    """Pairs in which both reached the level."""
    ratio_of_means: Interval | None
    """Over the pairs in which both reached it; None if there are none."""


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
    by_name = {name: {(t.plan, t.seed): t for t in trials if t.explorer == name} for name in names}
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
    time_to, path_to = (
        {level: _compare_level(trials, reference, quantity, level) for level in SHARES}
        for quantity in ("time", "path")
    )
    ours, theirs = (_by_plan(found, _FIGURES["map_error"]) for found in (trials, reference))
    map_error = ratio_of_means(ours, theirs) if theirs.any() else None
    return Comparison(trials[0].explorer, reference[0].explorer, time_to, path_to, map_error)


def succeeded(trial: Trial) -> bool:
    """True if the explorer ended by itself with :data:`SUCCESS_COVERAGE` seen."""
    return trial.finished and trial.coverage >= SUCCESS_COVERAGE


def reached_at(trial: Trial, quantity: str, level: str) -> float | None:
    """Time [s] or path [m] to a level, :data:`DONE` too; None where it wasn't reached."""
    if level == DONE:
        return float(getattr(trial, quantity)) if succeeded(trial) else None
    value = getattr(trial, f"{quantity}_to")[level]
    return None if value is None else float(value)


def censored(trial: Trial, quantity: str, level: str) -> float:
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


_FIGURES: dict[str, _Figure] = {
    name: operator.attrgetter(name)
    for name in ("mean_coverage", "coverage", "collisions", "map_error", "ate", "time", "path")
} | {"success": succeeded}
"""Figures that are averaged for each explorer."""


def _by_plan(trials: Sequence[Trial], figure: _Figure) -> FloatArray:
    """Mean of a figure on each plan, shape (plans,): repetitions on one plan are no independent draws."""
    found: dict[str, list[float]] = {}
    for trial in trials:
        found.setdefault(trial.plan, []).append(figure(trial))
    return np.array([np.mean(values) for values in found.values()])


def _compare_level(
    trials: Sequence[Trial], reference: Sequence[Trial], quantity: str, level: str
) -> LevelComparison:
    reached = [
        i
        for i, (one, other) in enumerate(zip(trials, reference, strict=True))
        if reached_at(one, quantity, level) is not None
        # A level that the very first scan shows takes no time, which has no ratio.
        and (reached_at(other, quantity, level) or 0.0) > 0.0
    ]
    ratio = None
    if reached:
        figure = functools.partial(censored, quantity=quantity, level=level)
        ours, theirs = (
            _by_plan([found[i] for i in reached], figure) for found in (trials, reference)
        )
        ratio = ratio_of_means(ours, theirs)
    return LevelComparison(len(reached), ratio)


def _summary(name: str, trials: Sequence[Trial]) -> ExplorerSummary:
    def mean(figure: _Figure) -> Interval:
        return mean_interval(_by_plan(trials, figure))

    def to_levels(quantity: str) -> dict[str, Interval]:
        return {
            level: mean(functools.partial(censored, quantity=quantity, level=level))
            for level in SHARES
        }

    reached = {
        level: float(np.mean([reached_at(t, "time", level) is not None for t in trials]))
        for level in SHARES
    }
    successes = [trial for trial in trials if succeeded(trial)]
    return ExplorerSummary(
        explorer=name,
        trials=len(trials),
        reached=reached,
        time_to=to_levels("time"),
        path_to=to_levels("path"),
        tail=mean_interval(_by_plan(successes, tail)) if successes else None,
        decision_ms=1e3 * float(np.mean([t.decision_cpu for t in trials])),
        **{name: mean(figure) for name, figure in _FIGURES.items()},
    )
