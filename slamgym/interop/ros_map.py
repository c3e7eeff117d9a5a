"""Maps as ROS map_server stores them: an image and a yaml file.

The writer makes the trinary form that ``map_saver`` makes (0 occupied, 205 unknown, 254 free). The reader is
tolerant, because maps in the wild are: unknown is 205 in map_server maps, 127-128 in cartographer's, 220, 204
or 100 elsewhere, and a ``free_thresh`` of 0.25 (nav2's default) would turn 205 into free space. So the cells
are classified by their grey values, and the thresholds of the yaml only fill in where the grey values are
ambiguous.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import yaml

from slamgym.core.config import Share, Within
from slamgym.core.documents import known_fields, parse_yaml
from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes, read_text, write_bytes, write_text
from slamgym.core.geometry import wrap_angle
from slamgym.core.limits import YAML_BYTES, shown
from slamgym.core.pictures import decode_picture, grey_picture
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, GridFrame, OccupancyGrid, Pose2D

OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.196
"""map_saver's own thresholds: the grey value 205 lies between them."""

SMALLEST_CELL = 1e-5
"""Smaller cells are a broken number [m]."""
LARGEST_CELL = 100.0
"""Larger cells are a broken number [m]."""
MAX_ORIGIN = 1e8
"""A map farther from the origin than this is a broken number [m]; UTM coordinates go up to 1e7."""

MIN_UNKNOWN_SHARE = 0.01
"""A grey level between black and white counts as *the* unknown level if this share of the cells has it."""

COMMON_GREYS_SHARE = 0.5
"""The three commonest greys of a map cover at least this share of it (0.79 or more of a hundred maps in the wild)."""


_Place = Annotated[float, Within(ge=-MAX_ORIGIN, le=MAX_ORIGIN)]


@dataclass(frozen=True)
class MapDescription:
    """Contents of a map's yaml file."""

    image: str
    """The picture, in the folder of the file."""
    resolution: Annotated[float, Within(ge=SMALLEST_CELL, le=LARGEST_CELL)]
    """Metres of a cell."""
    origin: tuple[_Place, _Place, float]
    """x and y of the outer corner of the bottom-left cell [m], yaw [rad]."""
    mode: Literal["trinary", "scale", "raw"] = "trinary"
    negate: Literal["0", "1", "false", "true"] = "0"
    occupied_thresh: Share = OCCUPIED_THRESHOLD
    free_thresh: Share = FREE_THRESHOLD


def write_ros_map(destination: Path | str, grid: OccupancyGrid) -> Path:
    """Write ``map.pgm`` and ``map.yaml``.

    Args:
        destination: An existing folder (the files are called ``map``), or the stem of the two files, e.g.
            ``out/flat`` for ``out/flat.pgm`` and ``out/flat.yaml``.
        grid: The map.

    Returns:
        The path of the yaml file.

    Raises:
        InputFileError: If the files can't be written.
    """
    destination = Path(destination)
    if destination.is_dir():
        destination = destination / "map"
    image = destination.with_name(destination.name + ".pgm")
    description = destination.with_name(destination.name + ".yaml")
    rows, cols = grid.cells.shape
    header = b"P5\n%d %d\n255\n" % (cols, rows)
    write_bytes(image, header + np.ascontiguousarray(grid.cells).tobytes())
    # -20.700000000000003 is written as -20.7.
    x = round(float(grid.frame.origin_x), 12)
    y = round(float(grid.frame.origin_y), 12)
    values = {
        "image": image.name,
        "mode": "trinary",
        "resolution": float(grid.frame.resolution),
        "origin": [x, y, 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESHOLD,
        "free_thresh": FREE_THRESHOLD,
    }
    text = yaml.safe_dump(
        values, allow_unicode=True, width=math.inf, sort_keys=False, default_flow_style=None
    )
    # The yaml goes last: where it exists, the image is complete.
    write_text(description, text)
    return description


def read_ros_map(path: Path | str) -> OccupancyGrid:
    """Read a map from its yaml file.

    Args:
        path: The yaml file; the image is looked up in its folder.

    Returns:
        The map with the three values 0, 205 and 254.

    Raises:
        InputFileError: If the yaml or the image is missing or malformed, or the map is rotated.

    Convention: the image's first row is the map's top row (largest y); ``origin`` is the outer corner of its
    bottom-left cell.
    """
    grid, placement = read_turned_map(path)
    if placement.theta != 0.0:
        raise InputFileError(
            path, f"is rotated by {placement.theta}; turn the image and set the yaw to 0"
        )
    return grid


class TurnedMap(NamedTuple):
    """A map whose image may be turned in the map frame."""

    grid: OccupancyGrid  # of a turned map the frame's origin is (0, 0)
    placement: Pose2D  # of the grid's frame in the map frame; zero unless the map is turned


def read_turned_map(path: Path | str) -> TurnedMap:
    """Read a map that may have a yaw; see :func:`read_ros_map`.

    Raises:
        InputFileError: If the yaml or the image is missing or malformed.
    """
    path = Path(path)
    description = _read_description(path)
    occupied = description.occupied_thresh
    free = description.free_thresh
    if not free <= occupied:
        raise InputFileError(path, f"'free_thresh' is {free:g}, above 'occupied_thresh'; swap them")
    is_negated = description.negate in ("1", "true")
    is_raw = description.mode == "raw"
    pixels = _read_pixels(path.parent / description.image, f"; correct 'image' in {path.name}")
    if is_raw and (is_negated or pixels.dtype != np.uint8):
        raise InputFileError(
            path, "has the mode raw, which needs 'negate: 0' and an image of 8 bits a pixel"
        )
    grey, transparent = grey_picture(pixels)
    if is_raw:
        # The occupancy in percent, and 255 (or any value above 100) for unknown.
        cells = np.full(grey.shape, UNKNOWN, np.uint8)
        cells[grey <= 100.0 * free] = FREE
        cells[(grey >= 100.0 * occupied) & (grey <= 100)] = OCCUPIED
    else:
        cells = classify_greys(255 - grey if is_negated else grey, occupied, free)
    cells[transparent] = UNKNOWN
    x, y, yaw = description.origin
    if abs(yaw) < 1e-3:
        frame = GridFrame(description.resolution, x, y, *grey.shape)
        return TurnedMap(OccupancyGrid(cells, frame), Pose2D(0.0, 0.0, 0.0))
    frame = GridFrame(description.resolution, 0.0, 0.0, *grey.shape)
    return TurnedMap(OccupancyGrid(cells, frame), Pose2D(x, y, wrap_angle(yaw)))


def read_bare_map(path: Path | str, resolution: float) -> OccupancyGrid:
    """Read a map's image that has no yaml file, with its origin at (0, 0).

    Args:
        path: The image.
        resolution: Size of a cell [m], which nothing but the user knows.

    Returns:
        The map with the three values 0, 205 and 254.

    Raises:
        InputFileError: If the image is missing or malformed, or has too many shades for a map.
    """
    path = Path(path)
    grey, transparent = grey_picture(_read_pixels(path))
    counts = np.sort(np.bincount(grey.ravel(), minlength=256))
    common = counts[-3:].sum() / grey.size
    if common < COMMON_GREYS_SHARE:
        raise InputFileError(path, f"is no map: its three commonest greys cover {common:.0%} of it")
    cells = classify_greys(grey)
    cells[transparent] = UNKNOWN
    return OccupancyGrid(cells, GridFrame(resolution, 0.0, 0.0, *grey.shape))


def classify_greys(
    grey: ByteArray,
    occupied_thresh: float = OCCUPIED_THRESHOLD,
    free_thresh: float = FREE_THRESHOLD,
) -> ByteArray:
    """Classify the pixels of a map image (dark walls, light free space) as 0, 205 or 254.

    Args:
        grey: Grey values, shape (rows, cols), already un-negated.
        occupied_thresh: Cells with an occupancy (255 - grey) / 255 above this are walls.
        free_thresh: Cells with an occupancy below this are free, where no grey level marks the unknown.

    Returns:
        The cells, shape (rows, cols).
    """
    occupancy = (255.0 - np.arange(256)) / 255.0
    counts = np.bincount(grey.ravel(), minlength=256)
    darkest = math.floor(255.0 * (1.0 - occupied_thresh)) + 1
    # Unknown is the commonest grey between the walls and the lightest common one (free space). White and almost white
    # (253-255) never is; the margin keeps 250 with 254 in free space.
    candidates = np.flatnonzero(counts[:240] >= MIN_UNKNOWN_SHARE * grey.size)
    candidates = candidates[candidates >= darkest]
    unknown = int(candidates[np.argmax(counts[candidates])]) if len(candidates) else None
    if unknown is None:
        is_free = occupancy < free_thresh
    else:
        # A probability map has free cells of every lightness: what is clearly lighter than unknown is free.
        is_free = np.arange(256) > unknown + max(2.0, 0.25 * (FREE - unknown))
    table = np.where(is_free, FREE, UNKNOWN)
    table[occupancy > occupied_thresh] = OCCUPIED
    return table.astype(np.uint8)[grey]


_KEYS = "it needs the keys image, resolution and origin"


def _read_description(path: Path) -> MapDescription:
    values = parse_yaml(read_text(path, YAML_BYTES), path)
    if not isinstance(values, dict):
        raise InputFileError(path, f"is not a map description; {_KEYS}")
    for name in ("image", "resolution", "origin"):
        if name not in values:
            raise InputFileError(path, f"is not a map description: {name!r} is missing; {_KEYS}")
    words = {name: str(values[name]).lower() for name in ("mode", "negate") if name in values}
    keys = ("resolution", "occupied_thresh", "free_thresh")
    numbers = {name: _as_number(values[name]) for name in keys if name in values}
    origin = values.get("origin")
    if isinstance(origin, list):
        numbers["origin"] = [_as_number(value) for value in origin]
        if len(origin) == 2:
            numbers["origin"].append(0.0)
    description = known_fields(MapDescription, {**values, **words, **numbers}, path)
    if not description.image or "\0" in description.image:
        raise InputFileError(
            path, f"'image' is {shown(description.image)}; it names the map's image file"
        )
    return description


def _as_number(value: Any) -> Any:
    """A number that stands in quotes as one; anything else as it is."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def described_picture(path: Path) -> Path:
    """The picture that a map's yaml names.

    Raises:
        InputFileError: If it is malformed or names none.
    """
    return path.parent / _read_description(path).image


def _read_pixels(path: Path, fix: str = "") -> Any:
    try:
        encoded = read_bytes(path)
    except InputFileError as error:
        raise InputFileError(path, f"the map's image {error.reason}{fix}") from error
    return decode_picture(path, encoded)
