"""One exploration by a team: so many robots with an explorer each, measured as a single robot is."""

import math
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgym.agents.evaluation.trial import (
    Task,
    Trial,
    TrialConfig,
    curve_of,
    record_of,
    trial_hash,
)
from slamgym.agents.registry import make_explorer
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D
from slamgym.envs.episode import fitted_env
from slamgym.envs.explore_env import explorer_context
from slamgym.envs.plan_cache import PreparedPlan, ResetOptions
from slamgym.envs.team.config import MOST_ROBOTS
from slamgym.envs.team.episode import team_steps
from slamgym.envs.team.exploration import TeamExploration
from slamgym.metrics import absolute_trajectory_error


class TeamName(NamedTuple):
    """The name of an explorer, and on how many robots it drives."""

    explorer: str
    robots: int

    @classmethod
    def read(cls, name: str) -> "TeamName":
        """Read a name such as ``rl`` or ``rl*2``.

        Raises:
            ConfigError: If the number isn't one of robots.
        """
        explorer, sign, count = name.partition("*")
        if not sign:
            return cls(name, 1)
        if count not in map(str, range(1, MOST_ROBOTS + 1)):
            raise ConfigError(
                f"a team of {count or 'no'} robots: {name!r} needs a number from 1 to {MOST_ROBOTS} behind its *"
            )
        return cls(explorer, int(count))

    def __str__(self) -> str:
        return self.explorer if self.robots == 1 else f"{self.explorer}*{self.robots}"


def run_team_trial(task: Task, config: TrialConfig) -> Trial:
    """Let a team explore a building until all robots are done or the time is up.

    Coverage is the team's, the path that of all robots together, errors are means over the robots.

    Args:
        task: The exploration; its explorer is named as :class:`TeamName` reads it.
        config: How explorers are put to the test.

    Raises:
        PlanError: If there is no room for the robots in the plan.
        ConfigError: If there is no such explorer.
    """
    name = TeamName.read(task.explorer)
    fitted = fitted_env(task.plan, config.env, config.minutes)
    env = replace(fitted, team=replace(fitted.team, robots=name.robots))
    team = TeamExploration(task.plan, env)
    began = time.process_time()
    context = explorer_context(env)
    explorers = [
        make_explorer(name.explorer, context, task.seed, config.promise) for _ in range(name.robots)
    ]
    points = []
    wanted = ResetOptions(task.plan, _starts(task, team))
    for _ in team_steps(team, explorers, task.seed, wanted):
        path = sum(robot.path_length for robot in team.robots)
        points.append((team.time, path, team.coverage))
    curve = curve_of(points)
    errors = [team.explorations.assessment.map_error(k) for k in range(len(team))]
    return replace(
        record_of(env.time_limit, task, trial_hash(config, explorers[0].fingerprint), curve),
        finished=all(explorer.finished for explorer in explorers),
        collisions=sum(robot.collisions for robot in team.robots),
        map_error=round(float(np.mean(errors)), 6),
        ate=round(float(np.mean(_path_errors(team))), 6),
        decisions=sum(explorer.decisions for explorer in explorers),
        cpu=round(time.process_time() - began, 4),
        curve=curve.thinned().to_dict(),
    )


def _starts(task: Task, team: TeamExploration) -> tuple[Pose2D, ...]:
    """Starts of a team whose first robot's is given, the others drawn by the seed; none if that one is drawn, too."""
    if task.start is None:
        return ()
    rng = np.random.default_rng(task.seed)
    prepared = PreparedPlan(task.plan, team.config.robot)
    starts = [task.start]
    while len(starts) < len(team):
        start = prepared.sample_start(rng)
        if min(math.dist(start[:2], other[:2]) for other in starts) > 1.0:
            starts.append(start)
    return tuple(starts)


def _path_errors(team: TeamExploration) -> list[float]:
    """Root mean square error of each robot's final path, unaligned [m]."""
    return [
        absolute_trajectory_error(
            robot.mapper.trajectory(), log.true_trajectory(robot.start), align=False
        ).translation.rmse
        for robot, log in zip(team.robots, team.logs, strict=True)
    ]
