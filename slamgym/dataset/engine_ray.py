"""A Ray cluster: the machines that somebody has started, or processes of this machine.

The driver alone writes. Tasks give their files back as bytes through Ray's object store, so the nodes need no
common file system; a bounded number of tasks is under way, so the store does not fill up.
"""

import logging
import os
import re
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from types import ModuleType
from typing import Any, Self, TypeVar

import cv2

from slamgym import __version__
from slamgym.dataset.engine import Attempt, Backlog, Lost, available_cores
from slamgym.errors import ConfigError, SlamgymError

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

IN_FLIGHT_PER_CPU = 2
"""Tasks handed to Ray per core of the cluster: one to run, and one that waits, by which a cluster that can
grow sees that there is work."""

CPU_COUNT_INTERVAL = 5.0
"""How often the size of the cluster is looked up; nodes come and go [s]."""

LOCAL_STORE_PER_WORKER = 64 << 20
"""Object store of a cluster on this machine, per worker: an exploration's files take a few MB."""

SMALLEST_STORE = 128 << 20
"""Ray refuses less than 75 MiB."""

CONNECTION_TIMEOUT = 10.0
"""How long a cluster's head may take to accept a connection [s]."""


class RayEngine:
    """A Ray cluster.

    Args:
        workers: Size of a cluster that is started here; of one that runs already, the most tasks at a time, 0
            for all it has.
        address: Where a cluster runs; None takes the ``RAY_ADDRESS`` of the environment, or starts one here.

    Raises:
        ConfigError: If Ray is not installed, or no cluster answers.
    """

    shares_files = False

    def __init__(self, workers: int, address: str | None = None) -> None:
        self._ray = _import_ray()
        self._workers = workers
        self._ours = not self._ray.is_initialized()
        if self._ours:
            _connect(self._ray, workers, address or os.environ.get("RAY_ADDRESS"))
        self._limit = 1
        self._next_count_time = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._ours:
            self._ray.shutdown()

    def run(
        self, task: Callable[[_Item], _Result], items: Iterable[_Item]
    ) -> Iterator[_Result | Lost[_Item]]:
        """See :class:`~slamgym.dataset.engine.Engine`."""
        # Ray's own retries are off: the count is kept here, the same for crashes, lost nodes and lost results.
        remote = self._ray.remote(num_cpus=1, max_retries=0)(_run_on_node)
        backlog = Backlog(items)
        pending: dict[Any, Attempt[_Item]] = {}
        try:
            while True:
                while len(pending) < self._in_flight_limit() and (attempt := backlog.pop()) is not None:
                    pending[remote.remote(task, attempt.item, __version__)] = attempt
                if not pending:
                    return
                done, _ = self._ray.wait(list(pending), num_returns=1)
                attempt = pending.pop(done[0])
                result = self._result_of(done[0], attempt, backlog)
                del done  # the reference keeps the result in the object store
                if result is not None:
                    yield result
        finally:
            for reference in pending:
                self._ray.cancel(reference, force=True)

    def _result_of(
        self, reference: Any, attempt: Attempt[_Item], backlog: Backlog[_Item]
    ) -> _Result | Lost[_Item] | None:
        """What a task gave; None if it was lost and will be tried again."""
        errors = self._ray.exceptions
        try:
            result: _Result = self._ray.get(reference)
        except errors.RayTaskError as error:
            raise error.cause from None
        except errors.OutOfMemoryError:
            return backlog.worker_died(attempt, "a worker ran out of memory")
        except errors.NodeDiedError:
            return backlog.worker_died(attempt, "a node was lost")
        except errors.ObjectLostError:
            return backlog.worker_died(attempt, "a node with a result was lost")
        except (errors.WorkerCrashedError, errors.LocalRayletDiedError):
            return backlog.worker_died(attempt, "a worker process was killed")
        except errors.RayError as error:
            raise SlamgymError(f"Ray failed: {error}; run the same command again to go on") from error
        backlog.succeeded()
        return result

    def _in_flight_limit(self) -> int:
        """How many tasks may be under way, by the present size of the cluster."""
        now = time.monotonic()
        if now >= self._next_count_time:
            cpus = int(self._ray.cluster_resources().get("CPU", 0))
            self._limit = max(1, IN_FLIGHT_PER_CPU * cpus)
            if self._workers and not self._ours:
                self._limit = min(self._limit, self._workers)
            self._next_count_time = now + CPU_COUNT_INTERVAL
        return self._limit


def _run_on_node(task: Callable[[_Item], _Result], item: _Item, version: str) -> _Result:
    """Run a task in a worker of the cluster."""
    if version != __version__:
        raise ConfigError(
            f"a node of the Ray cluster has slamgym {__version__}, the driver has {version}; install the same"
        )
    cv2.setNumThreads(1)
    return task(item)


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
    if address is not None and address != "local":
        check_address(address)
        options: dict[str, Any] = {"address": address}
    else:
        workers = workers or available_cores()
        store = max(SMALLEST_STORE, workers * LOCAL_STORE_PER_WORKER)
        options = {"address": "local", "num_cpus": workers, "object_store_memory": store}
        options["include_dashboard"] = False
    try:
        ray.init(**options, **quiet)
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        raise _no_answer(address or "this machine", error) from error


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
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    return ConfigError(
        f"--address: no Ray cluster answers at {where} ({reason}); `ray status` on its head shows whether it runs"
    )
