"""One place that decides how the numeric kernels are compiled, and where they are kept.

Kernels are compiled on first use and cached beside the source (or in the user's cache folder where the package
is read-only), so only the very first use after an installation waits for the compiler. numba itself is imported
when the first kernel is called: help pages, and programs that call none, don't wait for it.
"""

import functools
import os
import stat
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

_F = TypeVar("_F", bound=Callable[..., Any])
_T = TypeVar("_T", bound=tuple[Any, ...])

EXPECTED_SECONDS = 25
"""About what the kernels take to compile on one core (17 CPU seconds were measured)."""


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
        """What numba makes of the function."""
        import numba

        jit = numba.njit(cache=True, nogil=True, error_model="numpy")
        try:
            return jit(self._function)
        except RuntimeError as error:
            # Neither the package nor the user's cache folder is writable.
            if "no locator available" not in str(error):
                raise
            numba.config.CACHE_DIR = use_temporary_cache()
            return jit(self._function)

    @property
    def _numba_type_(self) -> Any:
        """What another kernel sees of it: numba asks objects that it doesn't know for their type."""
        return self.dispatcher._numba_type_


def use_temporary_cache() -> str:
    """Choose a temporary folder for compiled kernels, say so on stderr, and return its path.

    Worker processes find it in their environment, and later programs by its name, which holds the user's number.
    """
    user = os.getuid() if sys.platform != "win32" else 0
    folder = Path(tempfile.gettempdir()) / f"slamgym-kernels-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.stat(follow_symlinks=False)
    # Compiled kernels are programs: take none from a folder that somebody else has made or can write to.
    if (
        found.st_uid != user
        or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        or not stat.S_ISDIR(found.st_mode)
    ):
        folder = Path(tempfile.mkdtemp(prefix="slamgym-kernels-"))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    sys.stderr.write(f"slamgym: no cache folder is writable; compiled kernels are kept in {folder}\n")
    return str(folder)


def kernel_cache(function: Callable[..., Any]) -> Path:
    """The folder in which a kernel is kept when it is compiled."""
    return Path(cast(Kernel, function).dispatcher.stats.cache_path)


def is_compiled(function: Callable[..., Any]) -> bool:
    """Whether a kernel, or another one of its package, was compiled already."""
    return any(kernel_cache(function).glob("*.nbi"))


@functools.cache
def announce_compilation(function: Callable[..., Any]) -> None:
    """Say on stderr that the first steps will take a while, if they will; at most once in a process.

    Args:
        function: A kernel that stands for those that will be called.
    """
    if not is_compiled(function):
        sys.stderr.write(
            f"slamgym: compiling the numeric kernels, once after installation: about {EXPECTED_SECONDS} s\n"
        )
        sys.stderr.flush()
