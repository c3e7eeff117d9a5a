"""Where to stand to see a whole building, and in what order: planning for one who knows the floor plan.

The places are an art gallery's guards: a greedy set cover (Chvatal, "A greedy heuristic for the set-covering
problem", Math. of OR 4(3), 1979) over what the scanner sees from a lattice of places, its range included.
An open travelling salesman's tour orders them; then each place is moved to where it still sees what only it
sees but costs a smaller detour, and places are left out whose part is seen while driving between the others
(Danner and Kavraki, "Randomized planning for short inspection paths", ICRA 2000, split the task alike).
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgym.core.config import Settings
from slamgym.core.geometry import unit_vectors
from slamgym.core.types import BoolArray, FloatArray, GridFrame, IntArray
from slamgym.envs.coverage import sweep
from slamgym.planning import Costmap, Reachable
from slamgym.planning.frontiers import Point
from slamgym.planning.grid_path import CoarsePaths
from slamgym.planning.open_tour import open_tour
from slamgym.sim.raycast import cast_rays

_BEAMS = 360
_APART = 0.6
"""Distance between the points of a path from which something is seen [m]."""


class CoverageTourConfig(Settings):
    """How the tour is planned."""

    spacing: float = 0.75
    """Distance between places of the lattice [m]."""
    every: int = 2
    """Every so many-th floor cell of a row and of a column stands for the others."""
    goal: float = 0.995
    """Share of the floor that the tour shall see: the last slivers behind corners cost more than they show."""
    clearly: float = 1.0
    """A tour must be so much shorter than the current one to replace it [m]."""
    sweeps: int = 3
    """How often places are moved and left out."""


class Stop(NamedTuple):
    """A place of the tour."""

    place: int  # index into CoverageTourPlanner.places
    point: Point  # world frame [m]
    cells: IntArray  # what is to be seen from there, indices into CoverageTourPlanner.cells


class CoverageTourPlanner:
    """Plans tours through one building.

    Convention: everything is in the world frame; floor masks have row 0 at the bottom, as
    :class:`~slamgym.envs.coverage.Coverage` has them.

    Args:
        costmap: Of the true building, world frame.
        reachable: Where the robot can get to in it.
        floor: The floor to be seen, shape ``frame.shape``.
        frame: Its frame.
        segments: What hides the view, shape (S, 4) [m].
        max_range: How far the scanner sees [m].
        config: Settings.

    Attributes:
        places: The lattice, shape (P, 2) [m].
        cells: The floor cells that stand for all, flat indices, shape (C,).
        coverable: Which of them can be seen from some place, shape (C,).
        cell_area: Floor that each of them stands for [m2].
        views: Which cells are seen all round from each place, shape (P, C).
        lengths: Of the paths between the places, shape (P, P) [m].
    """

    def __init__(
        self,
        costmap: Costmap,
        reachable: Reachable,
        floor: BoolArray,
        frame: GridFrame,
        segments: FloatArray,
        max_range: float,
        config: CoverageTourConfig | None = None,
    ) -> None:
        self.config = config or CoverageTourConfig()
        self._paths = CoarsePaths(costmap, reachable)
        self._frame = frame
        self._segments = segments
        self._max_range = max_range
        self.places = _lattice(costmap, reachable, self.config.spacing)
        self.cells: IntArray = _thinned(floor, self.config.every)
        self.views: BoolArray = np.vstack(
            [self._in_sight(x, y, floor) for x, y in self.places.tolist()]
        )  # (P, C)
        self._lists = [np.flatnonzero(seen) for seen in self.views]
        self.cell_area = (self.config.every * frame.resolution) ** 2
        self._legs: dict[tuple[int, int], BoolArray] = {}  # what is seen while driving from place to place
        self.coverable: BoolArray = np.asarray(self.views.any(axis=0))
        at = [self._paths.place((x, y)) for x, y in self.places.tolist()]
        self.lengths: FloatArray = np.vstack([self._paths.lengths_from(cell)[at] for cell in at])
        row, col = np.divmod(self.cells, frame.width_px)
        self._centres = np.column_stack(
            [frame.origin_x + (col + 0.5) * frame.resolution, frame.origin_y + (row + 0.5) * frame.resolution]
        )

    def plan(
        self,
        unseen: BoolArray,
        start: Point,
        banned: frozenset[int] = frozenset(),
        previous: Sequence[int] = (),
        from_start: FloatArray | None = None,
    ) -> list[Stop]:
        """A short tour that sees what is left.

        Args:
            unseen: Which of :attr:`cells` are still to be seen, shape (C,).
            start: The robot [m].
            banned: Places that it failed to get to.
            previous: Places of an earlier tour that sees all this. It is improved too, and kept unless another
                is clearly shorter, so that the robot doesn't turn back for a tour that only looks different.
            from_start: Path length from the robot to each place, where the caller knows better than the plan
                which paths are open, shape (P,) [m].

        Returns:
            Stops in their order; each cell belongs to the first stop that sees it.
        """
        wanted = unseen & self.coverable
        spare = (1.0 - self.config.goal) * np.count_nonzero(self.coverable)
        if np.count_nonzero(wanted) <= spare:
            return []
        if from_start is None:
            from_start = self.lengths_from(start)
        usable = np.isfinite(from_start)
        usable[list(banned)] = False
        kept = [place for place in previous if usable[place]]
        fresh = self._cover(wanted, spare, usable)
        best: list[int] = []
        for places, handicap in ((kept, 0.0), (fresh, self.config.clearly)):
            if not places:
                continue
            tour = self._improved(places, wanted, from_start, usable, start)
            missed = np.count_nonzero(wanted & ~self._seen_by(tour, start))
            if places is kept and missed > spare:
                continue
            if not best or self.length(tour, from_start) + handicap < self.length(best, from_start):
                best = tour
        return self._stops(best, wanted)

    def length(self, tour: Sequence[int], from_start: FloatArray) -> float:
        """Length of an open tour over places [m].

        Args:
            tour: Places in their order.
            from_start: Path length from the start to each place, shape (P,) [m].
        """
        legs = sum(float(self.lengths[a, b]) for a, b in itertools.pairwise(tour))
        return float(from_start[tour[0]]) + legs if tour else 0.0

    def _improved(
        self, places: list[int], wanted: BoolArray, from_start: FloatArray, usable: BoolArray, start: Point
    ) -> list[int]:
        """A tour through some places, with these moved and left out where that makes it shorter."""
        tour = self._ordered(places, from_start)
        for _ in range(self.config.sweeps):
            before = list(tour)
            tour = self._moved(tour, wanted, from_start, usable)
            tour = self._ordered(self._without_seen_on_path(tour, wanted, start), from_start)
            if tour == before:
                break
        return tour

    def _seen_by(self, tour: list[int], start: Point) -> BoolArray:
        """Cells that are seen from the stops of a tour or between them, shape (C,)."""
        seen: BoolArray = np.asarray(self.views[tour].any(axis=0)) | self._seen_on_path(tour, start)
        return seen

    def _in_sight(self, x: float, y: float, floor: BoolArray) -> BoolArray:
        """Which cells are in sight all round a place, shape (C,)."""
        ranges = np.empty(_BEAMS)
        step = 2.0 * math.pi / _BEAMS
        segments = self._segments.view()
        segments.flags.writeable = False
        cast_rays(x, y, 0.0, 0.0, step, segments, self._max_range, ranges)
        unseen = floor.copy()
        directions = unit_vectors(step * np.arange(_BEAMS, dtype=np.float64))
        frame = self._frame
        grid = frame.origin_x, frame.origin_y, frame.resolution
        sweep(unseen, *grid, x, y, 0.0, directions, ranges, self._max_range)
        seen: BoolArray = ~unseen.reshape(-1)[self.cells]
        return seen

    def _cover(self, wanted: BoolArray, spare: float, usable: BoolArray) -> list[int]:
        """Greedy set cover: always the place that sees most of what no other sees yet."""
        left = np.flatnonzero(wanted)
        seen = self.views[:, left] & usable[:, None]
        counts = seen.sum(axis=1)
        chosen: list[int] = []
        open_cells = np.ones(len(left), dtype=np.bool_)
        while np.count_nonzero(open_cells) > spare and counts.max(initial=0) > 0:
            best = int(np.argmax(counts))
            chosen.append(best)
            fresh = open_cells & seen[best]
            counts = counts - seen[:, fresh].sum(axis=1)
            open_cells &= ~fresh
        return chosen

    def _ordered(self, places: list[int], from_start: FloatArray) -> list[int]:
        """The places in the order of a short open tour."""
        n = len(places)
        lengths = np.zeros((n + 1, n + 1))
        lengths[1:, 1:] = self.lengths[np.ix_(places, places)]
        lengths[0, 1:] = lengths[1:, 0] = from_start[places]
        return [places[i - 1] for i in open_tour(lengths)]

    def _moved(
        self, tour: list[int], wanted: BoolArray, from_start: FloatArray, usable: BoolArray
    ) -> list[int]:
        """Move each place to where it sees all that only it sees and costs the smallest detour."""
        tour = list(tour)
        times = self.views[tour].sum(axis=0, dtype=np.int32)
        for i, place in enumerate(tour):
            own = np.flatnonzero(wanted & self.views[place] & (times == 1))
            able = usable & self.views[:, own].all(axis=1)
            before = from_start if i == 0 else self.lengths[tour[i - 1]]
            detour = before + (self.lengths[tour[i + 1]] if i + 1 < len(tour) else 0.0)
            best = int(np.argmin(np.where(able, detour, np.inf)))
            if detour[best] < detour[place] - 1e-6:
                times += self.views[best].astype(np.int32) - self.views[place].astype(np.int32)
                tour[i] = best
        return list(dict.fromkeys(tour))

    def _without_seen_on_path(self, tour: list[int], wanted: BoolArray, start: Point) -> list[int]:
        """Leave out places whose part is seen from the other places or ahead on the path between them."""
        tour = list(tour)
        for place in sorted(tour, key=lambda p: int((wanted & self.views[p]).sum())):
            rest = [other for other in tour if other != place]
            if not rest:
                break
            lost = wanted & self.views[place] & ~self.views[rest].any(axis=0)
            if lost.any():
                lost &= ~self._seen_on_path(rest, start)
            if not lost.any():
                tour = rest
        return tour

    def _seen_on_path(self, tour: list[int], start: Point) -> BoolArray:
        """Cells that lie ahead of the robot, in sight, somewhere on the tour, shape (C,)."""
        seen = self.seen_on_leg(start, tour[0])
        for here, there in itertools.pairwise(tour):
            seen = seen | self.seen_between(here, there)
        return seen

    def seen_between(self, here: int, there: int) -> BoolArray:
        """Cells that are seen ahead on the path from one place to another, shape (C,)."""
        if (here, there) not in self._legs:
            x, y = self.places[here]
            self._legs[here, there] = self.seen_on_leg((float(x), float(y)), there)
        return self._legs[here, there]

    def lengths_from(self, start: Point) -> FloatArray:
        """Path length from a point to each place, shape (P,) [m]."""
        return self._paths.lengths_to(self._paths.lengths_from(self._paths.place(start)), self.places)

    def seen_on_leg(self, start: Point, place: int) -> BoolArray:
        """Cells that are seen ahead on the path from a point to a place, shape (C,)."""
        x, y = self.places[place]
        path = self._paths.path(start, (float(x), float(y)))
        seen = np.zeros(self.views.shape[1], dtype=np.bool_)
        stride = max(1, round(_APART / self._paths.cell))
        for i in range(stride, len(path), stride):
            ahead = path[i] - path[i - stride]
            nearest = int(np.argmin(((self.places - path[i]) ** 2).sum(axis=1)))
            cells = self._lists[nearest]
            x, y = (self._centres[cells] - path[i]).T
            seen[cells[x * ahead[0] + y * ahead[1] > 0.0]] = True
        return seen

    def _stops(self, tour: list[int], wanted: BoolArray) -> list[Stop]:
        """The stops with what each is there for."""
        left = wanted.copy()
        stops = []
        for place in tour:
            mine = left & self.views[place]
            left &= ~mine
            x, y = self.places[place]
            stops.append(Stop(place, (float(x), float(y)), np.flatnonzero(mine)))
        return stops


def _thinned(floor: BoolArray, every: int) -> IntArray:
    """Every n-th cell of the floor in both directions, flat indices."""
    kept = np.zeros_like(floor)
    kept[::every, ::every] = floor[::every, ::every]
    return np.flatnonzero(kept)


def _lattice(costmap: Costmap, reachable: Reachable, spacing: float) -> FloatArray:
    """Places where the robot's centre can be, one in each square of a lattice, shape (P, 2) [m].

    Of each square the cell farthest from walls is taken, so that doorways, which a lattice of points would
    miss, have theirs.
    """
    width = costmap.costs.shape[1]
    order = reachable.order[: reachable.num_centre]
    rows, cols = np.divmod(order, width)
    size = max(1, round(spacing / costmap.frame.resolution))
    square = (rows // size) * (width // size + 1) + cols // size
    clearance = costmap.distance[rows, cols]
    best = np.lexsort((-clearance, square))
    _, first = np.unique(square[best], return_index=True)
    kept = best[first]
    return np.column_stack(costmap.frame.to_point(rows[kept], cols[kept]))
