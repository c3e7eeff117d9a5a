"""IFC4 by ifcopenshell: project, site, building and storey; walls of types, doors in openings, slabs, spaces.

Straight walls run from corner to corner, through their doors: an opening voids the wall and the door fills it. Walls
know which they meet (IfcRelConnectsPathElements), and whether floor was found on one side alone (IsExternal). A map
knows nothing of heights: walls and rooms are 2.5 m high, doors 2.1 m, slabs 0.2 m, as the storey says.
"""

import math
import uuid
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from slamgym.cad.polygons import polygon_parts
from slamgym.core.types import FloatArray
from slamgym.drawing.drawing import Drawing, DrawnDoor, DrawnPoint, DrawnRoom, DrawnWall
from slamgym.drawing.formats.straight_walls import straight_walls
from slamgym.drawing.settings import USUAL_CELL, WALL_HEIGHT

DOOR_HEIGHT = 2.1
"""Height of doors and openings, usual in homes [m]."""
SLAB = 0.2
"""Thickness of a slab, usual in homes [m]."""
GLASS_MATERIAL = "glass"
"""Name of the material of walls of glass, and of their style."""


def format_ifc(drawing: Drawing) -> str:
    """The text of the file (IFC4)."""
    import ifcopenshell.guid

    builder = _Builder(drawing.name)
    walls, wall_of = straight_walls(drawing.walls, drawing.doors)
    bodies = builder.add_walls(walls)
    builder.connect_walls(walls, bodies)
    pairs = list(zip(walls, bodies, strict=True))
    doors = []
    for number, door in enumerate(drawing.doors, 1):
        at_jambs = [pairs[k] for k in wall_of[list(door.walls)]]
        doors += builder.add_door(number, door, at_jambs)
    of_walls = [wall.polygon for wall in drawing.walls]
    footprint = polygon_parts(shapely.union_all([drawing.floor, *of_walls]))
    slabs = [builder.add_slab(number, part) for number, part in enumerate(footprint, 1)]
    for room in drawing.rooms:
        builder.add_space(room)
    # All at once, as each call copies the list of what is in the storey.
    parts = [*bodies, *doors, *slabs]
    builder.run("spatial.assign_container", products=parts, relating_structure=builder.storey)
    # Placed once all know what they are part of, doors last, as their places are relative to those of openings.
    for entity, matrix in sorted(builder.placements, key=lambda one: one[0].is_a("IfcDoor")):
        builder.run("geometry.edit_object_placement", product=entity, matrix=matrix)
    for number, root in enumerate(builder.file.by_type("IfcRoot")):
        # Names that don't change from run to run.
        name = uuid.uuid5(uuid.NAMESPACE_URL, f"{drawing.name}/{number}")
        root.GlobalId = ifcopenshell.guid.compress(name.hex)
    return builder.file.to_string()


class _Builder:
    """A file that grows."""

    def __init__(self, name: str) -> None:
        import ifcopenshell.api
        from ifcopenshell.util.shape_builder import ShapeBuilder

        self.file = ifcopenshell.api.run("project.create_file", version="IFC4")
        self.shapes = ShapeBuilder(self.file)
        self.placements: list[tuple[Any, FloatArray]] = []
        whole = self._create("IfcProject", name)
        kinds = ("LENGTHUNIT", "AREAUNIT", "VOLUMEUNIT")
        units = [self.run("unit.add_si_unit", unit_type=kind) for kind in kinds]
        self.run("unit.assign_unit", units=units)
        model = self.run("context.add_context", context_type="Model")
        self.body, self.axis = (
            self.run(
                "context.add_context",
                context_type="Model",
                parent=model,
                context_identifier=name,
                target_view=view,
            )
            for name, view in (("Body", "MODEL_VIEW"), ("Axis", "GRAPH_VIEW"))
        )
        site = self._add_part("IfcSite", "Site", whole)
        building = self._add_part("IfcBuilding", name, site)
        self.storey = self._add_part("IfcBuildingStorey", "Storey", building)
        self.styles = {
            "IfcWall": self._style("wall", (0.93, 0.9, 0.85), 0.0),
            "IfcDoor": self._style("door", (0.55, 0.35, 0.2), 0.0),
            "IfcSlab": self._style("slab", (0.7, 0.7, 0.7), 0.0),
            "IfcSpace": self._style("space", (0.6, 0.8, 1.0), 0.7),
        }
        self.storey.Elevation = 0.0
        heights = f"heights ({WALL_HEIGHT} m, doors {DOOR_HEIGHT} m)"
        self.storey.Description = f"drawn from a two-dimensional map: {heights} are assumed"

    def run(self, call: str, **values: Any) -> Any:
        """Call ifcopenshell's function of that name."""
        import ifcopenshell.api

        return ifcopenshell.api.run(call, self.file, **values)

    def add_walls(self, walls: Sequence[DrawnWall]) -> list[Any]:
        """An IfcWall each, its origin at the beginning of its centre line, and a type for each thickness in cells.

        Those of glass have types of their own, whose material is called so.
        """
        if any(wall.is_glass for wall in walls):
            self.styles[GLASS_MATERIAL] = self._style(GLASS_MATERIAL, (0.6, 0.85, 0.95), 0.7)
        bodies = []
        types: dict[tuple[str, int], list[Any]] = {}
        for number, wall in enumerate(walls, 1):
            matrix = _placement(wall.start, wall.end)
            evidence = {
                "Thickness": wall.thickness,
                "Length": wall.length,
                "Layer": wall.layer,
                "Confidence": wall.confidence,
                "ShareSeen": wall.share_seen,
            }
            base = _local(wall.polygon, matrix)
            name = f"W{number:03d}"
            look = GLASS_MATERIAL if wall.is_glass else "IfcWall"
            body = self._solid("IfcWall", name, matrix, base, WALL_HEIGHT, evidence, look)
            bodies.append(body)
            self._add_axis(body, wall.length)
            centimetres = round(100.0 * USUAL_CELL) * max(round(wall.thickness / USUAL_CELL), 1)
            made_of = GLASS_MATERIAL if wall.is_glass else "unknown"
            types.setdefault((made_of, centimetres), []).append(body)
            common = self.run("pset.add_pset", product=body, name="Pset_WallCommon")
            facts = {
                "Reference": _type_name(made_of, centimetres),
                "IsExternal": not wall.thickness_known,
            }
            self.run("pset.edit_pset", pset=common, properties=facts)
        names = sorted({made_of for made_of, _ in types})
        materials = {name: self.run("material.add_material", name=name) for name in names}
        for (made_of, centimetres), alike in sorted(types.items(), reverse=True):
            kind = self._add_wall_type(
                _type_name(made_of, centimetres), centimetres, materials[made_of]
            )
            self.run("type.assign_type", related_objects=alike, relating_type=kind)
        return bodies

    def _add_axis(self, body: Any, length: float) -> None:
        """The centre line of a wall, in the wall's frame."""
        line = self.shapes.polyline([(0.0, 0.0), (length, 0.0)])
        shape = self.shapes.get_representation(self.axis, [line])
        self.run("geometry.assign_representation", product=body, representation=shape)

    def connect_walls(self, walls: Sequence[DrawnWall], bodies: Sequence[Any]) -> None:
        """Say of walls that meet at which end or along which of both they do."""
        shapes = [wall.polygon for wall in walls]
        near = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=USUAL_CELL)
        for one, other in near.T.tolist():
            if one < other:
                meeting = shapely.shortest_line(walls[one].line, walls[other].line)
                here, there = meeting.coords
                self.run(
                    "geometry.connect_path",
                    relating_element=bodies[one],
                    related_element=bodies[other],
                    relating_connection=_end_at(walls[one], here),
                    related_connection=_end_at(walls[other], there),
                )

    def _add_wall_type(self, name: str, centimetres: int, material: Any) -> Any:
        """An IfcWallType of a thickness and of one layer."""
        kind = self._create("IfcWallType", name, predefined_type="SOLIDWALL")
        layers = self.run(
            "material.add_material_set", name=kind.Name, set_type="IfcMaterialLayerSet"
        )
        layer = self.run("material.add_layer", layer_set=layers, material=material)
        layer.LayerThickness = centimetres / 100
        self.run(
            "material.assign_material", products=[kind], type="IfcMaterialLayerSet", material=layers
        )
        return kind

    def add_door(
        self, number: int, door: DrawnDoor, walls: list[tuple[DrawnWall, Any]]
    ) -> list[Any]:
        """An opening in the wall at a jamb, and the IfcDoor that fills it, if it is a door."""
        doors = []
        if door.kind == "door":
            doors.append(self._in_gap("IfcDoor", f"D{number:02d}", door, 0.04))
        if walls:
            wall, body = max(walls, key=lambda both: _runs_through(both[0], door))
            depth = max(door.depth, wall.thickness) + 0.1  # through walls that are oblique, too
            opening = self._in_gap("IfcOpeningElement", f"O{number:02d}", door, depth)
            self.run("feature.add_feature", feature=opening, element=body)
            for entity in doors:
                self.run("feature.add_filling", opening=opening, element=entity)
        for entity in doors:
            entity.OverallWidth = door.width
            entity.OverallHeight = DOOR_HEIGHT
        return doors

    def add_slab(self, number: int, part: Polygon) -> Any:
        """An IfcSlab below a part of the floor and its walls."""
        matrix = np.eye(4)
        matrix[2, 3] = -SLAB
        base = Polygon(part.exterior)
        evidence = {"Layer": "INFERRED"}
        return self._solid("IfcSlab", f"F{number:02d}", matrix, base, SLAB, evidence)

    def add_space(self, room: DrawnRoom) -> None:
        """An IfcSpace with its area."""
        evidence = {"ShareSeen": room.share_seen, "Layer": room.layer}
        entity = self._solid("IfcSpace", room.name, np.eye(4), room.polygon, WALL_HEIGHT, evidence)
        self.run("aggregate.assign_object", products=[entity], relating_object=self.storey)
        quantities = self.run("pset.add_qto", product=entity, name="Qto_SpaceBaseQuantities")
        area = {"NetFloorArea": float(room.area)}
        self.run("pset.edit_qto", qto=quantities, properties=area)

    def _create(self, kind: str, name: str, predefined_type: str | None = None) -> Any:
        return self.run(
            "root.create_entity", ifc_class=kind, name=name, predefined_type=predefined_type
        )

    def _add_part(self, kind: str, name: str, whole: Any) -> Any:
        """A part of the site or the building, where its whole is."""
        part = self._create(kind, name)
        self.run("aggregate.assign_object", products=[part], relating_object=whole)
        self.placements.append((part, np.eye(4)))
        return part

    def _style(self, name: str, colour: tuple[float, float, float], transparency: float) -> Any:
        red, green, blue = colour
        look = {
            "SurfaceColour": {"Name": None, "Red": red, "Green": green, "Blue": blue},
            "Transparency": transparency,
        }
        style = self.run("style.add_style", name=name)
        self.run(
            "style.add_surface_style",
            style=style,
            ifc_class="IfcSurfaceStyleShading",
            attributes=look,
        )
        return style

    def _in_gap(self, kind: str, name: str, door: DrawnDoor, depth: float) -> Any:
        """A solid that fills a door's gap to a depth [m]."""
        evidence = {"Width": door.width, "Confidence": door.confidence, "Layer": door.layer}
        half = 0.5 * depth
        box = shapely.box(0.0, -half, door.width, half)
        matrix = _placement(door.start, door.end)
        return self._solid(kind, name, matrix, box, DOOR_HEIGHT, evidence)

    def _solid(
        self,
        kind: str,
        name: str,
        matrix: FloatArray,
        base: Polygon,
        height: float,
        evidence: dict[str, Any],
        look: str = "",
    ) -> Any:
        """A named thing with a body, its style, that of its kind by default, and its evidence."""
        entity = self._create(kind, name)
        self.placements.append((entity, matrix))
        outline, *voids = [
            self.shapes.polyline(ring.coords[:-1], closed=True) for ring in shapely.get_rings(base)
        ]
        profile = self.shapes.profile(outline, inner_curves=voids)
        solid = self.shapes.extrude(profile, height)
        shape = self.shapes.get_representation(self.body, [solid])
        self.run("geometry.assign_representation", product=entity, representation=shape)
        style = self.styles.get(look or kind)
        if style is not None:
            self.run(
                "style.assign_representation_styles", shape_representation=shape, styles=[style]
            )
        described = self.run("pset.add_pset", product=entity, name="Slamgym_Evidence")
        self.run("pset.edit_pset", pset=described, properties=evidence)
        return entity


def _type_name(made_of: str, centimetres: int) -> str:
    """What a type of walls is called."""
    return f"{'Glass wall' if made_of == GLASS_MATERIAL else 'Wall'} {centimetres} cm"


def _runs_through(wall: DrawnWall, door: DrawnDoor) -> tuple[float, float]:
    """Agreement of a wall at a jamb with a door in direction, and then in place."""
    of_wall = _placement(wall.start, wall.end)[:2, 0]
    of_door = _placement(door.start, door.end)[:2, 0]
    in_direction = abs(float(of_wall @ of_door))
    in_place = wall.polygon.intersection(door.line).length
    return round(in_direction, 1), float(in_place)


def _end_at(wall: DrawnWall, place: DrawnPoint) -> str:
    """Where along its path a wall is met at a place."""
    reach = wall.thickness + USUAL_CELL
    if math.dist(place, wall.start) <= reach:
        return "ATSTART"
    return "ATEND" if math.dist(place, wall.end) <= reach else "ATPATH"


def _placement(start: DrawnPoint, end: DrawnPoint) -> FloatArray:
    """The matrix (4, 4) of a frame at the start whose x axis points to the end."""
    from ifcopenshell.util.placement import a2p

    origin = (*start, 0.0)
    up = (0.0, 0.0, 1.0)
    along = (end[0] - start[0], end[1] - start[1], 0.0)
    return np.asarray(a2p(origin, up, along))


def _local(polygon: Polygon, matrix: FloatArray) -> Polygon:
    """A polygon in the frame of a placement."""
    origin = matrix[:2, 3]
    axes = matrix[:2, :2]
    return shapely.transform(polygon, lambda points: (points - origin) @ axes)
