"""``slamgym cad``: a map or a folder of maps in, drawings with true dimensions out."""

from __future__ import annotations

import dataclasses
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import tyro

from slamgym.commands.frame import (
    TRANSLATING,
    Extra,
    Out,
    maps_in,
    require,
    require_folder,
    require_input,
)
from slamgym.core.config import Arguments, Positive, Within
from slamgym.core.documents import YAML_SUFFIXES
from slamgym.core.errors import ConfigError, InputFileError, SlamgymError
from slamgym.core.files import read_bytes, shown_path, spare_inputs, write_text
from slamgym.core.names import distinct_names
from slamgym.core.pictures import PICTURE_SUFFIXES
from slamgym.core.progress import counted, say, tell
from slamgym.drawing.settings import DEFAULT_MODEL, DRAWING_FORMATS

if TYPE_CHECKING:
    from slamgym.core.types import OccupancyGrid
    from slamgym.drawing import Drawing, FloorModel

BUILDING_MODELS = Extra("ifc", ("ifcopenshell",))
VALETUDO_KEY = b'"pixelSize"'
"""Key that identifies a Valetudo map."""
VALETUDO_WITHIN = 1 << 16
"""Number of first bytes of a Valetudo map in which its key is found."""


class CadArguments(Arguments):
    """Draw a SLAM map as an architect would: walls, doors and rooms with true dimensions, in metres.

    What the map holds no evidence of lies in a separate layer, INFERRED.
    """

    maps: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """A ROS map's .yaml, Valetudo's .json or .png, a picture of a map (with --resolution), or a folder of those; or
    several."""
    out: Out
    """Folder of the drawings; made if it is missing."""
    formats: str = "dxf,svg,geojson,json,png,html"
    """Any of dxf, svg, ifc, geojson, json, png, html (the report), yaml (a ROS map of the drawing); for robots
    keepout.yaml (a mask for Nav2's filter), route.geojson (a graph for its route server), sdf (a Gazebo world)."""
    model: str = DEFAULT_MODEL
    """The package's network, other weights (which need torch), or ``none``, which cleans the map without a network."""
    angle: Annotated[float, Within(ge=-360.0, le=360.0)] | None = None
    """Direction of the main walls [deg, counter-clockwise from the map's x axis]; found in the map by default."""
    resolution: Positive | None = None
    """Metres of a pixel of pictures that don't say it."""
    corrections: Path | None = None
    """A person's corrections of the drawing of one map, NAME.corrections.json, which the report saves."""


def main(arguments: CadArguments, typed: str) -> int:
    """Run the command.

    Returns:
        The exit code: 1 if some maps of a folder couldn't be drawn, or less than half of a map's seen floor, else 0.

    Raises:
        SlamgymError: If an argument or the map can't be used.
    """
    for path in arguments.maps:
        require_input(path, "a map's yaml, a picture of a map or a folder")
    formats = _formats(arguments.formats)
    if arguments.model not in (DEFAULT_MODEL, "none"):
        require(TRANSLATING, f"--model {arguments.model}", f", or draw by --model {DEFAULT_MODEL}")
    require_folder(arguments.out)
    maps: list[Path] = []
    for path in arguments.maps:
        if path.is_dir():
            maps += maps_in(path, _may_be_map, "maps of Valetudo and no pictures of maps")
        else:
            maps.append(path)
    if not maps:
        raise ConfigError("no map is named; give a map's yaml, a picture of a map or a folder")
    if arguments.corrections and (len(maps) > 1 or arguments.maps[0].is_dir()):
        raise ConfigError("--corrections are of one map; name the file of that map alone")
    named = dict(zip(distinct_names(maps), maps, strict=True))
    from slamgym.core.freed_memory import keep_freed_memory
    from slamgym.drawing import load_floor_model

    keep_freed_memory()
    job = _Job(arguments, formats, load_floor_model(arguments.model), typed)
    if len(arguments.maps) > 1 or arguments.maps[0].is_dir():
        return _draw_all(named, job)
    return int(_draw(maps[0].stem, maps[0], job).is_half)


class _Job(NamedTuple):
    """Common to all maps of a call."""

    arguments: CadArguments
    formats: list[str]
    model: FloorModel
    command: str


def _draw_all(maps: dict[str, Path], job: _Job) -> int:
    """Draw what can be drawn, and an index of the reports; returns the exit code."""
    from slamgym.drawing.formats.html import INDEX, checks, format_index

    arguments = job.arguments
    with_index = "html" in job.formats
    reports = []
    failures = []
    are_half = 0
    for name, path in maps.items():
        try:
            if with_index and name == INDEX.stem:
                raise InputFileError(path, f"is called like the index, {INDEX}; rename it")
            drawing = _draw(name, path, job)
            reports.append((name, checks(drawing)))
            are_half += drawing.is_half
        except SlamgymError as error:
            failures.append(str(error))
            say(f"skipped {error}")
    given = shown_path(", ".join(map(str, arguments.maps)))
    if not reports:
        raise InputFileError(given, "holds nothing that could be drawn; see the lines above")
    if with_index:
        title = arguments.maps[0].resolve().name if len(arguments.maps) == 1 else given
        write_text(arguments.out / INDEX, format_index(title, reports, failures, job.command))
    tell(f"{len(reports)} of {counted(len(maps), 'map')} drawn in {arguments.out}")
    return 1 if failures or are_half else 0


def _formats(text: str) -> list[str]:
    formats = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in formats if name not in DRAWING_FORMATS]
    if unknown or not formats:
        raise ConfigError(f"--formats must be any of {', '.join(DRAWING_FORMATS)}, not {text!r}")
    if "ifc" in formats:
        require(BUILDING_MODELS, "--formats ifc")
    return formats


def _may_be_map(path: Path) -> bool:
    """True if a file without a yaml is a picture or a Valetudo map; folders hold other JSON, too."""
    suffix = path.suffix.lower()
    if suffix == ".json":
        with path.open("rb") as file:
            return VALETUDO_KEY in file.read(VALETUDO_WITHIN)
    return suffix in PICTURE_SUFFIXES


def _draw(name: str, path: Path, job: _Job) -> Drawing:
    """Draw one map under a name and say what came of it."""
    from slamgym.drawing import make_drawing, write_drawing
    from slamgym.drawing.edits import read_corrections
    from slamgym.drawing.given_names import with_given_names
    from slamgym.interop.map_files import read_map

    arguments = job.arguments
    begun = time.process_time()
    robot_map = read_map(path, arguments.resolution)
    stem = arguments.out / name
    pictures = [name.replace("yaml", "pgm") for name in job.formats if name.endswith("yaml")]
    _spare_files(path, robot_map.grid, stem, [*job.formats, *pictures])
    corrections = None
    if arguments.corrections is not None:
        corrections = read_corrections(arguments.corrections)
    drawing = make_drawing(
        robot_map.grid,
        name,
        job.model,
        angle_deg=arguments.angle,
        provenance={"source": str(path), "model": arguments.model, "command": job.command},
        corrections=corrections,
    )
    drawing = with_given_names(drawing, robot_map.segments, robot_map.grid.frame)
    drawing = dataclasses.replace(drawing, doubts=(*robot_map.doubts, *drawing.doubts))
    files = write_drawing(drawing, stem, job.formats)
    total = sum(wall.length for wall in drawing.walls)
    inferred = sum(wall.length for wall in drawing.walls if wall.layer == "INFERRED")
    left_out = ""
    if drawing.left_out_area >= 0.5:
        left_out = f", left out {drawing.left_out_area:.0f} m2 of seen floor"
        left_out += " (more than half)" * drawing.is_half
    tell(
        f"{drawing.name}: {drawing.area:.1f} m2{left_out}, {counted(len(drawing.rooms), 'room')}, "
        f"{counted(len(drawing.doors), 'door')}, {total:.0f} m of wall ({inferred / max(total, 1e-9):.0%} inferred), "
        f"{time.process_time() - begun:.1f} CPU s: {files[0].parent}"
    )
    for doubt in drawing.doubts:
        say(f"{path}: {doubt}")
    return drawing


def _spare_files(path: Path, grid: OccupancyGrid, stem: Path, suffixes: list[str]) -> None:
    """Refuse to write over the map, the picture that its yaml names, or the drawing of another map."""
    from slamgym.drawing.edits import map_digest
    from slamgym.interop.ros_map import described_picture

    sources = [path, described_picture(path)] if path.suffix.lower() in YAML_SUFFIXES else [path]
    for suffix in suffixes:
        spare_inputs(sources, stem.with_name(f"{stem.name}.{suffix}"))
    older = stem.with_name(f"{stem.name}.json")
    if not older.is_file():
        return
    # Drawn anew by the same path, or by another path to the same cells.
    of_this_map = (json.dumps(str(path)), map_digest(grid))
    written = read_bytes(older)
    if not any(text.encode() in written for text in of_this_map):
        raise InputFileError(older, f"is no drawing of {path}; name another --out, or remove it")
