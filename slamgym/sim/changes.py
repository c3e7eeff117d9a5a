"""Chairs that are moved and doors that swing while the robot drives."""

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
        self._rows = rows[len(rows) - sum(len(places[0]) for places in self._places) :]
        ends = np.cumsum([len(places[0]) for places in self._places])
        self._slices = [
            slice(int(end) - len(places[0]), int(end)) for end, places in zip(ends, self._places, strict=True)
        ]
        self.reset()

    def reset(self) -> None:
        """Back to the start, to change in the same way again."""
        self._rng = np.random.default_rng(self._clutter.seed)
        self._now = [0] * len(self._places)
        for index in range(len(self._places)):
            self._put(index, 0)

    def furniture(self) -> tuple[FloatArray, ...]:
        """What stands on the floor now: corners of each solid, shape (K, 2) [m]."""
        if not self.movables:
            return self._clutter.solids()
        moved = zip(self.movables, self._now, strict=True)
        return (*self._clutter.furniture, *(solid for places, now in moved for solid in places[now]))

    def advance(self, span: float, discs: FloatArray) -> bool:
        """Let time pass, in which something may be moved, but nothing that would come near to somebody.

        Args:
            span: Duration [s].
            discs: Robot and people with the room they need, shape (D, 3) as x, y, radius [m].

        Returns:
            Whether anything was moved.
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
        """Whether nobody is on the way of a piece: in the box about its old and its new place."""
        points = np.vstack([self._rows[self._slices[index]], self._places[index][place]]).reshape(-1, 2)
        low, high = points.min(axis=0), points.max(axis=0)
        gap = discs[:, :2] - np.clip(discs[:, :2], low, high)
        return bool((np.hypot(*gap.T) > discs[:, 2]).all())

    def _put(self, index: int, place: int) -> None:
        self._now[index] = place
        self._rows[self._slices[index]] = self._places[index][place]
