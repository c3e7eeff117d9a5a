"""One exploration by one explorer, run to its end and measured against the truth."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from slamgym.agents.evaluation.coverage_curve import COVERAGE_LEVELS, CoverageCurve, CurveRecorder, horizon
from slamgym.agents.oracle import OracleConfig, bound_exploration
from slamgym.cad import FloorPlan
from slamgym.core.config import Counted, Measured, Positive, Settings, Share, config_hash
from slamgym.core.types import Explorer, Float32Array, Observation, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps, explored_env, fitted_env, time_limit
from slamgym.metrics import absolute_trajectory_error
from slamgym.metrics.map_error import ObstacleDistance
from slamgym.planning.promise import Promise

MakeForEpisode = Callable[[ExploreEnv, int], Explorer]
"""Makes an explorer for an environment that was just reset, and a seed."""

SUCCESS_COVERAGE = 0.98
"""An exploration succeeds if the explorer ends it by itself, in time, with so much seen."""

Key = tuple[str, str, int, str]
"""What makes two trials the same: explorer, plan, seed, hash of the settings."""


class TrialConfig(Settings):
    """How explorers are put to the test."""

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
class Trial:
    """The outcome of an exploration. Keys of ``time_to`` and ``path_to`` are levels such as ``"0.95"``."""

    explorer: str
    plan: str
    seed: int
    settings: str
    """Hash of the settings of trial and explorer."""
    area: Measured
    """Free area of the plan [m2]."""
    rooms: Counted
    time_limit: Measured
    """[s]"""
    finished: bool
    """Whether the explorer itself said that it is done; else the time was up."""
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
    """How often the explorer chose where to go."""
    decision_cpu: Measured
    """CPU time of a control step in which it chose [s]."""
    decision_cpu_max: Measured
    """The longest of these [s]."""
    step_cpu: Measured
    """CPU time of the explorer and its navigation per control step, all steps [s]."""
    cpu: Measured
    """CPU time of the whole exploration: explorer, physics, sensors and SLAM [s]."""
    curve: dict[str, list[Measured]]
    """Coverage over time and path."""

    def __post_init__(self) -> None:
        CoverageCurve.from_dict(self.curve)  # a trial out of a file may have none

    @property
    def key(self) -> Key:
        """What makes two trials the same."""
        return self.explorer, self.plan, self.seed, self.settings

    @property
    def coverage_curve(self) -> CoverageCurve:
        """:attr:`curve` as an object."""
        return CoverageCurve.from_dict(self.curve)


@dataclass(frozen=True)
class FailedTrial:
    """An exploration that crashed, hung or failed, so that it is not begun again and again."""

    explorer: str
    plan: str
    seed: int
    settings: str
    """Hash of the settings of trial and explorer."""
    error: str
    """Kind of the failure."""
    reason: str

    @property
    def key(self) -> Key:
        """What makes two trials the same."""
        return self.explorer, self.plan, self.seed, self.settings


def level_name(level: float) -> str:
    """The key of a coverage level."""
    return f"{level:g}"


def trial_hash(config: TrialConfig, explorer: Explorer) -> str:
    """Hash of the settings of a trial and of its explorer."""
    return config_hash(_Settings(config, explorer.fingerprint))


def bound_hash(config: TrialConfig, bound: OracleConfig) -> str:
    """Hash of the settings of a trial and of the oracle's budget."""
    return config_hash(_Settings(config, config_hash(bound)))


@dataclass(frozen=True)
class _Settings:
    trial: TrialConfig
    fingerprint: str


class _Stopwatch:
    """An explorer with the CPU time of its steps, those with a decision apart."""

    def __init__(self, explorer: Explorer) -> None:
        self._explorer = explorer
        self.all: list[float] = []
        self.deciding: list[float] = []
        self.fingerprint = explorer.fingerprint

    @property
    def finished(self) -> bool:
        """Whether the explorer is done."""
        return self._explorer.finished

    @property
    def decisions(self) -> int:
        """How often the explorer has chosen where to go."""
        return self._explorer.decisions

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Float32Array, Any]:
        """The explorer's action."""
        begin, decisions = time.thread_time(), self.decisions
        answer = self._explorer.predict(observation, state, episode_start, deterministic)
        self.all.append(time.thread_time() - begin)
        if self.decisions > decisions:
            self.deciding.append(self.all[-1])
        return answer


def run_trial(
    plan: FloorPlan,
    seed: int,
    name: str,
    config: TrialConfig,
    make: MakeForEpisode,
    start: Pose2D | None = None,
) -> Trial:
    """Let an explorer explore a building until it is done or the time is up, and measure how well.

    Args:
        plan: The building.
        seed: Of start, noise and explorer. The same for every explorer gives all the same start and streams
            of noise.
        name: Of the explorer, for the record.
        config: The settings.
        make: Makes the explorer.
        start: In the plan's frame; None draws it.

    Raises:
        PlanError: If the robot fits nowhere in the plan.
        ConfigError: If it doesn't fit at the start.
    """
    env = ExploreEnv(plan, fitted_env(plan, config.env, config.minutes))
    began = time.process_time()
    reset = env.reset(seed=seed, options={"plan": plan, "start": start})
    watch, recorder = _Stopwatch(make(env, seed)), CurveRecorder()
    for info in episode_steps(env, watch, reset):
        recorder.add(env.simulation.time, info["path_length"], info["coverage"])
    cpu = time.process_time() - began
    return _assess(env, seed, name, trial_hash(config, watch), recorder.curve(), watch, cpu)


def bound_trial(plan: FloorPlan, seed: int, settings: str, config: TrialConfig, bound: OracleConfig) -> Trial:
    """What one who knows the plan would need at least, in the form of a trial; nobody drives.

    Contacts, errors of the map and of the pose, and the CPU time of decisions are 0.

    Args:
        plan: The building.
        seed: The same start as that of the explorers with this seed.
        settings: Hash of the settings.
        config: How explorers are put to the test.
        bound: The oracle's budget.
    """
    env = ExploreEnv(plan, fitted_env(plan, config.env, config.minutes))
    began = time.process_time()
    _, info = env.reset(seed=seed, options={"plan": plan})
    bounds = bound_exploration(env, sorted({*COVERAGE_LEVELS, SUCCESS_COVERAGE}), seed % 2**32, bound)
    levels = {b.share: b for b in bounds}
    done = levels[SUCCESS_COVERAGE]
    steps = [(0.0, 0.0, min(info["coverage"], bounds[0].share)), *((b.time, b.path, b.share) for b in bounds)]
    curve = CoverageCurve(*np.array(steps).T)
    return Trial(
        explorer="oracle",
        plan=plan.id,
        seed=seed,
        settings=settings,
        area=round(plan.area, 3),
        rooms=len(plan.rooms),
        time_limit=round(time_limit(plan, config.minutes), 3),
        finished=True,
        time=round(done.time, 3),
        path=round(done.path, 4),
        coverage=SUCCESS_COVERAGE,
        time_to={level_name(level): round(levels[level].time, 4) for level in COVERAGE_LEVELS},
        path_to={level_name(level): round(levels[level].path, 4) for level in COVERAGE_LEVELS},
        mean_coverage=round(curve.mean_until(horizon(plan.area)), 6),
        collisions=0,
        map_error=0.0,
        ate=0.0,
        decisions=0,
        decision_cpu=0.0,
        decision_cpu_max=0.0,
        step_cpu=0.0,
        cpu=round(time.process_time() - began, 4),
        curve=curve.to_dict(),
    )


def _assess(
    env: ExploreEnv,
    seed: int,
    name: str,
    settings: str,
    curve: CoverageCurve,
    watch: _Stopwatch,
    cpu: float,
) -> Trial:
    """Make the record of an exploration that has ended."""
    plan, log = env.plan, env.log
    assert log is not None, "for_explorer() has the environment keep a log"
    assert env.config.time_limit is not None
    estimate, truth = env.mapper.trajectory(), log.true_trajectory(env.start)
    walls = ObstacleDistance(np.vstack([plan.segments(), env.clutter.segments()]))
    deciding = watch.deciding or watch.all
    return Trial(
        explorer=name,
        plan=plan.id,
        seed=seed,
        settings=settings,
        area=round(plan.area, 3),
        rooms=len(plan.rooms),
        time_limit=round(env.config.time_limit, 3),
        finished=watch.finished,
        time=round(float(curve.time[-1]), 3),
        path=round(float(curve.path[-1]), 4),
        coverage=round(curve.final, 6),
        time_to={level_name(level): _rounded(curve.time_to(level)) for level in COVERAGE_LEVELS},
        path_to={level_name(level): _rounded(curve.path_to(level)) for level in COVERAGE_LEVELS},
        mean_coverage=round(curve.mean_until(horizon(plan.area)), 6),
        collisions=env.simulation.collisions,
        map_error=round(walls.mean_error(env.mapper.occupancy_grid(), env.world_from_map), 6),
        ate=round(absolute_trajectory_error(estimate, truth, align=False).translation.rmse, 6),
        decisions=len(watch.deciding),
        decision_cpu=round(float(np.mean(deciding)), 7),
        decision_cpu_max=round(float(np.max(deciding)), 7),
        step_cpu=round(float(np.mean(watch.all)), 7),
        cpu=round(cpu, 4),
        curve=curve.thinned().to_dict(),
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
