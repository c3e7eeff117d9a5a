"""Find the SLAM-like maps that were generated from a set of CAD maps, one file per pair.

Three layouts of a folder are taken, by the names of the pairs::

    FOLDER/<name>.png            as `slamgym gan translate IMAGES/test/A` writes them
    FOLDER/B/<name>.png          a folder of pairs
    FOLDER/<name>/.../map.yaml   a ROS map and the cad.png it was made from, as `slamgym deform` writes them: the
                                 first one in the folder, laid over the pair's CAD map
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.geometry import paste
from slamgym.core.types import UNKNOWN, BoolArray, ByteArray
from slamgym.gan.data import SUFFIXES, PairSet, read_grey
from slamgym.gan.encoding import resample_grey
from slamgym.interop import read_ros_map
from slamgym.interop.ros_map import classify_greys
from slamgym.metrics import displacement_statistics, map_statistics
from slamgym.metrics.maps import resample_slam

MINIMUM = 10
"""A test on fewer maps says nothing."""


def parse_named_folders(arguments: list[str]) -> dict[str, Path]:
    """Read ``NAME=FOLDER`` arguments.

    Raises:
        ConfigError: If one has another form, or a name is given twice.
        InputFileError: If a folder doesn't exist.
    """
    folders: dict[str, Path] = {}
    for argument in arguments:
        name, equals, folder = argument.partition("=")
        if not (equals and name and folder):
            raise ConfigError(f"--generated takes NAME=FOLDER, e.g. modelprog=out/maps, not {argument!r}")
        if name in folders:
            raise ConfigError(f"--generated names {name!r} twice")
        if not Path(folder).is_dir():
            raise InputFileError(folder, "is not a folder of generated maps")
        folders[name] = Path(folder)
    return folders


def load_generated(folder: Path, pairs: PairSet) -> tuple[PairSet, ByteArray]:
    """Read the maps that were made of a set's CAD maps.

    Args:
        folder: See the module.
        pairs: The set.

    Returns:
        The pairs that have a map, and the maps (N, S, S) in their size and frame: 0, 205, 254.

    Raises:
        InputFileError: If a file is malformed, or fewer than :data:`MINIMUM` pairs have one.
    """
    found = [(index, path) for index, name in enumerate(pairs.names) if (path := _find(folder, name))]
    if len(found) < MINIMUM:
        what = f"holds maps of {len(found)} of the {len(pairs)} test pairs, but {MINIMUM} are needed"
        raise InputFileError(folder, f"{what}; name them like the pairs, e.g. {pairs.names[0]}.png")
    maps = [_load(path, pairs.cad[index], pairs.scale(index)) for index, path in found]
    return pairs.subset([index for index, _ in found]), np.stack(maps)


def _find(folder: Path, name: str) -> Path | None:
    images = (base / f"{name}{suffix}" for base in (folder, folder / "B") for suffix in SUFFIXES)
    found = [path for path in images if path.is_file()] or sorted((folder / name).rglob("map.yaml"))
    return found[0] if found else None


def _load(path: Path, cad: ByteArray, metres_per_px: float) -> ByteArray:
    """Read a map and bring it into the frame of the CAD map of its pair."""
    if path.suffix != ".yaml":
        grey = read_grey(path)
        if grey.shape[0] != grey.shape[1]:
            raise InputFileError(path, f"has shape {grey.shape}; the map of a square CAD map is square")
        return resample_slam(classify_greys(grey), cad.shape)
    grid = read_ros_map(path)
    own_cad = read_grey(path.with_name("cad.png"))
    if own_cad.shape != grid.cells.shape:
        raise InputFileError(path.with_name("cad.png"), "has another size than the map beside it")
    factor = grid.frame.resolution / metres_per_px
    shape = (max(1, round(own_cad.shape[0] * factor)), max(1, round(own_cad.shape[1] * factor)))
    inside = resample_grey(own_cad, shape) > 127
    if not inside.any() or not (cad > 127).any():
        raise InputFileError(path.with_name("cad.png"), "shows no floor")
    (top, left), (wanted_top, wanted_left) = _middle(inside), _middle(cad > 127)
    return shifted(resample_slam(grid.cells, shape), cad.shape, wanted_top - top, wanted_left - left)


def _middle(mask: BoolArray) -> tuple[float, float]:
    """Row and column of the middle of the bounding box."""
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return 0.5 * float(rows[0] + rows[-1]), 0.5 * float(cols[0] + cols[-1])


def shifted(cells: ByteArray, shape: tuple[int, ...], down: float, right: float) -> ByteArray:
    """Put a map on a canvas of unknown space of this shape; what extends beyond it is cut off.

    Args:
        cells: (H, W).
        shape: (rows, cols) of the canvas.
        down: Row of the canvas at which the map's first row lies, rounded; may be negative.
        right: The same for columns.
    """
    canvas = np.full(shape, UNKNOWN, np.uint8)
    paste(canvas, cells, -round(down), -round(right))
    return canvas


Statistics = list[dict[str, float]]


@dataclass(frozen=True)
class Sample:
    """SLAM-like maps of one kind, and what they were made from."""

    plans: list[str]
    statistics: Statistics

    @staticmethod
    def of(maps: ByteArray, pairs: PairSet) -> "Sample":
        """Describe maps that were made from the CAD maps of a set of pairs.

        Args:
            maps: (N, S, S): 0, 205, 254.
            pairs: Their CAD maps, plans and scales.
        """
        return Sample(list(pairs.plan_ids), describe_maps(maps, pairs))

    def subset(self, indices: Sequence[int]) -> "Sample":
        """The maps with these indices."""
        return Sample([self.plans[i] for i in indices], [self.statistics[i] for i in indices])


def describe_maps(maps: ByteArray, pairs: PairSet) -> Statistics:
    """Statistics of each map against its CAD map.

    Args:
        maps: SLAM-like maps (N, S, S): 0, 205, 254.
        pairs: Their CAD maps and scales.
    """
    described = []
    for i, cells in enumerate(maps):
        rng = np.random.default_rng(i)  # picks pairs of wall cells, the same for every kind of map
        moved = displacement_statistics(cells, pairs.cad[i] <= 127, pairs.scale(i), rng)
        described.append(map_statistics(cells, pairs.scale(i)) | moved)
    return described
