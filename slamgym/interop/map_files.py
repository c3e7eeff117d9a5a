"""A person's map of any kind: from ROS, from cartographer or slam_toolbox, from a robot vacuum, or a bare picture.

cartographer (``cartographer_pbstream_to_ros_map``) and slam_toolbox (``save_map``) write the yaml and the picture of
ROS; :func:`slamgym.interop.read_ros_map` copes with their greys. Whatever comes, what is no map is refused here, once.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from slamgym.core.documents import YAML_SUFFIXES, read_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes
from slamgym.core.pictures import PICTURE_SUFFIXES
from slamgym.core.types import FREE, OCCUPIED, OccupancyGrid, Pose2D
from slamgym.interop.ros_map import LARGEST_CELL, SMALLEST_CELL, read_bare_map, read_turned_map
from slamgym.interop.valetudo import MapSegment, embedded_map, parse_valetudo

MAP_SUFFIXES = (*YAML_SUFFIXES, *PICTURE_SUFFIXES, ".json")
"""Names of files with a map end so."""
MIN_FREE = 50
"""Fewer free cells are no map."""
USUAL_CELLS = (0.008, 0.15)
"""Cells of maps of buildings; others are doubtful [m]."""
USUAL_EXTENT = (2.0, 500.0)
"""Longest side of what is free in a map of a building; others are doubtful [m]."""


@dataclass(frozen=True)
class RobotMap:
    """A robot's map, ready for use."""

    grid: OccupancyGrid
    segments: tuple[MapSegment, ...] = ()
    """Rooms that the map itself names."""
    doubts: tuple[str, ...] = ()
    """Sentences about what is odd, the scale above all."""
    placement: Pose2D = Pose2D(0.0, 0.0, 0.0)
    """Pose of the grid's frame in the map frame; zero unless a ROS map's image is turned there."""


def read_map(path: Path | str, resolution: float | None = None) -> RobotMap:
    """Read a map.

    Args:
        path: A ROS map's yaml, or its picture with the yaml of the same name next to it; the folder of ``map.yaml``; a
            Valetudo map (``.json``, or a ``.png`` that holds it); a picture without any of these.
        resolution: Metres of a cell. Needed for a picture alone; else the file's own counts, so it must be None.

    Raises:
        InputFileError: If it can't be read, says no size of its cells, or is no map: nothing free, nothing occupied.
    """
    path = Path(path)
    found = _read(path, resolution)
    return replace(found, doubts=(*found.doubts, *_check(found.grid, path)))


def _read(path: Path, resolution: float | None) -> RobotMap:
    suffix = path.suffix.lower()
    if path.is_dir():
        return _read(_description_in(path), resolution)
    if suffix in (*YAML_SUFFIXES, ".json"):
        _refuse_resolution(path, resolution)
    if suffix in YAML_SUFFIXES:
        return _read_ros(path)
    if suffix == ".json":
        return RobotMap(*parse_valetudo(read_json(path), path))
    if suffix in PICTURE_SUFFIXES:
        return _read_picture(path, resolution)
    if suffix == ".pbstream":
        raise InputFileError(
            path,
            "is cartographer's own state; write a map of it by cartographer_pbstream_to_ros_map "
            "-pbstream_filename FILE -map_filestem map, and give map.yaml",
        )
    raise InputFileError(
        path, "is no known kind of map; give a ROS .yaml, a picture or a Valetudo .json"
    )


def _description_in(folder: Path) -> Path:
    """The yaml file of the map in a folder."""
    found = [*folder.glob("*.yaml"), *folder.glob("*.yml")]
    if len(found) == 1:
        return found[0]
    if folder / "map.yaml" in found:
        return folder / "map.yaml"
    raise InputFileError(
        folder, f"holds {len(found)} yaml files; name the one that describes the map"
    )


def _read_ros(path: Path) -> RobotMap:
    grid, placement = read_turned_map(path)
    if placement.theta == 0.0:
        return RobotMap(grid)
    turned = (
        f"the image is turned by {math.degrees(placement.theta):.1f} deg in the map frame; coordinates are the "
        "image's, from its lower left corner"
    )
    return RobotMap(grid, doubts=(turned,), placement=placement)


def _read_picture(path: Path, resolution: float | None) -> RobotMap:
    value = embedded_map(read_bytes(path), path) if path.suffix.lower() == ".png" else None
    if value is not None:
        _refuse_resolution(path, resolution)
        return RobotMap(*parse_valetudo(value, path))
    if resolution is None:
        for suffix in YAML_SUFFIXES:
            if path.with_suffix(suffix).exists():
                return _read_ros(path.with_suffix(suffix))
        raise InputFileError(
            path, "is a picture without a yaml; give its metres per pixel by --resolution"
        )
    if not (math.isfinite(resolution) and SMALLEST_CELL <= resolution <= LARGEST_CELL):
        raise InputFileError(
            path, f"its resolution is {resolution}; it must be metres per pixel, above 0"
        )
    return RobotMap(read_bare_map(path, resolution))


def _refuse_resolution(path: Path, resolution: float | None) -> None:
    if resolution is not None:
        raise InputFileError(path, "says itself how large its cells are; leave the resolution out")


def _check(grid: OccupancyGrid, path: Path) -> tuple[str, ...]:
    """Refuse what is no map, and say what is doubtful."""
    free = grid.cells == FREE
    occupied = grid.cells == OCCUPIED
    cell = grid.frame.resolution
    if not free.any():
        raise InputFileError(
            path, "is no map: none of its cells is free; check its thresholds, or negate it"
        )
    if not occupied.any():
        raise InputFileError(path, "is no map: none of its cells is occupied; check its thresholds")
    if free.sum() < MIN_FREE:
        raise InputFileError(
            path, f"is no map: it has {free.sum()} free cells, fewer than {MIN_FREE}"
        )
    rows = np.flatnonzero(free.any(axis=1))
    cols = np.flatnonzero(free.any(axis=0))
    height = int(rows[-1] - rows[0])
    width = int(cols[-1] - cols[0])
    extent = cell * max(height, width) + cell
    doubts = []
    if not USUAL_CELLS[0] <= cell <= USUAL_CELLS[1]:
        doubts.append(f"scale doubtful: its cells measure {cell:g} m")
    if not USUAL_EXTENT[0] <= extent <= USUAL_EXTENT[1]:
        doubts.append(f"scale doubtful: what is free measures {extent:.1f} m")
    return tuple(doubts)
