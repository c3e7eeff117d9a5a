"""Packages that not every installation has, and the extras that bring them."""

import importlib.util
from typing import NamedTuple

from slamgym.core.errors import SlamgymError


class Extra(NamedTuple):
    """What a command or an option needs beyond the base installation."""

    name: str
    """As ``pyproject.toml`` has it."""
    packages: tuple[str, ...]
    """Those of its packages that are needed, as they are imported."""


LEARNING = Extra("agents", ("torch", "stable_baselines3", "tensorboard", "matplotlib"))
TRANSLATING = Extra("gan", ("torch", "safetensors"))


def require(extra: Extra, what: str, otherwise: str = "") -> None:
    """Refuse with one sentence where a package is missing, before any work is done.

    Args:
        extra: The packages.
        what: The command or option that needs them.
        otherwise: What works without them, behind the advice to install them.

    Raises:
        SlamgymError: If one of them isn't installed.
    """
    for package in extra.packages:
        if not is_installed(package):
            raise SlamgymError(
                f"{what} needs the package {package!r}; install it with: pip install 'slamgym[{extra.name}]'"
                f"{otherwise}"
            )


def is_installed(package: str) -> bool:
    """Whether a package can be imported; it isn't."""
    return importlib.util.find_spec(package) is not None
