"""The environment: a robot explores a floor plan and maps it with SLAM."""

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from slamgym.cad import FloorPlan
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.core.jit import announce_compilation
from slamgym.core.types import ByteArray, Pose2D
from slamgym.envs.batch.exploration import Explorations, StepOutcome
from slamgym.envs.config import MAP_UPDATE_INTERVAL, ExploreConfig, resolve_config
from slamgym.envs.coverage import Coverage
from slamgym.envs.observations import observation_space
from slamgym.envs.path_drive import put_robot
from slamgym.envs.plan_cache import PlanCache, PlansArgument, ResetOptions
from slamgym.envs.rewards import Reward, RewardTerms
from slamgym.envs.simulation import Actions, EpisodeLog, Simulation
from slamgym.planning import ExplorerContext
from slamgym.sim import Clutter, Lidar
from slamgym.sim.raycast import cast_sweep
from slamgym.slam import Mapper
from slamgym.viz.exploration import Renderer, Scene
from slamgym.viz.window import Window

RENDER_MODES = ("rgb_array", "human")


_ONE = np.ones(1, dtype=np.bool_)


class StepInfo(dict[str, Any]):
    """The ``info`` of a step: ``map_error`` is measured when it is read, e.g. where a wrapper ends the episode."""

    def __init__(self, figures: dict[str, Any], measure: Callable[[], float]) -> None:
        super().__init__(figures)
        self._measure = measure

    def __reduce__(self) -> tuple[type, tuple[dict[str, Any]]]:
        return dict, (dict(self),)  # to other processes goes what was measured

    def __missing__(self, name: str) -> float:
        """Measure the error of the newest map."""
        if name != "map_error":
            raise KeyError(name)
        return self._measure()


def figures_of_one(values: Mapping[str, Any], index: int = 0) -> dict[str, Any]:
    """The figures of one robot alone, as plain numbers where they are numbers."""
    return {
        name: value[index].item() if value.ndim == 1 else value[index]
        for name, value in values.items()
    }


class ExploreEnv(gym.Env[Any, Any]):
    """A TurtleBot3-class robot explores an unknown building and maps it with SLAM.

    ## Description

    A differential-drive robot with a 2D laser scanner is put down somewhere in a floor plan. It drives, its
    scanner and its wheel odometry measure with noise, and a pose graph, or a particle filter (as GMapping),
    makes a map of it all. The task is to see the whole building: quickly, without collisions, and with a good
    map. Robot and scanner have the values of a TurtleBot3 Waffle Pi; a step lasts one scan, 0.2 s.

    Observations hold what the robot believes and measures, never the truth. Rewards and ``info`` do hold the
    truth (coverage, pose error): they are a privileged training signal.

    ## Action Space

    | Num | ``Box(-1, 1, (2,), float32)``, the default | Min | Max | Full scale |
    |-----|---------------------------------------------|-----|-----|------------|
    | 0   | speed, backward to forward                  | -1  | 1   | 0.26 m/s   |
    | 1   | turning rate, clockwise to counter-clockwise | -1  | 1   | 1.82 rad/s |

    With ``actions="physical"`` the same in m/s and rad/s. What exceeds the limits is cut off; acceleration is
    limited too (2.5 m/s2, 3.2 rad/s2). With ``actions="discrete"``, as in ``slamgym/ExploreDiscrete-v4``,
    ``Discrete(3)``: 0 ahead at full speed, 1 turn left on the spot, 2 turn right, both at 1.82 rad/s.

    ## Observation Space

    ``Dict`` of:

    | Key        | Shape, type         | Min | Max   | Unit | Meaning |
    |------------|---------------------|-----|-------|------|---------|
    | "map"      | (1, 84, 84) uint8   | 0   | 255   | -    | SLAM map: 0 occupied, 205 unknown, 254 free |
    | "scan"     | (180,) float32      | 0   | 3.5   | m    | right to left; 3.5 no return, 0 too near |
    | "pose"     | (3,) float32        | -1000, -1000, -pi | 1000, 1000, pi | m, m, rad | believed |
    | "velocity" | (2,) float32        | -0.52, -3.64 | 0.52, 3.64 | m/s, rad/s | by wheel odometry |
    | "time"     | (1,) float32        | 0   | 420   | s    | since the start |

    The scan is seen from the pose, also of a laser that sweeps (``lidar.sweep``): what it hasn't seen from there is no
    return. The pose is in the map frame, whose origin is the start and whose axes are the building's. By default the
    map is an egocentric crop of 8.4 x 8.4 m at 0.1 m a cell: the believed pose in the middle, ahead up. With
    ``observation={"map": "global"}`` it is the whole map on a fixed canvas centred on the start, shape
    (1, 1280, 1280) for 64 m at 0.05 m, published again every 2 s; with ``shared_map`` it is the same read-only
    array in between.

    ``observation={"preset": "compact"}`` is a ``Box(-1, 1, (944,), float32)`` for perceptrons, each number scaled: the
    crop as 21 x 21 blocks' shares of free and of occupied space (the rest is unknown), 60 ranges, each the nearest of
    its beams, speed and turning rate; with ``"map": "global"`` of the map as last published. ``"compact_far"`` adds 27:
    which way leads to the nearest unknown space, and how far it is. ``"preset": "map"`` is the map alone, ``"dict"``
    the default.

    With ``localization="ground_truth"`` the believed pose *is* the true pose, by that setting. With
    ``localization="map"`` the robot finds itself on a finished map (``finished_map``; by default drawn from the plan);
    the observed map shows what it has seen.

    ## Rewards

    The sum of weighted terms, which ``info["reward_terms"]`` shows one by one. By default 10 per share of the
    reachable floor seen for the first time, -0.01 per second, -0.1 per step in contact, 1 on completion.
    :class:`~slamgym.envs.rewards.RewardConfig` has all weights; ``reward_terms={"name": (weight, function)}``
    adds functions of a :class:`~slamgym.envs.rewards.StepRecord`.

    ## Starting State

    A plan drawn evenly from ``plans`` and a pose drawn evenly from where the robot fits, at rest. The first
    scan is taken. ``reset(options={"plan": ..., "start": (x, y, theta)})`` sets a plan (an id, or a
    :class:`~slamgym.cad.FloorPlan`) and a start in the plan's frame.

    ## Episode End

    1. Termination: the published map shows no frontier of 0.35 m or more that the robot could reach. It is
       checked whenever the map is published (``terminate_when_explored=False`` turns it off, ``"98%:95%"`` stops
       as soon as that is sure).
    2. Termination: the true coverage reaches ``coverage_goal`` (off by default; privileged).
    3. Truncation: ``time_limit`` is over, by default 420 s or 2,100 steps.

    ## Info

    ``coverage`` (share of the reachable floor truly seen, see :mod:`slamgym.envs.coverage`), ``path_length``
    [m], ``collisions`` (contacts begun), ``pose_error`` [m], ``heading_error`` [rad],
    ``doubtful_scans`` (where the map may be wrong), ``is_doubtful`` (the newest is one: the pose may be wrong),
    ``true_pose`` (3,) in the world, ``reward_terms``, ``is_success`` (terminated); where a reward reads it, and at the
    end of the episode, ``map_error`` [m], which is measured too where ``info["map_error"]`` is read, as after
    Gymnasium's own ``TimeLimit``. ``reset`` adds ``plan``, the id.

    ## Arguments

    Args:
        plans: Floor plans: what :func:`slamgym.cad.open_plans` takes (``"bundled"``, a file, a folder, an
            archive), a source of plans, or floor plans.
        config: Settings; the defaults where None.
        render_mode: ``"rgb_array"``, ``"human"`` or None.
        reward_terms: More terms of the reward: name to (weight, function).
        **settings: Fields of :class:`~slamgym.envs.config.ExploreConfig` by name, on top of ``config``: parts
            as dataclasses or as mappings of what differs, ``lidar`` and ``odometry`` also as the name of an
            error level, and ``localization`` (``"pose_graph"``, the default, ``"rbpf"``, ``"dead_reckoning"``,
            ``"map"``, ``"ground_truth"``).

    Raises:
        ConfigError: If a setting is unknown or makes no sense.
        InputFileError: If the plans can't be read.

    ## Reproducibility

    A seed decides everything. Plan, clutter, start, odometry, scanner and SLAM draw from generators of their
    own, derived from ``np_random`` at reset: with more particles the sensors' noise stays the same.

    ## Version History

    * v3: one step for one robot and many; contacts are pymunk's.
    * v2: the default localisation is ``pose_graph``.
    * v1: the laser's errors belong to places, and furniture is what a laser near the floor sees.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 5}  # noqa: RUF012 - Gymnasium declares it so

    def __init__(
        self,
        plans: PlansArgument | PlanCache = "bundled",
        config: ExploreConfig | None = None,
        *,
        render_mode: str | None = None,
        reward_terms: RewardTerms | None = None,
        **settings: Any,
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ConfigError(
                f"unknown render_mode {render_mode!r}; {suggest(render_mode, RENDER_MODES)}"
            )
        self.config = resolve_config(config, settings)
        if self.config.team.robots > 1:
            raise ConfigError(
                f"one robot explores here, not {self.config.team.robots}; make a team with "
                "slamgym.envs.team.parallel_env"
            )
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(self.config.lidar.rate)}
        self.observation_space = observation_space(self.config)
        self._actions = Actions(self.config)
        self.action_space = self._actions.space
        self._reward = Reward(self.config.reward, reward_terms)
        parts = self.config.robot, self.config.lidar.surfaces
        sites = plans if isinstance(plans, PlanCache) else PlanCache(plans, *parts)
        self._explorations = Explorations(self.config, 1, sites, self._reward)
        self._robot: Simulation | None = None
        self.log: EpisodeLog | None = None
        self._renderer = Renderer()
        self._window: Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seeds ``np_random``; without it the episodes go on from it.
            options: ``"plan"`` and ``"start"``, see the class.

        Raises:
            ConfigError: If an option is unknown, or the start leaves no room for the robot.
            PlanError: If the plan can't be explored or doesn't fit on the canvas.
        """
        super().reset(seed=seed)
        announce_compilation(cast_sweep)
        explorations = self._explorations
        config = self.config
        self._latest: StepOutcome | None = None
        explorations.begin(_ONE, [self.np_random], ResetOptions.read(options))
        self._robot = Simulation(explorations.beliefs)
        self.log = EpisodeLog(config.lidar.num_beams) if config.record or self.render_mode else None
        self._record()
        observation = explorations.observer.observe_one(0, is_published=True)
        self._show()
        info = self.info()
        info["plan"] = self.plan.id
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive for one control step; see :class:`gymnasium.Env`.

        Raises:
            ActionError: If the action is of another kind than those of the space, or not a number.
        """
        explorations = self._explorations
        _ = self.simulation  # raises before the first reset
        return self._after(explorations.step(self._actions.to_command(action)))

    def place(self, pose: Pose2D, length: float, steps: int) -> tuple[Any, StepOutcome]:
        """Step to where so many control steps have brought the robot, without physics; see :func:`put_robot`."""
        _ = self.simulation  # raises before the first reset
        put_robot(self._explorations.fleet, pose, length, steps)
        self._latest = outcome = self._explorations.look(np.zeros((1, 2)))
        is_published = bool(self._explorations.is_published[0])
        return self._explorations.observer.observe_one(0, is_published), outcome

    def _after(self, outcome: StepOutcome) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """What a step returns."""
        explorations = self._explorations
        self._latest = outcome
        self._record()
        is_published = bool(explorations.is_published[0])
        observation = explorations.observer.observe_one(0, is_published)
        self._show()
        terminated = bool(outcome.terminations[0])
        truncated = bool(outcome.truncations[0])
        info = self.info()
        info["reward_terms"] = figures_of_one(outcome.terms)
        info["is_success"] = terminated
        if terminated or truncated:
            info["map_error"] = self.map_error()
        return observation, float(outcome.rewards[0]), terminated, truncated, info

    def conclude(self) -> tuple[float, dict[str, float]]:
        """Let the latest step be the last: what that adds to its reward, and to each term."""
        if self._latest is None:
            return 0.0, {}
        record = self._latest.record.but(terminated=np.ones(1, dtype=np.bool_))
        reward, terms = self._reward(record)
        added = {name: terms[name] - before for name, before in self._latest.terms.items()}
        return float(reward[0] - self._latest.rewards[0]), figures_of_one(added)

    def render(self) -> Any:
        """The frame, shape (720, 1280, 3) uint8, in mode ``"rgb_array"``; else None."""
        if self.render_mode == "rgb_array":
            return self._draw()
        if self.render_mode is None:
            gym.logger.warn(
                'render() needs a render_mode: make the environment with render_mode="rgb_array"'
            )
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    # What recorders, explorers and viewers may look at.

    @property
    def simulation(self) -> Simulation:
        """The running episode.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if self._robot is None:
            raise gym.error.ResetNeeded("call reset() before step() or render()")
        return self._robot

    @property
    def plan(self) -> FloorPlan:
        """The building. Privileged."""
        return self._explorations.fleet.each[0].prepared.plan

    @property
    def clutter(self) -> Clutter:
        """Furniture and people in it. Privileged."""
        return self._explorations.fleet.each[0].prepared.clutter

    @property
    def start(self) -> Pose2D:
        """Where the robot began, world frame. Privileged."""
        return self.simulation.start

    @property
    def mapper(self) -> Mapper:
        """SLAM, with its map and its estimate."""
        return self.simulation.mapper

    @property
    def coverage(self) -> Coverage:
        """Floor that was truly seen. Privileged."""
        return self.simulation.coverage

    def map_error(self) -> float:
        """Mean distance of the map's occupied cells from the nearest true obstacle [m]. Privileged."""
        return self._explorations.assessment.map_error(0)

    def scene(self) -> Scene:
        """Contents of a picture of this moment, where the steps are recorded. Privileged."""
        simulation = self.simulation
        assert self.log is not None
        return simulation.scene(self.log)

    def explorer_context(self) -> ExplorerContext:
        """Knowledge that an explorer may have in advance: the robot, the scanner and the frame of the map.

        Raises:
            ConfigError: If the observation's map is not the global one, on which explorers plan, or the
                actions are not velocities.
        """
        config = self.config
        observation = config.observation
        shows_whole_map = observation.preset == "dict" and observation.map == "global"
        if not shows_whole_map or config.actions == "discrete":
            raise ConfigError(
                'explorers need observation={"preset": "dict", "map": "global"} and velocities as actions; '
                "ExploreConfig.for_explorer() sets both"
            )
        return explorer_context(config)

    # The parts of reset and step.

    def info(self) -> dict[str, Any]:
        """The newest figures; the map's error is measured where somebody asks for it."""
        info = StepInfo(figures_of_one(self._explorations.figures()), self.map_error)
        if self._explorations.assessment.errors_read()[0]:
            info["map_error"] = self.map_error()
        return info

    def _record(self) -> None:
        if self.log is not None:
            self.log.note(self.simulation)

    def _show(self) -> None:
        if self.render_mode == "human":
            if self._window is None:
                self._window = Window("slamgym", self.metadata["render_fps"])
            self._window.show(self._draw())

    def _draw(self) -> ByteArray:
        """A picture of the episode."""
        return self._renderer.draw(self.scene())


def explorer_context(config: ExploreConfig) -> ExplorerContext:
    """What an explorer may know in advance of an environment with these settings."""
    return ExplorerContext(
        frame=config.observation.frame(),
        geometry=Lidar(config.lidar).geometry,
        robot_radius=config.robot.radius,
        max_linear=config.robot.max_linear,
        max_angular=config.robot.max_angular,
        control_step=config.control_step,
        map_update_interval=MAP_UPDATE_INTERVAL,
        normalized_actions=config.actions == "normalized",
    )
