"""From the walls of a CAD drawing to a floor plan: which of the areas between lines is floor.

Drawings show walls in three forms: closed bodies, two lines for the two faces, one line. All are taken as lines
that divide the plane. What they enclose is a wall where it is narrow, else a space. Doors and windows are lines
that close gaps; two spaces with a door between them are one floor, and what lies behind an outer door isn't.
Outlines of rooms shut out the outside where walls have gaps.

Convention: metres, x right, y up, as in a :class:`FloorPlan`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.floorplan import Door, FloorPlan, Room
from slamgym.cad.houseexpo import MAX_PLAN_COORDINATE
from slamgym.cad.polygons import largest_part, polygon_parts, refuse_crowded
from slamgym.core.errors import PlanError
from slamgym.core.limits import NEAR_PAIRS, PLAN_PARTS, VERTICES
from slamgym.core.types import FloatArray, IntArray

LINE_GRID = 1e-3
"""Ends of lines that are closer than this meet [m]."""
MAX_WALL = 0.7
"""Space between lines that is narrower than this is a wall [m]."""
JAMB = 0.05
"""Doors and windows are drawn this much longer at both ends, into the walls next to them [m]."""
BESIDE_DOOR = (0.02, 0.1, 0.2, 0.3, 0.4, 0.5)
"""Distances from a door's middle at which the spaces that it joins are looked for [m]; a wall may run through it."""
LINE_WIDTH = 0.01
"""Thickness of a wall that is drawn as one line [m]."""
CROWDED = 0.1
"""Lines that are closer than this are near each other [m]."""
_MIN_ENCLOSED_SHARE = 0.3
"""Spaces fill at least this share of the box round the walls; else the building has open gaps."""
OUTER_GAP = 1.5
"""Open gaps in the outer walls up to this width are taken for shut [m]."""
MIN_JOINED_SHARE = 0.5
"""The spaces that doors join make up at least this share of all."""


@dataclass(frozen=True)
class DrawnWalls:
    """Findings of a reader in a drawing; segments have shape (N, 4): x0, y0, x1, y1 [m]."""

    walls: FloatArray
    doors: FloatArray
    windows: FloatArray
    rooms: tuple[Room, ...] = ()
    doubts: tuple[str, ...] = ()
    """Sentences about what the drawing left open, its unit above all."""


class _Doorway(NamedTuple):
    """A door between two spaces."""

    door: int  # its number
    spaces: tuple[int, int]
    slab: Polygon  # what has to be opened between them


def floor_of_walls(drawn: DrawnWalls, plan_id: str, source: str) -> FloorPlan:
    """Make a plan of a drawing's walls.

    Args:
        drawn: The walls, doors and windows.
        plan_id: Name of the plan.
        source: Named in errors.

    Raises:
        PlanError: If the walls enclose nothing, or doors join too little of it.
    """
    drawn = _checked(drawn, source)
    spaces = _all_spaces(drawn, source)
    doorways = _doorways(drawn.doors, spaces)
    joined = _largest_group(spaces, doorways)
    total = sum(space.area for space in spaces)
    floor_area = sum(spaces[i].area for i in joined)
    if floor_area < MIN_JOINED_SHARE * total:
        raise PlanError(
            source,
            f"its doors join only {floor_area:.1f} of {total:.1f} m2 between the walls; "
            "check that the doors are read (their layer) and lie in the walls",
        )
    used = [way for way in doorways if way.spaces[0] in joined]
    slabs = [way.slab for way in used]
    floor = _floor([spaces[i] for i in joined], slabs, drawn, source)
    shapely.prepare(floor)
    rooms = tuple(room for room in drawn.rooms if floor.intersects(room.polygon))
    doors = tuple(_door(drawn.doors[way.door]) for way in used)
    return FloorPlan(plan_id, floor, rooms, doors, source, drawn.doubts)


def _all_spaces(drawn: DrawnWalls, source: str) -> list[Polygon]:
    """The areas that the walls enclose, those outside of the building apart.

    Raises:
        PlanError: If there are none, or the lines are too many or too tangled.
    """
    closures = _lengthened(np.vstack([drawn.doors, drawn.windows]))
    drawn_lines = np.vstack([drawn.walls, closures])
    outlines = outline_edges(room.polygon for room in drawn.rooms)
    segments = np.vstack([drawn_lines, *outlines])
    _refuse_tangled(segments, source)
    network = _joined(segments)
    spaces = _spaces(network, drawn_lines)
    min_x, min_y, max_x, max_y = shapely.bounds(network).tolist()
    box = (max_x - min_x) * (max_y - min_y)
    if sum(space.area for space in spaces) < _MIN_ENCLOSED_SHARE * box:
        spaces = _spaces_with_gaps_shut(network, drawn_lines) or spaces
    if not spaces:
        raise PlanError(
            source, "its walls enclose no space; check the layers, the unit and gaps at corners"
        )
    return spaces


def stacked(lines: Iterable[FloatArray]) -> FloatArray:
    """Segments of many lines, shape (N, 4); there may be none."""
    return np.vstack([np.empty((0, 4)), *lines])


def outline_edges(polygons: Iterable[Polygon]) -> list[FloatArray]:
    """The edges of polygons and of their holes, ring by ring."""
    rings = [ring for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]
    return [edges_of(shapely.get_coordinates(ring), closed=False) for ring in rings]


def edges_of(points: FloatArray, closed: bool) -> FloatArray:
    """The edges of a line through points (N, 2), shape (N - 1, 4), or (N, 4) of a closed one."""
    after = np.roll(points, -1, axis=0)
    edges = np.hstack([points, after])
    return edges if closed else edges[:-1]


def middle_line(polygon: Polygon, direction: FloatArray | None = None) -> FloatArray:
    """The middle line of a polygon that is roughly a rectangle, shape (4,): the long one, or that in a direction."""
    box = shapely.get_coordinates(shapely.oriented_envelope(polygon))
    if len(box) < 5:
        return np.concatenate([box[0], box[-1]])
    sides = np.diff(box[:3], axis=0)
    lengths = np.hypot(*sides.T)
    fit = lengths if direction is None else np.abs(sides @ direction) / lengths
    along = sides[np.argmax(fit)]
    centre = box[:4].mean(axis=0)
    half = 0.5 * along
    return np.concatenate([centre - half, centre + half])


def _checked(drawn: DrawnWalls, source: str) -> DrawnWalls:
    """The drawing within its limits, and with zeros for numbers so small that geometry divides by zero."""
    segments = np.vstack([drawn.walls, drawn.doors, drawn.windows])
    if not np.isfinite(segments).all() or np.abs(segments).max(initial=0.0) > MAX_PLAN_COORDINATE:
        raise PlanError(
            source,
            f"has a coordinate that is no number or beyond {MAX_PLAN_COORDINATE:.0f} m; check its unit",
        )
    corners = shapely.get_coordinates([room.polygon for room in drawn.rooms])
    VERTICES.check(source, len(segments) + len(corners), PlanError)
    for parts in (drawn.doors, drawn.windows, drawn.rooms):
        PLAN_PARTS.check(source, len(parts), PlanError)
    if len(drawn.walls) < 3:
        raise PlanError(source, "has no walls; name their layer, or check the kind of its objects")
    segments[np.abs(segments) < 1e-9] = 0.0
    first_door = len(drawn.walls)
    first_window = first_door + len(drawn.doors)
    walls, doors, windows = np.split(segments, [first_door, first_window])
    return DrawnWalls(walls, doors, windows, drawn.rooms, drawn.doubts)


def _refuse_tangled(segments: FloatArray, source: str) -> None:
    """Refuse lines of which too many cross or all but touch."""
    refuse_crowded(segments, CROWDED, source)
    lines: Any = _lines(segments)
    pairs = shapely.STRtree(lines).query(lines, predicate="intersects")
    NEAR_PAIRS.check(source, pairs.shape[1] * 10, PlanError)


def _joined(segments: FloatArray) -> Any:
    """Lines cut where they cross, with their ends on the grid."""
    # GEOS keeps the ends in a tree that nothing balances: lines in the order of their places make it a list.
    mixed = np.random.default_rng(0).permutation(segments)
    return shapely.union_all(_lines(mixed), grid_size=LINE_GRID)


def _lines(segments: FloatArray) -> Any:
    return shapely.linestrings(segments.reshape(-1, 2, 2))


def _lengthened(segments: FloatArray) -> FloatArray:
    direction = segments[:, 2:] - segments[:, :2]
    length = np.maximum(np.hypot(*direction.T), 1e-9)
    more = JAMB * (direction / length[:, None])
    return np.hstack([segments[:, :2] - more, segments[:, 2:] + more])


def _spaces(network: Any, drawn_lines: FloatArray) -> list[Polygon]:
    """Areas that the lines enclose, without the bodies of walls; the outline of a room doesn't part two of them."""
    faces = shapely.get_parts(shapely.polygonize([network]))
    group = _groups(len(faces), _open_borders(network, drawn_lines, faces))
    last_of_group = np.cumsum(np.bincount(group))[:-1]
    spaces = []
    for members in np.split(faces[np.argsort(group)], last_of_group):
        for area in polygon_parts(shapely.union_all(members)):
            core = area.buffer(-0.5 * MAX_WALL, join_style="mitre")
            if not core.is_empty:
                spaces.append(area)
    return spaces


def _open_borders(network: Any, drawn_lines: FloatArray, faces: Any) -> list[tuple[int, int]]:
    """Pairs of faces that meet where no line of a wall, door or window is drawn."""
    borders = shapely.get_parts(network)
    long_borders = borders[shapely.length(borders) > JAMB]
    middles = shapely.line_interpolate_point(long_borders, 0.5, normalized=True)
    drawn = shapely.STRtree(_lines(drawn_lines))
    shut, _ = drawn.query(middles, "dwithin", 2.0 * LINE_GRID)
    open_middles = np.delete(middles, shut)
    border, face = shapely.STRtree(faces).query(open_middles, "dwithin", LINE_GRID)
    of_one_border = border[1:] == border[:-1]
    first = face[:-1][of_one_border]
    second = face[1:][of_one_border]
    return list(zip(first.tolist(), second.tolist(), strict=True))


def _spaces_with_gaps_shut(network: Any, drawn_lines: FloatArray) -> list[Polygon]:
    """The same where the outer walls have gaps: the outside is what a disc that can't pass them covers."""
    outside = _outside(network, drawn_lines)
    shut = shapely.union_all([network, outside.boundary], grid_size=LINE_GRID)
    strip = 10.0 * LINE_GRID
    borders = np.vstack([drawn_lines, *outline_edges(polygon_parts(outside))])
    spaces = []
    for space in _spaces(shut, borders):
        if not outside.intersects(space.representative_point()):
            shrunk = space.buffer(-strip, join_style="mitre")
            spaces += polygon_parts(shrunk.buffer(strip, join_style="mitre"))
    return spaces


def _outside(network: Any, drawn_lines: FloatArray) -> Any:
    """What a disc as wide as an open gap covers from beyond the building, a hair smaller.

    So its border doesn't lie on the walls that it touches; the strip between is taken off later.
    """
    radius = 0.5 * OUTER_GAP
    around = shapely.box(*shapely.bounds(network)).buffer(4.0 * OUTER_GAP, join_style="mitre")
    # One line at a time: GEOS takes the square of the time, and of the memory, for all of them at once.
    thick_lines = shapely.buffer(_lines(drawn_lines), radius, quad_segs=16)
    free = around.difference(shapely.union_all(thick_lines))
    border = around.exterior
    beyond = [part for part in shapely.get_parts(free) if part.intersects(border)]
    smooth = shapely.union_all(beyond).simplify(LINE_GRID, preserve_topology=False)
    return smooth.buffer(radius - 5.0 * LINE_GRID)


def _doorways(doors: FloatArray, spaces: Sequence[Polygon]) -> list[_Doorway]:
    """Which spaces each door joins."""
    tree = shapely.STRtree(spaces)
    found = []
    for index, (x0, y0, x1, y1) in enumerate(doors):
        length = float(np.hypot(x1 - x0, y1 - y0))
        if length < 0.1:
            continue
        normal = np.array([y0 - y1, x1 - x0]) / length
        middle = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1)])
        before = _space_beside(tree, middle, normal)
        behind = _space_beside(tree, middle, -normal)
        if before is None or behind is None or before.space == behind.space:
            continue
        ends = np.array([[x0, y0], [x1, y1]])
        front = ends + before.distance * normal
        back = ends - behind.distance * normal
        slab = Polygon(np.vstack([front, back[::-1]]))
        found.append(_Doorway(index, (before.space, behind.space), slab))
    return found


class _Beside(NamedTuple):
    """What lies beside a door."""

    space: int
    distance: float  # from the door's middle to where the space begins [m]


def _space_beside(tree: Any, middle: FloatArray, normal: FloatArray) -> _Beside | None:
    """The space on one side of a door."""
    for distance in BESIDE_DOOR:
        hits = tree.query(shapely.Point(middle + distance * normal), predicate="within")
        if len(hits):
            return _Beside(int(hits[0]), distance)
    return None


def _largest_group(spaces: Sequence[Polygon], doorways: Sequence[_Doorway]) -> set[int]:
    """The spaces that doors join to the largest floor."""
    group = _groups(len(spaces), [way.spaces for way in doorways])
    areas = np.bincount(group, [space.area for space in spaces])
    is_member = group == np.argmax(areas)
    return set(np.flatnonzero(is_member).tolist())


def _groups(count: int, pairs: Sequence[tuple[int, int]]) -> IntArray:
    """For each of some things the number of its group, joined pair by pair."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rows, cols = np.array(pairs, np.int64).reshape(-1, 2).T
    joined = coo_array((np.ones(len(rows)), (rows, cols)), shape=(count, count))
    _, group = connected_components(joined, directed=False)
    return np.asarray(group, np.int64)


def _floor(
    spaces: Sequence[Polygon], slabs: Sequence[Polygon], drawn: DrawnWalls, source: str
) -> Polygon:
    """The spaces and the doors between them as one polygon; walls of one line get a thickness."""
    floor = shapely.union_all([*spaces, *slabs], grid_size=LINE_GRID)
    lines = _joined(np.vstack([drawn.walls, drawn.windows]))
    within = lines.intersection(floor.buffer(-3.0 * LINE_GRID))
    inner = within.difference(shapely.union_all(list(slabs)))
    if not inner.is_empty:
        bodies = shapely.buffer(shapely.get_parts(inner), 0.5 * LINE_WIDTH, cap_style="square")
        floor = floor.difference(shapely.disjoint_subset_union_all(bodies))
    largest = largest_part(floor).simplify(LINE_GRID, preserve_topology=False)
    if not isinstance(largest, Polygon) or largest.is_empty or not largest.is_valid:
        raise PlanError(source, "its walls enclose no simple floor; check the layers of the walls")
    PLAN_PARTS.check(source, len(largest.interiors), PlanError)
    VERTICES.check(source, len(shapely.get_coordinates(largest)), PlanError)
    return largest


def _door(segment: FloatArray) -> Door:
    x0, y0, x1, y1 = segment.tolist()
    return Door((x0, y0), (x1, y1))
