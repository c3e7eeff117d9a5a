"""The shortest drive that sees a given share of a known building, by large neighbourhood search.

An orienteering problem over a lattice of places: which to look from, and in what order, so that enough of the floor
is seen from them or on the way. Again and again a part of the tour is taken out and put back by the best ratio of what
is seen to the detour, places that have become needless are removed, others moved to where the detour is shorter, and
the order improved by 2-opt and Or-opt (Pisinger and Ropke, "Large neighborhood search", 2010; Vansteenwegen et al.,
"The orienteering problem: a survey", EJOR 2011).
"""

import itertools

import numpy as np

from slamgym.agents.coverage_tour import CoverageTourPlanner
from slamgym.core.portable import product
from slamgym.core.types import BoolArray, IntArray
from slamgym.planning.frontiers import Point
from slamgym.planning.open_tour import improve_tour

_WARMTH = 0.02
"""At first a tour that is longer by this share is gone on from."""
_NEIGHBOURS = 6
"""A place may be moved to one of so many near it."""
_SMALL_DETOUR = 0.3
"""Added to detours before they divide what is seen [m]."""


class TourSearch:
    """Searches tours through one building from one start.

    Args:
        planner: Places, what is seen from them, and the lengths of paths between them.
        start: Where the robot begins, world frame [m]; it looks all round there.
        rng: Draws what is taken out.
    """

    def __init__(self, planner: CoverageTourPlanner, start: Point, rng: np.random.Generator) -> None:
        self._planner, self._start, self._rng = planner, start, rng
        self._views = planner.views
        self._matrix = np.ascontiguousarray(self._views.T, np.float32)
        count = len(planner.places)
        self._lengths = np.empty((count + 1, count + 1))
        self._lengths[:count, :count] = planner.lengths
        self._lengths[count, :count] = self._lengths[:count, count] = planner.lengths_from(start)
        self._lengths[count, count] = 0.0
        self._home = count  # index of the start in the lengths
        nearest = ((planner.places - np.array(start)) ** 2).sum(axis=1).argmin()
        self._first_view = self._views[nearest]
        self._near = np.argsort(planner.lengths, axis=1)[:, 1 : 1 + _NEIGHBOURS]
        self._first_legs: dict[int, BoolArray] = {}  # what is seen on the way from the start to each place
        self._usable = np.isfinite(self._lengths[count, :count])

    def shortest(self, share: float, iterations: int, begin: list[int] | None = None) -> list[int]:
        """A short tour that sees a share of the floor, or all that can be seen if that is less.

        Args:
            share: Of the planner's cells.
            iterations: How often a part of the tour is taken out.
            begin: Stops to begin with.

        Returns:
            Places in their order, without the start.
        """
        most = self._views[self._usable].any(axis=0) | self._first_view
        needed = min(round(share * most.size), int(np.count_nonzero(most)))
        current = self._reduced(self._ordered(self._repaired(list(begin or []), needed)), needed)
        best = current
        for number in range(iterations):
            tried = self._reduced(self._ordered(self._repaired(self._destroyed(current), needed)), needed)
            if number % 10 == 0:
                tried = self._slid(tried, needed)
            allowed = 1.0 + _WARMTH * (1.0 - number / iterations)
            if self.length(tried) < allowed * self.length(current):
                current = tried
            if self.length(tried) < self.length(best) - 1e-9:
                best = tried
        return self._reduced(self._slid(best, needed), needed)

    def length(self, tour: list[int]) -> float:
        """Length of the drive [m]."""
        stops = [self._home, *tour]
        return float(sum(self._lengths[a, b] for a, b in itertools.pairwise(stops)))

    def share(self, tour: list[int]) -> float:
        """What a tour sees of the planner's cells."""
        return float((self._counts(tour) > 0).mean())

    def _destroyed(self, tour: list[int]) -> list[int]:
        """The tour without some stops: a stretch of it, or stops here and there."""
        if not tour:
            return tour
        count = int(self._rng.integers(1, max(2, len(tour) // 2) + 1))
        if self._rng.random() < 0.6:
            first = int(self._rng.integers(0, len(tour)))
            return tour[:first] + tour[first + count :]
        kept = set(self._rng.permutation(len(tour))[count:].tolist())
        return [place for index, place in enumerate(tour) if index in kept]

    def _repaired(self, tour: list[int], needed: int) -> list[int]:
        """The tour with stops put in, by what each shows for its detour, until enough is seen."""
        tour = list(tour)
        unseen = self._counts(tour) == 0
        noise = 1.0 + 0.3 * self._rng.random(len(self._views))
        while (missing := needed - (unseen.size - int(np.count_nonzero(unseen)))) > 0:
            gains = (
                np.minimum(product(unseen[None].astype(np.float32), self._matrix)[0], missing) * self._usable
            )
            stops = np.array([self._home, *tour])
            to_stops = self._lengths[stops, : self._home]  # (n + 1, P)
            detours = to_stops.copy()
            detours[:-1] += to_stops[1:] - self._lengths[stops[:-1], stops[1:]][:, None]
            cheapest = np.where(self._usable, detours, np.inf).min(axis=0)
            place = int(np.argmax(noise * gains / (np.maximum(cheapest, 0.0) + _SMALL_DETOUR)))
            tour.insert(int(np.argmin(detours[:, place])), place)
            unseen &= ~self._views[place]
        return tour

    def _ordered(self, tour: list[int]) -> list[int]:
        """The same stops in a better order."""
        if len(tour) < 3:
            return tour
        stops = [self._home, *tour]
        order = improve_tour(self._lengths[np.ix_(stops, stops)], np.arange(1, len(stops)))
        return [stops[index] for index in order]

    def _reduced(self, tour: list[int], needed: int) -> list[int]:
        """The tour without stops that aren't needed, those with the largest detour first."""
        tour, counts = list(tour), self._counts(tour)
        is_shorter = True
        while is_shorter:
            is_shorter = False
            stops = [self._home, *tour]
            savings = self._lengths[stops[:-1], tour].copy()
            savings[:-1] += self._lengths[tour[:-1], tour[1:]] - self._lengths[stops[:-2], tour[1:]]
            for index in np.argsort(-savings).tolist():
                left = counts - self._seen_for(tour, index)
                if np.count_nonzero(left) >= needed:
                    del tour[index]
                    counts, is_shorter = left, True
                    break
        return tour

    def _seen_for(self, tour: list[int], index: int) -> IntArray:
        """What one stop adds to how often each cell is seen, shape (C,)."""
        before = tour[index - 1] if index else None
        own = self._views[tour[index]].astype(np.int64) + self._on_the_way(before, tour[index])
        if index + 1 < len(tour):
            own += self._on_the_way(tour[index], tour[index + 1])
            own -= self._on_the_way(before, tour[index + 1])
        return own

    def _slid(self, tour: list[int], needed: int) -> list[int]:
        """The tour with stops moved to places near them where that makes it shorter and enough is still seen."""
        tour = list(tour)
        for index in range(len(tour)):
            for place in self._near[tour[index]].tolist():
                moved = [*tour[:index], place, *tour[index + 1 :]]
                shorter = self._usable[place] and self.length(moved) < self.length(tour) - 1e-6
                if shorter and np.count_nonzero(self._counts(moved)) >= needed:
                    tour = moved
        return tour

    def _counts(self, tour: list[int]) -> IntArray:
        """How often each cell is seen, from the stops, the start and on the way, shape (C,)."""
        counts = self._first_view.astype(np.int64)
        for here, there in itertools.pairwise([None, *tour]):
            assert there is not None
            counts += self._views[there]
            counts += self._on_the_way(here, there)
        return counts

    def _on_the_way(self, here: int | None, there: int) -> IntArray:
        """Whether each cell is seen ahead on the path to a stop, shape (C,)."""
        if here is not None:
            return self._planner.seen_between(here, there).astype(np.int64)
        if there not in self._first_legs:
            self._first_legs[there] = self._planner.seen_on_leg(self._start, there)
        return self._first_legs[there].astype(np.int64)
