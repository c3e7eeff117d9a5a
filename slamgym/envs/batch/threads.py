"""Threads of this process, for kernels that release the interpreter's lock."""

import functools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from slamgym.core.parallel.backlog import available_cores
from slamgym.core.types import IntArray


def usable_threads() -> int:
    """The process's cores, or fewer by ``NUMBA_NUM_THREADS`` and ``OMP_NUM_THREADS``, which are 1 in workers."""
    most = available_cores()
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS"):
        asked = os.environ.get(name, "")
        if asked.isdecimal():
            most = min(most, int(asked))
    return max(1, most)


def divide_work(
    work: Callable[[IntArray], None], ids: IntArray, threads: int, parts: int = 1
) -> None:
    """Let threads work on many things, each by itself.

    Args:
        work: Called for some of them, by numbers.
        ids: All numbers, shape (N,).
        threads: How many.
        parts: So many calls for each thread.
    """
    if threads == 1 or len(ids) < 2:
        work(ids)
        return
    calls = min(parts * threads, len(ids))
    results = _pool(os.getpid(), threads).map(work, np.array_split(ids, calls))
    for _ in results:  # raises what a call has raised
        pass


@functools.cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:  # noqa: ARG001 - a fork can't use its parent's
    return ThreadPoolExecutor(threads)
