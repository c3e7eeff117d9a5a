"""What makes a map fit for a dataset: coverage, error, and that the robot didn't get stuck."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from slamgym.core.errors import ConfigError
from slamgym.core.types import FloatArray

if TYPE_CHECKING:
    from slamgym.dataset.format import PairRecord

STUCK_PATH = 1.0
"""A robot that drove less than this got stuck, by the truth [m]: some three times its own length."""

_ENDINGS = {
    "explored": "the explorer saw nothing left that it could reach",
    "time_limit": "time limit",
    "coverage": "coverage goal",
}


@dataclass(frozen=True)
class Criteria:
    """When a map counts as good, where the truth is known."""

    min_coverage: float = 0.95
    """Share of the reachable floor that was truly seen."""
    max_map_error: float = 0.30
    """Mean distance of the SLAM map's walls to the CAD walls [m]. An honest map of medium odometry has 0.1 m;
    beyond 0.3 m, three times the thickness of an inner wall, rooms overlap. Not asked for with furniture or
    people, which no CAD map shows."""
    max_ate: float = 0.60
    """Position error of the estimate [m]: about twice the map error that it causes."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.min_coverage <= 1.0:
            raise ConfigError(f"min_coverage must be a share in [0, 1], not {self.min_coverage}")
        for name in ("max_map_error", "max_ate"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"{name} must be positive, not {getattr(self, name)}")

    def faults(self, coverage: float, map_error: float, ate: float, *, has_clutter: bool) -> list[str]:
        """What is wrong with a map, each fault in words; nothing if it is good.

        Args:
            coverage: True coverage.
            map_error: [m].
            ate: [m].
            has_clutter: Whether furniture or people were about.
        """
        found = []
        if coverage < self.min_coverage:
            found.append(f"coverage {_below(coverage, self.min_coverage)} < {self.min_coverage:.2f}")
        if map_error > self.max_map_error and not has_clutter:
            found.append(f"map error {map_error:.2f} m > {self.max_map_error:.2f} m")
        if ate > self.max_ate:
            found.append(f"position error {ate:.2f} m > {self.max_ate:.2f} m")
        return found


@dataclass(frozen=True)
class StuckFilter:
    """Tells from the map alone that a robot got stuck, by its ratio of occupied to free cells.

    The ratio alone can't do it: standing in a corner and having mapped a home give the same. So beside its
    bounds, which catch open space without walls and walls smeared by a robot that spins, a map of no more
    than what is seen from one place, with a way on, is that of a robot that never took it.
    """

    min_ratio: float = 0.015
    """Occupied to free cells: complete maps of homes at 5 cm have 0.03 to 0.09. The ratio falls in
    proportion to the cell size, which is allowed for."""
    max_ratio: float = 0.25
    """Upper bound of the same."""
    view: float = 3.0
    """How far the robot maps [m]: from one place it sees a disc of that radius at most."""
    way_on: float = 0.35
    """Width of an open frontier that counts as a way on [m], as the environment's frontiers."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.min_ratio < self.max_ratio:
            raise ConfigError(
                f"min_ratio must be less than max_ratio and not negative, not {self.min_ratio} and {self.max_ratio}"
            )
        if not (self.view > 0.0 and self.way_on > 0.0):
            raise ConfigError(f"view and way_on must be positive, not {self.view} and {self.way_on}")

    def why_stuck(self, features: FloatArray, resolution: float) -> str:
        """Why a map looks like that of a robot that got stuck; nothing if it doesn't.

        Args:
            features: Of the map, shape (15,).
            resolution: [m/px].
        """
        from slamgym.dataset.curate.completeness import FEATURES

        values = dict(zip(FEATURES, features.tolist(), strict=True))
        area, ratio = values["free_area"], values["occupied_per_free"] * 0.05 / resolution
        if area == 0.0:
            return "stuck: the map shows no free space"
        if not self.min_ratio <= ratio <= self.max_ratio:
            few = "few" if ratio < self.min_ratio else "many"
            return f"stuck: {few} occupied cells for the free ones ({ratio:.3f})"
        if area <= math.pi * self.view**2 and values["widest_frontier"] >= self.way_on:
            return f"stuck: {area:.0f} m2 seen, no more than from one place, with a way on"
        return ""


def has_clutter(record: PairRecord) -> bool:
    """Whether furniture or people were about in an exploration."""
    conditions = record.conditions
    return bool(conditions.get("clutter.furniture", 0.0) or conditions.get("clutter.people", 0))


def record_faults(record: PairRecord, criteria: Criteria) -> list[str]:
    """What is wrong with a pair by the truth, each fault in words; nothing if it is good."""
    found = criteria.faults(record.coverage, record.map_error, record.ate, has_clutter=has_clutter(record))
    if found and found[0].startswith("coverage"):
        found[0] += f": {_ENDINGS.get(record.finished, record.finished)}"
        if record.path_length < STUCK_PATH:
            found.insert(0, f"stuck: drove {record.path_length:.1f} m")
    return found


def fault_kind(fault: str) -> str:
    """A fault of :func:`record_faults` without its figures, but with how the exploration ended; else nothing."""
    for kind in ("stuck", "coverage", "map error", "position error"):
        if fault.startswith(kind):
            ending = fault.rpartition(": ")[2] if kind == "coverage" and ": " in fault else ""
            return f"{kind}: {ending}" if ending else kind
    return ""


def _below(value: float, limit: float) -> str:
    """A value less than a limit, with as many digits as it takes to see that."""
    for digits in (2, 3, 4):
        text = f"{value:.{digits}f}"
        if float(text) < limit:
            return text
    return f"{value:.6f}"
