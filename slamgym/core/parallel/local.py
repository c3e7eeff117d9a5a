"""The processes of one machine.

Every worker is a separate loky executor with a single process: when one dies, its current task is
known, and the others continue. A common pool would lose every task in flight with it.
"""

import functools
import os
import re
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

import cv2
from joblib.externals import loky

from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import Attempt, Backlog, Engine, Lost, run_limited

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

SINGLE_THREADED = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
"""Every worker computes on one thread: the tasks themselves are the parallelism."""

PARENT_CHECK_INTERVAL = 0.5
"""Time after which a worker looks again whether its parent lives [s]."""


class InProcessEngine(Engine):
    """This process: nothing to start and everything in reach of a debugger, but a crash ends it."""

    def close(self) -> None:
        """Nothing to end."""

    def run(self, task: Callable[[_Item], _Result], items: Iterable[_Item]) -> Iterator[_Result]:
        """Run one task after the other, on one OpenCV thread as in a worker."""
        before = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            yield from map(task, items)
        finally:
            cv2.setNumThreads(before)


class LocalEngine(Engine):
    """Processes of this machine, one thread each; one worker is a separate process, too.

    Args:
        workers: Number of processes.
        timeout: Longest wall time of a task [s]; None for no limit.

    Raises:
        ConfigError: If the number is not positive.
    """

    def __init__(self, workers: int, timeout: float | None = None) -> None:
        if workers < 1:
            raise ConfigError(f"the number of workers must be at least 1, not {workers}")
        # loky ends a worker that holds much memory between two tasks, and says so; the next one takes over.
        warnings.filterwarnings("ignore", "A worker stopped while some jobs were given")
        self._workers = [_Worker() for _ in range(workers)]
        self._timeout = timeout

    def close(self) -> None:
        """End all workers."""
        for worker in self._workers:
            worker.close()

    def run(
        self, task: Callable[[_Item], _Result], items: Iterable[_Item]
    ) -> Iterator[_Result | Lost[_Item]]:
        """Run the task on this machine's workers."""
        backlog = Backlog(items, self._timeout)
        limited = functools.partial(run_limited, task, timeout=self._timeout)
        running: dict[Future[_Result], tuple[_Worker, Attempt[_Item]]] = {}

        def start(worker: _Worker) -> None:
            if (attempt := backlog.pop()) is not None:
                running[worker.submit(limited, attempt.item)] = (worker, attempt)

        try:
            for worker in self._workers:
                start(worker)
            while running:
                results: list[_Result | Lost[_Item]] = []
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    worker, attempt = running.pop(future)
                    result = _result_of(future, attempt, backlog)
                    if result is not None:
                        results.append(result)
                    # The worker continues before the caller takes its time over the result.
                    start(worker)
                yield from results
        finally:
            for worker, _ in running.values():
                worker.close()


def _result_of(
    future: Future[_Result], attempt: Attempt[_Item], backlog: Backlog[_Item]
) -> _Result | Lost[_Item] | None:
    """Result of a task; None if its worker died and it will be tried again."""
    try:
        result = future.result()
    except BrokenProcessPool as error:
        how = "".join(f" ({name})" for name in re.findall(r"\{(SIG\w+)\(", str(error)))
        return backlog.worker_died(attempt, f"a worker process died{how}")
    backlog.succeeded()
    return result


class _Worker:
    """One process, started again when it died."""

    def __init__(self) -> None:
        self._executor: Any = None

    def submit(self, task: Callable[[_Item], _Result], item: _Item) -> Future[_Result]:
        """Hand a task to the process, which is started if it does not run."""
        if self._executor is not None:
            try:
                future: Future[_Result] = self._executor.submit(task, item)
            except (
                BrokenProcessPool
            ):  # it was killed, with this task's forerunner or while it was idle
                self.close()
            else:
                return future
        # Unless it is set, loky turns the fault handler on, whose stacks would bury the sentence about a crash.
        faults = os.environ.get("PYTHONFAULTHANDLER", "")
        environment = {**SINGLE_THREADED, "PYTHONFAULTHANDLER": faults}
        self._executor = loky.ProcessPoolExecutor(
            1, initializer=_start_worker, initargs=(os.getpid(),), env=environment
        )
        return self._executor.submit(task, item)

    def close(self) -> None:
        """End the process at once: after Ctrl-C or an error, its current task is of no use."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, kill_workers=True)
            self._executor = None


def _start_worker(parent: int) -> None:
    """Prepare a worker: one thread, Ctrl-C left to the parent, exit when the parent dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    if os.name == "posix":
        threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()


def _end_with_parent(parent: int) -> None:
    """End this process when its parent was killed: loky's workers would wait for tasks for ever."""
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK_INTERVAL)
    os._exit(1)
