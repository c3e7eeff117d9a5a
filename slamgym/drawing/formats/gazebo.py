"""A drawing as a world of Gazebo (SDF): walls as high as a storey, doors open, what stands in the rooms, a floor."""

import xml.etree.ElementTree as ET

import shapely
from shapely import Polygon

from slamgym.cad.polygons import polygon_parts
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.settings import OUTER_WALL, WALL_HEIGHT

THING_HEIGHT = 0.5
"""Of what stands in the rooms [m]: above the scanners of small robots; a map says nothing of it."""
SYSTEMS = {
    "gz-sim-physics-system": "gz::sim::systems::Physics",
    "gz-sim-user-commands-system": "gz::sim::systems::UserCommands",
    "gz-sim-scene-broadcaster-system": "gz::sim::systems::SceneBroadcaster",
    "gz-sim-sensors-system": "gz::sim::systems::Sensors",
    "gz-sim-imu-system": "gz::sim::systems::Imu",
}
"""What a robot with a laser needs of Gazebo; a world that names some systems gets no others."""


def format_world(drawing: Drawing) -> str:
    """A drawing as the text of an SDF file.

    Convention: metres, in the frame of the map that it was drawn from, z up, the floor at 0.
    """
    sdf = ET.Element("sdf", version="1.8")
    world = ET.SubElement(sdf, "world", name=drawing.name)
    for filename, name in SYSTEMS.items():
        system = ET.SubElement(world, "plugin", filename=filename, name=name)
        if name.endswith("Sensors"):
            _add(system, "render_engine", "ogre2")
    light = ET.SubElement(world, "light", name="sun", type="directional")
    _add(light, "pose", "0 0 10 0 0 0")
    _add(light, "direction", "-0.5 0.1 -0.9")
    ground = _add_model(world, "ground")
    for kind in ("collision", "visual"):
        plane = ET.SubElement(
            ET.SubElement(ET.SubElement(ground, kind, name=kind), "geometry"), "plane"
        )
        _add(plane, "normal", "0 0 1")
        _add(plane, "size", "100 100")
    _add_bodies(world, "walls", wall_bodies(drawing), WALL_HEIGHT)
    _add_bodies(world, "things", standing_bodies(drawing), THING_HEIGHT)
    ET.indent(sdf)
    return ET.tostring(sdf, encoding="unicode", xml_declaration=True) + "\n"


def wall_bodies(drawing: Drawing) -> list[Polygon]:
    """All that is wall round the floor, in pieces without holes."""
    around = drawing.floor.buffer(OUTER_WALL, join_style="mitre")
    return _without_holes(around.difference(drawing.floor))


def standing_bodies(drawing: Drawing) -> list[Polygon]:
    """What stands on the floor by the map: its occupied cells, and floor that something hid from the laser."""
    smallest = 0.25 * drawing.grid.frame.resolution**2
    hidden = shapely.union_all([*drawing.echoes, *drawing.inferred_floor])
    standing = hidden.intersection(drawing.floor)
    return [body for body in _without_holes(standing) if body.area >= smallest]


def _without_holes(shape: shapely.Geometry) -> list[Polygon]:
    """Pieces without holes: Gazebo's extrusions have outlines alone."""
    bodies = []
    pending = polygon_parts(shape)
    while pending:
        body = pending.pop()
        if not body.interiors:
            bodies.append(body)
            continue
        hole = Polygon(body.interiors[0]).representative_point()
        left, low, right, high = body.bounds
        for half in (shapely.box(left, low, right, hole.y), shapely.box(left, hole.y, right, high)):
            pending += polygon_parts(body.intersection(half))
    return bodies


def _add_bodies(world: ET.Element, name: str, bodies: list[Polygon], height: float) -> None:
    """A model of upright bodies of a height [m]; none of nothing, which Gazebo refuses."""
    if not bodies:
        return
    link = _add_model(world, name)
    for number, body in enumerate(bodies):
        for kind in ("collision", "visual"):
            part = ET.SubElement(link, kind, name=f"{kind}_{number}")
            line = ET.SubElement(ET.SubElement(part, "geometry"), "polyline")
            for x, y in body.exterior.coords[:-1]:
                _add(line, "point", f"{x:.4f} {y:.4f}")
            _add(line, "height", f"{height}")


def _add_model(world: ET.Element, name: str) -> ET.Element:
    """A model that stands still; returns its only link."""
    model = ET.SubElement(world, "model", name=name)
    _add(model, "static", "true")
    return ET.SubElement(model, "link", name="link")


def _add(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text
