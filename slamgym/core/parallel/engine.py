"""Run independent tasks on many processes: what the engines have in common.

An engine draws items while the work goes on, so that a long sequence never lies in memory, and gives the
results in any order. A worker that dies takes nothing with it but the task in its hands, which is tried again
:data:`MAX_ATTEMPTS` times in all; then the engine hands the item back as :class:`Lost`.
"""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Generic, Literal, Protocol, TypeVar

from slamgym.core.errors import ConfigError, SlamgymError

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

EngineName = Literal["local", "ray"]

MAX_ATTEMPTS = 3
"""How often a task is begun whose workers die under it."""

MAX_LOST_IN_A_ROW = 5
"""So many tasks lost with no result between them are the machine's fault, not the tasks'."""


class WorkerLostError(SlamgymError):
    """Workers were killed from outside, again and again."""


@dataclass(frozen=True)
class Lost(Generic[_Item]):
    """An item whose worker died at every attempt."""

    item: _Item
    reason: str


class Engine(Protocol):
    """Applies a function to many items, on processes that live until the engine is closed."""

    @property
    def shares_files(self) -> bool:
        """Whether the tasks see the files of this process."""
        ...

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
        ...


def available_cores() -> int:
    """Cores that this process may use: a batch system or a container may grant fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def open_engine(
    name: EngineName = "local", workers: int = 1, address: str | None = None
) -> AbstractContextManager[Engine]:
    """Start an engine for the length of a ``with`` block.

    Args:
        name: ``local``: processes of this machine; ``ray``: a Ray cluster.
        workers: Number of processes. For a Ray cluster that runs already, the most tasks at a time; 0 takes
            all that it has.
        address: Of the Ray cluster, e.g. ``auto`` or ``10.0.0.1:6379``; None starts one on this machine.

    Raises:
        ConfigError: If an option makes no sense, Ray is not installed or no cluster answers.
    """
    if name == "ray":
        from slamgym.core.parallel.ray import RayEngine

        return RayEngine(workers, address)
    if address is not None:
        raise ConfigError("--address names a Ray cluster; add --engine ray")
    from slamgym.core.parallel.local import LocalEngine

    return LocalEngine(workers)


def run_tasks(task: Callable[[_Item], _Result], items: Iterable[_Item], workers: int) -> Iterator[_Result]:
    """Apply a function to every item on processes of this machine, for work in which no item may be lost.

    Raises:
        WorkerLostError: If the workers of one item died at every attempt.
    """
    with open_engine("local", workers) as engine:
        for result in engine.run(task, items):
            if isinstance(result, Lost):
                raise WorkerLostError(f"{result.reason}; run the same command again to go on")
            yield result


@dataclass(frozen=True, eq=False)
class Attempt(Generic[_Item]):
    """An item on its way to a worker."""

    item: _Item
    number: int


class Backlog(Generic[_Item]):
    """What an engine submits next: tasks whose worker died, then fresh items."""

    def __init__(self, items: Iterable[_Item]) -> None:
        self._items = iter(items)
        self._ready: deque[Attempt[_Item]] = deque()
        self._lost_in_a_row = 0

    def prefetch(self, count: int) -> None:
        """Draw items until so many are ready, while the workers are busy."""
        while len(self._ready) < count:
            try:
                self._ready.append(Attempt(next(self._items), 1))
            except StopIteration:
                return

    def pop(self) -> Attempt[_Item] | None:
        """The next task, or None if there is none left."""
        self.prefetch(1)
        return self._ready.popleft() if self._ready else None

    def succeeded(self) -> None:
        """Note a result: the machine is fit."""
        self._lost_in_a_row = 0

    def worker_died(self, attempt: Attempt[_Item], cause: str) -> Lost[_Item] | None:
        """Put a task back to be tried again, or give it up.

        Raises:
            WorkerLostError: If task after task is lost.
        """
        if attempt.number < MAX_ATTEMPTS:
            self._ready.appendleft(Attempt(attempt.item, attempt.number + 1))
            return None
        self._lost_in_a_row += 1
        if self._lost_in_a_row >= MAX_LOST_IN_A_ROW:
            raise WorkerLostError(
                f"{cause} under {MAX_LOST_IN_A_ROW} tasks in a row, {MAX_ATTEMPTS} times each; perhaps memory "
                "is short: run the same command again with fewer --workers"
            )
        return Lost(attempt.item, f"{cause} at each of {MAX_ATTEMPTS} attempts")
