"""Run independent tasks on many processes: what the engines have in common.

An engine draws items while the work continues, so that a long sequence never lies in memory, and gives the
results in any order. When a worker dies, only its current task is lost, which is tried again
:data:`~slamgym.core.parallel.backlog.MAX_ATTEMPTS` times in all; then the engine hands the item back as :class:`Lost`.
A task that takes longer than it may is ended with its worker and handed back at once. So it is with one worker, too;
only the engine ``in_process`` runs the tasks in the caller's process, which dies with them.
"""

import functools
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, TypeVar

from slamgym.core.errors import ConfigError
from slamgym.core.parallel.backlog import TASK_TIMEOUT, Engine, Lost, WorkerLostError, tried

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

EngineName = Literal["local", "ray", "in_process"]


@dataclass(frozen=True)
class Execution:
    """Where many explorations run; what they give does not depend on it."""

    workers: int = 1
    """Processes. Of a Ray cluster, the most to use; 0 uses all."""
    engine: EngineName = "local"
    """``local``: processes of this machine; ``ray``: a Ray cluster; ``in_process``: this process, for debugging and
    tests: a crash ends it, and there is no time limit."""
    address: str | None = None
    """Address of the Ray cluster; None takes that of ``RAY_ADDRESS``."""
    task_timeout: float | None = TASK_TIMEOUT
    """Longest wall time of an exploration [s]; one that hangs is ended and noted. None for no limit."""

    def open(self) -> Engine:
        """Start the engine for the length of a ``with`` block.

        Raises:
            ConfigError: If an option makes no sense, Ray is not installed or no cluster answers.
        """
        if self.engine == "ray":
            from slamgym.core.parallel.ray import RayEngine

            return RayEngine(self.workers, self.address, self.task_timeout)
        if self.address is not None:
            raise ConfigError("--address names a Ray cluster; add --engine ray")
        from slamgym.core.parallel.local import InProcessEngine, LocalEngine

        return (
            InProcessEngine()
            if self.engine == "in_process"
            else LocalEngine(self.workers, self.task_timeout)
        )


def try_out(
    engine: Engine, task: Callable[[str], _Result], names: Iterable[str]
) -> dict[str, _Result]:
    """Apply a function to names before any work is done, in a worker: code of the user's own may crash.

    Raises:
        ConfigError: If that of one fails.
    """
    results = {}
    for name in names:
        for result in engine.run(functools.partial(tried, task), [name]):
            if isinstance(result, Lost):
                raise ConfigError(f"{name!r} can't be used ({result.error}): {result.reason}")
            results[name] = result
    return results


def run_apart(
    task: Callable[[_Item], _Result], item: _Item, seconds: float
) -> _Result | Lost[_Item]:
    """Run a task in another process, which is kept for the next: native code may crash there, or never end.

    Args:
        task: A function that can be pickled by reference, and returns a value.
        item: Its argument.
        seconds: Longest wall time [s].
    """
    (result,) = _another_process(os.getpid(), seconds).run(task, [item])
    return result


@functools.cache
def _another_process(process: int, seconds: float) -> Engine:  # noqa: ARG001 - a fork can't use its parent's
    """One worker; a daemon may have no child, so there it is this process."""
    name: EngineName = "in_process" if multiprocessing.current_process().daemon else "local"
    return Execution(engine=name, task_timeout=seconds).open()


def run_tasks(
    task: Callable[[_Item], _Result], items: Iterable[_Item], workers: int
) -> Iterator[_Result]:
    """Apply a function to every item, for work that can't do without any of them, such as drawing.

    A crash ends it in any case, so with one worker it is done in this process, which starts at once.

    Raises:
        WorkerLostError: If the workers of one item died at every attempt.
    """
    execution = Execution(workers, "in_process" if workers == 1 else "local", task_timeout=None)
    with execution.open() as engine:
        for result in engine.run(task, items):
            if isinstance(result, Lost):
                raise WorkerLostError(f"{result.reason}; run the same command again to go on")
            yield result
