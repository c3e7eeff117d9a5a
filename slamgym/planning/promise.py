"""When an exploration may stop: a promise of what will have been seen, kept by the map alone.

Behind a door may be a cupboard or a wing, which no map tells. So a promise is kept once the exploration means to visit
no frontier any more that the robot fits through; what is left then are slits, pinholes of noise and doors that the map
draws too narrow. Explorations of other plans show what was unseen at that moment. A promise is offered where no larger
share of them, counted with one failure more, broke it than it allows (conformal risk control, Angelopoulos et al., ICLR
2024); where none is, an exploration goes on to its end.
"""

import functools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from slamgym.core.config import Positive, Settings, Within
from slamgym.core.errors import ConfigError
from slamgym.core.provenance import check_origin
from slamgym.core.types import Float32Array, FloatArray
from slamgym.planning.frontiers import Frontier

CALIBRATION = Path(__file__).parent / "pretrained" / "promises.safetensors"
"""Floor that explorations had not seen when a promise would have ended them."""

SMALLEST_CALIBRATED = 19.0
"""Smallest plan explored [m2]: of a smaller map, maybe a room behind a narrow door, nothing is promised."""

_FORM = re.compile(r"(?P<amount>\d+(\.\d+)?)(?P<unit>%|m2)(:(?P<confidence>\d+(\.\d+)?)%)?")


class Promise(Settings, section="promise"):
    """A promise that holds when *done* is said; written ``98%:95%``, or ``2m2:90%``."""

    seen: Annotated[float, Within(gt=0.0, lt=1.0)] | None = 0.98
    """At least this share of the floor that the robot can get to has been seen."""
    left: Positive | None = None
    """Or: at most so much of it has not [m2]."""
    confidence: Annotated[float, Within(gt=0.0, lt=1.0)] = 0.95
    """In at least this share of explorations."""

    def _check(self) -> None:
        if (self.seen is None) == (self.left is None):
            raise ConfigError("a promise is either of a share to be seen or of an area left")

    @staticmethod
    def parse(text: str) -> "Promise":
        """Read the written form; the confidence is 95 % where it is left out.

        Raises:
            ConfigError: If it is none.
        """
        found = _FORM.fullmatch(text)
        if found is None:
            raise ConfigError(
                f"{text!r} is no promise; write the share that will be seen and how sure that is, as in 98%:95%, "
                "or the area that may be left, as in 2m2:90%"
            )
        amount = float(found["amount"])
        confidence = float(found["confidence"] or 95.0) / 100.0
        if found["unit"] == "%":
            return Promise(amount / 100.0, None, confidence)
        return Promise(None, amount, confidence)

    def holds(self, seen: float, floor_area: float) -> bool:
        """True if it is true of a share that was seen of a floor [m2]."""
        if self.seen is not None:
            return seen >= self.seen
        assert self.left is not None, "a promise is of one or the other"
        return (1.0 - seen) * floor_area <= self.left

    def __str__(self) -> str:
        amount = f"{self.left:g}m2" if self.seen is None else f"{100.0 * self.seen:g}%"
        return f"{amount}:{100.0 * self.confidence:g}%"


def split_promise(name: str) -> tuple[str, Promise | None]:
    """An explorer's name and the promise behind it, as in ``rl@98%:95%``."""
    base, found, text = name.rpartition("@")
    if not found or _FORM.fullmatch(text) is None:
        return name, None
    return base, Promise.parse(text)


def is_offered(promise: Promise, unseen: Mapping[str, FloatArray | Float32Array]) -> bool:
    """True if a promise would have been kept often enough.

    Args:
        promise: The promise.
        unseen: The ``share`` and ``area`` [m2] of the floor that was unseen when explorations were stopped, shape (N,).
    """
    shares = unseen["share"]
    if promise.seen is None:
        most_left = promise.left or 0.0
        is_broken = unseen["area"] > most_left
    else:
        is_broken = shares > 1.0 - promise.seen
    broken = int(np.count_nonzero(is_broken))
    # One exploration more than were seen may fail, too: that is what the new one is.
    explorations = len(shares) + 1
    may_break = explorations * (1.0 - promise.confidence)
    return broken + 1 <= may_break + 1e-9


@functools.cache
def _is_calibrated(promise: Promise) -> bool:
    """True if a promise is offered by the explorations that come with the package."""
    from safetensors.numpy import load_file

    check_origin(CALIBRATION)
    return is_offered(promise, load_file(CALIBRATION))


def is_kept(promise: Promise, ways_on: Sequence[Frontier] | None, known_area: float) -> bool:
    """True if an exploration may stop.

    Args:
        promise: The promise.
        ways_on: Frontiers that the robot fits through and that are still to be visited; None where they aren't known.
        known_area: Of the map [m2].
    """
    return ways_on == [] and known_area >= SMALLEST_CALIBRATED and _is_calibrated(promise)
