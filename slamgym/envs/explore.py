"""The environment: a robot explores a floor plan and maps it with SLAM."""

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from slamgym.cad import FloorPlan
from slamgym.config import suggest
from slamgym.envs.completion import FrontierWatch
from slamgym.envs.config import ExploreConfig, resolve_config
from slamgym.envs.coverage import Coverage
from slamgym.envs.observations import MapView, Observation, Observer, make_view, observation_space
from slamgym.envs.recording import EpisodeLog
from slamgym.envs.rewards import Reward, RewardFunction, StepRecord
from slamgym.envs.simulation import Simulation, Streams
from slamgym.envs.sites import PlansArgument, Site, Sites
from slamgym.errors import ConfigError, PlanError
from slamgym.planning import ExplorerContext
from slamgym.sensors import Lidar
from slamgym.slam import Mapper
from slamgym.types import UNKNOWN, LaserScan, Pose2D, Twist2D
from slamgym.warmup import announce_compilation
from slamgym.world import Clutter, Motion, make_clutter

RENDER_MODES = ("rgb_array", "human")


class ResetOptions(NamedTuple):
    """What ``reset(options=...)`` may hold."""

    plan: str | FloorPlan | None = None
    start: Pose2D | None = None


class ExploreEnv(gym.Env[Observation, Any]):
    """A TurtleBot3-class robot explores an unknown building and maps it with a particle filter.

    ## Description

    A differential-drive robot with a 2D laser scanner is put down somewhere in a floor plan. It drives, its
    scanner and its wheel odometry measure with noise, and a Rao-Blackwellised particle filter (as GMapping)
    makes a map of it all. The task is to see the whole building: quickly, without collisions, and with a good
    map. Robot, scanner and SLAM have the values of a TurtleBot3 Waffle Pi and its launch files; a step lasts
    one scan, 0.2 s.

    Observations hold what the robot believes and measures, never the truth. Rewards and ``info`` do hold the
    truth (coverage, pose error): they are a privileged training signal.

    ## Action Space

    | Num | ``Box(-1, 1, (2,), float32)``, the default | Min | Max | Full scale |
    |-----|---------------------------------------------|-----|-----|------------|
    | 0   | speed, astern to ahead                      | -1  | 1   | 0.26 m/s   |
    | 1   | turning rate, clockwise to counter-clockwise | -1  | 1   | 1.82 rad/s |

    With ``actions="physical"`` the same in m/s and rad/s. What exceeds the limits is cut off; acceleration is
    limited too (2.5 m/s2, 3.2 rad/s2). With ``actions="discrete"``, as in ``slamgym/ExploreDiscrete-v0``,
    ``Discrete(3)``: 0 ahead at full speed, 1 turn left on the spot, 2 turn right, both at 1.82 rad/s.

    ## Observation Space

    ``Dict`` of:

    | Key        | Shape, type         | Min | Max   | Unit | Meaning |
    |------------|---------------------|-----|-------|------|---------|
    | "map"      | (1, 84, 84) uint8   | 0   | 255   | -    | SLAM map: 0 occupied, 205 unknown, 254 free |
    | "scan"     | (180,) float32      | 0   | 3.5   | m    | ranges from right to left; 3.5 no return, 0 nearer than 0.12 m |
    | "pose"     | (3,) float32        | -64, -64, -pi | 64, 64, pi | m, m, rad | believed x, y, theta in the map frame |
    | "velocity" | (2,) float32        | -0.52, -3.64 | 0.52, 3.64 | m/s, rad/s | by the wheel odometry |
    | "time"     | (1,) float32        | 0   | 420   | s    | since the start |

    The map frame has its origin at the start and the axes of the building. By default the map is an egocentric
    crop of 8.4 x 8.4 m at 0.1 m a cell: the believed pose in the middle, ahead up. With
    ``observation={"map": "global"}`` it is the whole map on a fixed canvas centred on the start, shape
    (1, 1280, 1280) for 64 m at 0.05 m, published anew every 2 s; with ``shared_map`` the same read-only array in between.

    With ``localization="ground_truth"`` the believed pose *is* the true pose, by that setting.

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
       checked whenever the map is published (``terminate_when_explored=False`` turns it off).
    2. Termination: the true coverage reaches ``coverage_goal`` (off by default; privileged).
    3. Truncation: ``time_limit`` is over, by default 420 s or 2,100 steps.

    ## Info

    ``coverage`` (share of the reachable floor truly seen, see :mod:`slamgym.envs.coverage`), ``path_length``
    [m], ``collisions`` (contacts begun), ``pose_error`` [m], ``heading_error`` [rad], ``n_eff``,
    ``true_pose`` (3,) in the world, ``reward_terms``; with the map error measured, or at the end of the
    episode, ``map_error`` [m]; at the end ``is_success`` (terminated). ``reset`` adds ``plan``, the id.

    ## Arguments

    Args:
        plans: Floor plans: what :func:`slamgym.cad.open_plans` takes (``"bundled"``, a file, a folder, an
            archive), a source of plans, or floor plans.
        config: Settings; the defaults where None.
        render_mode: ``"rgb_array"``, ``"human"`` or None.
        reward_terms: More terms of the reward: name to (weight, function).
        **settings: Fields of :class:`~slamgym.envs.config.ExploreConfig` by name, on top of ``config``: parts
            as dataclasses or as mappings of what differs, ``lidar`` and ``odometry`` also as the name of an
            error level, and ``localization`` (``"rbpf"``, ``"scan_matching"``, ``"dead_reckoning"``,
            ``"ground_truth"``).

    Raises:
        ConfigError: If a setting is unknown or makes no sense.
        InputFileError: If the plans can't be read.

    ## Reproducibility

    A seed decides everything. Plan, clutter, start, odometry, scanner and SLAM draw from generators of their
    own, derived from ``np_random`` at reset: with more particles the sensors' noise stays the same.

    ## Version History

    * v0: first version.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": 5}

    def __init__(
        self,
        plans: PlansArgument = "bundled",
        config: ExploreConfig | None = None,
        *,
        render_mode: str | None = None,
        reward_terms: Mapping[str, tuple[float, RewardFunction]] | None = None,
        **settings: Any,
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ConfigError(f"unknown render_mode {render_mode!r}; {suggest(render_mode, RENDER_MODES)}")
        announce_compilation()
        self.config = resolve_config(config, settings)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(self.config.lidar.rate)}
        self.observation_space = observation_space(self.config)
        self.action_space, self._commands = _action_space(self.config)
        self._lidar = Lidar(self.config.lidar)
        self._sites = Sites(plans, self.config.robot)
        self._observer = Observer(self.config)
        self._reward = Reward(self.config.reward, reward_terms)
        self._renderer: Any = None
        self._simulation: Simulation | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seeds ``np_random``; without it the episodes go on from it.
            options: ``"plan"`` and ``"start"``, see the class.

        Raises:
            ConfigError: If an option is unknown, or the start leaves no room for the robot.
            PlanError: If the plan can't be explored or doesn't fit on the canvas.
        """
        super().reset(seed=seed)
        wanted = _read_options(options)
        streams = Streams.spawn(self.np_random)
        site = self._choose_site(wanted, streams)
        start = wanted.start or site.sample_start(streams.start)
        self._refuse_too_large(site.plan, start)

        config = self.config
        self._site = site
        self._simulation = simulation = Simulation(site, start, config, self._lidar, streams)
        self._coverage = Coverage(
            site.floor.mask(start.x, start.y), site.floor.frame, self._lidar.geometry, config.usable_range
        )
        self._coverage.add(start, simulation.true_ranges)
        self._view: MapView = make_view(config)
        self._frontiers = FrontierWatch(config.robot.radius, config.min_frontier_size)
        self.log = EpisodeLog(config.lidar.num_beams) if config.record or self.render_mode else None
        self._record()
        self._last = self._take_stock(None, terminated=False)
        observation = self._observe(published=True)
        self._show()
        return observation, {**self._info(self._last), "plan": site.plan.id}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one control step; see :class:`gymnasium.Env`."""
        simulation = self.simulation
        motion = simulation.step(self._command(action))
        self._coverage.add(motion.pose, simulation.true_ranges)
        self._record()

        published = simulation.steps % self.config.publication_steps == 0
        terminated = self._is_complete(published)
        truncated = self.config.max_steps is not None and simulation.steps >= self.config.max_steps
        record = self._last = self._take_stock(motion, terminated)
        reward, terms = self._reward(record)

        observation = self._observe(published)
        info = {**self._info(record), "reward_terms": terms}
        if terminated or truncated:
            info["is_success"] = terminated
            info["map_error"] = self._map_error()
        self._show()
        return observation, reward, terminated, truncated, info

    def render(self) -> Any:
        """The frame, shape (height, width, 3) uint8, in mode ``"rgb_array"``; else None."""
        if self.render_mode == "rgb_array":
            return self._make_renderer().draw(self)
        if self.render_mode is None:
            gym.logger.warn(
                'render() shows nothing without a render_mode; make the environment with render_mode="rgb_array"'
            )
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

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
        return self._site.plan

    @property
    def clutter(self) -> Clutter:
        """Furniture and people in it. Privileged."""
        return self._site.clutter

    @property
    def start(self) -> Pose2D:
        """Where the robot began, world frame. Privileged."""
        return self.simulation.start

    @property
    def true_pose(self) -> Pose2D:
        """Where the robot is, world frame. Privileged."""
        return self.simulation.true_pose

    @property
    def world_from_map(self) -> Pose2D:
        """The map frame in the world, a translation. Privileged."""
        return self.simulation.world_from_map

    @property
    def odometry_pose(self) -> Pose2D:
        """Integrated wheel odometry; it starts in the map frame and drifts off."""
        return self.simulation.odometry_pose

    @property
    def scan(self) -> LaserScan:
        """The newest scan."""
        return self.simulation.scan

    @property
    def mapper(self) -> Mapper:
        """SLAM, with its map and its estimate."""
        return self.simulation.mapper

    @property
    def coverage(self) -> Coverage:
        """What was truly seen. Privileged."""
        return self._coverage

    def explorer_context(self) -> ExplorerContext:
        """What an explorer may know in advance: the robot, the scanner and the frame of the map.

        Raises:
            ConfigError: If the observation's map is not the global one, on which explorers plan, or the
                actions are not velocities.
        """
        config = self.config
        if config.observation.map != "global" or config.actions == "discrete":
            raise ConfigError(
                'explorers need observation={"map": "global"} and velocities as actions; '
                "ExploreConfig.for_explorer() sets both"
            )
        robot = config.robot
        return ExplorerContext(
            frame=config.observation.frame(),
            geometry=self._lidar.geometry,
            robot_radius=robot.circumscribed_radius,
            max_linear=robot.max_linear,
            max_angular=robot.max_angular,
            linear_acceleration=robot.linear_acceleration,
            angular_acceleration=robot.angular_acceleration,
            control_step=config.control_step,
            map_update_interval=config.map_update_interval,
            normalized_actions=config.actions == "normalized",
        )

    # The parts of reset and step.

    def _choose_site(self, wanted: ResetOptions, streams: Streams) -> Site:
        """The building, furnished and populated where the settings want it."""
        if wanted.plan is None:
            site = self._sites.draw(streams.plan)
        elif isinstance(wanted.plan, FloorPlan):
            site = self._sites.of(wanted.plan)
        else:
            site = self._sites.named(wanted.plan)
        clutter = self.config.clutter
        if clutter.furniture == 0.0 and clutter.people == 0:
            return site
        robot = self.config.robot
        return Site(site.plan, robot, make_clutter(site.plan, streams.clutter, clutter, robot))

    def _refuse_too_large(self, plan: FloorPlan, start: Pose2D) -> None:
        """Refuse a plan that reaches out of the canvas, because its map would be cut off."""
        observation = self.config.observation
        if observation.map != "global":
            return
        min_x, min_y, max_x, max_y = plan.bounds
        reach = max(start.x - min_x, max_x - start.x, start.y - min_y, max_y - start.y)
        if reach > 0.5 * observation.map_size:
            raise PlanError(
                plan.where,
                f"the plan reaches {reach:.1f} m from the start at ({start.x:.1f}, {start.y:.1f}) but the map only "
                f"{0.5 * observation.map_size:.1f} m; set observation.map_size to {2.0 * reach + 1.0:.0f} or more",
            )

    def _command(self, action: Any) -> Twist2D:
        """The velocity that an action asks for; the world cuts off what exceeds the robot's limits."""
        if self._commands:
            return self._commands[int(action)]
        linear, angular = float(action[0]), float(action[1])
        if self.config.actions == "normalized":
            robot = self.config.robot
            return Twist2D(linear * robot.max_linear, angular * robot.max_angular)
        return Twist2D(linear, angular)

    def _is_complete(self, published: bool) -> bool:
        """Whether the exploration is complete by one of the rules in force."""
        config, simulation = self.config, self.simulation
        if config.coverage_goal is not None and self._coverage.share >= config.coverage_goal:
            return True
        if not (config.terminate_when_explored and published):
            return False
        mapper = simulation.mapper
        return self._frontiers.is_explored(mapper.occupancy_grid(), mapper.pose)

    def _take_stock(self, motion: Motion | None, terminated: bool) -> StepRecord:
        """Judge the step, or with no motion the beginning."""
        simulation, reward = self.simulation, self._reward
        coverage = self._coverage.share
        record = StepRecord(
            duration=self.config.control_step if motion else 0.0,
            time=simulation.time,
            distance=motion.distance if motion else 0.0,
            contact=motion.contact if motion else False,
            coverage=coverage,
            previous_coverage=self._last.coverage if motion else coverage,
            pose_error=_distance(simulation.mapper.pose, simulation.true_map_pose),
            n_eff=simulation.mapper.n_eff,
            terminated=terminated,
        )
        if not (reward.needs_known_area or reward.needs_map_error or reward.needs_covariance):
            return record
        return self._take_dear_stock(record, self._last if motion else None)

    def _take_dear_stock(self, record: StepRecord, last: StepRecord | None) -> StepRecord:
        """Measure what only some reward terms need."""
        mapper, reward, dear = self.simulation.mapper, self._reward, {}
        is_same_map = last is not None and not self.simulation.is_new_scan_processed
        if reward.needs_known_area:
            area = last.known_area if last is not None and is_same_map else _known_area(mapper)
            dear.update(known_area=area, previous_known_area=last.known_area if last else area)
        if reward.needs_map_error:
            error = last.map_error if last is not None and is_same_map else self._map_error()
            dear.update(map_error=error, previous_map_error=last.map_error if last else error)
        if reward.needs_covariance:
            dear.update(position_sigma=float(np.sqrt(np.trace(mapper.covariance[:2, :2]))))
        return dataclasses.replace(record, **dear)

    def _map_error(self) -> float:
        simulation = self.simulation
        return self._site.wall_distance.mean_error(
            simulation.mapper.occupancy_grid(), simulation.world_from_map
        )

    def _observe(self, published: bool) -> Observation:
        simulation = self.simulation
        mapper = simulation.mapper
        cells = self._view.view(mapper, simulation.is_new_scan_processed, published)
        return self._observer.observe(cells, simulation.scan, mapper.pose, simulation.velocity)

    def _info(self, record: StepRecord) -> dict[str, Any]:
        simulation = self.simulation
        heading = simulation.mapper.pose.theta - simulation.true_pose.theta
        info = {
            "coverage": record.coverage,
            "path_length": simulation.path_length,
            "collisions": simulation.collisions,
            "pose_error": record.pose_error,
            "heading_error": abs((heading + np.pi) % (2.0 * np.pi) - np.pi),
            "n_eff": record.n_eff,
            "true_pose": np.array(simulation.true_pose),
        }
        if self._reward.needs_map_error:
            info["map_error"] = record.map_error
        return info

    def _record(self) -> None:
        if self.log is not None:
            simulation = self.simulation
            self.log.append(
                simulation.scan, simulation.true_pose, simulation.odometry_pose, simulation.mapper.pose
            )

    def _show(self) -> None:
        if self.render_mode == "human":
            self._make_renderer().show(self)

    def _make_renderer(self) -> Any:
        if self._renderer is None:
            from slamgym.envs.rendering import Renderer

            self._renderer = Renderer(self.metadata["render_fps"])
        return self._renderer


def _action_space(config: ExploreConfig) -> tuple[spaces.Space[Any], tuple[Twist2D, ...]]:
    """The space of the actions and, where they are discrete, what each one commands."""
    robot = config.robot
    if config.actions == "discrete":
        commands = (
            Twist2D(robot.max_linear, 0.0),
            Twist2D(0.0, robot.max_angular),
            Twist2D(0.0, -robot.max_angular),
        )
        return spaces.Discrete(len(commands)), commands
    high = np.ones(2, dtype=np.float32)
    if config.actions == "physical":
        high = np.array([robot.max_linear, robot.max_angular], dtype=np.float32)
    return spaces.Box(-high, high, dtype=np.float32), ()


def _read_options(options: Mapping[str, Any] | None) -> ResetOptions:
    """Check the options of a reset."""
    if not options:
        return ResetOptions()
    for name in options:
        if name not in ResetOptions._fields:
            raise ConfigError(f"unknown reset option {name!r}; {suggest(name, ResetOptions._fields)}")
    plan, start = options.get("plan"), options.get("start")
    if plan is not None and not isinstance(plan, str | FloorPlan):
        raise ConfigError(f"the reset option 'plan' must be an id or a FloorPlan, not {plan!r}")
    if start is None:
        return ResetOptions(plan)
    try:
        x, y, theta = (float(value) for value in start)
    except (TypeError, ValueError):
        raise ConfigError(f"the reset option 'start' must be (x, y, theta), not {start!r}") from None
    return ResetOptions(plan, Pose2D(x, y, theta))


def _distance(a: Pose2D, b: Pose2D) -> float:
    return float(np.hypot(a.x - b.x, a.y - b.y))


def _known_area(mapper: Mapper) -> float:
    """Area of the map's known cells [m2]."""
    grid = mapper.occupancy_grid()
    return float(np.count_nonzero(grid.cells != UNKNOWN)) * grid.frame.resolution**2
