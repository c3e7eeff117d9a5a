"""Reasons why a map is unfit for a dataset: the criteria, and faults as records with a :attr:`MapFault.sentence`."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

from slamgym.core.config import Positive, Settings, Share
from slamgym.dataset.record import GOOD_COVERAGE, PairRecord

MapFaultKind = Literal[
    "coverage", "map_error", "position_error", "hardly_driven", "incomplete", "doubtful", "unreadable",
    "low_coverage", "not_clean", "too_large",
]  # fmt: skip

_ENDINGS = {
    "explored": "the explorer saw nothing left that it could reach",
    "time_limit": "time limit",
    "stuck": "the map stood still",
    "coverage": "coverage goal",
}
_WORDS: dict[MapFaultKind, tuple[str, str]] = {
    "coverage": ("coverage", "coverage {below} < {limit:.2f}"),
    "map_error": ("map error", "map error {value:.2f} m > {limit:.2f} m"),
    "position_error": ("position error", "position error {value:.2f} m > {limit:.2f} m"),
    "hardly_driven": ("stuck", "stuck: drove {value:.1f} m"),
    "incomplete": (
        "incomplete",
        "incomplete: probability {value:.2f} of being complete < {limit:.2f}",
    ),
    "doubtful": ("doubtful", "doubtful: probability {value:.2f} of being complete < {limit:.2f}"),
    "unreadable": ("unreadable", "{detail}"),
    "low_coverage": ("low coverage", "low coverage: {value:.3f} < {limit:g}, ended by {detail}"),
    "not_clean": ("not clean", "not clean: {detail}"),
    "too_large": ("too large", "too large: {value:.1f} m long but the image shows {limit:.1f} m"),
}
"""For each kind: the reason under which it is counted, and its sentence."""


@dataclass(frozen=True)
class MapFault:
    """Why a map is not fit, or not surely."""

    kind: MapFaultKind
    value: float = 0.0
    """Measured value, if something was measured."""
    limit: float = 0.0
    """Limit that a good map meets, if there is one."""
    detail: str = ""
    """For low coverage: how the exploration ended; otherwise details that the figures don't give."""

    @property
    def reason(self) -> str:
        """Under what it is counted: the kind without figures, but with how the exploration ended."""
        name = _WORDS[self.kind][0]
        return f"{name}: {self._ending}" if self.kind == "coverage" and self.detail else name

    @property
    def sentence(self) -> str:
        """The fault in words."""
        text = _WORDS[self.kind][1].format(
            value=self.value,
            limit=self.limit,
            detail=self.detail,
            below=_below(self.value, self.limit),
        )
        return f"{text}: {self._ending}" if self.kind == "coverage" and self.detail else text

    @property
    def _ending(self) -> str:
        return _ENDINGS.get(self.detail, self.detail)


def _below(value: float, limit: float) -> str:
    """A value less than a limit, with as many digits as it takes to see that."""
    for digits in (2, 3, 4):
        text = f"{value:.{digits}f}"
        if float(text) < limit:
            return text
    return f"{value:.6f}"


STUCK_PATH = 1.0
"""A robot that drove less than this got stuck, by the truth [m]: some three times its own length."""


class Criteria(Settings):
    """When a map counts as good, where the truth is known."""

    min_coverage: Share = GOOD_COVERAGE
    """Share of the reachable floor that was truly seen."""
    max_map_error: Positive = 0.30
    """Mean distance of the SLAM map's walls to the CAD walls [m]. An honest map of medium odometry has 0.1 m;
    beyond 0.3 m, three times the thickness of an inner wall, rooms overlap. Not asked for with furniture or
    people, which no CAD map shows."""
    max_ate: Positive = 0.60
    """Position error of the estimate [m]: about twice the map error that it causes."""

    def faults(
        self, coverage: float, map_error: float, ate: float, *, has_clutter: bool
    ) -> list[MapFault]:
        """Faults of a map; empty if it is good.

        Args:
            coverage: True coverage.
            map_error: [m].
            ate: [m].
            has_clutter: Furniture or people were about.
        """
        found = []
        if coverage < self.min_coverage:
            found.append(MapFault("coverage", coverage, self.min_coverage))
        if map_error > self.max_map_error and not has_clutter:
            found.append(MapFault("map_error", map_error, self.max_map_error))
        if ate > self.max_ate:
            found.append(MapFault("position_error", ate, self.max_ate))
        return found


def has_clutter(record: PairRecord) -> bool:
    """True if furniture, doors' leaves or people were about in an exploration."""
    conditions = record.conditions
    return any(conditions.get(f"clutter.{kind}") for kind in ("furniture", "doors", "people"))


def record_faults(record: PairRecord, criteria: Criteria) -> list[MapFault]:
    """Faults of a pair by the truth; empty if it is good."""
    found = criteria.faults(
        record.coverage, record.map_error, record.ate, has_clutter=has_clutter(record)
    )
    if found and found[0].kind == "coverage":
        found[0] = dataclasses.replace(found[0], detail=record.finished)
        if record.path_length < STUCK_PATH:
            found.insert(0, MapFault("hardly_driven", record.path_length, STUCK_PATH))
    return found
