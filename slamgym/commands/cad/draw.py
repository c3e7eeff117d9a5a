"""``slamgym cad``: a map or a folder of maps in, drawings with true dimensions out."""

from __future__ import annotations

import dataclasses
import shlex
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import tyro

from slamgym.commands.extras import TRANSLATING, Extra, require
from slamgym.core.config import Arguments, Positive, Within
from slamgym.core.documents import YAML_SUFFIXES, parse_yaml
from slamgym.core.errors import ConfigError, InputFileError, SlamgymError
from slamgym.core.files import read_text, write_text
from slamgym.core.limits import YAML_BYTES
from slamgym.core.pictures import PICTURE_SUFFIXES
from slamgym.core.progress import counted, say, tell
from slamgym.drawing.settings import DEFAULT_DRAWING, DEFAULT_MODEL

if TYPE_CHECKING:
    from slamgym.drawing import Drawing, FloorModel

BUILDING_MODELS = Extra("ifc", ("ifcopenshell",))
VALETUDO_KEY, VALETUDO_WITHIN = b'"pixelSize"', 1 << 16
"""Of its maps, within their first bytes."""


class CadArguments(Arguments):
    """Draw a SLAM map as an architect would: walls, doors and rooms with true dimensions, in metres.

    What the map holds no evidence of lies in a layer of its own, INFERRED.
    """

    map: Annotated[Path, tyro.conf.Positional]
    """A ROS map's .yaml, Valetudo's .json or .png, a picture of a map (with --resolution), or a folder of those."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the drawings; made if it is missing."""
    formats: str = "dxf,svg,geojson,json,png,html"
    """Any of dxf, svg, ifc, geojson, json, png, html (the report), yaml (a ROS map of the drawing)."""
    model: str = DEFAULT_MODEL
    """Pretrained or other weights; of A+B the second helps where the first leaves out floor that the robot saw;
    ``none`` cleans the map without a network (needs no torch)."""
    angle: Annotated[float, Within(ge=-360.0, le=360.0)] | None = None
    """Direction of the main walls [deg, counter-clockwise from the map's x axis]; found in the map by default."""
    resolution: Positive | None = None
    """Metres of a pixel of pictures that don't say it."""
    opening_width: Positive = DEFAULT_DRAWING.opening_width
    """Wide gaps in a wall up to this are openings that part two rooms [m], e.g. 3; at 1.6 doors alone do."""


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
        require(TRANSLATING, f"--model {arguments.model}", ", or draw without a network by --model none")
    if arguments.out.is_file():
        raise InputFileError(arguments.out, "is a file; drawings are written into a folder")
    if not arguments.map.exists():
        raise InputFileError(
            arguments.map, "doesn't exist; give a map's yaml, a picture of a map or a folder"
        )
    from slamgym.drawing import load_floor_model

    job = _Job(arguments, formats, load_floor_model(arguments.model), shlex.join(["slamgym", "cad", *argv]))
    if arguments.map.is_dir():
        return _draw_folder(_maps_in(arguments.map), job)
    _draw(arguments.map, job)
    return 0


class _Job(NamedTuple):
    """What is done with every map."""

    arguments: CadArguments
    formats: list[str]
    model: FloorModel
    command: str


def _draw_folder(maps: list[Path], job: _Job) -> int:
    """Draw what can be drawn, and a gallery of it; returns the exit code."""
    from slamgym.drawing.report.gallery import GALLERY, GalleryCard, format_gallery

    arguments, with_gallery = job.arguments, "html" in job.formats
    cards, failures, drawn = [], [], 0
    for path in maps:
        try:
            if with_gallery and path.stem == GALLERY.stem:
                raise InputFileError(path, f"is called like the gallery, {GALLERY}; rename it")
            drawing = _draw(path, job)
        except SlamgymError as error:
            failures.append(str(error))
            say(f"skipped {error}")
            continue
        drawn += 1
        if with_gallery:
            cards.append(GalleryCard.of(drawing, path.stem))
    if not drawn:
        raise InputFileError(arguments.map, "holds nothing that could be drawn; see the lines above")
    if with_gallery:
        page = format_gallery(arguments.map.resolve().name, cards, failures, job.command)
        write_text(arguments.out / GALLERY, page)
    tell(f"{drawn} of {counted(len(maps), 'map')} drawn in {arguments.out}")
    return 1 if failures else 0


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
    """ROS maps, and pictures and vacuums' maps that belong to none."""
    files = [path for path in sorted(folder.iterdir()) if path.is_file() and not path.name.startswith(".")]
    maps = [path for path in files if path.suffix.lower() in YAML_SUFFIXES]
    belonging = {path.stem for path in maps}
    maps += [path for path in files if path.stem not in belonging and _may_be_map(path)]
    if not maps:
        raise InputFileError(
            folder,
            f"holds no ROS maps ({', '.join(YAML_SUFFIXES)}), no maps of Valetudo and no pictures of maps",
        )
    return maps


def _may_be_map(path: Path) -> bool:
    """Whether a file without a yaml is a picture or a Valetudo map; folders hold other JSON, too."""
    suffix = path.suffix.lower()
    if suffix == ".json":
        with path.open("rb") as file:
            return VALETUDO_KEY in file.read(VALETUDO_WITHIN)
    return suffix in PICTURE_SUFFIXES


def _draw(path: Path, job: _Job) -> Drawing:
    """Draw one map and say what came of it."""
    from slamgym.drawing import make_drawing, write_drawing
    from slamgym.interop.map_files import read_map

    arguments = job.arguments
    begun = time.process_time()
    robot_map = read_map(path, arguments.resolution)
    stem = arguments.out / path.stem
    suffixes = [*job.formats, "pgm"] if "yaml" in job.formats else job.formats
    _spare_input(path, [stem.with_name(f"{stem.name}.{suffix}") for suffix in suffixes])
    provenance = {"source": str(path), "model": arguments.model, "command": job.command}
    drawing = make_drawing(
        robot_map.grid,
        path.stem,
        job.model,
        dataclasses.replace(DEFAULT_DRAWING, opening_width=arguments.opening_width),
        angle_deg=arguments.angle,
        provenance=provenance,
    )
    drawing = dataclasses.replace(drawing, doubts=(*robot_map.doubts, *drawing.doubts))
    files = write_drawing(drawing, stem, job.formats)
    tell(f"{_summary(drawing)}, {time.process_time() - begun:.1f} CPU s: {files[0].parent}")
    for doubt in drawing.doubts:
        say(f"{path}: {doubt}")
    return drawing


def _spare_input(path: Path, targets: list[Path]) -> None:
    """Refuse to write over the map, or over the picture that its yaml names."""
    sources = [path]
    if path.suffix.lower() in YAML_SUFFIXES:
        sources.append(path.parent / str(parse_yaml(read_text(path, YAML_BYTES), path)["image"]))
    for target in targets:
        if target.exists() and any(source.exists() and target.samefile(source) for source in sources):
            raise InputFileError(target, "is the map itself and would be written over; name another --out")


def _summary(drawing: Drawing) -> str:
    inferred = sum(wall.length for wall in drawing.walls if wall.layer == "INFERRED")
    total = sum(wall.length for wall in drawing.walls)
    return (
        f"{drawing.name}: {drawing.area:.1f} m2, {counted(len(drawing.rooms), 'room')}, "
        f"{counted(len(drawing.doors), 'door')}, {total:.0f} m of wall ({inferred / max(total, 1e-9):.0%} inferred)"
    )
