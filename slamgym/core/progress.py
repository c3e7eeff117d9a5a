"""Progress of a long run: a bar in a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from slamgym.core.text import printable

if TYPE_CHECKING:
    from rich.console import Console

LINE_INTERVAL = 15.0
"""Time between two lines where there is no terminal [s]."""


Advance = Callable[[], None]
"""Called once for everything that is done."""


def duration(seconds: float) -> str:
    """A time span in words: ``41 s``, ``3 min``, ``2 h 05 min``."""
    if seconds < 60.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    if minutes < 60:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def counted(count: int, noun: str) -> str:
    """A number of things in words: ``1 pair``, ``2 pairs``, ``1,240 pairs``."""
    return f"{count:,} {noun}" + ("" if count == 1 else "s")


@contextmanager
def show_progress(label: str, done: int, total: int) -> Iterator[Advance]:
    """Show how far the work is on standard error while the block runs.

    Args:
        label: What is being made, in the plural.
        done: How many exist already.
        total: How many there will be.
    """
    from rich.console import Console

    console = Console(stderr=True)
    display = _bar if console.is_terminal else _lines
    with display(console, label, done, total) as show:
        now = done
        began = time.monotonic()

        def advance() -> None:
            nonlocal now
            now += 1
            seconds_each = (time.monotonic() - began) / (now - done)
            left = duration(seconds_each * (total - now))
            show(now, f"{3600.0 / seconds_each:,.0f} an hour, {left} left")

        yield advance


@contextmanager
def show_count(label: str, count: Callable[[], int]) -> Iterator[None]:
    """Say on standard error how many there are and since when, now and then while the block runs and at its end.

    Args:
        label: What others make while the block runs, in the plural.
        count: How many there are by now.
    """
    began = time.monotonic()
    before = count()
    ended = threading.Event()

    def show() -> None:
        say(f"{count() - before} {label}, {time.monotonic() - began:.0f} s")

    def watch() -> None:
        while not ended.wait(LINE_INTERVAL):
            show()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()
    show()


_Show = Callable[[int, str], None]
"""Shows how much is done, and the rate and the remaining time in words."""


@contextmanager
def _bar(console: Console, label: str, done: int, total: int) -> Iterator[_Show]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[outlook]}"),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(label, total=total, completed=done, outlook="")
        yield lambda now, outlook: progress.update(task, completed=now, outlook=outlook)


@contextmanager
def _lines(console: Console, label: str, done: int, total: int) -> Iterator[_Show]:  # noqa: ARG001 - as _bar
    last = time.monotonic()

    def show(now: int, outlook: str) -> None:
        nonlocal last
        if time.monotonic() - last >= LINE_INTERVAL or now == total:
            last = time.monotonic()
            console.file.write(f"{now}/{total} {label}, {outlook}\n")
            console.file.flush()

    yield show


def say(message: str) -> None:
    """Write one line for the user on standard error, where progress goes."""
    sys.stderr.write(printable(message) + "\n")
    sys.stderr.flush()


def tell(*lines: str) -> None:
    """Write lines on standard output, where results go."""
    sys.stdout.write("".join(printable(line) + "\n" for line in lines))
