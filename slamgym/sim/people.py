"""People who walk from place to place, keep off walls and furniture, and stop for robots."""

import math
from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import unit_vectors
from slamgym.core.types import BoolArray, FloatArray
from slamgym.sim.passages import PASSAGE_CELL

PERSON_RADIUS = 0.25
"""A standing or walking person seen from above [m]: half the shoulder width of 0.46 m and some clothes."""

_LEG_RADIUS = 0.06
"""Radius of a leg near the floor, where a scanner sees it [m]."""
_LEG_APART = 0.1
"""Distance of a leg from the middle of the body to the side [m]: half the width of the hips."""
_LEG_SWING = 0.14
"""A leg swings so far to the front and to the back [m]."""
_STRIDE = 1.4
"""Distance that a person walks in a full swing of a leg [m]."""
_LEG_CORNERS = 6
"""Number of corners of a leg."""

# People keep this much more than touching distance from the robot and from each other [m].
_POLITE_DISTANCE = 0.1

# Walking is simulated in pieces of this duration [s]: 12 cm at a brisk pace.
_STEP_TIME = 0.1

# A person who had to wait this long goes elsewhere [s].
_PATIENCE = 1.5

# Directions tried for a new path, and the longest straight path [m].
_TRIES = 16
_LONGEST_PATH = 8.0


@dataclass(frozen=True)
class Person:
    """A person who walks about."""

    start: tuple[float, float]  # [m], world frame
    speed: float  # [m/s]
    seed: int  # of the paths that the person chooses


@dataclass(frozen=True)
class Walkable:
    """Where the middle of a person may be: cells of the raster of :mod:`slamgym.sim.passages`."""

    cells: BoolArray  # row 0 at the bottom
    origin: tuple[float, float]  # lower left corner [m]

    def covers(self, here: FloatArray, there: FloatArray) -> bool:
        """True if a straight path stays on it; points (x, y) [m]."""
        way = there - here
        number = 2 + int(np.hypot(*way) / (0.5 * PASSAGE_CELL))
        points = here + np.linspace(0.0, 1.0, number)[:, None] * way
        cells = np.floor((points - self.origin) / PASSAGE_CELL)
        cols, rows = cells.astype(np.int64).T
        height, width = self.cells.shape
        if rows.min() < 0 or rows.max() >= height:
            return False
        if cols.min() < 0 or cols.max() >= width:
            return False
        return bool(self.cells[rows, cols].all())


class Crowd:
    """The people of a world while they walk.

    Args:
        people: Who they are.
        walkable: Where the middle of a person may be.
    """

    def __init__(self, people: tuple[Person, ...], walkable: Walkable) -> None:
        self._people = people
        self._walkable = walkable
        self.discs = np.empty((len(people), 3))
        """Discs that can be touched, shape (P, 3) as x, y, radius [m]."""
        self.reset()

    def reset(self) -> None:
        """Back to the start, to walk the same paths again."""
        number = len(self._people)
        self._rngs = [np.random.default_rng(person.seed) for person in self._people]
        for disc, person in zip(self.discs, self._people, strict=True):
            disc[:2] = person.start
        self.discs[:, 2] = PERSON_RADIUS
        self._targets = self.discs[:, :2].copy()
        self._headings = [float(rng.uniform(-math.pi, math.pi)) for rng in self._rngs]
        self._walked = [0.0] * number
        self._waited = [0.0] * number

    def advance(self, span: float, robots: FloatArray) -> None:
        """Let everybody walk for a time while robots stand, shape (R, 3) as x, y, radius [m]."""
        pieces = max(1, math.ceil(span / _STEP_TIME))
        standing = robots.tolist()
        for _ in range(pieces):
            for index in range(len(self._people)):
                self._walk(index, span / pieces, standing)

    def legs(self) -> FloatArray:
        """Segments that the LIDAR sees, shape (P * 2 * _LEG_CORNERS, 4) as x0, y0, x1, y1 [m]."""
        numbers = np.arange(_LEG_CORNERS + 1, dtype=np.float64)
        angles = numbers * (2.0 * math.pi / _LEG_CORNERS)
        ring = _LEG_RADIUS * unit_vectors(angles)
        outlines = []
        for index, heading in enumerate(self._headings):
            swing = _LEG_SWING * math.sin(2.0 * math.pi * self._walked[index] / _STRIDE)
            cos = math.cos(heading)
            sin = math.sin(heading)
            for side in (-1.0, 1.0):
                ahead = side * swing
                left = side * _LEG_APART
                from_person = (ahead * cos - left * sin, ahead * sin + left * cos)
                corners = ring + (self.discs[index, :2] + from_person)
                outlines.append(np.hstack([corners[:-1], corners[1:]]))
        return np.vstack(outlines) if outlines else np.empty((0, 4))

    def _walk(self, index: int, span: float, robots: list[list[float]]) -> None:
        """Move one person, unless that would come too near to a robot or to somebody else."""
        x, y = self.discs[index, :2].tolist()
        dx, dy = (self._targets[index] - (x, y)).tolist()
        left = math.hypot(dx, dy)
        distance = self._people[index].speed * span
        if left < 1e-6 or self._waited[index] > _PATIENCE:
            self._choose_path(index)
            return
        share = min(1.0, distance / left)
        there = x + share * dx, y + share * dy
        self._headings[index] = math.atan2(dy, dx)
        if self._is_free(index, (x, y), there, robots):
            self.discs[index, :2] = there
            self._walked[index] += share * left
            self._waited[index] = 0.0
        else:
            self._waited[index] += span

    def _is_free(
        self,
        index: int,
        here: tuple[float, float],
        there: tuple[float, float],
        robots: list[list[float]],
    ) -> bool:
        """True if no one is too near to a place; stepping back from someone near is always free."""
        discs = self.discs.tolist()
        del discs[index]
        for x, y, radius in (*robots, *discs):
            distance = math.hypot(x - there[0], y - there[1])
            polite = radius + PERSON_RADIUS + _POLITE_DISTANCE
            if distance < polite and distance < math.hypot(x - here[0], y - here[1]):
                return False
        return True

    def _choose_path(self, index: int) -> None:
        """Pick somewhere to go in a straight line, the furthest of some free directions."""
        self._waited[index] = 0.0
        rng = self._rngs[index]
        here = self.discs[index, :2]
        best = 0.0
        angles = rng.uniform(-math.pi, math.pi, _TRIES)
        distances = rng.uniform(0.5, _LONGEST_PATH, _TRIES)
        for angle, distance in zip(angles, distances, strict=True):
            there = here + distance * np.array([math.cos(angle), math.sin(angle)])
            if distance > best and self._walkable.covers(here, there):
                best = distance
                self._targets[index] = there
