"""One flat of two rooms, drawn in every form that the readers of drawings take."""

import io
import json

import numpy as np
import pytest

T = 0.12
"""Thickness of the walls [m]."""
DOOR = (4.0, 1.0, 4.0, 1.9)
"""Between the rooms, in the middle of its wall: x0, y0, x1, y1 [m]."""
ENTRANCE = (1.0, -T / 2, 2.0, -T / 2)
AREA = (7.0 - T) * 4.0 + 0.9 * T + 1.0 * T / 2
"""Of the floor: two rooms, the door between them, and the inner half of the entrance [m2]."""
ROOMS = {"Kitchen": (0.0, 0.0, 4.0 - T / 2, 4.0), "Bedroom": (4.0 + T / 2, 0.0, 7.0, 4.0)}


def bodies(door_x=4.0):
    """The walls as boxes x0, y0, x1, y1 [m]; the floor is 0..7 x 0..4 between the outer ones."""
    h = T / 2
    return [
        (-T, 4.0, 7.0 + T, 4.0 + T),
        (-T, -T, 1.0, 0.0),
        (2.0, -T, 7.0 + T, 0.0),
        (-T, -T, 0.0, 4.0 + T),
        (7.0, -T, 7.0 + T, 4.0 + T),
        (door_x - h, 0.0, door_x + h, 1.0),
        (door_x - h, 1.9, door_x + h, 4.0),
    ]


def ring(box):
    x0, y0, x1, y1 = box
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def geojson():
    """The flat as a FeatureCollection."""

    def feature(kind, geometry, coordinates, **more):
        return {
            "type": "Feature",
            "properties": {"kind": kind, **more},
            "geometry": {"type": geometry, "coordinates": coordinates},
        }

    lines = [
        feature("door", "LineString", np.reshape(line, (2, 2)).tolist())
        for line in (DOOR, ENTRANCE)
    ]
    rooms = [feature("room", "Polygon", [ring(box)], name=name) for name, box in ROOMS.items()]
    walls = [feature("wall", "Polygon", [ring(box)]) for box in bodies()]
    return {"type": "FeatureCollection", "features": [*walls, *lines, *rooms]}


def dxf(unit="m", walls="WALLS", doors="DOORS", swings=False, block=False):
    """The flat as the text of a DXF file; units ``m``, ``mm`` or none (``""``, in millimetres)."""
    import ezdxf
    from ezdxf import units

    document = ezdxf.new(units={"m": units.M, "mm": units.MM, "": 0}[unit])
    scale = 1.0 if unit == "m" else 1000.0
    space = document.modelspace()
    target = document.blocks.new("FLAT") if block else space
    for box in bodies():
        attributes = {"layer": "0" if block else walls}
        target.add_lwpolyline(np.array(ring(box)[:4]) * scale, close=True, dxfattribs=attributes)
    if block:
        space.add_blockref("FLAT", (0, 0), dxfattribs={"layer": walls})
    for x0, y0, x1, y1 in np.array([DOOR, ENTRANCE]) * scale:
        if swings:
            angle = np.degrees(np.arctan2(y1 - y0, x1 - x0))
            space.add_arc(
                (x0, y0),
                np.hypot(x1 - x0, y1 - y0),
                angle,
                angle + 90.0,
                dxfattribs={"layer": doors},
            )
        else:
            space.add_line((x0, y0), (x1, y1), dxfattribs={"layer": doors})
    text = io.StringIO()
    document.write(text)
    return text.getvalue()


def ifc(storeys=1):
    """The flat as the text of an IFC model: walls that run through, with openings for doors and a window."""
    pytest.importorskip("ifcopenshell")
    import ifcopenshell.api.aggregate
    import ifcopenshell.api.context
    import ifcopenshell.api.feature
    import ifcopenshell.api.geometry
    import ifcopenshell.api.project
    import ifcopenshell.api.root
    import ifcopenshell.api.spatial
    import ifcopenshell.api.unit

    api = ifcopenshell.api
    model = api.project.create_file()
    project = api.root.create_entity(model, ifc_class="IfcProject", name="flat")
    api.unit.assign_unit(model)  # millimetres
    whole = api.context.add_context(model, context_type="Model")
    body = api.context.add_context(
        model,
        context_type="Model",
        context_identifier="Body",
        target_view="MODEL_VIEW",
        parent=whole,
    )
    building = api.root.create_entity(model, ifc_class="IfcBuilding", name="house")
    api.aggregate.assign_object(model, relating_object=project, products=[building])

    def solid(kind, box, low, height, name=""):
        x0, y0, x1, y1 = box
        element = api.root.create_entity(model, ifc_class=kind, name=name)
        matrix = np.eye(4)
        matrix[:3, 3] = x0, y0, low
        api.geometry.edit_object_placement(model, product=element, matrix=matrix, is_si=True)
        shape = api.geometry.add_wall_representation(
            model, context=body, length=x1 - x0, height=height, thickness=y1 - y0
        )
        api.geometry.assign_representation(model, product=element, representation=shape)
        return element

    h = T / 2
    walls = {
        "south": (-T, -T, 7.0 + T, 0.0),
        "north": (-T, 4.0, 7.0 + T, 4.0 + T),
        "west": (-T, 0.0, 0.0, 4.0),
        "east": (7.0, 0.0, 7.0 + T, 4.0),
        "middle": (4.0 - h, 0.0, 4.0 + h, 4.0),
    }
    openings = [
        ("middle", (3.8, 1.0, 4.2, 1.9), 0.0, 2.0),
        ("south", (1.0, -0.3, 2.0, 0.2), 0.0, 2.0),
        ("north", (2.0, 3.9, 3.0, 4.3), 1.0, 1.2),
    ]
    for number in range(storeys):
        storey = api.root.create_entity(
            model, ifc_class="IfcBuildingStorey", name=f"Level {number}"
        )
        storey.Elevation = 3000.0 * number
        api.aggregate.assign_object(model, relating_object=building, products=[storey])
        elements = {
            name: solid("IfcWall", box, 3.0 * number, 2.5, name) for name, box in walls.items()
        }
        for name, box, low, height in openings:
            opening = solid("IfcOpeningElement", box, 3.0 * number + low, height)
            api.feature.add_feature(model, feature=opening, element=elements[name])
        api.spatial.assign_container(
            model, relating_structure=storey, products=list(elements.values())
        )
    return model.to_string()


def geojson_text():
    return json.dumps(geojson())
