"""Drawings as files."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from slamgym.cad.floorplan import map_values
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import write_text
from slamgym.core.types import UNKNOWN, GridFrame, OccupancyGrid
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.evidence import filled
from slamgym.drawing.settings import DRAWING_FORMATS

WALL = 0.2
"""Round the floor so much is occupied in a ROS map [m]; a robot sees the walls' faces alone."""


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
    stem, paths = Path(stem), []
    for name in dict.fromkeys(formats):
        path = stem.with_name(f"{stem.name}.{name}")
        if name == "png":
            from slamgym.drawing.formats.png import draw_picture
            from slamgym.viz.canvas import write_picture

            write_picture(path, draw_picture(drawing))
        elif name == "yaml":
            from slamgym.interop.ros_map import write_ros_map

            if stem.is_dir():
                reason = "is a folder, into which the ROS map would be written; name another --out"
                raise InputFileError(stem, reason)
            write_ros_map(stem, drawing_map(drawing))
        else:
            # What a format needs is imported for it alone.
            module = import_module(
                f"slamgym.drawing.formats.{'json' if name == 'geojson' else name}"
            )
            write_text(path, getattr(module, f"format_{name}")(drawing))
        paths.append(path)
    return paths


def drawing_map(drawing: Drawing) -> OccupancyGrid:
    """Draw the floor, seen and inferred, as a map for a robot, in the frame of the map that it was drawn from.

    Floor is free, what bounds it is occupied, all else is unknown.
    """
    cell = drawing.grid.frame.resolution
    frame = GridFrame.covering(drawing.floor.bounds, cell, margin=WALL)
    return OccupancyGrid(map_values(filled(drawing.floor, frame), cell, UNKNOWN, WALL), frame)
