"""Cells: the rooms of a plan before its walls have a thickness.

A layout tiles the building with polygons whose edges are the middle lines of walls. All coordinates are whole
centimetres, so that shared edges are exactly equal and unions need no tolerance.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Polygon

GRID = 0.01
"""All corners lie on this grid [m], as HouseExpo's do."""


class Box(NamedTuple):
    """An axis-parallel rectangle [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def width(self) -> float:
        """Along x [m]."""
        return self.x1 - self.x0

    @property
    def height(self) -> float:
        """Along y [m]."""
        return self.y1 - self.y0

    @property
    def area(self) -> float:
        """[m2]."""
        return self.width * self.height

    @property
    def aspect(self) -> float:
        """Longer side over shorter side."""
        shorter, longer = sorted((self.width, self.height))
        return longer / max(shorter, GRID)

    def polygon(self) -> Polygon:
        """The same rectangle for shapely."""
        return shapely.box(*self)

    def cut(self, share: float, along_x: bool) -> tuple["Box", "Box"]:
        """Two boxes; the first gets ``share`` of the area and lies left, or below."""
        if along_x:
            x = snap(self.x0 + share * self.width)
            return self._replace(x1=x), self._replace(x0=x)
        y = snap(self.y0 + share * self.height)
        return self._replace(y1=y), self._replace(y0=y)


@dataclass(frozen=True)
class Space:
    """A room that a building should have."""

    category: str
    area: float  # [m2], wanted


@dataclass(frozen=True)
class Cell:
    """A room in its place, up to the middle of its walls."""

    category: str
    polygon: Polygon

    @staticmethod
    def of_box(category: str, box: Box) -> "Cell":
        """A rectangular room."""
        return Cell(category, box.polygon())


def total_area(spaces: Sequence[Space]) -> float:
    """Wanted area of some rooms [m2]."""
    return sum(space.area for space in spaces)


class Wall(NamedTuple):
    """A straight piece of a cell's wall: its middle line, axis-parallel."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def length(self) -> float:
        """[m]."""
        return abs(self.x1 - self.x0) + abs(self.y1 - self.y0)

    def point(self, distance: float) -> tuple[float, float]:
        """The point at a distance [m] from the start."""
        share = distance / self.length
        x = self.x0 + share * (self.x1 - self.x0)
        y = self.y0 + share * (self.y1 - self.y0)
        return snap(x), snap(y)

    def opening(self, start: float, stop: float, thickness: float) -> Box:
        """The piece of the wall between two distances from its start [m], as thick as the wall."""
        ends = sorted((self.point(start), self.point(stop)))
        (x0, y0), (x1, y1) = ends
        half = 0.5 * thickness
        if y0 == y1:
            below = snap(y0 - half)
            above = snap(y0 + half)
            return Box(x0, below, x1, above)
        left = snap(x0 - half)
        right = snap(x0 + half)
        return Box(left, y0, right, y1)


def snap(value: float) -> float:
    """The nearest whole centimetre [m]."""
    return round(float(value), 2)


def cut_out(polygon: Polygon, box: Box) -> Polygon:
    """Cut a box out of a cell, at its corner or in its middle."""
    rest = polygon.difference(box.polygon())
    assert isinstance(rest, Polygon)
    return rest


def shared_walls(a: Polygon, b: Polygon) -> list[Wall]:
    """The straight pieces of boundary that two cells share, the longest first."""
    common = shapely.line_merge(a.boundary.intersection(b.boundary))
    walls = []
    for line in shapely.get_parts(common):
        if line.geom_type != "LineString":
            continue
        points = np.round(shapely.get_coordinates(line.simplify(0.0)), 2)
        for (x0, y0), (x1, y1) in itertools.pairwise(points):
            if x0 == x1 or y0 == y1:
                walls.append(Wall(float(x0), float(y0), float(x1), float(y1)))
    return sorted(walls, key=lambda wall: -wall.length)


def subdivide(box: Box, spaces: Sequence[Space], rng: np.random.Generator) -> list[Cell]:
    """Fill a box with rooms in proportion to their wanted areas.

    The list is cut in two where that gives the best-shaped halves, and so on down to single rooms. Rooms that
    are neighbours in the list become neighbours in the plan.
    """
    if len(spaces) == 1:
        return [Cell.of_box(spaces[0].category, box)]
    total = total_area(spaces)
    options: list[_Cut] = []
    share = 0.0
    for index in range(1, len(spaces)):
        share += spaces[index - 1].area / total
        for along_x in (True, False):
            first, second = box.cut(share, along_x)
            badness = _awkwardness([(first, index), (second, len(spaces) - index)])
            options.append(_Cut(badness * rng.uniform(1.0, 1.3), index, first, second))
    best = min(options, key=lambda option: option.badness)
    first_cells = subdivide(best.first, spaces[: best.split], rng)
    return first_cells + subdivide(best.second, spaces[best.split :], rng)


class _Cut(NamedTuple):
    """A box in two parts: the first so many of the rooms go into the first."""

    badness: float
    split: int
    first: Box
    second: Box


def _awkwardness(parts: Sequence[tuple[Box, int]]) -> float:
    """Badness of boxes for so many rooms each: long thin ones, and those narrower than 1.3 m, are bad."""
    badness = 0.0
    for box, rooms in parts:
        # Several rooms can share a long box, so only its shape per room matters.
        badness += max(box.aspect / (1.0 + 0.4 * (rooms - 1)), 1.0)
        badness += 20.0 * max(0.0, 1.3 - min(box.width, box.height))
    return badness
