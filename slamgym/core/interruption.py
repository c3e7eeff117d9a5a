"""Ctrl-C and SIGTERM, by which batch systems and people end a command before its time."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


class Terminated(KeyboardInterrupt):
    """SIGTERM came; everything that is done after Ctrl-C is done after this, too."""


class Interruption:
    """True if the user, or the batch system, asked to stop."""

    def __init__(self) -> None:
        self.signal: int | None = None

    @property
    def requested(self) -> bool:
        """True if a signal came."""
        return self.signal is not None

    def conclude(self) -> None:
        """End as the signal would have done, now that nothing is half done.

        Raises:
            KeyboardInterrupt: If one came; :class:`Terminated` if it was SIGTERM.
        """
        if self.signal is not None:
            raise _error_of(self.signal)


@contextmanager
def deferred_interrupt() -> Iterator[Interruption]:
    """Note the first Ctrl-C (or SIGTERM) inside the block instead of aborting; a second one aborts.

    Outside the main thread, where signals can't be caught, nothing is deferred.
    """
    interruption = Interruption()

    def note(number: int, frame: FrameType | None) -> None:
        del frame
        if interruption.requested:
            raise _error_of(number)
        interruption.signal = number

    with _handlers(note, signal.SIGINT, signal.SIGTERM):
        yield interruption


@contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """Have SIGTERM raise :class:`Terminated` inside the block, as Ctrl-C raises ``KeyboardInterrupt``."""

    def stop(number: int, frame: FrameType | None) -> None:
        del frame
        raise _error_of(number)

    with _handlers(stop, signal.SIGTERM):
        yield


@contextmanager
def kept_termination() -> Iterator[None]:
    """Undo what the block makes of SIGTERM."""
    with _handlers(signal.getsignal(signal.SIGTERM), signal.SIGTERM):
        yield


def _error_of(number: int) -> KeyboardInterrupt:
    return Terminated() if number == signal.SIGTERM else KeyboardInterrupt()


@contextmanager
def _handlers(handler: Any, *numbers: signal.Signals) -> Iterator[None]:
    """Handle signals inside the block; outside the main thread, where they can't be caught, nothing happens."""
    if threading.current_thread() is not threading.main_thread() or handler is None:
        yield
        return
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)
