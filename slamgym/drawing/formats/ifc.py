"""IFC4 by ifcopenshell: project, site, building and storey; walls of types, doors in openings, slabs, spaces.

Straight walls run through their doors: an opening voids the wall and the door fills it. A map knows nothing of heights:
walls and rooms are 2.5 m high, doors 2.1 m, slabs 0.2 m, and the storey's description says so.
"""

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

WALL_HEIGHT, DOOR_HEIGHT, SLAB = 2.5, 2.1, 0.2
"""Usual in homes [m]; a map has no heights."""


def format_ifc(drawing: Drawing) -> str:
    """The text of the file (IFC4)."""
    import ifcopenshell.guid

    builder = _Builder(drawing.name)
    walls, wall_of = straight_walls(drawing.walls, drawing.doors)
    bodies = builder.add_walls(walls)
    pairs = list(zip(walls, bodies, strict=True))
    doors = []
    for number, door in enumerate(drawing.doors, 1):
        doors += builder.add_door(number, door, [pairs[k] for k in wall_of[list(door.walls)]])
    footprint = shapely.union_all([drawing.floor, *(wall.polygon for wall in drawing.walls)])
    slabs = [
        builder.add_slab(number, part) for number, part in enumerate(polygon_parts(footprint), 1)
    ]
    for room in drawing.rooms:
        builder.add_space(room)
    # All at once, as each call copies the list of what is in the storey.
    parts = [*bodies, *doors, *slabs]
    builder.run("spatial.assign_container", products=parts, relating_structure=builder.storey)
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
        whole = self._create("IfcProject", name)
        kinds = ("LENGTHUNIT", "AREAUNIT", "VOLUMEUNIT")
        self.run(
            "unit.assign_unit",
            units=[self.run("unit.add_si_unit", unit_type=kind) for kind in kinds],
        )
        model = {
            "context_type": "Model",
            "parent": self.run("context.add_context", context_type="Model"),
        }
        view = {"context_identifier": "Body", "target_view": "MODEL_VIEW"}
        self.body = self.run("context.add_context", **model, **view)
        for kind, title in (
            ("IfcSite", "Site"),
            ("IfcBuilding", name),
            ("IfcBuildingStorey", "Storey"),
        ):
            part = self._create(kind, title)
            self.run("aggregate.assign_object", products=[part], relating_object=whole)
            self.run("geometry.edit_object_placement", product=part, matrix=np.eye(4))
            whole = part
        self.styles = {
            "IfcWall": self._style("wall", (0.93, 0.9, 0.85), 0.0),
            "IfcDoor": self._style("door", (0.55, 0.35, 0.2), 0.0),
            "IfcSlab": self._style("slab", (0.7, 0.7, 0.7), 0.0),
            "IfcSpace": self._style("space", (0.6, 0.8, 1.0), 0.7),
        }
        self.storey = whole
        self.storey.Elevation = 0.0
        heights = f"heights ({WALL_HEIGHT} m, doors {DOOR_HEIGHT} m)"
        self.storey.Description = f"drawn from a two-dimensional map: {heights} are assumed"

    def run(self, call: str, **values: Any) -> Any:
        """Call ifcopenshell's function of that name."""
        import ifcopenshell.api

        return ifcopenshell.api.run(call, self.file, **values)

    def add_walls(self, walls: Sequence[DrawnWall]) -> list[Any]:
        """An IfcWall each, its origin at the beginning of its centre line, and a type for each thickness in cm."""
        bodies, types = [], dict[int, list[Any]]()
        for number, wall in enumerate(walls, 1):
            matrix = _placement(wall.start, wall.end)
            evidence = {"Thickness": wall.thickness, "Length": wall.length, "Layer": wall.layer}
            evidence |= {"Confidence": wall.confidence, "ShareSeen": wall.share_seen}
            body = _local(wall.polygon, matrix)
            bodies.append(
                self._solid("IfcWall", f"W{number:03d}", matrix, body, WALL_HEIGHT, **evidence)
            )
            types.setdefault(max(round(100.0 * wall.thickness), 1), []).append(bodies[-1])
        material = self.run("material.add_material", name="unknown")
        for thickness, alike in sorted(types.items()):
            kind = self._create("IfcWallType", f"Wall {thickness} cm", predefined_type="SOLIDWALL")
            layers = self.run(
                "material.add_material_set", name=kind.Name, set_type="IfcMaterialLayerSet"
            )
            layer = self.run("material.add_layer", layer_set=layers, material=material)
            layer.LayerThickness = thickness / 100
            self.run(
                "material.assign_material",
                products=[kind],
                type="IfcMaterialLayerSet",
                material=layers,
            )
            self.run("type.assign_type", related_objects=alike, relating_type=kind)
        return bodies

    def add_door(
        self, number: int, door: DrawnDoor, walls: list[tuple[DrawnWall, Any]]
    ) -> list[Any]:
        """An opening in the wall at a jamb, and the IfcDoor that fills it, if it is a door."""
        doors = (
            [self._in_gap("IfcDoor", f"D{number:02d}", door, 0.04)] if door.kind == "door" else []
        )
        if walls:
            wall, body = max(walls, key=lambda both: _runs_through(both[0], door))
            depth = max(door.depth, wall.thickness) + 0.1  # through walls that are oblique, too
            opening = self._in_gap("IfcOpeningElement", f"O{number:02d}", door, depth)
            self.run("feature.add_feature", feature=opening, element=body)
            for entity in doors:
                self.run("feature.add_filling", opening=opening, element=entity)
        for entity in doors:
            entity.OverallWidth, entity.OverallHeight = door.width, DOOR_HEIGHT
        return doors

    def add_slab(self, number: int, part: Polygon) -> Any:
        """An IfcSlab below a part of the floor and its walls."""
        matrix = np.eye(4)
        matrix[2, 3] = -SLAB
        return self._solid(
            "IfcSlab", f"F{number:02d}", matrix, Polygon(part.exterior), SLAB, Layer="INFERRED"
        )

    def add_space(self, room: DrawnRoom) -> None:
        """An IfcSpace with its area."""
        seen = {"ShareSeen": room.share_seen, "Layer": room.layer}
        entity = self._solid("IfcSpace", room.name, np.eye(4), room.polygon, WALL_HEIGHT, **seen)
        self.run("aggregate.assign_object", products=[entity], relating_object=self.storey)
        self.run("geometry.edit_object_placement", product=entity, matrix=np.eye(4))
        quantities = self.run("pset.add_qto", product=entity, name="Qto_SpaceBaseQuantities")
        self.run("pset.edit_qto", qto=quantities, properties={"NetFloorArea": float(room.area)})

    def _create(self, kind: str, name: str, **more: Any) -> Any:
        return self.run("root.create_entity", ifc_class=kind, name=name, **more)

    def _style(self, name: str, colour: tuple[float, float, float], transparency: float) -> Any:
        rgb = {"Name": None, **dict(zip(("Red", "Green", "Blue"), colour, strict=True))}
        look = {"SurfaceColour": rgb, "Transparency": transparency}
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
        box = shapely.box(0.0, -0.5 * depth, door.width, 0.5 * depth)
        return self._solid(
            kind, name, _placement(door.start, door.end), box, DOOR_HEIGHT, **evidence
        )

    def _solid(
        self,
        kind: str,
        name: str,
        matrix: FloatArray,
        base: Polygon,
        height: float,
        **evidence: Any,
    ) -> Any:
        """A named thing with a body, its style and its evidence."""
        entity = self._create(kind, name)
        self.run("geometry.edit_object_placement", product=entity, matrix=matrix)
        rings = [shapely.get_coordinates(ring)[:-1].tolist() for ring in shapely.get_rings(base)]
        outline, *voids = [self.shapes.polyline(ring, closed=True) for ring in rings]
        solid = self.shapes.extrude(self.shapes.profile(outline, inner_curves=voids), height)
        shape = self.shapes.get_representation(self.body, [solid])
        self.run("geometry.assign_representation", product=entity, representation=shape)
        if kind in self.styles:
            styles = [self.styles[kind]]
            self.run(
                "style.assign_representation_styles", shape_representation=shape, styles=styles
            )
        described = self.run("pset.add_pset", product=entity, name="Slamgym_Evidence")
        self.run("pset.edit_pset", pset=described, properties=evidence)
        return entity


def _runs_through(wall: DrawnWall, door: DrawnDoor) -> tuple[float, float]:
    """Agreement of a wall at a jamb with a door in direction, and then in place."""
    of_wall, of_door = (_placement(part.start, part.end)[:2, 0] for part in (wall, door))
    return round(abs(float(of_wall @ of_door)), 1), float(
        wall.polygon.intersection(door.line).length
    )


def _placement(start: DrawnPoint, end: DrawnPoint) -> FloatArray:
    """The matrix (4, 4) of a frame at the start whose x axis points to the end."""
    from ifcopenshell.util.placement import a2p

    return np.asarray(
        a2p((*start, 0.0), (0.0, 0.0, 1.0), (end[0] - start[0], end[1] - start[1], 0.0))
    )


def _local(polygon: Polygon, matrix: FloatArray) -> Polygon:
    """A polygon in the frame of a placement."""
    return shapely.transform(polygon, lambda points: (points - matrix[:2, 3]) @ matrix[:2, :2])
