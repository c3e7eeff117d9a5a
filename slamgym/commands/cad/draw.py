"""``slamgym cad``: a map or a folder of maps in, drawings with true dimensions out."""

from __future__ import annotations

import dataclasses
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from slamgym.commands.extras import TRANSLATING, Extra, require
from slamgym.core.config import Arguments, Positive, Within
from slamgym.core.documents import YAML_SUFFIXES
from slamgym.core.errors import ConfigError, InputFileError, SlamgymError
from slamgym.core.pictures import PICTURE_SUFFIXES
from slamgym.core.progress import say

if TYPE_CHECKING:
    from slamgym.drawing import Drawing, FloorModel

BUILDING_MODELS = Extra("ifc", ("ifcopenshell",))


class CadArguments(Arguments):
    """Draw a SLAM map as an architect would: walls, doors and rooms with true dimensions, in metres.

    What the map holds no evidence of lies in a layer of its own, INFERRED.
    """

    map: Annotated[Path, tyro.conf.Positional]
    """A ROS map's .yaml, Valetudo's .json or .png, a picture of a map (with --resolution), or a folder of those."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the drawings; made if it is missing."""
    formats: str = "dxf,svg,geojson,json,png"
    """Any of dxf, svg, ifc, geojson, json, png, with commas between."""
    model: str = "slam2cad"
    """``slam2cad`` or other weights; ``none`` cleans the map without a network (needs no torch)."""
    angle: Annotated[float, Within(ge=-360.0, le=360.0)] | None = None
    """Direction of the main walls [deg, counter-clockwise from the map's x axis]; found in the map by default."""
    resolution: Positive | None = None
    """Metres of a pixel of pictures that don't say it."""


def main(argv: list[str]) -> int:
    """Run the command.

    Returns:
        The exit code: 1 if some maps of a folder couldn't be drawn, else 0.

    Raises:
        SlamgymError: If an argument or the map can't be used.
    """
    arguments = tyro.cli(CadArguments, args=argv, prog="slamgym cad")
    formats = _formats(arguments.formats)
    if arguments.model != "none":
        require(TRANSLATING, f"--model {arguments.model}")
    if arguments.out.is_file():
        raise InputFileError(arguments.out, "is a file; drawings are written into a folder")
    if not arguments.map.exists():
        raise InputFileError(
            arguments.map, "doesn't exist; give a map's yaml, a picture of a map or a folder"
        )
    from slamgym.drawing import load_floor_model

    maps = _maps_in(arguments.map) if arguments.map.is_dir() else [arguments.map]
    model = load_floor_model(arguments.model)
    if not arguments.map.is_dir():
        _draw(maps[0], arguments, formats, model)
        return 0
    failed = 0
    for path in maps:
        try:
            _draw(path, arguments, formats, model)
        except SlamgymError as error:
            failed += 1
            say(f"skipped {error}")
    if failed == len(maps):
        raise InputFileError(arguments.map, "holds nothing that could be drawn; see the lines above")
    sys.stdout.write(f"{len(maps) - failed} of {len(maps)} maps drawn in {arguments.out}\n")
    return 1 if failed else 0


def _formats(text: str) -> list[str]:
    from slamgym.drawing.formats.names import DRAWING_FORMATS

    formats = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in formats if name not in DRAWING_FORMATS]
    if unknown or not formats:
        raise ConfigError(f"--formats must be any of {', '.join(DRAWING_FORMATS)}, not {text!r}")
    if "ifc" in formats:
        require(BUILDING_MODELS, "--formats ifc")
    return formats


def _maps_in(folder: Path) -> list[Path]:
    """ROS maps, and pictures that belong to none."""
    files = [path for path in sorted(folder.iterdir()) if path.is_file() and not path.name.startswith(".")]
    maps = [path for path in files if path.suffix.lower() in YAML_SUFFIXES]
    belonging = {path.stem for path in maps}
    maps += [path for path in files if path.suffix.lower() in PICTURE_SUFFIXES and path.stem not in belonging]
    if not maps:
        raise InputFileError(
            folder, f"holds no ROS maps ({', '.join(YAML_SUFFIXES)}) and no pictures of maps"
        )
    return maps


def _draw(path: Path, arguments: CadArguments, formats: list[str], model: FloorModel) -> None:
    """Draw one map and say what came of it."""
    from slamgym.drawing import make_drawing, write_drawing
    from slamgym.interop.map_files import read_map

    begun = time.process_time()
    robot_map = read_map(path, arguments.resolution)
    provenance = {"source": str(path), "model": arguments.model}
    drawing = make_drawing(robot_map.grid, path.stem, model, angle_deg=arguments.angle, provenance=provenance)
    drawing = dataclasses.replace(drawing, doubts=(*robot_map.doubts, *drawing.doubts))
    files = write_drawing(drawing, arguments.out / path.stem, formats)
    sys.stdout.write(f"{_summary(drawing)}, {time.process_time() - begun:.1f} CPU s: {files[0].parent}\n")
    for doubt in drawing.doubts:
        say(f"{path}: {doubt}")


def _summary(drawing: Drawing) -> str:
    inferred = sum(wall.length for wall in drawing.walls if wall.layer == "INFERRED")
    total = sum(wall.length for wall in drawing.walls)
    return (
        f"{drawing.name}: {drawing.area:.1f} m2, {len(drawing.rooms)} rooms, {len(drawing.doors)} doors, "
        f"{total:.0f} m of wall ({inferred / max(total, 1e-9):.0%} inferred)"
    )
