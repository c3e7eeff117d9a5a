"""Joining a Ray cluster, or starting one on this machine: what goes wrong is one clear error."""

import logging
import os
import re
import socket
from types import ModuleType
from typing import Any

from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import available_cores

LOCAL_STORE_PER_WORKER = 64 << 20
"""Object store of a cluster on this machine, per worker: an exploration's files take a few MB."""

SMALLEST_STORE = 128 << 20
"""Ray refuses less than 75 MiB."""

CONNECTION_TIMEOUT = 10.0
"""How long a cluster's head may take to accept a connection [s]."""

_REASON_LENGTH = 200


def import_ray() -> ModuleType:
    """The ``ray`` package.

    Raises:
        ConfigError: If it isn't installed.
    """
    # No report of usage to Ray's makers, and no remarks about settings that concern GPUs alone.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise ConfigError(
            "--engine ray needs Ray, which is not installed: pip install 'slamgym[ray]'"
        ) from error
    module: ModuleType = ray
    return module


def connect(ray: ModuleType, workers: int, address: str | None) -> None:
    """Join a cluster or start one on this machine.

    Args:
        ray: The package.
        workers: Size of a cluster that is started here; 0 takes one per core.
        address: Where a cluster runs; None takes the ``RAY_ADDRESS`` of the environment, or starts one here.

    Raises:
        ConfigError: If no cluster answers or none can be started.
    """
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    address = address or os.environ.get("RAY_ADDRESS")
    joins = address is not None and address != "local"
    if address is not None and joins:
        check_address(address)
        options: dict[str, Any] = {"address": address}
    else:
        workers = workers or available_cores()
        store = max(SMALLEST_STORE, workers * LOCAL_STORE_PER_WORKER)
        options = {"address": "local", "num_cpus": workers, "object_store_memory": store}
        options["include_dashboard"] = False
    try:
        ray.init(**options, **quiet)
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        if joins:
            raise _no_answer(str(address), error) from error
        raise ConfigError(
            f"Ray could not be started on this machine ({one_line(error)}); its logs are in "
            "/tmp/ray/session_latest/logs, and --engine local does without it"
        ) from error


def check_address(address: str) -> None:
    """Find out at once that nobody listens, for which Ray itself takes minutes.

    Raises:
        ConfigError: If the address is ``host:port`` and takes no connection.
    """
    match = re.fullmatch(r"(?:ray://)?([^:/]+):(\d+)", address)
    if match is None:
        return
    try:
        socket.create_connection((match[1], int(match[2])), timeout=CONNECTION_TIMEOUT).close()
    except (OSError, OverflowError) as error:
        raise _no_answer(address, error) from error


def _no_answer(where: str, error: Exception) -> ConfigError:
    return ConfigError(
        f"--address: no Ray cluster answers at {where} ({one_line(error)}); `ray status` on its head shows "
        "whether it runs, and one that demands a token needs the same one here"
    )


def one_line(error: Exception) -> str:
    """What an error says, on one line of some length."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= _REASON_LENGTH else text[: _REASON_LENGTH - 3] + "..."
