"""``slamgym/ExploreTeam-v0``: several robots in one building as PettingZoo's parallel environment."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import error, spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from slamgym.core.errors import ConfigError
from slamgym.core.jit import announce_compilation
from slamgym.core.types import ByteArray
from slamgym.envs.batch.exploration import StepOutcome
from slamgym.envs.config import ExploreConfig, resolve_config
from slamgym.envs.explore_env import figures_of_one
from slamgym.envs.observations import FURTHEST, observation_space
from slamgym.envs.plan_cache import PlanCache, PlansArgument, ResetOptions
from slamgym.envs.rewards import RewardTerms
from slamgym.envs.simulation import Actions
from slamgym.envs.team.exploration import TeamExploration
from slamgym.sim.raycast import cast_sweep
from slamgym.viz.exploration import Renderer


class ExploreTeamEnv(ParallelEnv[str, Any, Any]):
    """Two to four robots explore one building, each with its own sensors, errors and mapper.

    ## Description

    The robots of :class:`~slamgym.envs.ExploreEnv`, called ``robot1`` to ``robot4``. They see, touch and push each
    other. Whenever maps are published, every 2 s, those that hear each other exchange them: always, within a range, or
    when they meet (:class:`~slamgym.envs.team.config.TeamConfig`). Each lays what it was told under its own map, by
    where the robots were put down if they know that, else once it is sure where the maps lie on each other.

    ## Action and Observation Space

    Each robot's are those of a single one, and its map is what it shares. The preset ``dict`` has one more key,
    ``"mates"``, (robots - 1, 4) float32, a row for each other robot in order: 1 if it is heard now, else the row is
    zero; x [m], y [m] and heading [rad] where it believes to be, in the own map's frame.

    ## Rewards

    Each robot's are those of a single one, but coverage is the team's: what any has seen nobody sees for the first
    time.

    ## Episode End

    It is the team's: all are terminated once each one's map shows no frontier, or the team has reached the
    ``coverage_goal``; all are truncated at the time limit.

    ## Arguments

    Args:
        plans: Floor plans, as for a single robot.
        config: Settings; the defaults where None.
        robots: How many; in place of ``config.team.robots``.
        render_mode: ``"rgb_array"`` or None.
        reward_terms: More terms of the reward: name to (weight, function of one robot's step).
        **settings: As for a single robot; ``team={"exchange": "range", "reach": 8.0}`` says when robots hear each
            other.

    Raises:
        ConfigError: If a setting is unknown or makes no sense.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - PettingZoo declares it so
        "render_modes": ["rgb_array"],
        "name": "slamgym/ExploreTeam-v0",
        "is_parallelizable": True,
        "render_fps": 5,
    }

    def __init__(
        self,
        plans: PlansArgument | PlanCache = "bundled",
        config: ExploreConfig | None = None,
        *,
        robots: int | None = None,
        render_mode: str | None = None,
        reward_terms: RewardTerms | None = None,
        **settings: Any,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f"unknown render_mode {render_mode!r}; take 'rgb_array' or None")
        config = resolve_config(config, settings)
        if robots is None:
            robots = max(2, config.team.robots)
        self.config = replace(
            config,
            team=replace(config.team, robots=robots),
            record=config.record or render_mode is not None,
        )
        self.render_mode = render_mode
        self.possible_agents = [f"robot{number + 1}" for number in range(robots)]
        self.agents: list[str] = []
        self.team = TeamExploration(plans, self.config, reward_terms)
        self._actions = Actions(self.config)
        self._renderer = Renderer()
        self._spaces = {
            name: (self._observation_space(), Actions(self.config).space)
            for name in self.possible_agents
        }
        self._rng: np.random.Generator | None = None

    def _observation_space(self) -> spaces.Space[Any]:
        space = observation_space(self.config)
        if isinstance(space, spaces.Dict):
            rows = len(self.possible_agents) - 1
            most = np.array([1.0, FURTHEST, FURTHEST, np.pi], np.float32)
            high = np.tile(most, (rows, 1))
            low = -high
            low[:, 0] = 0.0
            space = spaces.Dict({**space.spaces, "mates": spaces.Box(low, high, dtype=np.float32)})
        return space

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """What a robot observes."""
        return self._spaces[agent][0]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """What a robot may do."""
        return self._spaces[agent][1]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Decides everything; without one episodes go on from the last.
            options: ``"plan"``, and ``"start"``: a pose (x, y, theta) for each robot in the plan's frame.

        Raises:
            ConfigError: If an option is unknown, or a start leaves no room for its robot, or is on another one.
            PlanError: If the plan can't be explored.
        """
        announce_compilation(cast_sweep)
        if self._rng is None or seed is not None:
            self._rng, _ = seeding.np_random(seed)
        # PettingZoo's own test asks with a key of this name.
        known = {name: value for name, value in (options or {}).items() if name != "options"}
        self.team.begin(self._rng, ResetOptions.read(known))
        self.agents = list(self.possible_agents)
        plan = self.team.explorations.fleet.each[0].prepared.plan.id
        infos = {name: {**info, "plan": plan} for name, info in self._infos().items()}
        return self._observations(), infos

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[
        dict[str, Any],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Drive for one control step, each robot by its action.

        Raises:
            ActionError: If an action is of another kind than those of its space.
            gymnasium.error.ResetNeeded: Before the first reset, and after the end.
        """
        if not self.agents:
            raise error.ResetNeeded("call reset() first: the episode is over, or hasn't begun")
        missing = [name for name in self.agents if name not in actions]
        if missing:
            raise ConfigError(
                f"step() takes an action for each robot, and has none for {missing[0]}"
            )
        commands = self._actions.to_commands([actions[name] for name in self.agents])
        outcome = self.team.step(commands)
        terminated = bool(outcome.terminations.all())
        truncated = bool(outcome.truncations.any())
        infos = self._infos(outcome)
        names = self.agents
        observations = self._observations()
        rewards = dict(zip(names, outcome.rewards.tolist(), strict=True))
        if terminated or truncated:
            self.agents = []
        return (
            observations,
            rewards,
            dict.fromkeys(names, terminated),
            dict.fromkeys(names, truncated),
            infos,
        )

    def _observations(self) -> dict[str, Any]:
        return {name: self.team.observe(index) for index, name in enumerate(self.agents)}

    def _infos(self, outcome: StepOutcome | None = None) -> dict[str, dict[str, Any]]:
        """The newest figures of each robot, as a single one's ``info`` has them."""
        figures = self.team.explorations.figures()
        infos: dict[str, dict[str, Any]] = {}
        for index, name in enumerate(self.agents):
            infos[name] = figures_of_one(figures, index)
            if outcome is not None:
                infos[name]["reward_terms"] = figures_of_one(outcome.terms, index)
        return infos

    def render(self) -> ByteArray | None:
        """A picture of the building and of the first robot's map, shape (720, 1280, 3) uint8; else None."""
        return None if self.render_mode is None else self._renderer.draw(self.team.scene())

    def close(self) -> None:
        """Nothing is open."""
