"""Stamps that don't fit those before: a single odd one is left out, several that agree are those of another clock."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

CLOCK_JUMP = 1.0
"""A stamp that is so much older than the last one belongs to another run [s]; less is disorder."""
LONGEST_GAP = 5.0
"""A stamp that is so much later than the last one is odd at first [s]: a sensor that paused, or a wrong clock."""
AGREEING = 5
"""So many odd stamps in a row that follow each other are those of another clock."""
Warn = Callable[[str, str], None]
"""Takes a kind of fault, each of which is said once, and the sentence."""
_Item = TypeVar("_Item")


@dataclass(frozen=True)
class Stamped(Generic[_Item]):
    """A message, or what it says, and when."""

    stamp: float
    """[s]."""
    item: _Item


class StampGate(Generic[_Item]):
    """Holds messages of one topic back whose stamps are odd, until enough agree; none of those is lost then.

    Args:
        name: Of the topic.
        warn: Told of a stamp that is left out.
    """

    def __init__(self, name: str, warn: Warn) -> None:
        self._name = name
        self._warn = warn
        self._newest: float | None = None  # [s]
        self._odd: list[Stamped[_Item]] = []

    def take(self, stamp: float, item: _Item) -> list[Stamped[_Item]]:
        """Take a message; returns those that are to be used now, in their order."""
        one = Stamped(stamp, item)
        newest = self._newest
        if newest is None or -CLOCK_JUMP <= stamp - newest <= LONGEST_GAP:
            self._newest = stamp if newest is None else max(newest, stamp)
            self._leave_out(stamp)
            return [one]
        if self._odd and not 0.0 < stamp - self._odd[-1].stamp <= LONGEST_GAP:
            self._leave_out(newest)
        self._odd.append(one)
        if len(self._odd) < AGREEING:
            return []
        agreeing = self._odd
        self._odd = []
        self._newest = stamp
        return agreeing

    def _leave_out(self, usual: float) -> None:
        """Leave out what was held back, which doesn't fit a usual stamp [s]."""
        if self._odd:
            apart = self._odd[0].stamp - usual
            side = "ahead of" if apart > 0.0 else "behind"
            self._warn(
                f"odd stamps of {self._name}",
                f"{self._name} is stamped {abs(apart):.1f} s {side} the others now and then: left out; "
                "is another driver, or a clock that is set, behind it?",
            )
        self._odd = []
