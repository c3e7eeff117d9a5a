"""Maps of real robots beside their translations: to be looked at, since nobody drew the CAD map."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, ByteArray, OccupancyGrid
from slamgym.gan.encoding import resample_slam
from slamgym.gan.translation.classical import clean_map
from slamgym.gan.translation.translate import Translator
from slamgym.interop import read_ros_map

UNKNOWN_BORDER_PX = 8
FINEST = 0.04
"""Maps with smaller cells are brought to this scale: networks and sizes in pixels are made for 5 cm [m]."""
LARGEST_PX = 1600
"""Maps are shrunk to this side at most: pictures show no more."""


def find_ros_maps(folder: Path) -> list[Path]:
    """The yaml files of a folder and its subfolders, sorted.

    Raises:
        InputFileError: If there is none.
    """
    found = sorted(path for pattern in ("*.yaml", "*.yml") for path in folder.rglob(pattern))
    if not found:
        raise InputFileError(folder, "holds no ROS maps (.yaml); name a folder of them")
    return found


def working_map(grid: OccupancyGrid) -> tuple[ByteArray, float]:
    """What is known of a map, with a margin, at a scale that can be worked with.

    Args:
        grid: Any map.

    Returns:
        The cells (rows, cols) and their metres per pixel.
    """
    known = grid.cells != UNKNOWN
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    cells = grid.cells
    if len(rows):
        cells = cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    scale = grid.frame.resolution
    factor = min(1.0, scale / FINEST, LARGEST_PX / max(cells.shape))
    shape = (max(1, round(cells.shape[0] * factor)), max(1, round(cells.shape[1] * factor)))
    return np.pad(resample_slam(cells, shape), UNKNOWN_BORDER_PX, constant_values=UNKNOWN), scale / factor


def translate_real(
    paths: Sequence[Path],
    translators: dict[str, Translator],
    warn: Callable[[str], None],
) -> tuple[list[str], list[list[ByteArray]], list[str]]:
    """Translate maps of real robots, by the cleaning without learning and by every translator.

    Args:
        paths: Their yaml files; one that can't be read is left out with a warning.
        translators: By name.
        warn: Takes the warnings.

    Returns:
        Titles of the columns, for each map a row of pictures, and a caption per row.
    """
    rows, captions = [], []
    for path in paths:
        try:
            cells, scale = working_map(read_ros_map(path))
        except SlamgymError as error:
            warn(f"left out: {error}")
            continue
        row = [cells, _drawn(clean_map(cells, scale))]
        row += [_drawn(t.translate(cells, scale) >= 0.5) for t in translators.values()]
        rows.append(row)
        height, width = (n * scale for n in cells.shape)
        captions.append(f"{path.stem[:60]}: {width:.0f} x {height:.0f} m, {scale:.3f} m/px")
    return ["SLAM map of a real robot", "classical cleaning", *translators], rows, captions


def _drawn(free: np.ndarray) -> ByteArray:
    return np.where(free, FREE, OCCUPIED).astype(np.uint8)
