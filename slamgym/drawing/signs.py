"""What lies around a line across the floor: the signs by which boundaries between rooms are told from other lines.

They say how wide a line is, what both sides of it reach by a short walk and how much of that another way joins, whether
the watershed of the free space cuts there, how the clearance goes across it, and where walls continue it. None changes
when a map is mirrored or turned by a quarter, or a line's ends are exchanged: the lesser of two values comes first.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from slamgym.core.types import OCCUPIED, BoolArray, FloatArray, GridFrame, IntArray, OccupancyGrid
from slamgym.drawing.evidence import values_at
from slamgym.drawing.flood import REACHES, limited_flood
from slamgym.drawing.settings import USUAL_CELL
from slamgym.metrics.cleaning import fill_furniture
from slamgym.metrics.layers import DOOR_DEPTH, MapLayers
from slamgym.metrics.maps import distance_to
from slamgym.metrics.rooms import MAX_NARROWING, NARROWEST_ROOM, WIDEST_DOORWAY, Landscape

Signs = dict[str, FloatArray]
"""Values of N lines, (N,), by the names of the signs."""

PLAIN_WATERSHED = (1.1, 1.0, 1.1)
"""Rooms are what is farther than 0.55 m from everything, and what flows there; cf.
:func:`~slamgym.metrics.rooms.label_rooms`."""
DOORWAY_RULE = (WIDEST_DOORWAY, MAX_NARROWING, NARROWEST_ROOM)
"""Rooms that only doorways join."""
LONE_THINGS = 0.4
"""The watersheds are also asked without things of at most this size [m]. Without it the average precision on maps of
left out buildings falls from 0.912 to 0.909."""
ALONG = np.linspace(0.05, 0.95, 13)
"""Places on a line, as shares of its length."""
CLEARANCES_AT = (0.2, 0.4, 0.6, 1.0)
"""Distances to both sides of a line's middle at which the clearance is taken [m]."""
BASINS_AT = (0.3, 0.6)
"""The same at which two basins of a watershed are two rooms [m]."""
BEYOND = ((0.0, 0.3), (0.3, 0.8), (0.8, 1.5))
"""Stretches behind a line's ends in which its wall is looked for [m]."""
ASIDE = (0.05 * np.arange(-5, 6)).astype(np.float64)
"""A wall may lie so far beside the line that it continues [m]."""
DOOR_SIGNS = ("door, least", "door, mean")
"""Those that a network gives."""


@dataclass(frozen=True)
class Surroundings:
    """A map in which lines are looked at, of cells of about :data:`~slamgym.drawing.settings.USUAL_CELL`."""

    frame: GridFrame
    free: BoolArray
    clearance: FloatArray
    """Distance to what isn't free [m]."""
    to_echo: FloatArray
    """Distance to the nearest occupied cell [m]."""
    basins: tuple[IntArray, ...]
    """Rooms by several watersheds."""
    angle_deg: float
    """Direction of the main walls against the x axis."""

    @staticmethod
    def of(grid: OccupancyGrid, seen: BoolArray, angle_deg: float) -> "Surroundings":
        """Prepare a map.

        Args:
            grid: The map.
            seen: Its free cells that count.
            angle_deg: Direction of the main walls.
        """
        factor = max(1, math.floor(USUAL_CELL / grid.frame.resolution + 1e-6))
        cell = factor * grid.frame.resolution
        free = _shares(seen, factor) > 0.6
        occupied = _shares(grid.cells == OCCUPIED, factor) > 0.0
        rows, cols = free.shape
        lower = rows * cell - grid.frame.height_px * grid.frame.resolution
        frame = GridFrame(cell, grid.frame.origin_x, grid.frame.origin_y - lower, rows, cols)
        filled = fill_furniture(free, LONE_THINGS / cell)
        spaces = [Landscape.of(space, cell) for space in (free, filled)]
        basins = [
            space.rooms(*rule) for space in spaces for rule in (PLAIN_WATERSHED, DOORWAY_RULE)
        ]
        to_echo = cell * distance_to(occupied)
        return Surroundings(frame, free, spaces[0].clearance, to_echo, tuple(basins), angle_deg)

    def at(self, picture: np.ndarray, places: FloatArray, beyond: float = 0.0) -> FloatArray:
        """Values of one of the pictures under places (..., 2) [m]."""
        return np.asarray(values_at(picture, self.frame, places, beyond), np.float64)


def _shares(cells: BoolArray, factor: int) -> FloatArray:
    """Share of cells in squares of so many; there are none beyond the picture."""
    rows, cols = cells.shape
    padded = np.pad(cells, ((0, -rows % factor), (0, -cols % factor)))
    blocks = padded.reshape(len(padded) // factor, factor, -1, factor)
    return np.asarray(blocks.mean(axis=(1, 3)))


class _Lines(NamedTuple):
    """Lines across the floor, and their directions."""

    ends: FloatArray  # (N, 2, 2) [m]
    width: FloatArray  # (N,) [m]
    along: FloatArray  # (N, 2) from the first end to the second, unit length
    aside: FloatArray  # (N, 2) at right angles to it

    @property
    def on(self) -> FloatArray:
        """Places on them, (N, P, 2)."""
        way = self.ends[:, 1:] - self.ends[:, :1]
        return self.ends[:, :1] + ALONG[:, None] * way

    def beside(self, distance: float) -> FloatArray:
        """Places to both sides of their middles, (2, N, 2)."""
        middle = self.ends.mean(axis=1)
        return np.stack([middle + distance * self.aside, middle - distance * self.aside])

    def beyond(self, stretch: tuple[float, float], aside: FloatArray) -> FloatArray:
        """Places behind their ends and beside them, (2, N, places, asides, 2)."""
        steps = np.arange(stretch[0] + 0.5 * USUAL_CELL, stretch[1], USUAL_CELL)[:, None, None]
        outward = np.stack([-self.along, self.along])[:, :, None, None]
        ends = self.ends.swapaxes(0, 1)[:, :, None, None]
        return ends + steps * outward + aside[:, None] * self.aside[:, None, None]


def boundary_signs(ends: FloatArray, around: Surroundings) -> Signs:
    """The signs of lines by what a map shows around them.

    Args:
        ends: Of the lines, (N, 2, 2) [m].
        around: The map.
    """
    way = ends[:, 1] - ends[:, 0]
    width = np.hypot(way[:, 0], way[:, 1])
    along = way / width[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    lines = _Lines(ends, width, along, aside)
    clear = around.at(around.clearance, lines.on)
    neck = np.maximum(clear.max(axis=1), 0.1)
    turn = np.arctan2(along[:, 1], along[:, 0]) - math.radians(around.angle_deg)
    signs = {
        "width": np.log(width),
        "wider than 1 m": np.maximum(np.log(width), 0.0),
        "narrower than 0.7 m": np.maximum(np.log(0.7 / width), 0.0),
        "oblique": np.abs(np.sin(2.0 * turn)),
        "free": (clear > 0.0).mean(axis=1),
        "echoes": (around.at(around.to_echo, lines.on[:, 2:-2], math.inf) <= 0.0).mean(axis=1),
        "neck": np.log(2.0 * neck / width),
    }
    return signs | _reached(lines, neck, around) | _basins(lines, around) | _walls(lines, around)


def _reached(lines: _Lines, neck: FloatArray, around: Surroundings) -> Signs:
    """What both sides reach by a short walk while a line is closed, and how the clearance goes across it."""
    signs: Signs = {}
    flood = limited_flood(lines.ends, around.free, around.clearance, around.frame)
    for number, reach in enumerate(REACHES):
        area = flood.area[:, :, number]
        widest = np.maximum(flood.widest[:, :, number], 0.05) / neck[:, None]
        signs |= _both(f"area within {reach} m", np.log(area + 0.1).T)
        signs |= _both(f"widest within {reach} m", np.log(widest).T)
        shared = flood.shared[:, number]
        signs[f"shared within {reach} m"] = shared / np.maximum(area.min(axis=1), 0.1)
    for distance in CLEARANCES_AT:
        clear = around.at(around.clearance, lines.beside(distance))
        signs |= _both(f"clearance at {distance} m", np.minimum(clear, 1.5))
    return signs


def _basins(lines: _Lines, around: Surroundings) -> Signs:
    """Whether the two sides lie in two rooms of a watershed."""
    signs: Signs = {}
    for number, basin in enumerate(around.basins):
        for distance in BASINS_AT:
            one, other = around.at(basin, lines.beside(distance))
            are_two = (one != other) & (np.minimum(one, other) > 0.0)
            signs[f"watershed {number} at {distance} m"] = are_two.astype(np.float64)
    return signs


def _walls(lines: _Lines, around: Surroundings) -> Signs:
    """Whether walls go on behind the ends: the best row of echoes nearby, and what isn't free."""
    signs: Signs = {}
    for stretch in BEYOND:
        rows = around.at(around.to_echo, lines.beyond(stretch, ASIDE), math.inf) <= USUAL_CELL
        solid = around.at(around.free, lines.beyond(stretch, np.zeros(1))) <= 0.0
        name = f"from {stretch[0]} to {stretch[1]} m"
        signs |= _both(f"wall {name}", rows.mean(axis=2).max(axis=2))
        signs |= _both(f"solid {name}", solid.mean(axis=(2, 3)))
    return signs


def _both(name: str, sides: FloatArray) -> Signs:
    """The values (2, N) of two sides, the lesser first."""
    return {f"{name}, less": sides.min(axis=0), f"{name}, more": sides.max(axis=0)}


def door_signs(ends: FloatArray, layers: MapLayers, frame: GridFrame) -> Signs:
    """The log odds that a network gives doors along lines (N, 2, 2) [m], the least and the mean.

    What was seen free is free whatever the network says of it, so the probability of a door is that among free cells.
    """
    among_free = layers.door / np.maximum(layers.free, 0.1)
    side = 2 * round(DOOR_DEPTH / frame.resolution) + 1
    around = cv2.dilate(among_free.astype(np.float32), np.ones((side, side), np.uint8))
    way = ends[:, 1:] - ends[:, :1]
    on_line = values_at(around, frame, ends[:, :1] + ALONG[:, None] * way, 0.0)
    return dict(
        zip(
            DOOR_SIGNS,
            (_log_odds(on_line.min(axis=1)), _log_odds(on_line.mean(axis=1))),
            strict=True,
        )
    )


def _log_odds(share: FloatArray) -> FloatArray:
    """Log odds of shares in [0, 1], which stay finite."""
    return np.asarray(np.log((share + 0.01) / (1.01 - share)))
