"""When an exploration may stop: a promise of what will have been seen, kept by the map alone.

A small network estimates the unseen floor behind each frontier and elsewhere (:mod:`slamgym.planning.remaining`). Its
estimate is only ordered rightly, not true to the square metre, so the limit at which a robot stops is calibrated: on
explorations of plans that the network hasn't seen it is the largest with which no larger share of them, counted with
one failure more, stopped too early than the promise allows (conformal risk control, Angelopoulos et al., ICLR 2024).
"""

import functools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from slamgym.core.config import Positive, Settings, Within
from slamgym.core.errors import ConfigError
from slamgym.core.portable import exp, product
from slamgym.core.provenance import check_origin
from slamgym.core.types import Float32Array, FloatArray
from slamgym.planning.remaining import FRONTIER_FEATURES, Remains

PRETRAINED_ESTIMATE = Path(__file__).parent / "pretrained" / "remaining.safetensors"
"""The estimate and its calibration that come with the package."""

FAMILIAR_AREA = 100.0
"""Known floor counts up to that of a usual home [m2]: the limits are calibrated on homes, and in a larger building one
door, which the estimate gives a few square metres, may hide a wing. Beyond it no promise is kept while a frontier that
the robot fits through is still on offer: on 20 homes and offices of 104 to 401 m2 that took 3 % more time and kept the
one promise that was broken, by a door to 15 % of the floor."""

LARGEST_CALIBRATED = 300.0
"""The limits are calibrated on plans of up to this area [m2]. In larger buildings nothing is promised and an
exploration continues to its end: of 14 offices and schools with loops of more than 900 m2 six kept `98%:95%`, twelve
without a promise."""

_SAME_FRONTIER = 0.3
"""Frontiers are the same if points of them come so near to each other by both coordinates [m]."""

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
        amount, confidence = float(found["amount"]), float(found["confidence"] or 95.0) / 100.0
        if found["unit"] == "%":
            return Promise(amount / 100.0, None, confidence)
        return Promise(None, amount, confidence)

    def holds(self, seen: float, floor_area: float) -> bool:
        """True if it is true of a share that was seen of a floor [m2]."""
        return seen >= self.seen if self.left is None else (1.0 - seen) * floor_area <= self.left  # type: ignore[operator]

    def __str__(self) -> str:
        what = f"{self.left:g}m2" if self.seen is None else f"{100.0 * self.seen:g}%"
        return f"{what}:{100.0 * self.confidence:g}%"


def split_promise(name: str) -> tuple[str, Promise | None]:
    """An explorer's name and the promise behind it, as in ``rl@98%:95%``."""
    base, found, text = name.rpartition("@")
    if not found or _FORM.fullmatch(text) is None:
        return name, None
    return base, Promise.parse(text)


class UnseenFloor:
    """Estimates how much floor is still unseen, and knows how far that can be trusted.

    Args:
        arrays: Weights by name, and ``calibration.exploration``, ``.estimate``, ``.share`` and ``.area``: of moments
            of explorations with known truth, in their order, the estimated share and what was truly unseen. The
            last of each exploration is its end.
    """

    def __init__(self, arrays: Mapping[str, Float32Array]) -> None:
        self._arrays = arrays

    def area_behind(self, remains: Remains) -> FloatArray:
        """Expected unseen floor behind each frontier, shape (N,) [m2]."""
        whole = np.broadcast_to(remains.whole, (len(remains.frontiers), len(remains.whole)))
        inputs = np.hstack([remains.frontiers, whole])
        hidden = np.maximum(self._linear("b", np.maximum(self._linear("a", inputs), 0.0)), 0.0)
        return _area(self._linear("c", hidden)[:, 0])

    def share(self, remains: Remains) -> float:
        """Expected unseen share of the floor, at most :data:`FAMILIAR_AREA` of which counts as known."""
        elsewhere = _area(self._linear("o", np.maximum(self._linear("g", remains.whole[None]), 0.0))[:, 0])
        unseen = float(self.area_behind(remains).sum() + elsewhere.sum())
        return unseen / (unseen + min(remains.known_area, FAMILIAR_AREA))

    def limit(self, promise: Promise) -> float:
        """The largest estimated share at which the promise is kept; 0 where no stop before the end keeps it."""
        names = ("exploration", "estimate", "share", "area")
        exploration, estimate, share, area = (self._arrays[f"calibration.{name}"] for name in names)
        broken = area > promise.left if promise.left is not None else share > 1.0 - float(promise.seen or 0.0)
        # An exploration stops too early with every limit above its lowest estimate while the promise is broken.
        lowest = np.where(broken, estimate, np.inf)
        begins = np.flatnonzero(np.diff(exploration, prepend=-1.0))
        ends = np.append(begins[1:], len(broken)) - 1
        thresholds = np.sort(np.where(broken[ends], 0.0, np.minimum.reduceat(lowest, begins)))
        # One exploration more than were seen may fail, too: that is what the new one is.
        allowed = int(np.floor((len(begins) + 1) * (1.0 - promise.confidence) + 1e-9)) - 1
        return max(0.0, float(thresholds[allowed])) if 0 <= allowed < len(thresholds) else 0.0

    def _linear(self, name: str, values: FloatArray) -> FloatArray:
        return product(values, self._arrays[f"{name}.weight"].T) + self._arrays[f"{name}.bias"]


@functools.cache
def pretrained_unseen_floor() -> UnseenFloor:
    """The estimate that comes with the package."""
    from safetensors.numpy import load_file

    check_origin(PRETRAINED_ESTIMATE)
    return UnseenFloor(load_file(PRETRAINED_ESTIMATE))


@functools.cache
def pretrained_limit(promise: Promise) -> float:
    """The limit of a promise by the calibration that comes with the package."""
    return pretrained_unseen_floor().limit(promise)


def is_kept(promise: Promise, remains: Remains | None) -> bool:
    """True if an exploration may stop on what a map shows; never beyond :data:`LARGEST_CALIBRATED`."""
    if remains is None or remains.known_area > LARGEST_CALIBRATED:
        return False
    way_on = [FRONTIER_FEATURES.index(name) for name in ("offered", "in_reach")]
    if remains.known_area > FAMILIAR_AREA and remains.frontiers[:, way_on].all(axis=1).any():
        return False
    return pretrained_unseen_floor().share(remains) < pretrained_limit(promise)


def expected_floor(remains: Remains, frontiers: Sequence[FloatArray]) -> FloatArray:
    """Expected unseen floor behind frontiers, shape (N,) [m2]; inf where none was measured.

    Args:
        remains: What the map doesn't show yet.
        frontiers: Points of each, shape (M, 2) [m].
    """
    expected = np.full(len(frontiers), np.inf)
    if not remains.points:
        return expected
    areas = pretrained_unseen_floor().area_behind(remains)
    lowest, highest = (np.array([end(one, axis=0) for one in remains.points]) for end in (np.min, np.max))
    for index, points in enumerate(frontiers):
        low, high = points.min(axis=0) - _SAME_FRONTIER, points.max(axis=0) + _SAME_FRONTIER
        boxes_meet = np.flatnonzero(((lowest <= high) & (highest >= low)).all(axis=1))
        apart = [np.abs(remains.points[k][:, None] - points).max(axis=2).min() for k in boxes_meet]
        near = boxes_meet[np.array(apart) <= _SAME_FRONTIER]
        expected[index] = areas[near].max() if len(near) else np.inf
    return expected


def _area(values: FloatArray) -> FloatArray:
    """Square metres of what the network gives."""
    return exp(np.clip(values, -8.0, 5.0))
