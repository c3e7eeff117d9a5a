"""What makes a map fit for a dataset: coverage, error, and that the robot didn't get stuck."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from slamgym.core.config import NonNegative, Positive, Settings, Share
from slamgym.core.errors import ConfigError
from slamgym.core.types import FloatArray
from slamgym.dataset.faults import MapFault
from slamgym.dataset.record import GOOD_COVERAGE

if TYPE_CHECKING:
    from slamgym.dataset.record import PairRecord

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

    def faults(self, coverage: float, map_error: float, ate: float, *, has_clutter: bool) -> list[MapFault]:
        """What is wrong with a map; nothing if it is good.

        Args:
            coverage: True coverage.
            map_error: [m].
            ate: [m].
            has_clutter: Whether furniture or people were about.
        """
        found = []
        if coverage < self.min_coverage:
            found.append(MapFault("coverage", coverage, self.min_coverage))
        if map_error > self.max_map_error and not has_clutter:
            found.append(MapFault("map_error", map_error, self.max_map_error))
        if ate > self.max_ate:
            found.append(MapFault("position_error", ate, self.max_ate))
        return found


class StuckFilter(Settings):
    """Finds from the map alone that a robot got stuck, by its ratio of occupied to free cells.

    The ratio alone isn't enough: standing in a corner and having mapped a home give the same. Its bounds catch
    open space without walls and walls smeared by a robot that spins; besides, a robot is stuck if its map shows
    no more than is seen from one place although an open frontier leads on.
    """

    min_ratio: NonNegative = 0.015
    """Occupied to free cells: complete maps of homes at 5 cm have 0.03 to 0.09. The ratio falls in
    proportion to the cell size, which is allowed for."""
    max_ratio: float = 0.25
    """Upper bound of the same."""
    view: Positive = 3.0
    """How far the robot maps [m]: from one place it sees a disc of that radius at most."""
    way_on: Positive = 0.35
    """Width of an open frontier that counts as a way on [m], as the environment's frontiers."""

    def _check(self) -> None:
        if self.min_ratio >= self.max_ratio:
            raise ConfigError(
                f"min_ratio must be less than max_ratio, not {self.min_ratio} and {self.max_ratio}"
            )

    def fault(self, features: FloatArray, resolution: float) -> MapFault | None:
        """Why a map looks like that of a robot that got stuck; None if it doesn't.

        Args:
            features: Of the map, shape (15,).
            resolution: [m/px].
        """
        from slamgym.dataset.curate.completeness import FEATURES

        values = dict(zip(FEATURES, features.tolist(), strict=True))
        area, ratio = values["free_area"], values["occupied_per_free"] * 0.05 / resolution
        if area == 0.0:
            return MapFault("no_free_space")
        if ratio < self.min_ratio:
            return MapFault("few_walls", ratio, self.min_ratio)
        if ratio > self.max_ratio:
            return MapFault("many_walls", ratio, self.max_ratio)
        one_view = math.pi * self.view**2
        if area <= one_view and values["widest_frontier"] >= self.way_on:
            return MapFault("one_view", area, one_view)
        return None


def has_clutter(record: PairRecord) -> bool:
    """Whether furniture, doors' leaves or people were about in an exploration."""
    conditions = record.conditions
    return any(conditions.get(f"clutter.{kind}") for kind in ("furniture", "doors", "people"))


def record_faults(record: PairRecord, criteria: Criteria) -> list[MapFault]:
    """What is wrong with a pair by the truth; nothing if it is good."""
    found = criteria.faults(record.coverage, record.map_error, record.ate, has_clutter=has_clutter(record))
    if found and found[0].kind == "coverage":
        found[0] = dataclasses.replace(found[0], detail=record.finished)
        if record.path_length < STUCK_PATH:
            found.insert(0, MapFault("hardly_driven", record.path_length, STUCK_PATH))
    return found
