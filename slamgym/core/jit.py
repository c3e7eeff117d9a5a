"""One place that decides how the numeric kernels are compiled, and where they are kept.

Kernels are compiled on first use and cached next to the source (or in the user's cache folder where the package
is read-only), so only the very first use after an installation waits for the compiler. numba itself is imported
when the first kernel is called: help pages, and programs that call none, don't wait for it.
"""

import functools
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

_F = TypeVar("_F", bound=Callable[..., Any])
_T = TypeVar("_T", bound=tuple[Any, ...])

_ADDITIONS = 1_000_000
"""Additions of the loop that measures how fast this machine is."""
_EXPLORATION = 900.0
"""The kernels of an exploration take as long to compile as so many of these loops."""


def kernel(function: _F) -> _F:
    """Compile a numeric kernel: cached on disk, the GIL released, no fast-math.

    Fast-math stays off so that the same seed gives the same bytes on every call path and so that ``inf``
    (a beam without return) keeps its meaning.
    """
    return cast(_F, Kernel(function))


def plain(record: _T) -> _T:
    """A named tuple, and those in it, as tuples without names, for a kernel that names them again first thing.

    numba takes some 4 us to recognise a named tuple in each call, a fifth of that for one without names.
    """
    return cast(_T, tuple([plain(part) if isinstance(part, tuple) else part for part in record]))


class Kernel:
    """A function that becomes numba's dispatcher when it is first called, or used by another kernel."""

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)
        self._function = function

    def __call__(self, *args: Any) -> Any:  # noqa: D102 - the function has its own docstring
        return self.dispatcher(*args)

    def __reduce__(self) -> str:
        return self._function.__qualname__  # by name, as functions are pickled

    @functools.cached_property
    def dispatcher(self) -> Any:
        """The function as numba compiles it."""
        import numba

        # No kernel is a callback of C, which would be a separate entry.
        jit = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
        try:
            return _prepared(jit(self._function))
        except RuntimeError as error:
            # Neither the package nor the user's cache folder is writable.
            if "no locator available" not in str(error):
                raise
            numba.config.CACHE_DIR = use_temporary_cache()
            return _prepared(jit(self._function))

    @property
    def _numba_type_(self) -> Any:
        """The type by which another kernel knows it: numba asks objects that it doesn't know for their type."""
        return self.dispatcher._numba_type_


def _prepared(dispatcher: Any) -> Any:
    """Change two habits of numba's dispatcher, for which numba has no option."""
    _share_between_literals(dispatcher)
    _pass_over_unreadable_index(dispatcher)
    return dispatcher


def _share_between_literals(dispatcher: Any) -> None:
    """Let kernels that call this one with literal numbers share what is compiled for any number."""
    from numba.types import unliteral

    find = dispatcher.get_call_template

    def find_for_any_number(args: Any, keywords: Any) -> Any:
        return find([unliteral(each) for each in args], keywords)

    dispatcher.get_call_template = find_for_any_number


def _pass_over_unreadable_index(dispatcher: Any) -> None:
    """Let an index of the cache that can't be read count as none.

    numba unpickles it before it compares the source's stamp, and it may name classes that have been renamed since.
    """
    cache_file = dispatcher._cache._cache_file
    load = cache_file._load_index

    def load_if_readable() -> Any:
        try:
            return load()
        except Exception:  # noqa: BLE001 - unpickling may raise anything
            return {}

    cache_file._load_index = load_if_readable


@kernel
def assign(values: np.ndarray, out: np.ndarray) -> None:
    """Copy values of one shape: ``out[:] = values``, but without the texts about shapes that numba compiles with it."""
    for i in range(out.size):
        out.flat[i] = values.flat[i]


def use_temporary_cache() -> str:
    """Choose a temporary folder for compiled kernels, say so on stderr, and return its path.

    Worker processes find it in their environment, and later programs by its name, which holds the user's number.
    """
    user = os.getuid() if sys.platform != "win32" else 0
    folder = Path(tempfile.gettempdir()) / f"slamgym-kernels-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    # Compiled kernels are programs: take none from a folder that somebody else has made or can write to.
    if not _is_private(folder, user):
        folder = Path(tempfile.mkdtemp(prefix="slamgym-kernels-"))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    sys.stderr.write(
        f"slamgym: no cache folder is writable; compiled kernels are kept in {folder}\n"
    )
    return str(folder)


def _is_private(folder: Path, user: int) -> bool:
    """True if it is a folder of the user's, no link, into which nobody else can write."""
    found = folder.stat(follow_symlinks=False)
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != user:
        return False
    return not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def kernel_cache(function: Callable[..., Any]) -> Path:
    """The folder in which a kernel is kept when it is compiled."""
    return Path(cast(Kernel, function).dispatcher.stats.cache_path)


def is_compiled(function: Callable[..., Any]) -> bool:
    """True if a kernel was compiled already."""
    name = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"
    return any(kernel_cache(function).glob(f"{name}-*.nbi"))


@functools.cache
def announce_compilation(function: Callable[..., Any]) -> None:
    """Say on stderr that the first steps will take a while, if they will; at most once in a process.

    Args:
        function: A kernel that stands for those that will be called.
    """
    if not is_compiled(function):
        began = time.perf_counter()
        total = 0
        for number in range(_ADDITIONS):
            total += number
        seconds = _EXPLORATION * (time.perf_counter() - began)
        sys.stderr.write(
            f"slamgym: compiling the numeric kernels, once after installation: about {seconds:.0f} s in all; "
            "slamgym warmup does it beforehand, in processes beside each other\n"
        )
        sys.stderr.flush()
