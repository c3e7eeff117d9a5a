"""The layout of a dataset on disk: all that a reader needs to know.

::

    DATASET/
      config.json              settings, seed, version and the digest of the plan list
      manifest.jsonl           one line per pair, in the order of their index
      A/<name>.png             CAD map: 0 walls and outside, 254 inside
      B/<name>.png             SLAM map: 0 occupied, 205 unknown, 254 free; the same frame and scale as A
      episodes/<name>/         the exploration itself, from which the images can be rendered again
        episode.json           the manifest line
        plan.json              the floor plan (HouseExpo format, world frame)
        map.pgm, map.yaml      SLAM map for ROS map_server (map frame)
        truth.tum              true trajectory, one pose a scan
        odometry.tum           dead reckoning by the wheels, one pose a scan
        estimate.tum           the filter's trajectory, one pose a processed scan
        scans.log.gz           scans and odometry as a CARMEN log, for any other SLAM program
        field.npz              of `slamgym deform` alone: by how much the map is bent
        SHA256SUMS             digests of these files but episode.json, as ``sha256sum -c`` reads them
      rejected.jsonl           plans that could not be explored, and why
      timing.jsonl             seconds that each exploration took (the one file that differs between two runs)
      contact_sheet.png

Convention: everything but ``plan.json`` is in the ``map`` frame: its origin is the start position and its
axes are parallel to the world's, so a world point is ``start + map point``. The grid's row 0 is at the top.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import open_regular, sha256_of, text_lines
from slamgym.core.pictures import read_png
from slamgym.core.types import ByteArray
from slamgym.dataset.record import PairRecord

if TYPE_CHECKING:
    from slamgym.envs.episode import Episode

FORMAT_VERSION = 2
EDITION = 2
"""Generation of the mapper that draws the maps: what is learnt from one doesn't hold for another. The first edition was
drawn by a particle filter, the second by the pose graph over submaps."""
FIELD_FILE = "field.npz"
"""``field``, shape (2, rows, cols) [m] x and y, true minus measured, on the cells of the map."""
SIDES: tuple[Literal["A"], Literal["B"]] = ("A", "B")
"""CAD and SLAM map of a pair."""
SHARD_NAME = re.compile(r"shard-([0-9]{5,7})-of-([0-9]{5,7})")


@dataclass(frozen=True)
class Shard:
    """Shard ``number`` of ``count``: the slots whose index modulo ``count`` is ``number``.

    Neighbouring slots go to different shards, so that all have the same mix of plans and sources.
    """

    number: int
    count: int

    def __post_init__(self) -> None:
        if not 0 <= self.number < self.count:
            raise ConfigError(
                f"--shard {self.number}/{self.count}: of {self.count} shards the first is 0/{self.count} "
                f"and the last is {self.count - 1}/{self.count}"
            )

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read ``i/n``.

        Raises:
            ConfigError: If the text is something else, or ``i`` is not between 0 and ``n - 1``.
        """
        match = re.fullmatch(r"([0-9]{1,7})/([0-9]{1,7})", text.strip())
        if match is None:
            raise ConfigError(f"--shard must look like 3/10 (the fourth of ten), not {text!r}")
        return cls(int(match[1]), int(match[2]))

    @property
    def folder_name(self) -> str:
        """Name of the shard's folder."""
        return f"shard-{self.number:05d}-of-{self.count:05d}"

    def owns(self, index: int) -> bool:
        """True if a slot is the shard's."""
        return index % self.count == self.number

    def share_of(self, pairs: int) -> int:
        """Number of slots among the first ``pairs`` that are the shard's."""
        return len(range(self.number, pairs, self.count))


WHOLE = Shard(0, 1)
"""The only shard of a dataset that is not divided."""


def is_shard_name(name: str) -> bool:
    """True if a folder of this name holds a shard."""
    return SHARD_NAME.fullmatch(name) is not None


def shard_folders(root: Path) -> list[Path]:
    """The shards' folders below a root, by name."""
    if not root.is_dir():
        return []
    return sorted(path for path in root.iterdir() if is_shard_name(path.name) and path.is_dir())


def require_manifest(manifest: Path, made_by: str) -> None:
    """Refuse a folder without a manifest.

    Raises:
        InputFileError: Saying what the folder is instead, or which command (``made_by``) writes such folders.
    """
    if manifest.is_file():
        return
    root = manifest.parent
    if shard_folders(root):
        raise InputFileError(
            root,
            f"holds shards that are not merged yet; run `slamgym dataset merge {root}`, or name one of them",
        )
    if root.is_dir():
        raise InputFileError(
            root, f"holds no {manifest.name}; name a folder that `{made_by}` has written"
        )
    raise InputFileError(root, f"is no folder; name a folder that `{made_by}` has written")


def manifest_lines(manifest: Path, made_by: str) -> Iterator[tuple[str, str]]:
    """The lines of a manifest, each with its file and number for errors.

    Raises:
        InputFileError: If it is missing; ``made_by`` names the command that writes such folders.
    """
    require_manifest(manifest, made_by)
    yield from text_lines(manifest)


def count_lines(path: Path) -> int:
    """Number of lines of a file of any size."""
    with open_regular(path) as file:
        return sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(1 << 20), b""))


class FolderLayout:
    """Names that a dataset and a folder of rendered images have in common."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.config = root / "config.json"
        """Settings and version: how the content was made."""
        self.manifest = root / "manifest.jsonl"
        """One line per pair."""
        self.lock = root / ".lock"
        """Held by the run that writes."""


class Layout(FolderLayout):
    """Names of the files of one dataset."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.rejected = root / "rejected.jsonl"
        """Plans that could not be explored."""
        self.timing = root / "timing.jsonl"
        """Seconds per exploration."""
        self.episodes = root / "episodes"
        """Folder of the explorations."""
        self.incoming = root / ".incoming"
        """Folder of what is being written; nothing in it is part of the dataset."""

    def episode(self, name: str) -> Path:
        """Folder of one exploration."""
        return self.episodes / name

    def image(self, side: str, name: str) -> Path:
        """PNG of one side, ``"A"`` or ``"B"``, of a pair."""
        return self.root / side / f"{name}.png"


def is_dataset(place: Path | str) -> bool:
    """True if it is the folder of a dataset with pairs."""
    return Layout(Path(place)).manifest.is_file()


def read_manifest(root: Path | str) -> Iterator[PairRecord]:
    """Read the records of a dataset, in the order of their index.

    Raises:
        InputFileError: If the folder holds no dataset, or a line is malformed.
    """
    layout = Layout(Path(root))
    if (layout.root / "train").is_dir() and not layout.episodes.is_dir():
        raise InputFileError(
            root, "holds rendered images; name the dataset that they were made from"
        )
    for line, where in manifest_lines(layout.manifest, "slamgym generate"):
        yield PairRecord.from_line(line, where)


def read_dataset_config(root: Path | str) -> dict[str, Any]:
    """Read a dataset's ``config.json``.

    Raises:
        InputFileError: If there is none or it is no JSON object.
    """
    return read_object(Layout(Path(root)).config)


def read_object(path: Path) -> dict[str, Any]:
    """Read a file of settings.

    Raises:
        InputFileError: If there is none or it is no JSON object.
    """
    values = read_json(path, "choose another folder")
    if not isinstance(values, dict):
        raise InputFileError(path, "is not a JSON object")
    return values


def load_pair(root: Path | str, name: str) -> tuple[ByteArray, ByteArray]:
    """Read the two images of a pair, each (rows, cols).

    Raises:
        InputFileError: If one is missing, not a picture, or their shapes differ.
    """
    layout = Layout(Path(root))
    cad, slam = (read_png(layout.image(side, name)) for side in SIDES)
    if cad.ndim != 2:
        raise InputFileError(
            layout.image("A", name), "has colours; `slamgym dataset check` names all faults"
        )
    if slam.shape != cad.shape:
        raise InputFileError(
            layout.image("B", name), f"has shape {slam.shape} but A has {cad.shape}"
        )
    return cad, slam


SUMS = "SHA256SUMS"
"""File of the digests of an episode's other files."""


def write_episode(folder: Path, episode: Episode) -> None:
    """Write plan, map, trajectories and log of an exploration into an empty folder.

    Raises:
        InputFileError: If a file can't be written.
    """
    from slamgym.cad import write_houseexpo
    from slamgym.interop import write_carmen, write_ros_map, write_tum

    write_houseexpo(folder / "plan.json", episode.plan)
    write_ros_map(folder, episode.slam_map)
    write_tum(folder / "truth.tum", episode.truth)
    write_tum(folder / "odometry.tum", episode.odometry)
    write_tum(folder / "estimate.tum", episode.estimate)
    # Text of 300 scans a minute: compressed it takes a sixth of the space.
    write_carmen(folder / "scans.log.gz", episode.records, episode.geometry)


def digest_lines(folder: Path) -> bytes:
    """The SHA-256 of every file in a folder, sorted by name, in the form of ``sha256sum``."""
    paths = sorted(path for path in folder.iterdir() if path.is_file())
    return "".join(f"{sha256_of(path)}  {path.name}\n" for path in paths).encode()
