"""The algorithm of a training run and its hyper-parameters, by the names of Stable-Baselines3 and sb3-contrib."""

import importlib
import inspect
from collections.abc import Mapping
from dataclasses import field
from functools import cache
from pathlib import Path
from typing import Any

from slamgym.core.config import Settings, suggest
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_text

LIBRARIES = ("stable_baselines3", "sb3_contrib")
"""Where algorithms come from."""
_OWN = {"self", "policy", "env", "seed", "device", "verbose", "tensorboard_log", "policy_kwargs"}
_OWN |= {"_init_setup_model", "stats_window_size", "rollout_buffer_class", "rollout_buffer_kwargs"}
"""Arguments of an algorithm that a run sets itself."""
Value = bool | int | float | str | None
"""Of a hyper-parameter."""


class LearnerConfig(Settings, section="learner"):
    """An on-policy algorithm and its hyper-parameters."""

    algorithm: str = "ppo"
    """``ppo``, ``a2c``, or ``trpo`` of sb3-contrib."""
    hyperparameters: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the algorithm's class by name. A learning rate or clip range such as ``lin_3e-4`` falls linearly, as
    in rl-zoo."""

    def changed(self, algorithm: str | None, values: Mapping[str, Any]) -> "LearnerConfig":
        """The same with other hyper-parameters; of another algorithm those that it takes are kept."""
        name = algorithm or self.algorithm
        kept = {
            key: value
            for key, value in self.hyperparameters.items()
            if name == self.algorithm or key in hyperparameters_of(name)
        }
        return LearnerConfig(name, {**kept, **values})


@cache
def on_policy_algorithms() -> dict[str, Any]:
    """The on-policy algorithms of both libraries that take any actor and critic, by their lower-case names."""
    from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

    found: dict[str, Any] = {}
    for library in LIBRARIES:
        for name, value in vars(importlib.import_module(library)).items():
            is_class = inspect.isclass(value) and issubclass(value, OnPolicyAlgorithm)
            # These two ask for policies of their own: one with a memory, one with masks.
            if is_class and name not in ("RecurrentPPO", "MaskablePPO"):
                found[name.lower()] = value
    return found


def algorithm_class(name: str) -> Any:
    """An algorithm by its name.

    Raises:
        ConfigError: If there is none that trains these networks; the error suggests the nearest.
    """
    known = on_policy_algorithms()
    if name not in known:
        raise ConfigError(
            f"no on-policy algorithm {name!r} for these networks; {suggest(name, known)}"
        )
    return known[name]


def hyperparameters_of(name: str) -> set[str]:
    """Names of an algorithm's hyper-parameters."""
    return set(inspect.signature(algorithm_class(name).__init__).parameters) - _OWN


def arguments_of(config: LearnerConfig) -> dict[str, Any]:
    """The hyper-parameters as the algorithm's class takes them.

    Raises:
        ConfigError: If it takes no such hyper-parameter; the error suggests the nearest.
    """
    known = hyperparameters_of(config.algorithm)
    arguments: dict[str, Any] = {}
    for name, value in config.hyperparameters.items():
        if name not in known:
            raise ConfigError(
                f"{config.algorithm} takes no hyper-parameter {name!r}; {suggest(name, known)}"
            )
        arguments[name] = _scheduled(name, value)
    return arguments


def _scheduled(name: str, value: Any) -> Any:
    """A value as the algorithm takes it: text is a number, or one that falls linearly to a tenth."""
    if not isinstance(value, str):
        return value
    try:
        first = float(value.removeprefix("lin_"))
    except ValueError:
        raise ConfigError(f"{name}: {value!r} is no number; write 3e-4, or lin_3e-4") from None
    if not value.startswith("lin_"):
        return first
    return lambda left: first * max(0.1, left)


def parse_hyperparameters(texts: tuple[str, ...]) -> dict[str, Value]:
    """Hyper-parameters in rl-zoo's form, as in ``learning_rate:0.001``.

    Raises:
        ConfigError: If one isn't written so.
    """
    from yaml import YAMLError, safe_load

    values: dict[str, Value] = {}
    for text in texts:
        name, colon, value = text.partition(":")
        try:
            read = safe_load(value)
        except YAMLError:
            colon = ""
        if not (name and colon and value.strip()):
            raise ConfigError(f"{text!r} is no hyper-parameter; write learning_rate:0.001")
        values[name.strip()] = _number(read)
    return values


def read_hyperparameters(path: Path, env: str) -> dict[str, Value]:
    """Hyper-parameters out of a file of rl-zoo's, those of an environment.

    Args:
        path: A YAML file: environments' ids, each with hyper-parameters.
        env: Id, or its beginning up to the version.

    Raises:
        InputFileError: If the file is none, or has none for the environment.
    """
    from yaml import YAMLError, safe_load

    try:
        content = safe_load(read_text(path))
    except YAMLError as error:
        reason = " ".join(str(error).split())
        raise InputFileError(path, f"is no YAML ({reason}); rl-zoo's form is wanted") from None
    entries = content if isinstance(content, Mapping) else {}
    for name, values in entries.items():
        if str(name).startswith(env) and isinstance(values, Mapping):
            skipped = {"policy", "n_timesteps", "n_envs", "normalize", "policy_kwargs"}
            return {str(key): _number(value) for key, value in values.items() if key not in skipped}
    raise InputFileError(path, f"has no hyper-parameters of {env}; rl-zoo's form is wanted")


def _number(value: Any) -> Any:
    """A number that YAML takes for text, such as 1e5, as a number."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value
