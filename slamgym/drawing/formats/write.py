"""Drawings as files."""

from collections.abc import Sequence
from pathlib import Path

from slamgym.cad.floorplan import map_values
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import write_text
from slamgym.core.types import UNKNOWN, GridFrame, OccupancyGrid
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.evidence import filled
from slamgym.drawing.settings import DRAWING_FORMATS, OUTER_WALL


def write_drawing(drawing: Drawing, stem: Path | str, formats: Sequence[str]) -> list[Path]:
    """Write a drawing in several formats.

    Args:
        drawing: What to write.
        stem: Path of the files without extension: ``out/flat`` for ``out/flat.dxf``.
        formats: Out of :data:`~slamgym.drawing.settings.DRAWING_FORMATS`.

    Returns:
        The files, in the order of the formats.

    Raises:
        SlamgymError: If a file can't be written, or a format is unknown or needs a package that isn't installed.
    """
    unknown = [name for name in formats if name not in DRAWING_FORMATS]
    if unknown:
        raise SlamgymError(
            f"unknown format {unknown[0]!r}; choose from {', '.join(DRAWING_FORMATS)}"
        )
    stem = Path(stem)
    paths = []
    for name in dict.fromkeys(formats):
        path = stem.with_name(f"{stem.name}.{name}")
        if name == "png":
            from slamgym.drawing.formats.png import draw_picture
            from slamgym.viz.canvas import write_picture

            write_picture(path, draw_picture(drawing))
        elif name == "yaml":
            from slamgym.interop.ros_map import write_ros_map

            if stem.is_dir():
                raise InputFileError(
                    stem, "is a folder, into which the ROS map would be written; name another --out"
                )
            write_ros_map(stem, drawing_map(drawing))
        elif name == "keepout.yaml":
            from slamgym.drawing.formats.keepout import keepout_mask
            from slamgym.interop.ros_map import write_ros_map

            write_ros_map(path.with_suffix(""), keepout_mask(drawing))
        else:
            write_text(path, _text(drawing, name))
        paths.append(path)
    return paths


def _text(drawing: Drawing, name: str) -> str:
    """A drawing in one of the formats that are text; what a format needs is imported for it alone."""
    match name:
        case "dxf":
            from slamgym.drawing.formats.dxf import format_dxf

            return format_dxf(drawing)
        case "svg":
            from slamgym.drawing.formats.svg import format_svg

            return format_svg(drawing)
        case "ifc":
            from slamgym.drawing.formats.ifc import format_ifc

            return format_ifc(drawing)
        case "geojson":
            from slamgym.drawing.formats.json import format_geojson

            return format_geojson(drawing)
        case "route.geojson":
            from slamgym.drawing.formats.route_graph import format_route_graph

            return format_route_graph(drawing)
        case "sdf":
            from slamgym.drawing.formats.gazebo import format_world

            return format_world(drawing)
        case "json":
            from slamgym.drawing.formats.json import format_json

            return format_json(drawing)
        case _:
            from slamgym.drawing.formats.html import format_html

            return format_html(drawing)


def drawing_map(drawing: Drawing) -> OccupancyGrid:
    """Draw the floor, seen and inferred, as a map for a robot, in the frame of the map that it was drawn from.

    Floor is free, what bounds it is occupied, all else is unknown.
    """
    cell = drawing.grid.frame.resolution
    frame = GridFrame.covering(drawing.floor.bounds, cell, margin=OUTER_WALL)
    floor = filled(drawing.floor, frame)
    return OccupancyGrid(map_values(floor, cell, UNKNOWN, OUTER_WALL), frame)
