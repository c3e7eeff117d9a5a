"""IFC4 by ifcopenshell: project, site, building and storey; walls with bodies, doors in openings, rooms as spaces.

A map knows nothing of heights: walls and rooms are 2.5 m high, doors 2.1 m, and the storey's description says so.
"""

import math
import uuid
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from slamgym.drawing.drawing import Drawing, DrawnDoor, DrawnPoint, DrawnRoom, DrawnWall

WALL_HEIGHT, DOOR_HEIGHT = 2.5, 2.1
"""Usual in homes [m]; a map has no heights."""
ASSUMED = f"drawn from a two-dimensional map: heights ({WALL_HEIGHT} m, doors {DOOR_HEIGHT} m) are assumed"


def format_ifc(drawing: Drawing) -> str:
    """The text of the file (IFC4)."""
    import ifcopenshell.api
    import ifcopenshell.guid

    builder = _Builder(drawing, ifcopenshell.api.run)
    walls = [builder.add_wall(number, wall) for number, wall in enumerate(drawing.walls, 1)]
    doors = [
        builder.add_door(number, door, walls)
        for number, door in enumerate(drawing.doors, 1)
        if door.kind == "door"
    ]
    for number, door in enumerate(drawing.doors, 1):
        if door.kind == "opening" and door.walls:
            builder.add_opening(number, door, walls)
    builder.contain([*walls, *doors])
    for room in drawing.rooms:
        builder.add_space(room)
    for number, root in enumerate(builder.file.by_type("IfcRoot")):
        # Names that don't change from run to run.
        root.GlobalId = ifcopenshell.guid.compress(
            uuid.uuid5(uuid.NAMESPACE_URL, f"{drawing.name}/{number}").hex
        )
    return builder.file.to_string()


class _Builder:
    """A file that grows."""

    def __init__(self, drawing: Drawing, run: Any) -> None:
        self.run = run
        self.drawing = drawing
        self.file = run("project.create_file", version="IFC4")
        project = run("root.create_entity", self.file, ifc_class="IfcProject", name=drawing.name)
        metre = run("unit.add_si_unit", self.file, unit_type="LENGTHUNIT")
        area = run("unit.add_si_unit", self.file, unit_type="AREAUNIT")
        volume = run("unit.add_si_unit", self.file, unit_type="VOLUMEUNIT")
        run("unit.assign_unit", self.file, units=[metre, area, volume])
        model = run("context.add_context", self.file, context_type="Model")
        self.body = run(
            "context.add_context",
            self.file,
            context_type="Model",
            context_identifier="Body",
            target_view="MODEL_VIEW",
            parent=model,
        )
        site, building, self.storey = (
            run("root.create_entity", self.file, ifc_class=kind, name=name)
            for kind, name in (
                ("IfcSite", "Site"),
                ("IfcBuilding", drawing.name),
                ("IfcBuildingStorey", "Storey"),
            )
        )
        self.storey.Elevation = 0.0
        self.storey.Description = ASSUMED
        for part, whole in ((site, project), (building, site), (self.storey, building)):
            run("aggregate.assign_object", self.file, products=[part], relating_object=whole)
        for place in (site, building, self.storey):
            run("geometry.edit_object_placement", self.file, product=place, matrix=np.eye(4))

    def add_wall(self, number: int, wall: DrawnWall) -> Any:
        """An IfcWall whose origin is the beginning of its centre line."""
        matrix = _placement(wall.start, wall.end)
        evidence = {
            "Thickness": wall.thickness,
            "Length": wall.length,
            "Confidence": wall.confidence,
            "ShareSeen": wall.share_seen,
            "Layer": wall.layer,
        }
        body = _local(wall.polygon, matrix)
        return self._solid("IfcWall", f"W{number:03d}", matrix, body, WALL_HEIGHT, evidence)

    def add_door(self, number: int, door: DrawnDoor, walls: list[Any]) -> Any:
        """An IfcDoor; where a wall runs through it, in an opening of that wall."""
        entity = self._in_gap("IfcDoor", f"D{number:02d}", door, 0.04)
        entity.OverallWidth, entity.OverallHeight = door.width, DOOR_HEIGHT
        if door.walls:
            opening = self.add_opening(number, door, walls)
            self.run("feature.add_filling", self.file, opening=opening, element=entity)
        return entity

    def add_opening(self, number: int, door: DrawnDoor, walls: list[Any]) -> Any:
        """An IfcOpeningElement in the wall at a jamb."""
        # Drawn walls end at the jambs, so the opening takes nothing away; it says which wall the door is in.
        opening = self._in_gap("IfcOpeningElement", f"O{number:02d}", door, max(door.depth, 0.04))
        self.run("feature.add_feature", self.file, feature=opening, element=walls[door.walls[0]])
        return opening

    def contain(self, entities: list[Any]) -> None:
        """Put walls and doors into the storey; all at once, as each call copies the list of what is in it."""
        if entities:
            self.run("spatial.assign_container", self.file, products=entities, relating_structure=self.storey)

    def add_space(self, room: DrawnRoom) -> None:
        """An IfcSpace with its area."""
        evidence = {"ShareSeen": room.share_seen, "Layer": room.layer}
        entity = self._solid("IfcSpace", room.id, np.eye(4), room.polygon, WALL_HEIGHT, evidence)
        self.run("aggregate.assign_object", self.file, products=[entity], relating_object=self.storey)
        self.run("geometry.edit_object_placement", self.file, product=entity, matrix=np.eye(4))
        quantities = self.run("pset.add_qto", self.file, product=entity, name="Qto_SpaceBaseQuantities")
        self.run("pset.edit_qto", self.file, qto=quantities, properties={"NetFloorArea": float(room.area)})

    def _in_gap(self, kind: str, name: str, door: DrawnDoor, depth: float) -> Any:
        """A solid that fills a door's gap to a depth [m]."""
        evidence = {"Width": door.width, "Confidence": door.confidence, "Layer": door.layer}
        box = shapely.box(0.0, -0.5 * depth, door.width, 0.5 * depth)
        return self._solid(kind, name, _placement(door.start, door.end), box, DOOR_HEIGHT, evidence)

    def _solid(
        self,
        kind: str,
        name: str,
        matrix: np.ndarray,
        base: Polygon,
        height: float,
        evidence: dict[str, Any],
    ) -> Any:
        """A named thing with a body and its evidence."""
        entity = self.run("root.create_entity", self.file, ifc_class=kind, name=name)
        self.run("geometry.edit_object_placement", self.file, product=entity, matrix=matrix)
        self._extrude(entity, self._profile(base), height)
        values = {key: float(v) if isinstance(v, float) else v for key, v in evidence.items()}
        described = self.run("pset.add_pset", self.file, product=entity, name="Slamgym_Evidence")
        self.run("pset.edit_pset", self.file, pset=described, properties=values)
        return entity

    def _profile(self, polygon: Polygon) -> Any:
        """A closed profile; holes become voids."""
        curves = [self._curve(ring) for ring in (polygon.exterior, *polygon.interiors)]
        if len(curves) == 1:
            return self.file.create_entity("IfcArbitraryClosedProfileDef", "AREA", None, curves[0])
        return self.file.create_entity("IfcArbitraryProfileDefWithVoids", "AREA", None, curves[0], curves[1:])

    def _curve(self, ring: Any) -> Any:
        points = shapely.get_coordinates(ring).tolist()
        places = [self.file.createIfcCartesianPoint((float(x), float(y))) for x, y in points[:-1]]
        return self.file.createIfcPolyline([*places, places[0]])

    def _extrude(self, entity: Any, profile: Any, height: float) -> None:
        up = self.file.createIfcDirection((0.0, 0.0, 1.0))
        solid = self.file.createIfcExtrudedAreaSolid(profile, None, up, float(height))
        shape = self.file.createIfcShapeRepresentation(self.body, "Body", "SweptSolid", [solid])
        self.run("geometry.assign_representation", self.file, product=entity, representation=shape)


def _placement(start: DrawnPoint, end: DrawnPoint) -> np.ndarray:
    """The matrix (4, 4) of a frame at the start whose x axis points to the end."""
    length = max(math.hypot(end[0] - start[0], end[1] - start[1]), 1e-9)
    cos, sin = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    matrix = np.eye(4)
    matrix[:2, :2] = [[cos, -sin], [sin, cos]]
    matrix[:2, 3] = start
    return matrix


def _local(polygon: Polygon, matrix: np.ndarray) -> Polygon:
    """A polygon in the frame of a placement."""
    return shapely.transform(polygon, lambda points: (points - matrix[:2, 3]) @ matrix[:2, :2])
