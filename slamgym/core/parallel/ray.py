"""The processes of a Ray cluster that somebody has started.

The driver alone writes. Tasks give their files back as bytes through Ray's object store, so the nodes need no
common file system; a bounded number of tasks is under way, so the store does not fill up. A driver whose cluster
has lost its head is ended by Ray, which says so, after a minute; what was committed stays.
"""

import logging
import os
import re
import socket
from collections.abc import Callable, Iterable, Iterator
from types import ModuleType
from typing import Any, TypeVar

import cv2

from slamgym import __version__
from slamgym.core.errors import ConfigError, SlamgymError, needing_extra
from slamgym.core.interruption import kept_termination
from slamgym.core.parallel.backlog import Attempt, Backlog, Engine, Lost, run_limited

CONNECTION_TIMEOUT = 10.0
"""Longest time that a cluster's head may take to accept a connection [s]."""

_REASON_LENGTH = 200

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def import_ray() -> ModuleType:
    """The ``ray`` package.

    Raises:
        ConfigError: If it isn't installed.
    """
    # No report of usage to Ray's makers, and no remarks about settings that concern GPUs alone.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    with needing_extra("--engine ray", "ray"):
        import ray
    return ray


def connect(ray: ModuleType, address: str | None) -> None:
    """Join a cluster.

    Args:
        ray: The package.
        address: Where a cluster runs; None takes the ``RAY_ADDRESS`` of the environment.

    Raises:
        ConfigError: If none is named, or it doesn't answer.
    """
    address = address or os.environ.get("RAY_ADDRESS")
    if address is None:
        raise ConfigError(
            "--engine ray needs a cluster that runs: add --address, e.g. auto after `ray start --head`; on one "
            "machine the default engine does the same"
        )
    check_address(address)
    try:
        with kept_termination():  # Ray's own way would be to exit with status 15
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        raise _no_answer(address, error) from error


def check_address(address: str) -> None:
    """Find out at once that nothing listens; Ray itself takes minutes.

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
    """The text of an error, on one line of some length."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= _REASON_LENGTH else text[: _REASON_LENGTH - 3] + "..."


IN_FLIGHT_PER_CPU = 2
"""Tasks handed to Ray per core of the cluster: one to run, and one that waits, by which a cluster that can
grow sees that there is work."""

FETCH_TIMEOUT = 60.0
"""Longest time that the few MB of a result that is ready may take to arrive [s]."""


class RayEngine(Engine):
    """A Ray cluster.

    Args:
        workers: The most tasks at a time, 0 for all it has.
        address: Where a cluster runs; None takes the ``RAY_ADDRESS`` of the environment. A connection that this
            process has already is used as it is.
        timeout: Longest wall time of a task [s]; None for no limit.

    Raises:
        ConfigError: If Ray is not installed, or no cluster answers.
    """

    shares_files = False

    def __init__(
        self, workers: int, address: str | None = None, timeout: float | None = None
    ) -> None:
        self._ray = import_ray()
        self._is_ours = not self._ray.is_initialized()
        """True if the connection was made here, and ends here."""
        if self._is_ours:
            connect(self._ray, address)
        self._most = workers
        self._timeout = timeout

    def close(self) -> None:
        """End the connection, if it was made here."""
        if self._is_ours:
            self._ray.shutdown()

    def run(
        self, task: Callable[[_Item], _Result], items: Iterable[_Item]
    ) -> Iterator[_Result | Lost[_Item]]:
        """Run the task on the cluster's workers.

        Raises:
            SlamgymError: If Ray fails.
        """
        # Ray's own retries are off: the count is kept here, the same for crashes, lost nodes and lost results.
        remote = self._ray.remote(num_cpus=1, max_retries=0)(_run_on_node)
        backlog = Backlog(items, self._timeout)
        pending: dict[Any, Attempt[_Item]] = {}
        try:
            while True:
                limit = self._in_flight_limit()
                while len(pending) < limit and (attempt := backlog.pop()) is not None:
                    pending[remote.remote(task, attempt.item, __version__, self._timeout)] = attempt
                if not pending:
                    return
                (reference,), _ = self._ray.wait(list(pending), num_returns=1)
                result = self._result_of(reference, pending.pop(reference), backlog)
                del reference  # it keeps the result in the object store
                if result is not None:
                    yield result
        except (ConnectionError, self._ray.exceptions.RayError) as error:
            raise SlamgymError(
                f"Ray failed: {one_line(error)}; run the same command again to go on"
            ) from error
        finally:
            for reference in pending:
                self._ray.cancel(reference, force=True)

    def _result_of(
        self, reference: Any, attempt: Attempt[_Item], backlog: Backlog[_Item]
    ) -> _Result | Lost[_Item] | None:
        """Result of a task; None if it was lost and will be tried again."""
        errors = self._ray.exceptions
        try:
            result: _Result = self._ray.get(reference, timeout=FETCH_TIMEOUT)
        except errors.RayTaskError as error:
            raise error.cause from None
        except errors.RayError as error:
            cause = self._cause_of(error)
            if cause is None:
                raise
            self._cpus()  # without a head Ray ends the run here: the end of the cluster is not the task's fault
            return backlog.worker_died(attempt, cause)
        backlog.succeeded()
        return result

    def _cause_of(self, error: Exception) -> str | None:
        """Why a task was lost; None for an error that trying again can't fix."""
        errors = self._ray.exceptions
        causes = {
            errors.OutOfMemoryError: "a worker ran out of memory",
            errors.NodeDiedError: "a node was lost",
            errors.ObjectLostError: "a node with a result was lost",
            errors.GetTimeoutError: "a result could not be fetched",
            errors.WorkerCrashedError: "a worker process died",
        }
        return next((cause for kind, cause in causes.items() if isinstance(error, kind)), None)

    def _in_flight_limit(self) -> int:
        """Number of tasks that may be under way, by the present size of the cluster."""
        limit = max(1, IN_FLIGHT_PER_CPU * self._cpus())
        return min(limit, self._most) if self._most else limit

    def _cpus(self) -> int:
        """Cores that the head of the cluster knows of."""
        return int(self._ray.cluster_resources().get("CPU", 0))


def _run_on_node(
    task: Callable[[_Item], _Result], item: _Item, version: str, timeout: float | None
) -> _Result:
    """Run a task in a worker of the cluster."""
    if version != __version__:
        raise ConfigError(
            f"a node of the Ray cluster has slamgym {__version__}, the driver has {version}; install the same"
        )
    cv2.setNumThreads(1)
    return run_limited(task, item, timeout)
