"""One exploration by one explorer, run to its end and measured against the truth."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from slamgym.agents.evaluation.coverage_curve import COVERAGE_LEVELS, CoverageCurve, horizon
from slamgym.agents.oracle import bound_exploration
from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.config import Counted, Measured, Positive, Settings, Share, config_hash, to_dict
from slamgym.core.types import Explorer, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps, explored_env, fitted_env
from slamgym.metrics import absolute_trajectory_error
from slamgym.planning.context import ExplorerContext
from slamgym.planning.promise import Promise

SUCCESS_COVERAGE = 0.98
"""An exploration succeeds if the explorer ends it by itself, in time, with so much seen."""

ORACLE = "oracle"
"""Name of the bound among the explorers: the best drive known for one who knows the floor plan."""


class Key(NamedTuple):
    """Identity of a trial."""

    explorer: str
    plan: str
    seed: int
    settings: str  # hash of the settings of trial and explorer


class Task(NamedTuple):
    """One exploration to do."""

    explorer: str
    plan: FloorPlan
    seed: int  # of start, noise and explorer; the same for every explorer gives all the same start and noise
    start: Pose2D | None = None  # in the plan's frame; None draws it


class TrialConfig(Settings):
    """Settings of a trial."""

    minutes: Literal["auto"] | Positive = "auto"
    """Limit of robot time [min]; ``auto`` is 5 min and 8 s/m2, more than three times what Explore Lite takes
    in the median, so that hardly an exploration is cut off."""
    promise: Promise | None = Promise()
    """Explorers stop as soon as their map keeps it, but for those that end as their source does; None for when nothing
    is left to try."""
    env: ExploreConfig = field(default_factory=ExploreConfig)
    """Robot, sensors, SLAM, clutter."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "env", explored_env(self.env))


@dataclass(frozen=True)
class TrialIdentity:
    """Identity of an exploration that has ended."""

    explorer: str
    plan: str
    seed: int
    settings: str
    """Hash of the settings of trial and explorer."""

    @property
    def key(self) -> Key:
        """Identity of the trial."""
        return Key(self.explorer, self.plan, self.seed, self.settings)


@dataclass(frozen=True)
class Trial(TrialIdentity):
    """The outcome of an exploration. Keys of ``time_to`` and ``path_to`` are levels such as ``"0.95"``."""

    area: Measured
    """Free area of the plan [m2]."""
    rooms: Counted
    time_limit: Measured
    """[s]"""
    finished: bool
    """True if the explorer itself said that it is done; else the time was up."""
    time: Measured
    """Robot time at the end [s]."""
    path: Measured
    """True path driven [m]."""
    coverage: Share
    """Share of the reachable floor truly seen at the end."""
    time_to: dict[str, Measured | None]
    """Level to the time when it was reached [s]; None if it never was."""
    path_to: dict[str, Measured | None]
    """Level to the path driven by then [m]."""
    mean_coverage: Share
    """Area under the coverage curve as a share of the most possible, up to
    :func:`~slamgym.agents.evaluation.coverage_curve.horizon`."""
    collisions: Counted
    """Contacts begun."""
    map_error: Measured
    """Mean distance of the final map's occupied cells from the nearest wall [m]."""
    ate: Measured
    """Root mean square error of the final trajectory's positions, unaligned [m]."""
    decisions: Counted
    """Number of choices of where to go."""
    decision_cpu: Measured
    """CPU time of a control step in which it chose [s]."""
    cpu: Measured
    """CPU time of the whole exploration: explorer, physics, sensors and SLAM [s]."""
    curve: dict[str, list[Measured]]
    """Coverage over time and path."""

    def __post_init__(self) -> None:
        CoverageCurve.from_dict(self.curve)  # a trial out of a file may have none

    @property
    def coverage_curve(self) -> CoverageCurve:
        """:attr:`curve` as an object."""
        return CoverageCurve.from_dict(self.curve)


@dataclass(frozen=True)
class FailedTrial(TrialIdentity):
    """An exploration that crashed, hung or failed, so that it is not begun again and again."""

    error: str
    """Kind of the failure."""
    reason: str


def level_name(level: float) -> str:
    """The key of a coverage level."""
    return f"{level:g}"


def trial_hash(config: TrialConfig, fingerprint: str) -> str:
    """Hash of the settings of a trial and of the fingerprint of its explorer."""
    return config_hash({"trial": to_dict(config), "fingerprint": fingerprint})


def explorer_in(env: ExploreEnv, name: str, config: TrialConfig, seed: int = 0) -> Explorer:
    """Make an explorer, with what it promises, for an environment."""
    return make_explorer(name, env.explorer_context(), seed, config.promise)


class _Stopwatch:
    """An explorer with the CPU time of its steps, those with a decision apart."""

    def __init__(self, explorer: Explorer) -> None:
        self._explorer = explorer
        self.all: list[float] = []
        self.deciding: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._explorer, name)

    def predict(self, *arguments: Any) -> Any:
        """The explorer's action."""
        begin = time.thread_time()
        decisions = self.decisions
        answer = self._explorer.predict(*arguments)
        self.all.append(time.thread_time() - begin)
        if self.decisions > decisions:
            self.deciding.append(self.all[-1])
        return answer


def run_trial(
    task: Task, config: TrialConfig, make: Callable[[ExplorerContext], Explorer] | None = None
) -> Trial:
    """Let an explorer explore a building until it is done or the time is up, and measure how well.

    Args:
        task: The exploration.
        config: How explorers are put to the test.
        make: Makes the explorer; by default it is the one of the task's name.

    Raises:
        PlanError: If the robot fits nowhere in the plan.
        ConfigError: If it doesn't fit at the start, or there is no such explorer.
    """
    plan = task.plan
    env = ExploreEnv(plan, fitted_env(plan, config.env, config.minutes))
    began = time.process_time()
    reset = env.reset(seed=task.seed, options={"plan": plan, "start": task.start})
    explorer = (
        make(env.explorer_context()) if make else explorer_in(env, task.explorer, config, task.seed)
    )
    watch: Any = _Stopwatch(explorer)
    points = [
        (env.simulation.time, info["path_length"], info["coverage"])
        for info in episode_steps(env, watch, reset)
    ]
    cpu = time.process_time() - began
    curve = curve_of(points)
    return replace(
        record_of(env.config.time_limit, task, trial_hash(config, watch.fingerprint), curve),
        finished=watch.finished,
        collisions=env.simulation.collisions,
        map_error=round(env.map_error(), 6),
        ate=round(_trajectory_error(env), 6),
        decisions=len(watch.deciding),
        decision_cpu=round(float(np.mean(watch.deciding or watch.all)), 7),
        cpu=round(cpu, 4),
        curve=curve.thinned().to_dict(),
    )


def curve_of(points: list[tuple[float, float, float]]) -> CoverageCurve:
    """The curve through times [s], paths [m] and coverages."""
    time, path, coverage = np.array(points, dtype=np.float64).T
    return CoverageCurve(time, path, coverage)


def _trajectory_error(env: ExploreEnv) -> float:
    """Root mean square error of the final trajectory's positions, unaligned [m]."""
    assert env.log is not None, "for_explorer() has the environment keep a log"
    truth = env.log.true_trajectory(env.start)
    error = absolute_trajectory_error(env.mapper.trajectory(), truth, align=False)
    return error.translation.rmse


def bound_trial(task: Task, config: TrialConfig) -> Trial:
    """Lower bound of one who knows the plan, in the form of a trial; no robot drives.

    Contacts, errors of the map and of the pose, and the CPU time of decisions are 0.

    Args:
        task: The building, with the same start as that of the explorers with this seed.
        config: How explorers are put to the test.
    """
    env = ExploreEnv(task.plan, fitted_env(task.plan, config.env, config.minutes))
    began = time.process_time()
    _, info = env.reset(seed=task.seed, options={"plan": task.plan})
    levels = sorted({*COVERAGE_LEVELS, SUCCESS_COVERAGE})
    bounds = bound_exploration(env, levels, task.seed % 2**32)
    done = next(bound for bound in bounds if bound.share == SUCCESS_COVERAGE)
    first = (0.0, 0.0, min(info["coverage"], bounds[0].share))
    curve = curve_of([first, *((bound.time, bound.path, bound.share) for bound in bounds)])
    return replace(
        record_of(env.config.time_limit, task, trial_hash(config, ORACLE), curve),
        time=round(done.time, 3),
        path=round(done.path, 4),
        coverage=SUCCESS_COVERAGE,
        cpu=round(time.process_time() - began, 4),
    )


def record_of(time_limit: float | None, task: Task, settings: str, curve: CoverageCurve) -> Trial:
    """The record of an exploration, read from its curve alone.

    It is finished; contacts, errors, decisions and CPU times are 0.
    """
    plan = task.plan
    assert time_limit is not None
    time_to: dict[str, float | None] = {}
    path_to: dict[str, float | None] = {}
    for level in COVERAGE_LEVELS:
        reached = curve.reached(level)
        name = level_name(level)
        time_to[name] = None if reached is None else round(reached[0], 4)
        path_to[name] = None if reached is None else round(reached[1], 4)
    return Trial(
        explorer=task.explorer,
        plan=plan.id,
        seed=task.seed,
        settings=settings,
        area=round(plan.area, 3),
        rooms=len(plan.rooms),
        time_limit=round(time_limit, 3),
        finished=True,
        time=round(float(curve.time[-1]), 3),
        path=round(float(curve.path[-1]), 4),
        coverage=round(curve.final, 6),
        time_to=time_to,
        path_to=path_to,
        mean_coverage=round(curve.mean_until(horizon(plan.area)), 6),
        collisions=0,
        map_error=0,
        ate=0,
        decisions=0,
        decision_cpu=0,
        cpu=0,
        curve=curve.to_dict(),
    )
