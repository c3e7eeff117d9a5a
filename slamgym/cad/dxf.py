"""Walls, doors, windows and rooms from the layers of a DXF drawing (ezdxf).

Layers are told by their names, in several languages: ``WALLS``, ``A-WALL-FULL`` and ``Wände`` are walls. Blocks are
exploded, curves are cut into short lines. A door is a line from jamb to jamb or the arc of its swing. The unit is the
header's ``$INSUNITS`` (AutoCAD DXF reference, HEADER section); where that says nothing, the size decides, with a doubt.
"""

import fnmatch
import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Literal, NamedTuple

import ezdxf
import ezdxf.path
import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import Polygon

from slamgym.cad.drawn_plan import DrawnWalls, edges_of, floor_of_walls, outline_edges, stacked
from slamgym.cad.dxf_entities import CURVES, POLYLINES, entity_weight, strip_entities
from slamgym.cad.floorplan import FloorPlan, Room
from slamgym.cad.plan_formats import PlanOptions
from slamgym.cad.plan_index import PlanIndex
from slamgym.cad.polygons import refuse_crossings
from slamgym.core.errors import PlanError, as_plan_error
from slamgym.core.files import read_bytes
from slamgym.core.limits import DEPTH, DRAWING_BYTES, ENTRIES, VERTICES, shown
from slamgym.core.parallel.budget import read_apart
from slamgym.core.types import FloatArray

LayerKind = Literal["wall", "door", "window", "room", "other"]

LAYERS: dict[LayerKind, str] = {
    "window": r"window|glaz|fenster|fen[eê]tre|ventana|finestra|janela|raam|vindu",
    "door": r"door|opening|t[uü]e?r(?!m)|porte|puerta|porta|deur|d[oø]rr?",
    "room": r"room|raum|space|pi[eè]ce|locale|zone|area",
    "wall": r"wall|\bmur|wand|w[aä]e?nd|muro|pared|parete|vegg|cloison|inferred",
}
"""Meanings of the names of layers, the first that fits; regular expressions, capital letters or not."""

_FLATNESS = 0.005
"""Distance by which a curve may stray from the lines that stand for it [m]."""
DOOR_LENGTHS = (0.4, 4.0)
"""Lines of doors of other lengths are leaves, frames and handles [m]."""
HINGED = 0.03
"""The end of a swing that is so near to the other leaf's is where both close [m]."""
UNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 10: 0.9144, 14: 0.1}
"""Metres of what ``$INSUNITS`` stands for: inch, foot, millimetre, centimetre, metre, yard, decimetre."""
UNIT_BY_SIZE = ((1500.0, 0.001, "millimetres"), (150.0, 0.01, "centimetres"), (0.0, 1.0, "metres"))
"""A building whose drawing is longer than this is taken to be drawn in that unit."""
MAX_COORDINATE = 1e8
"""In the drawing's unit; what lies farther is a broken number."""
_ARC_SIZES = {"ARC": ("radius", "start_angle", "end_angle"), "CIRCLE": ("radius",)}
"""Attributes that must not be broken numbers either."""

# Errors that ezdxf raises on damaged files, besides its own.
_DAMAGED = (
    ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError, OSError, AssertionError,
)  # fmt: skip


def read_dxf(path: Path | str, unit: float | None = None, layers: Sequence[str] = ()) -> FloorPlan:
    """Read a floor plan from a DXF file.

    Args:
        path: The file, text or binary.
        unit: Metres of one unit of the drawing; None takes the header's, or guesses by the size, with a doubt.
        layers: Names or patterns (``A-WALL*``) of the layers that hold the walls; by default those that are called
            like walls, or the whole drawing if it has one layer.

    Raises:
        PlanError: If it is no DXF, has no walls, encloses no floor, or takes ezdxf more time or memory than it may.
    """
    return read_apart(_read, (Path(path), unit, tuple(layers)), Path(path), PlanError)


def _read(file: tuple[Path, float | None, tuple[str, ...]]) -> FloorPlan:
    path, unit, layers = file
    document = _open(path)
    code = document.header.get("$INSUNITS", 0)
    if not unit and isinstance(code, int):
        unit = UNITS.get(code)
    smallest_unit = UNIT_BY_SIZE[0][1]
    found = _Found(str(path), layers, _FLATNESS / (unit or smallest_unit))
    try:
        strip_entities(document)
        found.check_size(document)
        found.take(document.modelspace())
    except (ezdxf.DXFError, *_DAMAGED):
        raise PlanError(path, "is a damaged DXF drawing; save it again") from None
    walls = found.walls()
    doubts: tuple[str, ...] = ()
    if unit is None:
        unit, doubts = _unit_by_size(walls)
    walls = walls * unit
    drawn = DrawnWalls(
        walls=walls,
        doors=found.doors(walls / unit, unit),
        windows=stacked(found.lines["window"]) * unit,
        rooms=_rooms(found.rings, unit),
        doubts=doubts,
    )
    return floor_of_walls(drawn, path.stem, str(path))


def _rooms(rings: Iterable[FloatArray], unit: float) -> tuple[Room, ...]:
    """Rooms in metres from outlines in the drawing's unit; those without area are left out."""
    rooms = []
    for outline in map(Polygon, rings):
        if outline.is_valid and outline.area > 0.0:
            in_metres = shapely.transform(outline, lambda points: points * unit)
            rooms.append(Room("Room", in_metres))
    return tuple(rooms)


def open_dxf(path: Path, options: PlanOptions) -> PlanIndex:
    """The plan of a DXF drawing."""
    read = read_dxf if options.may_doubt else _read_certain
    return PlanIndex({path.stem: (path, options.scale, options.layers)}, read)


def _read_certain(path: Path, unit: float | None, layers: Sequence[str]) -> FloorPlan:
    """The plan of a drawing that says its unit."""
    plan = read_dxf(path, unit, layers)
    if plan.doubts:
        raise PlanError(
            path, f"{plan.doubts[0]}; give the metres of a unit, as in {path.name}@0.001"
        )
    return plan


def _open(path: Path) -> Any:
    from ezdxf import recover

    with as_plan_error():
        content = read_bytes(path, DRAWING_BYTES)
    try:
        document, _ = recover.read(io.BytesIO(content))
    except (ezdxf.DXFError, *_DAMAGED):
        raise PlanError(
            path, "is no readable DXF drawing; save it as DXF (a DWG has to be converted)"
        ) from None
    return document


def _unit_by_size(walls: FloatArray) -> tuple[float, tuple[str, ...]]:
    """The likely unit of a drawing that doesn't say it."""
    points = walls.reshape(-1, 2)
    size = float((points.max(axis=0) - points.min(axis=0)).max())
    fitting = [(unit, name) for least, unit, name in UNIT_BY_SIZE if size >= least]
    unit, name = fitting[0]
    doubt = (
        f"the drawing doesn't say its unit ($INSUNITS); by its size of {size:.0f} it is in {name}"
    )
    return unit, (doubt,)


_Block = tuple[str, LayerKind | None]
"""Name of a block, and the kind of the insert that it is drawn by."""


class _BlockContents(NamedTuple):
    """What stands in a block itself."""

    entities: int
    """Points and lines, as :func:`entity_weight` counts them."""
    wall_lines: int
    inserts: Counter[_Block]
    """How often it holds each other block."""


class _Found:
    """Lines of a drawing by what they are, in the drawing's unit."""

    def __init__(self, source: str, layers: Sequence[str], flatness: float) -> None:
        self.lines: dict[LayerKind, list[FloatArray]] = {kind: [] for kind in (*LAYERS, "other")}
        self.rings: list[FloatArray] = []
        self._hatched: list[FloatArray] = []  # outlines of hatches on layers of walls, as edges
        self.swings: list[FloatArray] = []  # (3, 2): hinge, start and end of the arc
        self._layers: set[str] = set()
        self._kinds: dict[str, LayerKind] = {}
        self._source = source
        self._chosen = tuple(layers)
        self._flatness = flatness
        self._count = 0
        self._crossings = 0

    def check_size(self, document: Any) -> None:
        """Refuse a drawing whose blocks stand for too much, before any of it is expanded.

        Raises:
            PlanError: If there are too many entities, walls or blocks within blocks.
        """
        outermost = (document.modelspace().block_record_name, None)
        level: Counter[_Block] = Counter({outermost: 1})
        known: dict[_Block, _BlockContents] = {}
        total = 0
        walls = 0
        depth = 0
        while level:
            DEPTH.check(self._source, depth, PlanError)
            deeper: Counter[_Block] = Counter()
            for block, times in level.items():
                if block not in known:
                    name, kind = block
                    known[block] = self._contents(document.blocks.get(name) or (), kind)
                total += times * known[block].entities
                walls += times * known[block].wall_lines
                for inner, copies in known[block].inserts.items():
                    deeper[inner] += times * copies
            ENTRIES.check(self._source, total, PlanError)
            VERTICES.check(self._source, walls, PlanError)
            level = deeper
            depth += 1

    def _contents(self, block: Iterable[Any], parent: LayerKind | None) -> _BlockContents:
        entities = 0
        wall_lines = 0
        inserts: Counter[_Block] = Counter()
        for entity in block:
            kind = self._kind_within(entity, parent)
            name = entity.dxftype()
            copies = max(entity.mcount, 1) if name == "INSERT" else 1
            entities += copies * entity_weight(entity)
            if name == "INSERT":
                inserts[entity.dxf.name.lower(), kind] += copies
            elif name == "LINE" and kind == "wall":
                wall_lines += 1
        return _BlockContents(entities, wall_lines, inserts)

    def take(self, entities: Iterable[Any], parent: LayerKind | None = None) -> None:
        """Sort entities into kinds; blocks are exploded, and their layer 0 is that of the block."""
        for entity in entities:
            kind = self._kind_within(entity, parent)
            name = entity.dxftype()
            if name == "INSERT" and entity.block():  # an empty block is false
                copies = entity.multi_insert() if entity.mcount > 1 else (entity,)
                for copy in copies:
                    self.take(copy.virtual_entities(), kind)
            elif name == "MLINE":
                self.take(entity.virtual_entities(), kind)
            elif name in CURVES:
                self._layers.add(entity.dxf.get("layer", "0"))
                self._take_curve(entity, name, kind)
            elif name == "HATCH":
                self._layers.add(entity.dxf.get("layer", "0"))
                self._take_hatch(entity, kind)

    def walls(self) -> FloatArray:
        """All lines of walls, shape (N, 4).

        Raises:
            PlanError: If there are none; it names the layers that there are.
        """
        # Hatches fill what lines bound; some drawings have nothing else.
        found = self.lines["wall"] or self._hatched
        if not found and not self._chosen and len(self._layers) == 1:
            found = self.lines["other"]
        if not found:
            names = ", ".join(shown(name) for name in sorted(self._layers)[:8]) or "none with lines"
            raise PlanError(
                self._source,
                f"has no layer that is called like walls; name it (--layers), it has {names}",
            )
        return np.vstack(found)

    def doors(self, walls: FloatArray, unit: float) -> FloatArray:
        """The doors, from jamb to jamb [m]: lines, and closed positions of swings."""
        lines = stacked(self.lines["door"])
        near = HINGED / unit
        hinges = shapely.STRtree([shapely.Point(swing[0]) for swing in self.swings])
        segments: Any = shapely.linestrings(lines.reshape(-1, 2, 2))
        open_leaves, _ = hinges.query(segments, predicate="dwithin", distance=near)
        others = np.delete(lines, open_leaves, axis=0)
        edges = stacked([others, self._closed_leaves(walls, near)]) * unit
        lengths = np.hypot(*(edges[:, 2:] - edges[:, :2]).T)
        return edges[(lengths >= DOOR_LENGTHS[0]) & (lengths <= DOOR_LENGTHS[1])]

    def _kind_within(self, entity: Any, parent: LayerKind | None) -> LayerKind:
        """Kind of an entity in a block whose insert is of the kind ``parent``."""
        layer = str(entity.dxf.get("layer", "0"))
        is_opening = parent in ("door", "window") and not self._chosen
        if parent is not None and (layer == "0" or is_opening):
            return parent
        if layer not in self._kinds:
            self._kinds[layer] = self._kind(layer)
        return self._kinds[layer]

    def _kind(self, layer: str) -> LayerKind:
        if any(fnmatch.fnmatch(layer.lower(), pattern.lower()) for pattern in self._chosen):
            return "wall"
        for kind, pattern in LAYERS.items():
            if not (kind == "wall" and self._chosen) and re.search(pattern, layer, re.IGNORECASE):
                return kind
        return "other"

    def _take_hatch(self, entity: Any, kind: LayerKind) -> None:
        for outline in ezdxf.path.from_hatch(entity) if kind == "wall" else ():
            self._hatched.append(edges_of(self._flattened(outline), True))

    def _flattened(self, curve: Any) -> FloatArray:
        """Points along a curve, (N, 2); none where it leaves all bounds."""
        flattened = islice(curve.flattening(self._flatness, 8), ENTRIES.value - self._count + 1)
        points = np.array([tuple(point)[:2] for point in flattened])
        self._count += len(points)
        ENTRIES.check(self._source, self._count, PlanError)
        is_bounded = len(points) > 1 and np.abs(points).max() < MAX_COORDINATE
        return points if is_bounded else np.empty((0, 2))

    def _take_curve(self, entity: Any, name: str, kind: LayerKind) -> None:
        for size in _ARC_SIZES.get(name, ()):
            if not abs(float(entity.dxf.get(size, 0.0))) < MAX_COORDINATE:  # true for nan
                raise PlanError(self._source, "has an arc without bounds; delete it")
        if kind == "door" and name == "ARC":
            # A mirrored block's arc has axes of its own.
            hinge = entity.ocs().to_wcs(entity.dxf.center)
            places = (hinge, entity.start_point, entity.end_point)
            self.swings.append(np.array([tuple(place)[:2] for place in places]))
            return
        curve = ezdxf.path.make_path(entity)
        points = self._flattened(curve)
        is_closed = bool(curve.is_closed or (name in POLYLINES and entity.is_closed))
        width = 0.0
        if not len(points):
            return
        if name == "LWPOLYLINE":
            width = float(entity.dxf.get("const_width", 0.0) or 0.0)
        if kind == "room" and is_closed:
            self.rings.append(points)
        elif width > 0.0:
            self.lines[kind] += self._faces(points, is_closed, width)
        else:
            self.lines[kind].append(edges_of(points, is_closed))

    def _faces(self, points: FloatArray, is_closed: bool, width: float) -> list[FloatArray]:
        """The outlines of a wide line through points (N, 2), as edges."""
        edges = edges_of(points, is_closed)
        self._crossings = refuse_crossings(edges, self._source, self._crossings)
        whole = np.vstack([points, points[:1]]) if is_closed else points
        body = shapely.LineString(whole).buffer(0.5 * width, cap_style="flat", join_style="mitre")
        return outline_edges(shapely.get_parts(body))

    def _closed_leaves(self, walls: FloatArray, near: float) -> FloatArray:
        """From hinges to those ends of the arcs that lie at a wall, or at another leaf's arc, shape (N, 4)."""
        swings = np.array(self.swings).reshape(-1, 3, 2)
        swings = swings[np.abs(swings).max(axis=(1, 2), initial=0.0) < MAX_COORDINATE]
        if not len(swings):
            return np.empty((0, 4))
        ends = swings[:, 1:].reshape(-1, 2)
        lines: Any = shapely.linestrings(walls.reshape(-1, 2, 2))
        _, to_wall = shapely.STRtree(lines).query_nearest(
            shapely.points(ends), return_distance=True, all_matches=False
        )
        # Of the three nearest ends two may be a swing's own.
        apart, nearest = cKDTree(ends).query(ends, k=3, distance_upper_bound=near)
        own = np.arange(len(ends))[:, None] // 2
        meets_another = (apart < near) & (nearest // 2 != own)
        is_alone = ~meets_another.any(axis=1)
        # Ends that meet another leaf come first, then those nearest to a wall.
        order = np.lexsort((to_wall.reshape(-1, 2), is_alone.reshape(-1, 2)))
        closed_ends = swings[np.arange(len(swings)), 1 + order[:, 0]]
        return np.hstack([swings[:, 0], closed_ends])
