"""Common parts of all engines: tasks on their way to workers, fresh ones and those whose worker died."""

import faulthandler
import itertools
import os
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from typing_extensions import Self

from slamgym.core.errors import PlanError, SlamgymError
from slamgym.core.progress import duration

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

TASK_TIMEOUT = 1800.0
"""Longest wall time of a task [s]: some 400 times what an exploration of a home takes."""

MAX_ATTEMPTS = 3
"""Most attempts at a task whose workers die."""

MAX_LOST_IN_A_ROW = 5
"""So many lost tasks in a row are the machine's fault, not the tasks'."""


class WorkerLostError(SlamgymError):
    """Workers died or hung, again and again."""


@dataclass(frozen=True)
class Lost(Generic[_Item]):
    """An item whose worker died at every attempt, that took too long, or of which :func:`tried` says why it failed."""

    item: _Item
    reason: str
    error: str = WorkerLostError.__name__
    """Kind of the failure, for records."""


def available_cores() -> int:
    """Cores that this process may use: a batch system or a container may grant fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True, eq=False)
class Attempt(Generic[_Item]):
    """An item on its way to a worker."""

    item: _Item
    number: int
    began: float
    """When it was handed over, by the monotonic clock [s]."""


def run_limited(task: Callable[[_Item], _Result], item: _Item, timeout: float | None) -> _Result:
    """Run a task in a worker, whose process ends where it takes longer, even in native code that never returns.

    Args:
        task: The function.
        item: Its argument.
        timeout: Longest wall time [s]; None for no limit.
    """
    if timeout is None:
        return task(item)
    with Path(os.devnull).open("w") as nowhere:
        # The watchdog is a thread of C that needs no interpreter lock.
        faulthandler.dump_traceback_later(timeout, exit=True, file=nowhere)
        try:
            return task(item)
        finally:
            faulthandler.cancel_dump_traceback_later()


def tried(task: Callable[[_Item], _Result], item: _Item) -> _Result | Lost[_Item]:
    """Run a task whose failure costs this item alone: one odd plan or explorer must not end a night's run.

    Raises:
        SlamgymError: If a setting is wrong, the disk can't be written or memory runs out.
    """
    try:
        return task(item)
    except PlanError as error:
        return Lost(item, error.reason, PlanError.__name__)
    except MemoryError as error:
        raise SlamgymError(
            "memory ran out; run the same command again with fewer --workers"
        ) from error
    except SlamgymError:
        raise
    except (Exception, SystemExit) as error:  # noqa: BLE001 - code of the user's own may raise anything
        if isinstance(
            error.__cause__, KeyboardInterrupt
        ):  # a SystemError: it came while C code ran
            raise error.__cause__ from None
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}:{frame.lineno}, {frame.name}"
        return Lost(item, f"{error} (in {place})", type(error).__name__)


class Engine(ABC):
    """Applies a function to many items, on processes that live until the end of its ``with`` block.

    Attributes:
        shares_files: True if the tasks see the files of this process.
    """

    shares_files = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None:
        """End the processes."""

    @abstractmethod
    def run(
        self, task: Callable[[_Item], _Result], items: Iterable[_Item]
    ) -> Iterator[_Result | Lost[_Item]]:
        """Apply a function to every item and yield the results as they come, in any order.

        Args:
            task: A function that can be pickled by reference.
            items: What to apply it to; drawn in this thread, a bounded number ahead of the results.

        Raises:
            WorkerLostError: If nothing but lost tasks comes back.
            Exception: What a task raises ends the iteration; tasks in flight are lost.
        """


class Backlog(Generic[_Item]):
    """Tasks that an engine submits next: tasks whose worker died, then fresh items.

    Args:
        items: The tasks' arguments.
        timeout: Longest wall time of a task [s]; None for no limit.
    """

    def __init__(self, items: Iterable[_Item], timeout: float | None = None) -> None:
        self._next: Iterator[tuple[_Item, int]] = ((item, 1) for item in items)
        self._timeout = timeout
        self._lost_in_a_row = 0

    def pop(self) -> Attempt[_Item] | None:
        """The next task, or None if there is none left."""
        found = next(self._next, None)
        return Attempt(*found, time.monotonic()) if found else None

    def succeeded(self) -> None:
        """Note a result: the machine is fit."""
        self._lost_in_a_row = 0

    def worker_died(self, attempt: Attempt[_Item], cause: str) -> Lost[_Item] | None:
        """Put a task back to be tried again, or give it up; one that took too long would do so again.

        Raises:
            WorkerLostError: If task after task is lost.
        """
        too_long = self._timeout is not None and time.monotonic() - attempt.began >= self._timeout
        if not too_long and attempt.number < MAX_ATTEMPTS:
            self._next = itertools.chain([(attempt.item, attempt.number + 1)], self._next)
            return None
        self._lost_in_a_row += 1
        limit = duration(self._timeout or 0.0)
        if self._lost_in_a_row >= MAX_LOST_IN_A_ROW and too_long:
            raise WorkerLostError(
                f"{MAX_LOST_IN_A_ROW} tasks in a row took longer than {limit}; run the same command again with "
                "a longer --task-timeout"
            )
        if self._lost_in_a_row >= MAX_LOST_IN_A_ROW:
            raise WorkerLostError(
                f"{cause} under {MAX_LOST_IN_A_ROW} tasks in a row, {MAX_ATTEMPTS} times each; perhaps memory "
                "is short: run the same command again with fewer --workers"
            )
        if too_long:
            reason = f"took longer than {limit}, the --task-timeout"
            return Lost(attempt.item, reason, TimeoutError.__name__)
        return Lost(attempt.item, f"{cause} at each of {MAX_ATTEMPTS} attempts")
