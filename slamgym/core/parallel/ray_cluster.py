"""The driver's connection to a Ray cluster: made, watched and ended, none of which may take for ever.

A driver whose cluster has lost its head is left waiting by Ray for a minute; then Ray's core ends the process, past
all handling of errors. So whether the head still listens is asked here.
"""

import atexit
import logging
import os
import re
import socket
import threading
import time
from collections.abc import Iterable
from types import ModuleType
from typing import Any

from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.parallel.backlog import available_cores

LOCAL_STORE_PER_WORKER = 64 << 20
"""Object store of a cluster on this machine, per worker: an exploration's files take a few MB."""

SMALLEST_STORE = 128 << 20
"""Ray refuses less than 75 MiB."""

CONNECTION_TIMEOUT = 10.0
"""How long a cluster's head may take to accept the first connection [s]."""

CHECK_INTERVAL = 5.0
"""How often it is asked whether the head still listens, and how large the cluster is [s]."""

ANSWER_TIMEOUT = 5.0
"""How long the head may take to accept a connection later [s]."""

HEAD_PATIENCE = 20.0
"""How long the head may be away [s]: one that keeps its state in Redis can be started again. Ray's own patience,
after which it ends the process, is 60 s."""

RETRY_INTERVAL = 1.0
"""Time between two attempts to reach a head that is away [s]."""

CLOSE_TIMEOUT = 10.0
"""How long the good-bye to a cluster that is lost may take [s]."""

_REASON_LENGTH = 200


class ClusterLostError(SlamgymError):
    """The head of the Ray cluster, or Ray on this machine, has gone."""


class RayCluster:
    """A connection to a Ray cluster.

    Args:
        workers: Size of a cluster that is started here; 0 takes one per core.
        address: Where a cluster runs; None takes the ``RAY_ADDRESS`` of the environment, or starts one here. A
            connection that this process has already is used as it is.

    Raises:
        ConfigError: If Ray is not installed, or no cluster answers.
    """

    def __init__(self, workers: int, address: str | None = None) -> None:
        self.ray = _import_ray()
        address = address or os.environ.get("RAY_ADDRESS")
        self.is_ours = not self.ray.is_initialized()
        """Whether the connection was made here, and ends here."""
        if self.is_ours:
            _connect(self.ray, workers, address)
        self._head = _head_of(self.ray, address)
        self._is_lost = False
        self._next_check = 0.0
        self._cpus = 0

    def cpus(self) -> int:
        """Cores of the cluster, as they were counted a moment ago, when its head listened.

        Raises:
            ClusterLostError: If the head is gone.
        """
        if time.monotonic() >= self._next_check:
            self.check()
            self._cpus = int(self.ray.cluster_resources().get("CPU", 0))
        return self._cpus

    def wait(self, references: Iterable[Any]) -> Any | None:
        """The first of some tasks to end; None if none does for a while.

        Not for ever: a cluster without its head doesn't tell that a task is lost.
        """
        done, _ = self.ray.wait(list(references), num_returns=1, timeout=CHECK_INTERVAL)
        return done[0] if done else None

    def check(self) -> None:
        """Wait until the head listens.

        Raises:
            ClusterLostError: If it doesn't for :data:`HEAD_PATIENCE`.
        """
        began = time.monotonic()
        while not _listens(self._head):
            if time.monotonic() - began >= HEAD_PATIENCE:
                raise self.lost(f"the head of the Ray cluster, {self._head}, does not answer any more")
            time.sleep(RETRY_INTERVAL)
        self._next_check = time.monotonic() + CHECK_INTERVAL

    def lost(self, what: str) -> ClusterLostError:
        """The error that ends the run; nothing more is asked of the cluster."""
        self._is_lost = True
        return ClusterLostError(
            f"{what}; what was committed is safe: start Ray again and repeat the same command to go on"
        )

    def cancel(self, references: Iterable[Any]) -> None:
        """Give up tasks; a cluster that is lost has done so itself."""
        if not self._has_gone():
            for reference in references:
                self.ray.cancel(reference, force=True)

    def close(self) -> None:
        """End the connection, and the cluster if it was started here."""
        if not self.is_ours:
            return
        if not self._has_gone():
            self.ray.shutdown()
            return
        closing = threading.Thread(target=self.ray.shutdown, daemon=True)
        closing.start()
        closing.join(CLOSE_TIMEOUT)
        if closing.is_alive():
            atexit.unregister(self.ray.shutdown)  # which would wait for the same once more

    def _has_gone(self) -> bool:
        """Whether there is nobody to say good-bye to; after Ctrl-C or an error nobody has asked yet."""
        self._is_lost = self._is_lost or not _listens(self._head)
        return self._is_lost


def check_address(address: str) -> None:
    """Find out at once that nobody listens, for which Ray itself takes minutes.

    Raises:
        ConfigError: If the address is ``host:port`` and takes no connection.
    """
    place = _host_and_port(address)
    if place is None:
        return
    try:
        socket.create_connection(place, timeout=CONNECTION_TIMEOUT).close()
    except (OSError, OverflowError) as error:
        raise _no_answer(address, error) from error


def _import_ray() -> ModuleType:
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


def _connect(ray: ModuleType, workers: int, address: str | None) -> None:
    """Join a cluster or start one on this machine."""
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
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


def _head_of(ray: ModuleType, address: str | None) -> str:
    """Where the process listens that a driver can't do without; nothing if it can't be reached directly."""
    through_client = address is not None and address.startswith("ray://")
    place = address if through_client else ray.get_runtime_context().gcs_address
    return str(place) if _listens(str(place)) else ""


def _listens(address: str) -> bool:
    """Whether a connection is accepted at ``host:port``; an address of another form is believed to listen."""
    place = _host_and_port(address)
    if place is None:
        return True
    try:
        socket.create_connection(place, timeout=ANSWER_TIMEOUT).close()
    except OSError:
        return False
    return True


def _host_and_port(address: str) -> tuple[str, int] | None:
    match = re.fullmatch(r"(?:ray://)?([^:/]+):(\d+)", address)
    return (match[1], int(match[2])) if match else None


def _no_answer(where: str, error: Exception) -> ConfigError:
    return ConfigError(
        f"--address: no Ray cluster answers at {where} ({one_line(error)}); `ray status` on its head shows "
        "whether it runs, and one that demands a token needs the same one here"
    )


def one_line(error: Exception) -> str:
    """What an error says, on one line of some length."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= _REASON_LENGTH else text[: _REASON_LENGTH - 3] + "..."
