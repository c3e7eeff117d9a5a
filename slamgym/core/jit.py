"""One place that decides how the numeric kernels are compiled, and where they are kept.

Kernels are compiled on first use and kept in the user's cache folder, so only the very first use after an installation
waits for the compiler, and the package's own folder holds nothing that ``pip uninstall`` would leave. numba itself is
imported when the first kernel is called: help pages, and programs that call none, don't wait for it.
"""

import contextlib
import functools
import os
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from slamgym.core.progress import LINE_INTERVAL, counted, say

_F = TypeVar("_F", bound=Callable[..., Any])
_T = TypeVar("_T", bound=tuple[Any, ...])

_CHOOSING = threading.Lock()
"""Held while numba looks for a folder: its setting is the whole process's."""


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
        with _kept_in(cache_folder()):
            return _prepared(jit(self._function))

    @property
    def _numba_type_(self) -> Any:
        """The type by which another kernel knows it: numba asks objects that it doesn't know for their type."""
        return self.dispatcher._numba_type_


@contextlib.contextmanager
def _kept_in(folder: Path) -> Iterator[None]:
    """Let numba keep what is declared in the block below a folder; other packages' kernels stay where they are."""
    import numba

    with _CHOOSING:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(folder)
        try:
            yield
        finally:
            numba.config.CACHE_DIR = before


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


def cache_folder() -> Path:
    """The folder of the compiled kernels: ``NUMBA_CACHE_DIR``, else the user's cache folder, else a temporary one.

    The user's has the version in its name: numba compiles a kernel anew when its file changes, but not when a file
    changes whose kernels it calls.
    """
    try:
        given = os.environ.get("NUMBA_CACHE_DIR")
        folder = Path(given) if given else _user_caches() / "slamgym" / f"kernels-{_version()}"
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError):  # not writable, or no home
        return Path(use_temporary_cache())
    return folder


def _version() -> str:
    """The package's, without an import of the package, whose stub names everything, for the type checker."""
    return str(sys.modules["slamgym"].__dict__["__version__"])


def _user_caches() -> Path:
    """Where a user's programs keep what can be made anew, by the habit of the system."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


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


def count_compiled() -> int:
    """How many kernels are kept by now."""
    return sum(1 for _ in cache_folder().glob("*/*.nbi"))


@functools.cache
def announce_compilation(function: Callable[..., Any]) -> None:
    """Say on stderr that the first steps will take a while, if they will, and now and then how far they are.

    At most once in a process.

    Args:
        function: A kernel that stands for those that will be called.
    """
    if is_compiled(function):
        return
    from numba.core import event

    say(
        "slamgym: compiling the numeric kernels, once after installation; slamgym warmup does it beforehand, in "
        "processes beside each other"
    )

    class Teller(event.Listener):
        began = last = time.monotonic()
        count = 0

        def on_start(self, _event: Any) -> None:
            pass

        def on_end(self, _event: Any) -> None:
            self.count += 1
            now = time.monotonic()
            if now - self.last >= LINE_INTERVAL:
                self.last = now
                say(f"{counted(self.count, 'kernel')} compiled, {now - self.began:.0f} s")

    event.register("numba:compile", Teller())
