"""SLAM-like maps that were made from the CAD maps of a set of pairs: translated ones, those of a folder.

For CAD to SLAM, which has no single right answer, they are compared with the simulated maps as sets.
"""

from pathlib import Path

import numpy as np

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.pictures import PICTURE_SUFFIXES
from slamgym.core.types import ByteArray
from slamgym.gan.data import PairSet
from slamgym.gan.pair_files import read_grey
from slamgym.gan.translation.translate import LearnedTranslator
from slamgym.interop import read_ros_map
from slamgym.interop.ros_map import classify_greys
from slamgym.metrics.maps import resample_slam

GeneratedMaps = dict[int, ByteArray]
"""By the index of the pair (H, W): 0, 205, 254, at the pair's scale."""


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
            raise ConfigError(
                f"--generated takes NAME=FOLDER, e.g. modelprog=out/maps, not {argument!r}"
            )
        if name in folders:
            raise ConfigError(f"--generated names {name!r} twice")
        if not Path(folder).is_dir():
            raise InputFileError(folder, "is not a folder of generated maps")
        folders[name] = Path(folder)
    return folders


def load_generated(folder: Path, pairs: PairSet) -> GeneratedMaps:
    """Read the maps of a folder, one file per pair, which its name tells.

    Three layouts are taken::

        FOLDER/<name>.png            as `slamgym gan translate IMAGES/test/A` writes them
        FOLDER/B/<name>.png          a folder of pairs
        FOLDER/<name>/.../map.yaml   a ROS map, as `slamgym deform` writes them: the first one in the folder

    Raises:
        InputFileError: If a file is malformed, or there is none.
    """
    maps = {}
    for index, name in enumerate(pairs.names):
        path = _find(folder, name)
        if path is not None:
            maps[index] = _load(path, pairs.cad.shape[1], pairs.scale(index))
    if not maps:
        raise InputFileError(
            folder,
            f"holds no map of a test pair; name them like the pairs, e.g. {pairs.names[0]}.png",
        )
    return maps


def _find(folder: Path, name: str) -> Path | None:
    """The file of a pair."""
    for base in (folder, folder / "B"):
        for suffix in PICTURE_SUFFIXES:
            path = base / f"{name}{suffix}"
            if path.is_file():
                return path
    return min((folder / name).rglob("map.yaml"), default=None)


def _load(path: Path, side: int, metres_per_px: float) -> ByteArray:
    """Read a map and bring it to the scale of its pair, whose images have this side [px]."""
    if path.suffix == ".yaml":
        grid = read_ros_map(path)
        factor = grid.frame.resolution / metres_per_px
        rows, cols = (max(1, round(count * factor)) for count in grid.cells.shape)
        return resample_slam(grid.cells, (rows, cols))
    grey = read_grey(path)
    if grey.shape[0] != grey.shape[1]:
        raise InputFileError(path, f"has shape {grey.shape}; the map of a square CAD map is square")
    return resample_slam(classify_greys(grey), (side, side))


def translated_maps(
    name: str, translator: LearnedTranslator, pairs: PairSet, seed: int
) -> dict[str, GeneratedMaps]:
    """By name what a translator makes of the CAD maps as they are, and of CAD maps bent as drift would.

    Args:
        name: Of the translator.
        translator: From CAD to SLAM.
        pairs: What to translate.
        seed: Of the bending.
    """
    as_they_are: GeneratedMaps = {}
    bent: GeneratedMaps = {}
    for i, cad in enumerate(pairs.cad):
        scale = pairs.scale(i)
        drift = np.random.default_rng([seed, i])
        as_they_are[i] = translator.translate_cells(cad, scale)
        bent[i] = translator.translate_cells(cad, scale, drift=drift)
    return {name: as_they_are, f"{name}, bent": bent}
