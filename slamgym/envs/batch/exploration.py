"""Explorations from start to end: the step of all environments, written once, for one robot or for many."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from slamgym.cad import FloorPlan
from slamgym.core.errors import PlanError
from slamgym.core.types import BoolArray, FloatArray, IntArray, Pose2D
from slamgym.envs.batch.assessment import Assessment
from slamgym.envs.batch.beliefs import Beliefs
from slamgym.envs.batch.fleet import Fleet
from slamgym.envs.batch.observing import BatchObserver
from slamgym.envs.batch.threads import divide_work
from slamgym.envs.config import ExploreConfig, ObservationConfig
from slamgym.envs.plan_cache import PlanCache, ResetOptions, Streams
from slamgym.envs.records import StepRecord
from slamgym.envs.rewards import Reward


class StepOutcome(NamedTuple):
    """What a step has led to, a row for each robot."""

    record: StepRecord
    rewards: FloatArray  # (N,)
    terms: dict[str, FloatArray]  # what each term has contributed to the rewards
    terminations: BoolArray  # (N,)
    truncations: BoolArray  # (N,)


class Explorations:
    """So many explorations, stepped together.

    Args:
        config: The settings.
        count: How many.
        plans: Where the buildings come from.
        reward: What a step is worth.
        threads: So many work on the robots.
        prefers_kernels: See :class:`slamgym.envs.batch.beliefs.Beliefs`.
        team_size: So many robots explore each building, each with its own sensors and map.

    Attributes:
        fleet: Bodies and scanners.
        beliefs: Poses and maps that the robots believe in.
        assessment: Measures them against the truth.
        observer: Makes the observations.
    """

    def __init__(
        self,
        config: ExploreConfig,
        count: int,
        plans: PlanCache,
        reward: Reward,
        *,
        threads: int = 1,
        prefers_kernels: bool = False,
        team_size: int = 1,
    ) -> None:
        self._config = config
        self._plans = plans
        self._reward = reward
        self.fleet = Fleet(config, count, threads, team_size)
        self.beliefs = Beliefs(self.fleet, prefers_kernels)
        self.assessment = Assessment(self.beliefs, reward)
        self.observer = BatchObserver(self.beliefs)
        self._everyone = np.arange(count)
        self._nobody = np.zeros(count, dtype=np.bool_)

    def begin(
        self, begins: BoolArray, generators: Sequence[np.random.Generator], wanted: ResetOptions
    ) -> None:
        """Begin episodes, up to their first scans.

        Args:
            begins: Who begins, shape (N,); robots of one building do together.
            generators: Of all robots; an episode's streams are derived from its robot's.
            wanted: Plan and start, if they aren't drawn.

        Raises:
            ConfigError: If the start leaves no room for the robot.
            PlanError: If the plan can't be explored or is larger than the observed map.
        """
        ids = self._put_down(begins, generators, wanted)
        self.beliefs.sense(ids, begins)
        if self.fleet.team_size > 1:
            self.fleet.share_seen()
        self.assessment.begin(ids)

    def _put_down(
        self, begins: BoolArray, generators: Sequence[np.random.Generator], wanted: ResetOptions
    ) -> IntArray:
        """Draw buildings and starts and put robots down, who don't scan yet; returns which."""
        ids = np.flatnonzero(begins)
        size = self.fleet.team_size
        teams = begins.reshape(-1, size)
        if (teams.any(axis=1) != teams.all(axis=1)).any():
            raise ValueError("robots of one building begin together")
        for first in ids[::size].tolist():
            team = range(first, first + size)
            streams = [Streams.spawn(generators[i]) for i in team]
            prepared, starts = self._plans.choose_site(wanted, streams, self._config.clutter)
            for i, own, start in zip(team, streams, starts, strict=True):
                _refuse_too_large(self._config.observation, prepared.plan, start)
                self.fleet.begin(i, prepared, start, own)
                self.beliefs.begin(i, start)
        self.observer.begin(ids)
        return ids

    def step(
        self,
        commands: FloatArray,
        begins: BoolArray | None = None,
        generators: Sequence[np.random.Generator] = (),
    ) -> StepOutcome:
        """Drive for one control step and scan; some begin an episode instead.

        Args:
            commands: Velocities that are asked for, shape (N, 2) [m/s, rad/s].
            begins: Who begins, shape (N,); nobody where left out.
            generators: As for :meth:`begin`.
        """
        fleet = self.fleet
        targets = fleet.within_limits(commands)
        if begins is None:
            fleet.drive(self._everyone, targets)
        else:
            fleet.drive(np.flatnonzero(~begins), targets)
            self._put_down(begins, generators, ResetOptions())
        return self.look(targets, begins)

    def look(self, targets: FloatArray, begins: BoolArray | None = None) -> StepOutcome:
        """Scan and measure, after all have been driven or put down; arguments as for :meth:`step`."""
        is_published = self.is_published
        self.beliefs.sense(self._everyone, is_published)
        if self.fleet.team_size > 1:
            self.fleet.share_seen()
        if begins is not None:
            self.assessment.begin(np.flatnonzero(begins))
        terminations = self._are_complete(is_published)
        truncations = self._are_cut_off()
        if begins is not None:
            terminations &= ~begins
            truncations &= ~begins
        record = self.assessment.record(targets, terminations)
        rewards, terms = self._reward(record)
        return StepOutcome(record, rewards, terms, terminations, truncations)

    @property
    def is_published(self) -> BoolArray:
        """Whose map is published at this step, shape (N,)."""
        published: BoolArray = self.fleet.robots.steps % self._config.publication_steps == 0
        return published

    def _are_complete(self, is_published: BoolArray) -> BoolArray:
        """Mask of explorations that are complete by one of the rules in force."""
        config = self._config
        complete = self._nobody.copy()
        if config.coverage_goal is not None:
            complete = self.fleet.shares >= config.coverage_goal
        if config.terminate_when_explored and is_published.any():

            def look(ids: IntArray) -> None:
                for i in ids.tolist():
                    complete[i] = self.assessment.is_explored(i)

            divide_work(look, np.flatnonzero(is_published & ~complete), self.fleet.threads)
        return complete

    def _are_cut_off(self) -> BoolArray:
        """Mask of explorations whose time limit is over."""
        if self._config.max_steps is None:
            return self._nobody.copy()
        return self.fleet.robots.steps >= self._config.max_steps

    def figures(self) -> dict[str, Any]:
        """The newest figures of every robot, as :class:`~slamgym.envs.ExploreEnv` describes them; shape (N, ...)."""
        robots = self.fleet.robots
        pose_error, heading_error = self.assessment.apart()
        # Robots that are mapped together have no doubts.
        doubtful_scans = np.zeros(len(self.fleet), dtype=np.int64)
        is_doubtful = self._nobody.copy()
        if not self.beliefs.is_mapped_together:
            for i in range(len(self.fleet)):
                stats = self.beliefs.mapper(i).stats
                doubtful_scans[i] = len(stats.doubtful)
                is_doubtful[i] = stats.is_doubtful
        return {
            "coverage": self.fleet.shares,
            "path_length": robots.path.copy(),
            "collisions": robots.collisions.copy(),
            "pose_error": pose_error,
            "heading_error": heading_error,
            "doubtful_scans": doubtful_scans,
            "is_doubtful": is_doubtful,
            "true_pose": robots.pose.copy(),
        }


def _refuse_too_large(observation: ObservationConfig, plan: FloorPlan, start: Pose2D) -> None:
    """Refuse a plan that reaches out of the canvas, because its map would be cut off."""
    if not observation.is_whole_map:
        return
    min_x, min_y, max_x, max_y = plan.bounds
    extent = max(start.x - min_x, max_x - start.x, start.y - min_y, max_y - start.y)
    if extent > 0.5 * observation.map_size:
        raise PlanError(
            plan.where,
            f"the plan reaches {extent:.1f} m from the start at ({start.x:.1f}, {start.y:.1f}) but the "
            f"map only {0.5 * observation.map_size:.1f} m; set observation.map_size to "
            f"{math.ceil(2.0 * extent)} or more",
        )
