"""Tasks on their way to the workers of an engine: fresh items, and those whose worker died, to be tried again."""

import os
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

from slamgym.core.errors import SlamgymError

_Item = TypeVar("_Item")

MAX_ATTEMPTS = 3
"""Most attempts at a task whose workers die."""

MAX_LOST_IN_A_ROW = 5
"""So many lost tasks in a row are the machine's fault, not the tasks'."""


class WorkerLostError(SlamgymError):
    """Workers were killed from outside, again and again."""


@dataclass(frozen=True)
class Lost(Generic[_Item]):
    """An item whose worker died at every attempt."""

    item: _Item
    reason: str


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
