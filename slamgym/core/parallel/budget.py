"""Readers that others wrote, run in a process of their own with a budget of time, memory and disk.

What a drawing or a bag costs its reader can't be told from its size: definitions within definitions, views of a
database and entities of two lines take gigabytes and minutes.
"""

import functools
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from slamgym.core.errors import InputFileError
from slamgym.core.limits import FILE_BYTES, LIMITS, READER_BYTES, READER_SECONDS
from slamgym.core.parallel.backlog import Lost
from slamgym.core.parallel.engine import run_apart

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def read_apart(
    read: Callable[[_Item], _Result],
    item: _Item,
    path: Path,
    error: type[InputFileError] = InputFileError,
) -> _Result:
    """Read a file in another process, which is kept for the next: of a hostile one the reader may crash, or never end.

    A worker of many explorations may have no process of its own, so there it is read without a budget.

    Args:
        read: A function that can be pickled by reference.
        item: Its argument.
        path: The file, for errors.
        error: What to raise.

    Raises:
        InputFileError: If the reader crashes, or needs more than it may.
    """
    variables = {limit.variable: str(limit.value) for limit in LIMITS}
    task = functools.partial(_within_budget, read, os.getpid(), variables)
    result = run_apart(task, item, READER_SECONDS.value)
    if isinstance(result, Lost):
        raise error(
            path,
            f"crashes its reader, or takes it more than {READER_SECONDS.value} s or {READER_BYTES.value} bytes of "
            f"memory; export it again, or set {READER_SECONDS.variable} or {READER_BYTES.variable} higher if it is "
            "only large",
        )
    return result


def _within_budget(
    read: Callable[[_Item], _Result], caller: int, variables: dict[str, str], item: _Item
) -> _Result | Lost[_Item]:
    """Read in the process of its own, with the limits of the caller."""
    if os.getpid() != caller:
        os.environ.update(variables)
        _limit_process()
    try:
        return read(item)
    except MemoryError as error:
        return Lost(item, str(error), type(error).__name__)


def _limit_process() -> None:
    """Bound what this process takes of memory, beyond what it has, and of the disk in one file."""
    if sys.platform == "linux":
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        taken = pages * resource.getpagesize()
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (taken + READER_BYTES.value, most))
        _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_BYTES.value, most))
