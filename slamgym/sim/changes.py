"""What changes in a building while the robot drives: chairs are moved, doors' leaves swing."""

import numpy as np

from slamgym.core.types import FloatArray
from slamgym.sim.clutter import Clutter, outlines_of


class Changes:
    """The movables of a world, and where each stands now.

    Args:
        clutter: What there is.
        rows: The world's segments of the clutter, as :meth:`Clutter.segments` gives them; changed in place.
    """

    def __init__(self, clutter: Clutter, rows: FloatArray) -> None:
        self._clutter = clutter
        self.movables = clutter.movables if clutter.changes else ()
        self._places = [[outlines_of(solids) for solids in places] for places in self.movables]
        sizes = [len(places[0]) for places in self._places]
        self._rows = rows[len(rows) - sum(sizes) :]
        self._slices = []
        first = 0
        for size in sizes:
            self._slices.append(slice(first, first + size))
            first += size
        self.reset()

    def reset(self) -> None:
        """Back to the start, to change in the same way again."""
        self._rng = np.random.default_rng(self._clutter.seed)
        self._now = [0] * len(self._places)
        for index in range(len(self._places)):
            self._put(index, 0)

    def furniture(self) -> tuple[FloatArray, ...]:
        """Solids that stand on the floor now: corners of each solid, shape (K, 2) [m]."""
        if not self.movables:
            return self._clutter.solids()
        standing = list(self._clutter.furniture)
        for places, now in zip(self.movables, self._now, strict=True):
            standing += places[now]
        return tuple(standing)

    def advance(self, span: float, discs: FloatArray) -> bool:
        """Let time pass, in which something may be moved, but nothing that would come near to somebody.

        Args:
            span: Duration [s].
            discs: Robot and people with the room they need, shape (D, 3) as x, y, radius [m].

        Returns:
            True if anything was moved.
        """
        if not self.movables:
            return False
        moved = False
        for _ in range(int(self._rng.poisson(self._clutter.changes * span))):
            index = int(self._rng.integers(len(self._places)))
            place = int(self._rng.integers(len(self._places[index])))
            if place != self._now[index] and self._is_away(index, place, discs):
                self._put(index, place)
                moved = True
        return moved

    def _is_away(self, index: int, place: int, discs: FloatArray) -> bool:
        """True if no person is on the way of a piece: in the box about its old and its new place."""
        old = self._rows[self._slices[index]]
        new = self._places[index][place]
        points = np.vstack([old, new]).reshape(-1, 2)
        middles = discs[:, :2]
        radii = discs[:, 2]
        nearest = np.clip(middles, points.min(axis=0), points.max(axis=0))
        apart = middles - nearest
        distances = np.hypot(apart[:, 0], apart[:, 1])
        return bool((distances > radii).all())

    def _put(self, index: int, place: int) -> None:
        self._now[index] = place
        self._rows[self._slices[index]] = self._places[index][place]
