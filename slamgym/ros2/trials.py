"""Ends of an exploration that are not final, and the clock that it goes by."""

import math

from slamgym.planning.exploration_loop import ExplorationLoop
from slamgym.planning.exploration_progress import LEAST_GROWTH

MOST_TRIES = 2
"""Places that weren't reached in so many more tries, while the robot could drive elsewhere, count as unreachable."""
FIRST_PAUSE = 5.0
"""Pause before the first of these tries [s]; it doubles from try to try."""
_LONGEST_PAUSE = 60.0
"""Longest pause before a try [s]: people walk on within a minute."""
_JUMP = 5.0
"""A clock that steps farther back than this began again, and no step ahead counts for more [s]."""


class RobotClock:
    """Time of an exploration, which neither jumps nor runs during a pause."""

    def __init__(self) -> None:
        self.now = 0.0  # [s]
        self._stamp = math.nan

    def tick(self, stamp: float, is_paused: bool) -> bool:
        """Take over a stamp [s]; returns True if the clock has begun again."""
        if not math.isfinite(stamp):
            return False
        passed = 0.0 if math.isnan(self._stamp) else stamp - self._stamp
        self._stamp = stamp
        self.now += 0.0 if is_paused else min(max(passed, 0.0), _JUMP)
        return passed < -_JUMP


class Trials:
    """Judges an exploration that came to its end, and says when to try again what wasn't reached."""

    def __init__(self) -> None:
        self.again_at = -math.inf  # [s]
        self.pause = 0.0  # [s]
        self.is_blocked = False  # the robot reached none of what was left
        self._tried = 0  # with another goal reached meanwhile
        self._in_vain = 0  # in a row without any
        self._reached = 0  # by the loop when this try began
        self._known_area = math.nan  # to the loop when this try began [m2]

    def note(self, loop: ExplorationLoop) -> None:
        """Note a step of the loop: what it reaches, or adds to the map, shows that the robot can drive."""
        if math.isnan(self._known_area):
            self._known_area = loop.known_area
        if self._is_driving(loop):
            self.is_blocked = False

    def _is_driving(self, loop: ExplorationLoop) -> bool:
        return (
            loop.growth.reached > self._reached or loop.known_area > self._known_area + LEAST_GROWTH
        )

    def is_over(self, loop: ExplorationLoop, is_lost: bool, time: float) -> bool:
        """True if the end is one; else it is to be tried again later.

        Args:
            loop: That has ended.
            is_lost: The robot stands where the map shows nothing.
            time: Now [s].
        """
        if loop.known_area > self._known_area + LEAST_GROWTH:
            self._tried = 0
            self._in_vain = 0
        is_driving = self._is_driving(loop)
        left = bool(loop.unreached())
        tries = self._tried if is_driving else self._in_vain
        enough = tries >= MOST_TRIES or (is_driving and not left)
        if enough and not is_lost and (is_driving or not left):
            return True
        self._tried += is_driving
        self._in_vain = 0 if is_driving else self._in_vain + 1
        self.is_blocked = left and not is_driving
        self.pause = min(FIRST_PAUSE * 2.0 ** min(tries, 10), _LONGEST_PAUSE)
        self.again_at = time + self.pause
        self._reached = loop.growth.reached
        self._known_area = loop.known_area
        return False
