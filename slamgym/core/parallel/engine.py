"""Run independent tasks on many processes: what the engines have in common.

An engine draws items while the work goes on, so that a long sequence never lies in memory, and gives the
results in any order. When a worker dies, only its current task is lost, which is tried again
:data:`~slamgym.core.parallel.backlog.MAX_ATTEMPTS` times in all; then the engine hands the item back as :class:`Lost`.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from typing import Literal, Protocol, TypeVar

from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import Lost, WorkerLostError

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

EngineName = Literal["local", "ray"]


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
