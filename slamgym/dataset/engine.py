"""Run independent tasks on all cores of one machine."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import TypeVar

import cv2
from joblib.externals import loky

from slamgym.errors import SlamgymError

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_SINGLE_THREADED = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}


PARENT_CHECK_INTERVAL = 0.5
"""How often a worker looks whether its parent lives [s]."""


class WorkerLostError(SlamgymError):
    """A worker process was killed from outside."""


def run_tasks(task: Callable[[_Item], _Result], items: Iterable[_Item], workers: int) -> Iterator[_Result]:
    """Apply a function to every item and yield the results as they come, in any order.

    Items are drawn while the work goes on, in this thread and at most two per worker ahead, so that a long
    sequence never lies in memory. With one worker everything runs in this process. Every worker computes on
    one thread: the tasks themselves are the parallelism.

    Args:
        task: A function that can be pickled by reference.
        items: What to apply it to.
        workers: Number of processes.

    Raises:
        WorkerLostError: If a worker was killed.
        Exception: What a task raises ends the iteration; tasks in flight are lost.
    """
    if workers == 1:
        with _one_opencv_thread():
            yield from map(task, items)
        return
    executor = loky.get_reusable_executor(
        workers, initializer=_start_worker, initargs=(os.getpid(),), env=_SINGLE_THREADED
    )
    remaining = iter(items)
    try:
        pending: set[Future[_Result]] = {
            executor.submit(task, item) for item in islice(remaining, 2 * workers)
        }
        while pending:
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
            pending |= {executor.submit(task, item) for item in islice(remaining, len(done))}
    except BrokenProcessPool as error:
        raise WorkerLostError(
            "a worker process was killed, perhaps for want of memory; run the same command again to go on, "
            "with fewer --workers if it happens again"
        ) from error
    finally:
        # After Ctrl-C or an error the tasks in flight would otherwise run to their ends first.
        executor.shutdown(wait=True, kill_workers=True)


def _start_worker(parent: int) -> None:
    """Prepare a worker: one thread, Ctrl-C is the parent's to handle, and no life after the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    if os.name == "posix":
        threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()


def _end_with_parent(parent: int) -> None:
    """End this process when its parent was killed: loky's workers would wait for tasks for ever."""
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK_INTERVAL)
    os._exit(1)


@contextlib.contextmanager
def _one_opencv_thread() -> Iterator[None]:
    """Compute on one OpenCV thread inside the block, as in a worker."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
