"""Maps to clean: the pairs of a dataset, or a folder of maps from elsewhere, of which no truth is known."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes, read_text
from slamgym.core.limits import YAML_BYTES
from slamgym.core.pictures import read_png
from slamgym.core.types import ByteArray, GridFrame, OccupancyGrid
from slamgym.dataset.format import (
    Layout,
    is_dataset,
    load_pair,
    read_manifest,
    require_manifest,
    shard_folders,
)
from slamgym.dataset.record import PairRecord

MAP_IMAGE_SUFFIXES = (".png", ".pgm")


@dataclass(frozen=True)
class MapItem:
    """A map to judge."""

    name: str
    """Name of the pair, or the file's path in the folder without its suffix."""
    load: Callable[[], OccupancyGrid]
    """Reads the map; raises InputFileError. Can be pickled."""
    load_cad: Callable[[], ByteArray] | None
    """Reads the CAD image of the pair, if there is one."""
    record: PairRecord | None
    """The truth, if it is known."""
    digest: str
    """SHA-256 of the map's file, so that a decision about it doesn't outlive it."""

    @property
    def plan_id(self) -> str:
        """Plan that the map shows; each map from elsewhere counts as a different plan."""
        return self.record.plan_id if self.record else self.name


def open_items(root: Path | str) -> list[MapItem]:
    """List what is to be judged in a folder.

    Args:
        root: A dataset that ``slamgym generate`` has written, or a folder (with subfolders) of ROS maps
            (``.yaml``).

    Returns:
        The items, in the order of the manifest or by name.

    Raises:
        InputFileError: If the folder holds neither, or the manifest is malformed.
    """
    root = Path(root)
    if not root.is_dir():
        raise InputFileError(
            root, "is not a folder; name a dataset or a folder of ROS maps (.yaml)"
        )
    if is_dataset(root):
        return [_pair_item(root, record) for record in read_manifest(root)]
    if shard_folders(root):
        require_manifest(Layout(root).manifest, "slamgym generate")
    items = [
        _map_item(root, path) for path in sorted(root.rglob("*.yaml")) if _describes_image(path)
    ]
    if not items:
        raise InputFileError(
            root, "holds neither a manifest.jsonl nor ROS maps (.yaml with an image beside it)"
        )
    return items


def _read_pair_map(path: Path, frame: GridFrame) -> OccupancyGrid:
    cells = read_png(path)
    if cells.shape != frame.shape:
        raise InputFileError(path, f"has shape {cells.shape}, the manifest says {frame.shape}")
    return OccupancyGrid(cells, frame)


def _pair_item(root: Path, record: PairRecord) -> MapItem:
    return MapItem(
        name=record.name,
        load=partial(_read_pair_map, Layout(root).image("B", record.name), record.frame),
        load_cad=lambda: load_pair(root, record.name)[0],
        record=record,
        digest=record.sha256.get("B", ""),
    )


def _map_item(root: Path, path: Path) -> MapItem:
    from slamgym.interop import read_ros_map

    name = path.relative_to(root).with_suffix("").as_posix()
    content = read_bytes(path, YAML_BYTES)
    for suffix in MAP_IMAGE_SUFFIXES:
        image = path.with_suffix(suffix)
        if image.is_file():
            content += read_bytes(image)
    digest = hashlib.sha256(content).hexdigest()
    return MapItem(name, partial(read_ros_map, path), None, None, digest)


def _describes_image(path: Path) -> bool:
    """True if a yaml file names an image, as a map's does: others may lie about."""
    try:
        lines = read_text(path, YAML_BYTES).splitlines()
    except InputFileError:
        return False
    return any(line.startswith("image:") for line in lines)
