"""The conditions of an exploration: its settings by their short names, as recipes set and manifests record them."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from slamgym.core.config import replace_setting, setting_names, suggest
from slamgym.core.errors import ConfigError
from slamgym.envs import ExploreConfig
from slamgym.envs.episode import EpisodeConfig
from slamgym.sim import lidar_level, odometry_level
from slamgym.sim.wheel_odometry import OdometryConfig

LEVELS: dict[str, Callable[[str], Any]] = {"lidar": lidar_level, "odometry": odometry_level}
"""Parts that can be set as a whole by the name of an error level."""
PARTS = ("robot", "lidar", "odometry", "slam", "clutter")
"""Parts of the environment whose settings bear on a map."""
EPISODE_SETTINGS = ("explorer", "minutes")
ODOMETRY_LEVELS = ("ideal", "low", "medium", "high")


def known_settings() -> list[str]:
    """Every name that a condition may have."""
    env = ExploreConfig()
    inner = [f"{part}.{name}" for part in PARTS for name in setting_names(getattr(env, part))]
    return [*EPISODE_SETTINGS, *LEVELS, *inner]


def apply_conditions(base: EpisodeConfig, conditions: Mapping[str, Any]) -> EpisodeConfig:
    """Put conditions into the settings of an exploration.

    Args:
        base: The settings.
        conditions: Settings by name: ``explorer``, ``minutes``, the name of an error level for ``lidar`` or
            ``odometry``, or single settings such as ``slam.particles``. Levels are set before single settings.

    Raises:
        ConfigError: If a name is unknown (the error suggests the nearest), or a value is refused.
    """
    config = base
    for name in sorted(conditions, key=lambda name: (name.count("."), name)):
        value = conditions[name]
        if name in EPISODE_SETTINGS:
            config = replace_setting(config, name, value)
        elif name in LEVELS:
            if not isinstance(value, str):
                raise ConfigError(f"{name} must be the name of an error level, not {value!r}")
            config = _with_env(config, name, LEVELS[name](value))
        elif name.partition(".")[0] in PARTS:
            config = dataclasses.replace(config, env=replace_setting(config.env, name, value))
        else:
            raise ConfigError(f"unknown setting {name!r}; {suggest(name, known_settings())}")
    return config


def setting_value(config: EpisodeConfig, name: str) -> Any:
    """The value of a setting by the name that conditions use."""
    value: Any = config if name in EPISODE_SETTINGS else config.env
    for part in name.split("."):
        value = getattr(value, part)
    return value


def standard_conditions(config: EpisodeConfig) -> dict[str, Any]:
    """What every manifest records, whether it varies or not."""
    env = config.env
    return {
        "explorer": config.explorer,
        "odometry": odometry_name(env.odometry),
        "slam.mode": env.slam.mode,
        "slam.particles": env.slam.particles,
        "lidar.range_max": env.lidar.range_max,
        "slam.max_usable_range": env.slam.max_usable_range,
        "clutter.furniture": env.clutter.furniture,
        "clutter.people": env.clutter.people,
    }


def odometry_name(config: OdometryConfig) -> str:
    """The error level that these settings are, or ``custom``."""
    for level in ODOMETRY_LEVELS:
        if odometry_level(level) == config:
            return level
    return "custom"


def _with_env(config: EpisodeConfig, part: str, value: Any) -> EpisodeConfig:
    return dataclasses.replace(config, env=dataclasses.replace(config.env, **{part: value}))
