"""Several robots explore one building and tell each other what they have mapped.

The step is that of the single environment (:class:`~slamgym.envs.batch.exploration.Explorations`): the robots see,
touch and push each other, and each has sensors, errors and a mapper of its own. Whenever maps are published, robots
that hear each other exchange them, and each lays what it was told under its own map.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from slamgym.core.types import BoolArray, Float32Array, FloatArray, OccupancyGrid
from slamgym.envs.batch.exploration import Explorations, StepOutcome
from slamgym.envs.config import ExploreConfig
from slamgym.envs.plan_cache import PlanCache, PlansArgument, ResetOptions
from slamgym.envs.rewards import Reward, RewardTerms
from slamgym.envs.simulation import EpisodeLog, Simulation
from slamgym.envs.team.maps import TeamMaps
from slamgym.sim.contact import SKIN
from slamgym.sim.raycast import cast_rays
from slamgym.viz.exploration import Scene


class TeamExploration:
    """The robots of one building.

    Args:
        plans: Where the buildings come from.
        config: The settings; those of the team are in ``config.team``.
        reward_terms: More terms of the reward.

    Attributes:
        config: As given.
        explorations: The step.
        robots: Views of the robots, once they have begun.
        maps: What they know of each other.
        logs: Of each robot, where the settings ask for it.
    """

    def __init__(
        self,
        plans: PlansArgument | PlanCache,
        config: ExploreConfig,
        reward_terms: RewardTerms | None = None,
    ) -> None:
        self.config = config
        count = config.team.robots
        if not isinstance(plans, PlanCache):
            plans = PlanCache(plans, config.robot, config.lidar.surfaces)
        reward = Reward(config.reward, reward_terms)
        self.explorations = Explorations(config, count, plans, reward, team_size=count)
        self.robots: list[Simulation] = []
        self.logs: list[EpisodeLog] = []
        self.maps: TeamMaps

    def __len__(self) -> int:
        return self.config.team.robots

    @property
    def time(self) -> float:
        """Robot time [s]."""
        return self.robots[0].time

    @property
    def coverage(self) -> float:
        """Share of the floor that the team has truly seen; the least of theirs where they can't get to each other."""
        return float(self.explorations.fleet.shares.min())

    def begin(self, rng: np.random.Generator, wanted: ResetOptions) -> None:
        """Begin an episode.

        Args:
            rng: What each robot draws is derived from it, robot by robot.
            wanted: Plan and starts, if they aren't drawn.

        Raises:
            ConfigError: If starts leave no room for the robots, or two are at one place.
            PlanError: If the plan can't be explored.
        """
        everyone = np.ones(len(self), dtype=np.bool_)
        self.explorations.begin(everyone, [rng] * len(self), wanted)
        beliefs = self.explorations.beliefs
        self.robots = [Simulation(beliefs, index) for index in range(len(self))]
        places = None
        if self.config.team.starts == "known":
            places = [robot.world_from_map for robot in self.robots]
        self.maps = TeamMaps([robot.mapper for robot in self.robots], places)
        beliefs.shown = self.maps.shared.__getitem__
        beams = self.config.lidar.num_beams
        self.logs = [EpisodeLog(beams) for _ in self.robots] if self.config.record else []
        self._tell()

    def step(self, commands: FloatArray) -> StepOutcome:
        """Drive for one control step towards velocities, shape (N, 2) [m/s, rad/s]."""
        outcome = self.explorations.step(commands)
        self._tell()
        return outcome

    def _tell(self) -> None:
        """Note what was sensed, and exchange maps where some are published."""
        for log, robot in zip(self.logs, self.robots, strict=False):
            log.note(robot)
        if len(self) > 1 and self.explorations.is_published[0]:
            poses = [robot.believed_pose for robot in self.robots]
            self.maps.exchange(self._links(), poses, self.time)

    def _links(self) -> BoolArray:
        """Who hears whom directly, shape (N, N)."""
        team = self.config.team
        if team.exchange == "always":
            return np.ones((len(self), len(self)), dtype=np.bool_)
        reach = team.reach if team.exchange == "range" else self.config.lidar.range_max
        places = np.array([robot.true_pose[:2] for robot in self.robots])
        apart = np.hypot(*(places[:, None] - places).T)
        linked = apart <= reach
        if team.exchange == "meeting":
            for one, other in np.argwhere(np.triu(linked, 1)).tolist():
                is_seen = self._is_in_sight(places[one], places[other])
                linked[one, other] = linked[other, one] = is_seen
        return np.asarray(linked, dtype=np.bool_)

    def _is_in_sight(self, here: FloatArray, there: FloatArray) -> bool:
        """True if nothing lies between robots at two places (2,)."""
        x, y = here.tolist()
        dx, dy = (there - here).tolist()
        distance = math.hypot(dx, dy)
        free = np.empty(1)
        objects = self.robots[0].world.segments()
        cast_rays(x, y, math.atan2(dy, dx), 0.0, 1.0, objects, distance, free)
        body = self.config.robot.radius + SKIN  # the ray ends at the other's body
        return bool(free[0] >= distance - body)

    def scene(self) -> Scene:
        """Contents of a picture of this moment, where the steps are recorded: the first robot's, with the others."""
        own, *mates = (robot.scene(log) for robot, log in zip(self.robots, self.logs, strict=True))
        start = self.robots[0].start
        shared = self.maps.shared[0].occupancy_grid()
        frame = shared.frame._replace(
            origin_x=shared.frame.origin_x + start.x, origin_y=shared.frame.origin_y + start.y
        )
        return replace(own, grid=OccupancyGrid(shared.cells, frame), mates=tuple(mates))

    def observe(self, index: int) -> Any:
        """What one robot observes; with the preset ``dict`` also ``mates``, see the environment."""
        is_published = bool(self.explorations.is_published[index])
        seen = self.explorations.observer.observe_one(index, is_published)
        if self.config.observation.preset != "dict":
            return seen
        return {**seen, "mates": self._mates(index)}

    def _mates(self, index: int) -> Float32Array:
        rows = np.zeros((len(self) - 1, 4), np.float32)
        for other, pose in self.maps.mates(index).items():
            rows[other - (other > index)] = 1.0, *pose
        return rows
