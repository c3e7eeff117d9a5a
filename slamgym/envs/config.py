"""Settings of the environment, nested as its parts are, and how keyword arguments become one of them."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Annotated, Any, Literal

from slamgym.core.config import Positive, PositiveShare, Settings, Within, from_dict, suggest
from slamgym.core.errors import ConfigError
from slamgym.core.limits import MAP_CELLS
from slamgym.core.types import GridFrame
from slamgym.envs.rewards import RewardConfig
from slamgym.envs.team.config import TeamConfig
from slamgym.planning.promise import Promise
from slamgym.sim import (
    ClutterConfig,
    LidarConfig,
    OdometryConfig,
    RobotConfig,
    lidar_level,
    odometry_level,
)
from slamgym.slam import SlamConfig

MAP_UPDATE_INTERVAL = 2.0
"""Time between two publications of the map (``map_update_interval`` of TurtleBot3's GMapping) [s]."""


class ObservationConfig(Settings, section="observation"):
    """Contents of the observation and of its map."""

    preset: Literal["dict", "map", "compact", "compact_far"] = "dict"
    """``dict``: map, scan, pose, velocity and time in their units; ``map``: the map alone, a picture of bytes;
    ``compact``: a vector in [-1, 1] for perceptrons (:mod:`slamgym.envs.compact`); ``compact_far``: the same, and which
    way leads to the nearest unknown space (:mod:`slamgym.envs.far_look`)."""

    map: Literal["egocentric", "global"] = "egocentric"
    """``egocentric``: a crop of the newest map about the believed pose, turned so that ahead is up;
    ``global``: the whole map as it was last published, on a canvas centred on the start."""

    crop_px: Annotated[int, Within(ge=1, le=2048)] = 84
    """Side of the egocentric crop [cells]; 84 is what convolutional policies are used to."""

    crop_resolution: Annotated[float, Within(gt=0.0, le=10.0)] = 0.1
    """Cell size of the egocentric crop [m]; 84 cells show 4.2 m to every side, more than the LDS-01 sees."""

    map_size: Annotated[float, Within(gt=0.0, le=1e4)] = 64.0
    """Side of the global canvas [m]; no plan may reach out of it, wherever the robot starts. Where whole
    explorations are run it grows with the plan (:meth:`holding`)."""

    map_resolution: Annotated[float, Within(gt=0.0, le=1.0)] = 0.05
    """Cell size of the global canvas [m]."""

    shared_map: bool = False
    """Observations between two publications hold the very same read-only global map. That saves copies of
    some megabytes a second, but Gymnasium's checks want observations that share nothing."""

    @property
    def is_compact(self) -> bool:
        """True if a vector is observed."""
        return self.preset in ("compact", "compact_far")

    @property
    def is_whole_map(self) -> bool:
        """True if the whole map is observed as a picture."""
        return self.map == "global" and not self.is_compact

    @property
    def crop_side(self) -> float:
        """Side of the egocentric crop [m]."""
        return self.crop_px * self.crop_resolution

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the observation's map."""
        if self.map == "egocentric":
            return 1, self.crop_px, self.crop_px
        return 1, *self.frame().shape

    @property
    def largest_extent(self) -> float:
        """Longest side of a plan that fits into memory, wherever the robot starts [m]."""
        return 0.5 * self.map_resolution * math.isqrt(MAP_CELLS.value)

    def holding(self, extent: float) -> "ObservationConfig":
        """The same with a canvas that holds a plan of some extent [m], wherever the robot starts."""
        needed = float(math.ceil(2.0 * extent))
        return dataclasses.replace(self, map_size=max(self.map_size, needed))

    def frame(self) -> GridFrame:
        """The global canvas in the map frame: centred on the start, the origin being a corner of cells."""
        half = max(1, round(0.5 * self.map_size / self.map_resolution))
        origin = -half * self.map_resolution
        return GridFrame(self.map_resolution, origin, origin, 2 * half, 2 * half)


class ExploreConfig(Settings):
    """Everything about an exploration but the floor plan."""

    robot: RobotConfig = field(default_factory=RobotConfig)
    """Measures and limits of the robot."""

    lidar: LidarConfig = field(default_factory=LidarConfig)
    """The scanner; an environment step lasts one of its turns. Also the name of an error level."""

    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    """Errors of the wheel odometry; also the name of an error level."""

    slam: SlamConfig = field(default_factory=SlamConfig)
    """Localisation and mapping."""

    finished_map: str | None = None
    """With ``localization="map"``: the yaml file of the map that the robot is given, in the plan's frame. None draws it
    from the plan, as a drawing from before the furniture came."""

    clutter: ClutterConfig = field(default_factory=ClutterConfig)
    """Furniture and people, which no drawing shows."""

    observation: ObservationConfig = field(default_factory=ObservationConfig)
    """The observation's map."""

    reward: RewardConfig = field(default_factory=RewardConfig)
    """Weights of the reward terms."""

    actions: Literal["normalized", "physical", "discrete"] = "normalized"
    """``normalized``: shares of the highest speeds in [-1, 1]; ``physical``: m/s and rad/s; ``discrete``:
    forward, left, right."""

    time_limit: Positive | None = 420.0
    """Robot time after which an episode is truncated: the 7 minutes of Daher et al.; None for none [s]."""

    coverage_goal: PositiveShare | None = None
    """An episode terminates once this share of the reachable floor has truly been seen. The truth decides
    that, so it is a privileged training signal, which no robot has; None turns it off."""

    terminate_when_explored: bool | str = True
    """An episode terminates once the published map shows no frontier that the robot could reach; or, with a promise
    such as ``"98%:95%"``, once the map keeps it (:class:`~slamgym.planning.promise.Promise`)."""

    team: TeamConfig = field(default_factory=TeamConfig)
    """How many robots explore the building, and when they hear each other."""

    record: bool = False
    """True to keep an :class:`~slamgym.envs.simulation.EpisodeLog` of every scan."""

    def _check(self) -> None:
        _ = self.promise

    @property
    def promise(self) -> Promise | None:
        """Promise that must be kept for an episode to terminate, if there is one."""
        rule = self.terminate_when_explored
        return Promise.parse(rule) if isinstance(rule, str) else None

    @property
    def control_step(self) -> float:
        """Duration of an environment step, which is that of a scan [s]."""
        return 1.0 / self.lidar.rate

    @property
    def max_steps(self) -> int | None:
        """Environment steps until the time limit."""
        limit = self.time_limit
        return None if limit is None else max(1, math.ceil(limit * self.lidar.rate - 1e-9))

    @property
    def publication_steps(self) -> int:
        """Environment steps between two publications of the map."""
        return max(1, round(MAP_UPDATE_INTERVAL * self.lidar.rate))

    @property
    def usable_range(self) -> float:
        """Range of the scanner that is used for mapping [m]."""
        return min(self.slam.max_usable_range, self.lidar.range_max)

    def for_explorer(self) -> "ExploreConfig":
        """The same exploration as a frontier explorer needs it.

        The whole map is observed (and shared between steps), every scan is recorded, and the explorer alone
        decides when it is done.
        """
        whole_map = dataclasses.replace(
            self.observation, preset="dict", map="global", shared_map=True
        )
        return dataclasses.replace(
            self,
            observation=whole_map,
            actions="physical" if self.actions == "discrete" else self.actions,
            coverage_goal=None,
            terminate_when_explored=False,
            record=True,
        )


ERROR_LEVELS: dict[str, Callable[[str], Any]] = {"lidar": lidar_level, "odometry": odometry_level}
"""Parts that can be set as a whole by the name of an error level."""


def resolve_config(config: ExploreConfig | None, settings: Mapping[str, Any]) -> ExploreConfig:
    """Merge keyword arguments into a configuration.

    Args:
        config: What the settings change; the defaults where None.
        settings: Fields of :class:`ExploreConfig` by name. A part is given as its dataclass, as a mapping of
            the fields that differ, or, for the lidar and the odometry, as the name of an error level.
            ``localization`` stands for ``slam.mode``.

    Raises:
        ConfigError: If a name is unknown; the error suggests the nearest one.
    """
    config = config or ExploreConfig()
    settings = dict(settings)
    mode = settings.pop("localization", None)
    known = {entry.name for entry in dataclasses.fields(ExploreConfig)}
    changes: dict[str, Any] = {}
    for name, value in settings.items():
        if name not in known:
            raise ConfigError(
                f"unknown setting {name!r} of ExploreEnv; {suggest(name, known | {'localization', 'plans'})}"
            )
        changes[name] = resolve_part(name, getattr(config, name), value)
    if mode is not None:
        changes["slam"] = dataclasses.replace(changes.get("slam", config.slam), mode=mode)
    return dataclasses.replace(config, **changes)


def resolve_part(name: str, current: Any, value: Any) -> Any:
    """A field's new value: as given, or with what a mapping or the name of an error level changes."""
    is_part = dataclasses.is_dataclass(current) and not isinstance(current, type)
    if not is_part or isinstance(value, type(current)):
        return value
    if isinstance(value, str) and name in ERROR_LEVELS:
        return ERROR_LEVELS[name](value)
    if isinstance(value, Mapping):
        values = {entry.name: getattr(current, entry.name) for entry in dataclasses.fields(current)}
        return from_dict(type(current), {**values, **value}, name)
    kind = type(current).__name__
    if name in ERROR_LEVELS:
        raise ConfigError(
            f"{name} must be a {kind} or a mapping of its fields, or the name of an error level, not {value!r}"
        )
    raise ConfigError(f"{name} must be a {kind} or a mapping of its fields, not {value!r}")
