"""One exploration from start to end, and everything about it that is worth keeping."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, Protocol

from slamgym.cad import FloorPlan
from slamgym.core.config import Positive, Settings, Within
from slamgym.core.types import (
    Explorer,
    LaserGeometry,
    LaserScan,
    Observation,
    OccupancyGrid,
    Pose2D,
    Trajectory,
)
from slamgym.envs import EpisodeLog, ExploreConfig, ExploreEnv
from slamgym.envs.stuck import StuckWatch
from slamgym.envs.team.config import TeamConfig
from slamgym.interop import LogRecord
from slamgym.planning import ExplorerContext

AUTO_BASE = 300.0
"""Part of the automatic time limit that every plan gets [s]."""
AUTO_PER_AREA = 8.0
"""Part of the automatic time limit that grows with the free area [s/m2]."""


class MakeExplorer(Protocol):
    """Makes an explorer by its name; raises :class:`~slamgym.core.errors.ConfigError` for an unknown one."""

    def __call__(self, name: str, context: ExplorerContext, seed: int = 0) -> Explorer:
        """Make a fresh explorer for one exploration."""
        ...


def explored_env(env: ExploreConfig) -> ExploreConfig:
    """The settings of an exploration's environment, so that the saved ones say what was done.

    The limit of robot time is the exploration's; it takes the place of the environment's own.
    """
    return dataclasses.replace(env.for_explorer(), time_limit=None)


def fitted_env(
    plan: FloorPlan, env: ExploreConfig, minutes: Literal["auto"] | float
) -> ExploreConfig:
    """The settings for one plan: its limit of robot time [min], and a canvas that holds it."""
    observation = env.observation.holding(plan.extent)
    return dataclasses.replace(env, time_limit=time_limit(plan, minutes), observation=observation)


class EpisodeConfig(Settings):
    """Settings for exploring a floor plan."""

    explorer: str = "rl"
    """Name of the explorer."""
    minutes: Literal["auto"] | Positive = "auto"
    """Limit of robot time [min]; ``auto`` grows with the floor area (:func:`time_limit`). The paper has 7."""
    stuck_after: Positive | None = None
    """An exploration ends where the ratio of black to white of its map has stood still for so long, the paper's rule
    for a robot that is stuck [min]; None lets it go on (:func:`~slamgym.envs.stuck.is_stuck`)."""
    turn_deg: Annotated[float, Within(ge=-180.0, le=180.0)] = 0.0
    """The building is turned by this first: people's maps lie as the robot stood when it was switched on [deg]."""
    env: ExploreConfig = field(default_factory=ExploreConfig)
    """Robot, sensors, SLAM, clutter. What concerns learning, such as rewards, has no effect."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "env", explored_env(self.env))


@dataclass(frozen=True)
class Episode:
    """An exploration that has ended. Trajectories, map and log are in the map frame."""

    plan: FloorPlan
    seed: int
    start: Pose2D  # world frame
    slam_map: OccupancyGrid
    truth: Trajectory  # one pose a scan
    odometry: Trajectory  # one pose a scan
    estimate: Trajectory  # one pose a processed scan, as corrected by the end
    final_estimate: Pose2D  # where the robot believes to be at the end
    geometry: LaserGeometry
    log: EpisodeLog
    finished: str  # "explored", "stuck" or "time_limit"
    time_limit: float  # [s]
    coverage: float  # share of the reachable floor that was truly seen
    collisions: int  # contacts begun

    @property
    def robot_seconds(self) -> float:
        """Duration on the robot's clock [s]."""
        return float(self.truth.stamps[-1]) + self.geometry.scan_time

    @property
    def records(self) -> Iterator[LogRecord]:
        """Scans and odometry, as a robot would log them."""
        log = self.log
        for stamp, pose, motion, ranges in zip(
            log.stamps.tolist(),
            log.odometry.tolist(),
            log.motions.tolist(),
            log.ranges,
            strict=True,
        ):
            scan = LaserScan(stamp, ranges, self.geometry, Pose2D(*motion))
            yield LogRecord(stamp, Pose2D(*pose), scan)


def time_limit(plan: FloorPlan, minutes: Literal["auto"] | float) -> float:
    """Robot time after which an exploration is cut off [s].

    ``auto`` is there to end explorations that go round in circles, not to hurry others: Explore Lite took
    2.4 s/m2 in the median of 50 HouseExpo plans, and 8.0 s/m2 in the slowest.
    """
    return AUTO_BASE + AUTO_PER_AREA * plan.area if minutes == "auto" else 60.0 * float(minutes)


def check_explorer(config: EpisodeConfig, make_explorer: MakeExplorer, name: str) -> None:
    """Make an explorer without exploring, to find a wrong setting before any work is done.

    Raises:
        ConfigError: If there is no explorer of that name, or the environment refuses a setting.
    """
    alone = dataclasses.replace(config.env, team=TeamConfig())
    make_explorer(name, ExploreEnv("bundled", alone).explorer_context())


def episode_steps(
    env: ExploreEnv, explorer: Explorer, start: tuple[Observation, dict[str, Any]]
) -> Iterator[dict[str, Any]]:
    """Let an explorer drive until it says that it is done or the environment cuts it off.

    Args:
        env: The environment; its state is that of the step yielded last.
        explorer: Whether it was done at the end, its ``finished`` says.
        start: What the environment's reset returned.

    Yields:
        The environment's ``info``: that of the reset, and that of each step.
    """
    observation, info = start
    yield info
    truncated = False
    while not truncated:
        action, _ = explorer.predict(observation)
        if explorer.finished:
            return
        observation, _, _, truncated, info = env.step(action)
        yield info


def run_episode(
    plan: FloorPlan, seed: int, config: EpisodeConfig, make_explorer: MakeExplorer
) -> Episode:
    """Let an explorer map a building until it says that it is done, it is stuck or the time is up.

    Args:
        plan: The building.
        seed: Of the start, the noise, the clutter and the explorer.
        config: The settings.
        make_explorer: Makes the explorer that ``config.explorer`` names.

    Raises:
        PlanError: If the robot fits nowhere in the plan.
        ConfigError: If there is no explorer of that name.
    """
    plan = plan.turned(config.turn_deg)
    env = ExploreEnv(plan, fitted_env(plan, config.env, config.minutes))
    explorer = make_explorer(config.explorer, env.explorer_context(), seed)
    watch = StuckWatch(60.0 * config.stuck_after) if config.stuck_after else None
    for info in episode_steps(env, explorer, env.reset(seed=seed, options={"plan": plan})):
        outcome = info
        if watch and watch.look(env):
            break
    ending = "stuck" if watch and watch.is_stuck else "time_limit"
    log = env.log
    assert log is not None, "EpisodeConfig has the environment keep a log"
    return Episode(
        plan=plan,
        seed=seed,
        start=env.start,
        slam_map=env.mapper.occupancy_grid(),
        truth=log.true_trajectory(env.start),
        odometry=Trajectory(log.stamps, log.odometry),
        estimate=env.mapper.trajectory(),
        final_estimate=env.simulation.believed_pose,
        geometry=env.simulation.scan.geometry,
        log=log,
        finished="explored" if explorer.finished else ending,
        time_limit=time_limit(plan, config.minutes),
        coverage=outcome["coverage"],
        collisions=outcome["collisions"],
    )
