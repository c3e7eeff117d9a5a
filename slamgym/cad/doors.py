"""Openings: those that join the rooms of a layout, and those that the walls of a finished plan show."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.cells import Box, Cell, Wall, shared_walls, snap
from slamgym.cad.floorplan import Door
from slamgym.cad.polygons import oriented_rings
from slamgym.core.types import BoolArray, FloatArray

_HUBS = {"Living_Room", "Dining_Room", "Hall", "Hallway", "Lobby", "Entryway"}
_SERVICE = {"Bathroom", "Toilet", "Storage", "Wardrobe", "Garage", "Boiler_room", "Balcony"}
_OPEN_PLAN = {
    "Living_Room",
    "Dining_Room",
    "Kitchen",
    "Hall",
    "Hallway",
    "Lobby",
    "Room",
    "Office",
    "Gym",
}

_CLOSED = {"Bathroom", "Toilet"}

MAX_SPARE = 3
"""Most openings that make loops in a plan."""
MIN_NIB = 0.06
"""Wall left next to a door [m], measured from the face of the wall that crosses there."""
DOOR_WIDTHS = (0.7, 0.75, 0.8, 0.9, 1.0, 1.05, 1.1, 1.2)
"""Clear widths of doors [m]. HouseExpo's openings peak at 0.7-0.8 and 0.95-1.05 m."""
_DOOR_SHARES = (0.08, 0.26, 0.1, 0.14, 0.22, 0.06, 0.06, 0.08)
"""Shares of the doors of these widths."""
_PENALTIES = (0.0, 2.0, 8.0)
"""Cost of a door between rooms of which none, one or both are baths, closets and the like."""
WIDE_OPENING = (1.2, 2.4)
"""Clear width of an opening without a door [m]."""

SIMPLIFY = 0.03
"""Tolerance [m] that removes the 1 cm staircases in which HouseExpo stores curved and oblique walls."""
JAMB_LENGTH = (0.05, 0.35)
"""Length of the end face of a wall [m]."""
OPENING_WIDTH = (0.5, 2.5)
"""Width of a door or a wider opening [m]."""


@dataclass(frozen=True)
class Opening:
    """A hole in the wall between two cells."""

    box: Box  # as thick as the wall
    door: Door | None  # None where the whole wall is left out
    cells: tuple[int, int]


@dataclass(frozen=True)
class _Neighbours:
    """Two cells that share enough wall for a door."""

    cells: tuple[int, int]
    wall: Wall
    cost: float


def join_rooms(
    cells: Sequence[Cell],
    thickness: float,
    rng: np.random.Generator,
    open_plan: float,
    loops: float,
) -> list[Opening] | None:
    """Join all rooms by a tree of openings, and some by one more so that there are loops.

    The tree prefers doors to halls and living rooms, then to bedrooms and offices; no one walks through a
    bath to get to a kitchen if there is another path.

    Args:
        cells: The layout.
        thickness: Of the walls [m].
        rng: Source of all draws.
        open_plan: Probability that a wall between two living areas is left out.
        loops: Probability that there are one to three openings that the tree doesn't need.

    Returns:
        The openings, or None if some room has no wall that a door fits into.
    """
    pairs = _neighbours(cells, thickness, rng)
    tree = _tree(len(cells), pairs)
    if len(tree) < len(cells) - 1:
        return None
    needed = [pair for pair in pairs if pair.cells in tree]
    joined = [_open(cells, pair, thickness, rng, open_plan) for pair in needed]
    others = [pair for pair in pairs if pair.cells not in tree]
    spare = [pair for pair in others if not _uses(cells, pair) & _SERVICE]
    if spare and rng.random() < loops:
        number = min(len(spare), int(rng.integers(1, 1 + MAX_SPARE)))
        chosen = rng.choice(len(spare), size=number, replace=False)
        extra = [spare[index] for index in chosen.tolist()]
        joined += [_open(cells, pair, thickness, rng, 0.3 * open_plan) for pair in extra]
    return joined


def _uses(cells: Sequence[Cell], pair: _Neighbours) -> set[str]:
    return {cells[index].category for index in pair.cells}


def _neighbours(
    cells: Sequence[Cell], thickness: float, rng: np.random.Generator
) -> list[_Neighbours]:
    needed = min(DOOR_WIDTHS) + thickness + 2 * MIN_NIB
    pairs = []
    for first, second in itertools.combinations(range(len(cells)), 2):
        one = cells[first]
        other = cells[second]
        if not one.polygon.intersects(other.polygon):
            continue
        shared = shared_walls(one.polygon, other.polygon)
        walls = [wall for wall in shared if wall.length >= needed]
        if not walls:
            continue
        # The longest wall is preferred, but not always taken.
        wall = walls[0]
        if len(walls) > 1 and rng.random() >= 0.6:
            wall = walls[int(rng.integers(len(walls)))]
        cost = _cost(one.category, other.category) + float(rng.uniform(0.0, 0.9))
        pairs.append(_Neighbours((first, second), wall, cost))
    return pairs


def _cost(a: str, b: str) -> float:
    """Cost of a door between two kinds of rooms: the unlikelier, the higher."""
    services = (a in _SERVICE) + (b in _SERVICE)
    hubs = (a in _HUBS) + (b in _HUBS)
    cost = 2.0 + _PENALTIES[services]
    if hubs:
        cost -= 1.5
    if hubs == 2:
        cost -= 0.3
    return cost


def _tree(count: int, pairs: Sequence[_Neighbours]) -> set[tuple[int, int]]:
    """The cheapest set of pairs that joins everything."""
    # Imported here, because only the generator needs scipy and it takes 0.2 s.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    ends = np.array([pair.cells for pair in pairs], np.int32)
    rows, cols = ends.reshape(-1, 2).T
    costs = [pair.cost for pair in pairs]
    graph = coo_array((costs, (rows, cols)), shape=(count, count))
    tree = minimum_spanning_tree(graph.tocsr()).tocoo()
    return set(zip(tree.row.tolist(), tree.col.tolist(), strict=True))


def _open(
    cells: Sequence[Cell],
    pair: _Neighbours,
    thickness: float,
    rng: np.random.Generator,
    open_plan: float,
) -> Opening:
    """Put an opening into a wall: none of the wall left, a wide opening, or a door."""
    categories = _uses(cells, pair)
    usable = pair.wall.length - thickness  # between the faces of the walls that cross at its ends
    start = 0.5 * thickness
    # Even a bedroom or a garage may have a passage rather than a door.
    chance = open_plan if categories <= _OPEN_PLAN else 0.4 * open_plan
    if not categories & _CLOSED and rng.random() < chance:
        if categories <= _OPEN_PLAN and rng.random() < 0.7:
            return Opening(pair.wall.opening(start, start + usable, thickness), None, pair.cells)
        width = float(np.clip(rng.uniform(*WIDE_OPENING), 0.7, usable - 2 * MIN_NIB))
    else:
        width = float(rng.choice(DOOR_WIDTHS, p=_DOOR_SHARES))
        if width > usable - 2 * MIN_NIB:
            width = min(DOOR_WIDTHS)
    # Whole centimetres, as the walls: rounding both ends of the box by themselves could narrow a door.
    at = snap(start + _place(usable, width, rng))
    width = snap(width)
    box = pair.wall.opening(at, at + width, thickness)
    return Opening(box, _door(box), pair.cells)


def _place(usable: float, width: float, rng: np.random.Generator) -> float:
    """Where a door starts along its wall: mostly close to one end, as doors are."""
    slack = usable - width
    near = min(float(rng.uniform(MIN_NIB, 0.25)), 0.5 * slack)
    choice = rng.random()
    if choice < 0.4:
        return near
    if choice < 0.8:
        return slack - near
    return float(rng.uniform(near, slack - near))


def _door(box: Box) -> Door:
    """The middle line of an opening, from jamb to jamb."""
    if box.width >= box.height:
        y = snap(0.5 * (box.y0 + box.y1))
        return Door((box.x0, y), (box.x1, y))
    x = snap(0.5 * (box.x0 + box.x1))
    return Door((x, box.y0), (x, box.y1))


def find_openings(free_space: Polygon) -> list[Door]:
    """The openings in a plan's walls, from geometry alone.

    An opening has on one side at least the end of a wall: a short edge between two corners that point into
    the free space. Its other side is the wall that faces that edge, 0.5 to 2.5 m away.
    """
    start, along, is_wall_end = _edges(free_space)
    length = np.hypot(*along.T)
    shortest, longest = JAMB_LENGTH
    ends = np.flatnonzero(is_wall_end & (length > shortest) & (length < longest))
    doors: list[Door] = []
    found: set[int] = set()
    for edge in ends:
        if edge in found:
            continue
        normal = np.array([-along[edge, 1], along[edge, 0]]) / length[edge]
        jamb = start[edge] + 0.5 * along[edge]
        distance, facing = _first_hit(jamb, normal, start, along)
        if OPENING_WIDTH[0] <= distance <= OPENING_WIDTH[1]:
            x, y = (jamb + distance * normal).tolist()
            doors.append(Door((float(jamb[0]), float(jamb[1])), (x, y)))
            found.add(facing)
    return doors


def _edges(free_space: Polygon) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Edges, free space on their left: start (S, 2), vector (S, 2), and whether both ends are reflex."""
    starts = []
    vectors = []
    ends = []
    for ring in oriented_rings(free_space):
        points = shapely.get_coordinates(ring)[:-1]
        vector = np.roll(points, -1, axis=0) - points
        unit = vector / np.hypot(*vector.T)[:, None]
        before = np.roll(unit, 1, axis=0)
        # The sine of the turn at the edge's start; below 0 the corner points into the free space.
        turn = before[:, 0] * unit[:, 1] - before[:, 1] * unit[:, 0]
        starts.append(points)
        vectors.append(vector)
        ends.append((turn < -0.5) & (np.roll(turn, -1) < -0.5))
    return np.vstack(starts), np.vstack(vectors), np.concatenate(ends)


def _first_hit(
    origin: FloatArray, direction: FloatArray, start: FloatArray, along: FloatArray
) -> tuple[float, int]:
    """Distance [m] and index of the first edge that a ray meets; infinite if there is none."""
    offset = start - origin
    x, y = offset.T
    along_x, along_y = along.T
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = direction[0] * along_y - direction[1] * along_x
        distance = (x * along_y - y * along_x) / cross
        share = (x * direction[1] - y * direction[0]) / cross
        ahead = (distance > 1e-3) & (share >= 0.0) & (share <= 1.0)
    distance = np.where(ahead, distance, np.inf)
    nearest = int(np.argmin(distance))
    return float(distance[nearest]), nearest
