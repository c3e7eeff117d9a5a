"""The shortest drive that sees a given part of a known building: viewpoints, and a search for a tour through them.

An orienteering problem over a lattice of places, solved by large neighbourhood search: which to look from, and in what
order, so that enough of the floor is seen from them or on the way. Again and again a part of the tour is taken out and
put back by the best ratio of what is seen to the detour, places that have become needless are removed, others moved to
where the detour is shorter, and the order improved by 2-opt and Or-opt (Pisinger and Ropke, "Large neighborhood
search", 2010; Vansteenwegen et al., "The orienteering problem: a survey", EJOR 2011).
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from slamgym.core.geometry import unit_vectors
from slamgym.core.portable import product
from slamgym.core.types import BoolArray, FloatArray, GridFrame, IntArray
from slamgym.envs.coverage import sweep
from slamgym.planning import Costmap, Reachable
from slamgym.planning.frontiers import Point
from slamgym.planning.grid_path import CoarsePaths
from slamgym.planning.open_tour import improve_tour
from slamgym.sim.raycast import cast_rays

_SPACING = 0.75
"""Distance between places of the lattice [m]."""
_EVERY = 2
"""Every so many-th floor cell of a row and of a column stands for the others."""
_BEAMS = 360
"""Beams of a look all round."""
_APART = 0.6
"""Distance between the points of a path from which something is seen [m]."""
_WARMTH = 0.02
"""At first the search continues from a tour that is longer by this share."""
_NEIGHBOURS = 6
"""A place may be moved to one of so many near it."""
_SMALL_DETOUR = 0.3
"""Added to detours before they divide what is seen [m]."""


class Viewpoints:
    """Places in one building, what is seen from them and between them, and the paths that join them.

    Convention: everything is in the world frame; floor masks have row 0 at the bottom, as
    :class:`~slamgym.envs.coverage.Coverage` has them.

    Args:
        costmap: Of the true building, world frame.
        reachable: Where the robot can get to in it.
        floor: The floor to be seen, shape ``frame.shape``.
        frame: Its frame.
        segments: What hides the view, shape (S, 4) [m].
        max_range: How far the scanner sees [m].

    Attributes:
        places: The lattice, shape (P, 2) [m].
        cells: The floor cells that stand for all, flat indices, shape (C,).
        views: Which cells are seen all round from each place, shape (P, C).
        paths: Lengths of paths in the building.
        lengths: Of the paths between the places, shape (P, P) [m].
        near: The places nearest to each by path, shape (P, neighbours).
    """

    def __init__(
        self,
        costmap: Costmap,
        reachable: Reachable,
        floor: BoolArray,
        frame: GridFrame,
        segments: FloatArray,
        max_range: float,
    ) -> None:
        self.paths = CoarsePaths(costmap, reachable)
        self.places = _lattice(costmap, reachable)
        kept = np.zeros_like(floor)
        kept[::_EVERY, ::_EVERY] = floor[::_EVERY, ::_EVERY]
        self.cells: IntArray = np.flatnonzero(kept)
        segments = segments.view()
        segments.flags.writeable = False
        points: list[Point] = [(x, y) for x, y in self.places.tolist()]
        in_sight = [_in_sight(point, floor, frame, segments, max_range) for point in points]
        self.views: BoolArray = np.vstack([seen.reshape(-1)[self.cells] for seen in in_sight])
        self._lists = [np.flatnonzero(seen) for seen in self.views]
        # What is seen while driving from place to place.
        self._legs: dict[tuple[int, int], BoolArray] = {}
        self._at: IntArray = self.paths.places(self.places)
        lengths = np.vstack([self.paths.lengths_from(cell, self._at) for cell in self._at])
        # Rounding makes a way back longer by micrometres, and improving a tour by such lengths may never end.
        self.lengths: FloatArray = np.minimum(lengths, lengths.T)
        self.near: IntArray = np.argsort(self.lengths, axis=1)[:, 1 : 1 + _NEIGHBOURS]
        row, col = np.divmod(self.cells, frame.width_px)
        x = frame.origin_x + (col + 0.5) * frame.resolution
        y = frame.origin_y + (row + 0.5) * frame.resolution
        self._centres = np.column_stack([x, y])

    def nearest(self, point: Sequence[float] | FloatArray) -> int:
        """The place nearest to a point."""
        away = self.places - np.asarray(point)
        return int((away**2).sum(axis=1).argmin())

    def lengths_from(self, start: Point) -> FloatArray:
        """Path length from a point to each place, shape (P,) [m]."""
        return self.paths.lengths_from(self.paths.place(start), self._at).astype(np.float64)

    def seen_between(self, here: int, there: int) -> BoolArray:
        """Cells that are seen ahead on the path from one place to another, shape (C,)."""
        if (here, there) not in self._legs:
            self._legs[here, there] = self.seen_on_leg(self._point(here), there)
        return self._legs[here, there]

    def _point(self, place: int) -> Point:
        x, y = self.places[place]
        return float(x), float(y)

    def seen_on_leg(self, start: Point, place: int) -> BoolArray:
        """Cells that are seen ahead on the path from a point to a place, shape (C,)."""
        path = self.paths.path(start, self._point(place))
        seen = np.zeros(self.views.shape[1], dtype=np.bool_)
        stride = max(1, round(_APART / self.paths.cell))
        for i in range(stride, len(path), stride):
            ahead = path[i] - path[i - stride]
            cells = self._lists[self.nearest(path[i])]
            x, y = (self._centres[cells] - path[i]).T
            is_ahead = x * ahead[0] + y * ahead[1] > 0.0
            seen[cells[is_ahead]] = True
        return seen


class TourSearch:
    """Searches tours through one building from one start.

    Args:
        viewpoints: Places, what is seen from them, and the lengths of paths between them.
        start: Where the robot begins, world frame [m].
        wanted: Which cells are still to be seen, shape (C,).
        rng: Draws what is taken out.
    """

    def __init__(
        self, viewpoints: Viewpoints, start: Point, wanted: BoolArray, rng: np.random.Generator
    ) -> None:
        self._viewpoints = viewpoints
        self._start = start
        self._wanted = wanted
        self._rng = rng
        self._views = viewpoints.views & wanted
        self._matrix = np.ascontiguousarray(self._views.T, np.float32)
        count = len(viewpoints.places)
        self._home = count  # index of the start in the lengths
        from_start = viewpoints.lengths_from(start)
        self._lengths = np.pad(viewpoints.lengths, (0, 1)).astype(np.float64)
        self._lengths[count, :count] = from_start
        self._lengths[:count, count] = from_start
        # What is seen on the way from the start to each place.
        self._first_legs: dict[int, BoolArray] = {}
        self._usable = np.isfinite(from_start)

    def shortest(self, needed: int, iterations: int, begin: Sequence[int] = ()) -> list[int]:
        """A short tour that sees so many of the wanted cells, or all that can be seen if those are fewer.

        Args:
            needed: Cells.
            iterations: How often a part of the tour is taken out.
            begin: Stops to begin with.

        Returns:
            Places in their order, without the start.
        """
        visible = self._views[self._usable].any(axis=0)
        needed = min(needed, int(np.count_nonzero(visible)))
        current = self._completed([place for place in begin if self._usable[place]], needed)
        best = current
        for number in range(iterations):
            tried = self._completed(self._destroyed(current), needed)
            if number % 10 == 0:
                tried = self._slid(tried, needed)
            allowed = 1.0 + _WARMTH * (1.0 - number / iterations)
            if self.length(tried) < allowed * self.length(current):
                current = tried
            if self.length(tried) < self.length(best) - 1e-9:
                best = tried
        return self._reduced(self._slid(best, needed), needed)

    def _completed(self, tour: list[int], needed: int) -> list[int]:
        """The tour with what it lacks, in a better order, and without what it doesn't need."""
        tour = self._repaired(tour, needed)
        tour = self._ordered(tour)
        return self._reduced(tour, needed)

    def length(self, tour: list[int]) -> float:
        """Length of the drive [m]."""
        stops = [self._home, *tour]
        return float(sum(self._lengths[a, b] for a, b in itertools.pairwise(stops)))

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
        unseen = self._wanted & (self.counts(tour) == 0)
        may_stay_unseen = np.count_nonzero(self._wanted) - needed
        noise = 1.0 + 0.3 * self._rng.random(len(self._views))
        while True:
            missing = int(np.count_nonzero(unseen)) - may_stay_unseen
            if missing <= 0:
                return tour
            shown = product(unseen[None].astype(np.float32), self._matrix)[0]
            gains = np.minimum(shown, missing) * self._usable
            detours = self._detours(tour)
            cheapest = np.where(self._usable, detours, np.inf).min(axis=0)
            costs = np.maximum(cheapest, 0.0) + _SMALL_DETOUR
            place = int(np.argmax(noise * gains / costs))
            tour.insert(int(np.argmin(detours[:, place])), place)
            unseen &= ~self._views[place]

    def _detours(self, tour: list[int]) -> FloatArray:
        """How much longer each place makes the drive if it is put before each stop or at the end, shape (n + 1, P)."""
        stops = np.array([self._home, *tour])
        to_stops = self._lengths[stops, : self._home]
        legs = self._lengths[stops[:-1], stops[1:]]
        detours = to_stops.copy()
        detours[:-1] += to_stops[1:] - legs[:, None]
        return detours

    def _ordered(self, tour: list[int]) -> list[int]:
        """The same stops in a better order."""
        if len(tour) < 3:
            return tour
        stops = [self._home, *tour]
        order = improve_tour(self._lengths[np.ix_(stops, stops)], np.arange(1, len(stops)))
        return [stops[index] for index in order]

    def _reduced(self, tour: list[int], needed: int) -> list[int]:
        """The tour without stops that aren't needed, those with the largest detour first."""
        tour = list(tour)
        counts = self.counts(tour)
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
                    counts = left
                    is_shorter = True
                    break
        return tour

    def _seen_for(self, tour: list[int], index: int) -> IntArray:
        """Number of times that one stop alone shows each cell, shape (C,)."""
        stop = tour[index]
        before = tour[index - 1] if index else None
        own = self._views[stop].astype(np.int64) + self._on_the_way(before, stop)
        if index + 1 < len(tour):
            after = tour[index + 1]
            own += self._on_the_way(stop, after)
            own -= self._on_the_way(before, after)
        return own

    def _slid(self, tour: list[int], needed: int) -> list[int]:
        """The tour with stops moved to places near them where that makes it shorter and enough is still seen."""
        tour = list(tour)
        for index in range(len(tour)):
            for place in self._viewpoints.near[tour[index]].tolist():
                moved = [*tour[:index], place, *tour[index + 1 :]]
                if not self._usable[place] or self.length(moved) >= self.length(tour) - 1e-6:
                    continue
                if np.count_nonzero(self.counts(moved)) >= needed:
                    tour = moved
        return tour

    def counts(self, tour: list[int]) -> IntArray:
        """Number of times that each wanted cell is seen, from the stops and on the way, shape (C,)."""
        counts = np.zeros(len(self._wanted), np.int64)
        for before, place in zip([None, *tour], tour, strict=False):
            counts += self._views[place]
            counts += self._on_the_way(before, place)
        return counts

    def _on_the_way(self, here: int | None, there: int) -> IntArray:
        """1 for each wanted cell that is seen ahead on the path to a stop, shape (C,)."""
        if here is not None:
            seen = self._viewpoints.seen_between(here, there)
        elif there in self._first_legs:
            seen = self._first_legs[there]
        else:
            seen = self._viewpoints.seen_on_leg(self._start, there)
            self._first_legs[there] = seen
        return (self._wanted & seen).astype(np.int64)


def _in_sight(
    point: Point, floor: BoolArray, frame: GridFrame, segments: FloatArray, max_range: float
) -> BoolArray:
    """Which floor is in sight all round a place, shape of the floor."""
    x, y = point
    ranges = np.empty(_BEAMS)
    step = 2.0 * math.pi / _BEAMS
    cast_rays(x, y, 0.0, 0.0, step, segments, max_range, ranges)
    unseen = floor.copy()
    directions = unit_vectors(step * np.arange(_BEAMS, dtype=np.float64))
    sweep(
        unseen,
        frame.origin_x,
        frame.origin_y,
        frame.resolution,
        x,
        y,
        0.0,
        directions,
        ranges,
        max_range,
    )
    return ~unseen


def _lattice(costmap: Costmap, reachable: Reachable) -> FloatArray:
    """Places where the robot's centre can be, one in each square of a lattice, shape (P, 2) [m].

    Of each square the cell farthest from walls is taken, so that doorways, which a lattice of points would
    miss, have theirs.
    """
    width = costmap.costs.shape[1]
    order = reachable.order[: reachable.num_centre]
    rows, cols = np.divmod(order, width)
    side = max(1, round(_SPACING / costmap.frame.resolution))
    squares = (rows // side) * (width // side + 1) + cols // side
    clearance = costmap.distance[rows, cols]
    by_square = np.lexsort((-clearance, squares))
    _, first = np.unique(squares[by_square], return_index=True)
    kept = by_square[first]
    return np.column_stack(costmap.frame.to_point(rows[kept], cols[kept]))
