"""The environment: a robot explores a floor plan and maps it with SLAM."""

import math
from typing import Any

import gymnasium as gym

from slamgym.cad import FloorPlan
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError, PlanError
from slamgym.core.jit import announce_compilation
from slamgym.core.types import ByteArray, Pose2D
from slamgym.envs.assessment import Assessment
from slamgym.envs.completion import CompletionDetector
from slamgym.envs.config import MAP_UPDATE_INTERVAL, ExploreConfig, resolve_config
from slamgym.envs.coverage import Coverage
from slamgym.envs.observations import Measurements, SensedStep, make_view, observation_space
from slamgym.envs.plan_cache import PlanCache, PlansArgument, ResetOptions, Streams
from slamgym.envs.rewards import Reward, RewardTerms
from slamgym.envs.simulation import Actions, EpisodeLog, Simulation
from slamgym.planning import ExplorerContext
from slamgym.sim import Clutter, Lidar
from slamgym.sim.raycast import cast_sweep
from slamgym.slam import Mapper
from slamgym.viz.exploration import Renderer, Scene
from slamgym.viz.window import Window

RENDER_MODES = ("rgb_array", "human")


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
    limited too (2.5 m/s2, 3.2 rad/s2). With ``actions="discrete"``, as in ``slamgym/ExploreDiscrete-v2``,
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
    ``true_pose`` (3,) in the world, ``reward_terms``; where a reward reads it, and at the end of the episode,
    ``map_error`` [m]; at the end ``is_success`` (terminated). ``reset`` adds ``plan``, the id.

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

    * v2: the default localisation is ``pose_graph``.
    * v1: the laser's errors belong to places, and furniture is what a laser near the floor sees.
    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 5}  # noqa: RUF012 - Gymnasium declares it so

    def __init__(
        self,
        plans: PlansArgument = "bundled",
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
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(self.config.lidar.rate)}
        self.observation_space = observation_space(self.config)
        self._actions = Actions(self.config)
        self.action_space = self._actions.space
        self._lidar = Lidar(self.config.lidar)
        self._plan_cache = PlanCache(plans, self.config.robot, self.config.lidar.surfaces)
        self._measurements = Measurements(self.config)
        self._reward = Reward(self.config.reward, reward_terms)
        self._renderer = Renderer()
        self._window: Window | None = None
        self._simulation: Simulation | None = None

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
        config = self.config
        wanted = ResetOptions.read(options)
        streams = Streams.spawn(self.np_random)
        prepared, start = self._plan_cache.choose_site(wanted, streams, config.clutter)
        self._prepared = prepared
        self._refuse_too_large(prepared.plan, start)

        simulation = Simulation(prepared, start, config, self._lidar, streams)
        self._simulation = simulation
        self.assessment = Assessment(
            prepared, simulation, self._lidar.geometry, config.usable_range, self._reward
        )
        self._view = make_view(config)
        self._frontiers = CompletionDetector.of(config)
        self.log = EpisodeLog(config.lidar.num_beams) if config.record or self.render_mode else None
        self._record()
        observation = self._observe(is_publication_due=True)
        self._show()
        info = self.assessment.info()
        info["plan"] = self.plan.id
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive for one control step; see :class:`gymnasium.Env`."""
        config = self.config
        simulation = self.simulation
        assessment = self.assessment
        motion = simulation.step(self._actions.to_command(action))
        assessment.look()
        self._record()

        is_publication_due = simulation.steps % config.publication_steps == 0
        terminated = self._is_complete(is_publication_due)
        truncated = config.max_steps is not None and simulation.steps >= config.max_steps
        record = assessment.assess(motion, config.control_step, terminated)
        reward, terms = self._reward(record)

        observation = self._observe(is_publication_due)
        info = assessment.info()
        info["reward_terms"] = terms
        if terminated or truncated:
            info["is_success"] = terminated
            info["map_error"] = assessment.map_error.measure()
        self._show()
        return observation, reward, terminated, truncated, info

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
        if self._simulation is None:
            raise gym.error.ResetNeeded("call reset() before step() or render()")
        return self._simulation

    @property
    def plan(self) -> FloorPlan:
        """The building. Privileged."""
        return self._prepared.plan

    @property
    def clutter(self) -> Clutter:
        """Furniture and people in it. Privileged."""
        return self._prepared.clutter

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
        return self.assessment.coverage

    def map_error(self) -> float:
        """Mean distance of the map's occupied cells from the nearest true obstacle [m]. Privileged."""
        return self.assessment.map_error.measure()

    def scene(self) -> Scene:
        """Contents of a picture of this moment, where the steps are recorded. Privileged."""
        _ = self.simulation  # raises before the first reset
        assert self.log is not None
        return self.assessment.scene(self.log)

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

    def _refuse_too_large(self, plan: FloorPlan, start: Pose2D) -> None:
        """Refuse a plan that reaches out of the canvas, because its map would be cut off."""
        observation = self.config.observation
        if observation.map != "global" or observation.is_compact:
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

    def _is_complete(self, is_publication_due: bool) -> bool:
        """True if the exploration is complete by one of the rules in force."""
        config = self.config
        if config.coverage_goal is not None and self.coverage.share >= config.coverage_goal:
            return True
        if not (config.terminate_when_explored and is_publication_due):
            return False
        grid = self.simulation.mapper.occupancy_grid()
        return self._frontiers.is_explored(grid, self.simulation.believed_pose)

    def _observe(self, is_publication_due: bool) -> Any:
        simulation = self.simulation
        now = SensedStep(
            mapper=simulation.mapper,
            ranges=simulation.ranges,
            pose=simulation.believed_pose,
            velocity=simulation.velocity,
            is_new=simulation.is_new_scan_processed,
            is_published=is_publication_due,
        )
        seen = self._view.look(now)
        if self.config.observation.preset != "dict":
            return seen
        stamps = (simulation.time,)
        return self._measurements.observe(seen, now.ranges, now.pose, now.velocity, stamps)

    def _record(self) -> None:
        if self.log is not None:
            now = self.simulation
            self.log.append(
                stamps=now.scan.stamp,
                true_poses=now.true_scan_pose,
                odometry=now.scan_odometry,
                estimates=now.mapper.pose,
                motions=now.scan.motion,
                ranges=now.scan.ranges,
            )

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
