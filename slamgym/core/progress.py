"""Progress of a long run: a bar in a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
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


class Meter:
    """Counts what is done and predicts the remaining time."""

    def __init__(self, done: int, total: int) -> None:
        self.done = done
        self.total = total
        self._at_start = done
        self._began = time.monotonic()

    def advance(self) -> None:
        """Note one more."""
        self.done += 1

    def describe(self) -> str:
        """Rate and remaining time, e.g. ``1,240 an hour, 3 min left``."""
        fresh = self.done - self._at_start
        if fresh == 0:
            return "rate not known yet"
        seconds_each = (time.monotonic() - self._began) / fresh
        left = seconds_each * (self.total - self.done)
        return f"{3600.0 / seconds_each:,.0f} an hour, {duration(left)} left"


def duration(seconds: float) -> str:
    """A time span in words: ``41 s``, ``3 min``, ``2 h 05 min``."""
    if seconds < 60.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


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

    meter = Meter(done, total)
    console = Console(stderr=True)
    show = _bar if console.is_terminal else _lines
    with show(console, label, meter) as advance:
        yield advance


@contextmanager
def _bar(console: Console, label: str, meter: Meter) -> Iterator[Advance]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[outlook]}"),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(label, total=meter.total, completed=meter.done, outlook="")

        def advance() -> None:
            meter.advance()
            progress.update(task, completed=meter.done, outlook=meter.describe())

        yield advance


@contextmanager
def _lines(console: Console, label: str, meter: Meter) -> Iterator[Advance]:
    last = time.monotonic()

    def advance() -> None:
        nonlocal last
        meter.advance()
        now = time.monotonic()
        if now - last >= LINE_INTERVAL or meter.done == meter.total:
            last = now
            console.file.write(f"{meter.done}/{meter.total} {label}, {meter.describe()}\n")
            console.file.flush()

    yield advance


def say(message: str) -> None:
    """Write one line for the user on standard error, where progress goes."""
    sys.stderr.write(printable(message) + "\n")
    sys.stderr.flush()


def tell(*lines: str) -> None:
    """Write lines on standard output, where results go."""
    sys.stdout.write("".join(printable(line) + "\n" for line in lines))
