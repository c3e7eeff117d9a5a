"""Maps of robot vacuums as Valetudo exports them: JSON, or a PNG that carries it.

Sources: https://valetudo.cloud/pages/development/valetudo-core-concepts.html (whole numbers, centimetres, origin at the
top left); ``MapLayer.js`` and ``ValetudoMap.openapi.json`` of https://github.com/Hypfer/Valetudo; its release notes
2021.12.0: version 1 stores ``pixels`` as x, y, x, y, ...; version 2 stores ``compressedPixels`` as x, y, count, ...,
``count`` pixels from x to the right. Layers are ``floor``, ``segment`` (a room; ``metaData`` has its id and perhaps a
name) and ``wall``. A PNG that the map card of Home Assistant shows has
the deflated JSON in a ``zTXt`` chunk of the name ``ValetudoMap``.
"""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.documents import parse_json
from slamgym.core.errors import InputFileError
from slamgym.core.limits import DOCUMENT_BYTES, ENTRIES, PIXELS, shown
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    BoolArray,
    GridFrame,
    IntArray,
    OccupancyGrid,
)

CHUNK = b"ValetudoMap"
"""Name of the text chunk that holds the map in a PNG."""
PIXEL_SIZES = (0.5, 100.0)
"""Cells of another size are a broken number [cm]; robots have 5."""
MAX_PIXEL = 1 << 20
"""Pixels farther from the origin than this are a broken number."""
_MAX_NAME = 100
"""Characters of a segment's name."""


@dataclass(frozen=True)
class MapSegment:
    """A room that the robot, or its owner, has marked."""

    name: str
    cells: BoolArray  # (rows, cols), the shape of the map


def parse_valetudo(value: Any, where: Path | str) -> tuple[OccupancyGrid, tuple[MapSegment, ...]]:
    """Read a map and its rooms from a JSON value.

    Args:
        value: The value.
        where: The file, for errors.

    Raises:
        InputFileError: If it isn't a Valetudo map, or one of its numbers makes no sense.
    """
    if not (isinstance(value, dict) and "pixelSize" in value and "layers" in value):
        raise InputFileError(where, "is no Valetudo map; it needs the keys pixelSize and layers")
    size = value.get("size")
    pixel = value["pixelSize"]
    if not (_is_number(pixel) and PIXEL_SIZES[0] <= pixel <= PIXEL_SIZES[1]):
        raise InputFileError(
            where, f"'pixelSize' is {shown(pixel)}; it must be the centimetres of a pixel"
        )
    # y = 0 of the map's frame lies so far below its top.
    height = size.get("y", 0) if isinstance(size, dict) else 0
    if not (_is_number(height) and abs(height) < 1e7):
        raise InputFileError(where, f"'size' is {shown(size)}; it must be x and y in centimetres")
    layers = _layers(value["layers"] or [], where)
    left, top, rows, cols = _extent(layers, where)
    cells = np.full((rows, cols), UNKNOWN, np.uint8)
    for kind, grey in (("floor", FREE), ("segment", FREE), ("wall", OCCUPIED)):
        for layer in layers:
            if layer.kind == kind:
                layer.paint(cells, left, top, grey)
    segments = []
    for number, layer in enumerate(layers):
        if layer.kind == "segment":
            mask = np.zeros((rows, cols), np.bool_)
            layer.paint(mask, left, top, True)
            segments.append(MapSegment(layer.name or f"segment {number}", mask))
    resolution = 0.01 * float(pixel)
    bottom = 0.01 * height - (top + rows) * resolution
    frame = GridFrame(resolution, left * resolution, bottom, rows, cols)
    return OccupancyGrid(cells, frame), tuple(segments)


def _layers(entries: Any, where: Path | str) -> list["_Layer"]:
    """The layers that have pixels."""
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputFileError(where, "'layers' is not a list of objects")
    ENTRIES.check(where, len(entries))
    every = [_layer(entry, where) for entry in entries]
    layers = [layer for layer in every if len(layer.runs)]
    if not layers:
        raise InputFileError(
            where, "has no pixels of floor, rooms or walls; let the robot map first"
        )
    return layers


def _extent(layers: list["_Layer"], where: Path | str) -> tuple[int, int, int, int]:
    """The leftmost column and topmost row of the map [px], and the number of its rows and columns."""
    runs = np.vstack([layer.runs for layer in layers])
    left, top = runs[:, :2].min(axis=0).tolist()
    right = int((runs[:, 0] + runs[:, 2]).max())
    bottom = int(runs[:, 1].max()) + 1
    rows = bottom - top
    cols = right - left
    # A few bytes stand for a million pixels: what all runs paint, and the masks of all segments, are counted before.
    painted = int(runs[:, 2].sum())
    masks = sum(layer.kind == "segment" for layer in layers)
    PIXELS.check(where, max(painted, rows * cols * (1 + masks)))
    return left, top, rows, cols


def embedded_map(content: bytes, where: Path | str) -> Any:
    """Read the JSON value of the map in a PNG; None if it has none.

    Args:
        content: The PNG file.
        where: Its name, for errors.

    Raises:
        InputFileError: If the chunk is damaged or expands too much.
    """
    place = 8
    while place + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, place)
        kind = content[place + 4 : place + 8]
        data = content[place + 8 : place + 8 + length]
        if kind == b"zTXt" and data.startswith(CHUNK + b"\0"):
            inflate = zlib.decompressobj()
            try:
                text = inflate.decompress(data[len(CHUNK) + 2 :], DOCUMENT_BYTES.value + 1)
            except zlib.error:
                raise InputFileError(
                    where, "has a damaged ValetudoMap chunk; export the map again"
                ) from None
            return parse_json(text, where)
        place += 12 + length
    return None


class _Layer(NamedTuple):
    kind: str
    name: str
    runs: IntArray  # (N, 3) x, y, count; counts above 0

    def paint(self, cells: Any, left: int, top: int, value: int) -> None:
        """Set the layer's pixels in an array whose first pixel is at (left, top)."""
        for x, y, count in (self.runs - [left, top, 0]).tolist():
            cells[y, x : x + count] = value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _layer(layer: Mapping[str, Any], where: Path | str) -> _Layer:
    kind = layer.get("type")
    about = layer.get("metaData") or {}
    if kind not in ("floor", "segment", "wall"):
        return _Layer("other", "", np.empty((0, 3), np.int64))
    if not isinstance(about, dict):
        raise InputFileError(
            where, f"has a layer whose metaData is {shown(about)}; it must be an object"
        )
    runs = _numbers(layer, "compressedPixels", 3, where)
    if (runs[:, 2] < 0).any():
        raise InputFileError(where, "has a run of pixels of a negative length")
    if not len(runs):
        pixels = _numbers(layer, "pixels", 2, where)
        runs = np.pad(pixels, ((0, 0), (0, 1)), constant_values=1)
    name = about.get("name") or about.get("segmentId") or ""
    name = str(name)[:_MAX_NAME] if isinstance(name, str | int) else ""
    return _Layer(str(kind), name, runs[runs[:, 2] > 0])


def _numbers(layer: Mapping[str, Any], key: str, group: int, where: Path | str) -> IntArray:
    """A flat list of whole numbers in groups, shape (N, group)."""
    values = layer.get(key) or []
    # numpy would give every item the size of the longest text among them.
    is_whole = isinstance(values, list) and all(type(number) is int for number in values)
    if not is_whole or len(values) % group or max(map(abs, values), default=0) > MAX_PIXEL:
        raise InputFileError(
            where, f"'{key}' of a layer is no list of whole numbers in groups of {group}"
        )
    return np.array(values, np.int64).reshape(-1, group)
