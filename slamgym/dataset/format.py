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
        SHA256SUMS             digests of these files but episode.json, as ``sha256sum -c`` reads them
      rejected.jsonl           plans that could not be explored, and why
      timing.jsonl             seconds that each exploration took (the one file that differs between two runs)
      contact_sheet.png

Convention: everything but ``plan.json`` is in the ``map`` frame: its origin is the start position and its
axes are parallel to the world's, so a world point is ``start + map point``. The grid's row 0 is at the top.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import InputFileError
from slamgym.core.png import read_png
from slamgym.core.staged import write_bytes
from slamgym.core.types import ByteArray, GridFrame
from slamgym.dataset.shard import shard_folders

if TYPE_CHECKING:
    from slamgym.envs.episode import Episode

FORMAT_VERSION = 2
SIDES: tuple[Literal["A"], Literal["B"]] = ("A", "B")
"""CAD and SLAM map of a pair."""

_Line = TypeVar("_Line")


@dataclass(frozen=True)
class PairRecord:
    """One line of the manifest: where a pair comes from and how good it is."""

    name: str
    """Stem of the files in ``A`` and ``B`` and name of the folder in ``episodes``."""
    index: int
    """Place in the sequence of explorations; places of rejected plans are missing."""
    plan_id: str
    plan_source: str
    """File that the plan came from, without its folder, or the generator."""
    repetition: int
    """How many explorations of the same plan come before this one."""
    seed: int
    """Seed of the exploration, derived from the dataset's seed, the plan id and the repetition."""
    config_hash: str
    version: str
    """Version of slamgym that made the pair."""
    explorer: str
    conditions: dict[str, Any]
    """Settings of the exploration by name (:mod:`slamgym.dataset.generate.recipe`): the usual ones and all that
    vary within the dataset."""
    finished: str
    """Why the exploration ended: ``explored``, ``coverage``, ``time_limit``, ..."""
    coverage: float
    """Share of the reachable floor that was truly seen, 0 to 1."""
    robot_seconds: float
    """Time on the robot's clock [s]."""
    time_limit: float
    """[s]"""
    path_length: float
    """Metres truly driven."""
    collisions: int
    """Contacts with walls, furniture or people."""
    ate: float
    """Absolute trajectory error of the estimate: RMSE of the position against the truth, not aligned [m]."""
    odometry_ate: float
    """The same of the wheels' dead reckoning [m]."""
    final_position_error: float
    """[m]"""
    map_error: float
    """Mean distance of the SLAM map's occupied cells to the nearest face of a CAD wall [m]."""
    mse: float
    """Mean squared error of B against A, free 1 and all else 0: the paper's MSE2 of Table I, not aligned."""
    area: float
    """Free area of the plan [m2]."""
    rooms: int
    resolution: float
    """[m/pixel]"""
    origin: tuple[float, float]
    """Outer corner of the images' bottom-left pixel, map frame [m]."""
    shape: tuple[int, int]
    """(rows, cols) of the images."""
    start: tuple[float, float, float]
    """Where the robot began, world frame: x [m], y [m], theta [rad]."""
    sha256: dict[str, str]
    """Digests of ``A`` and ``B`` (the PNG files) and ``episode`` (the episode's ``SHA256SUMS``)."""

    @property
    def frame(self) -> GridFrame:
        """Where the images' pixels lie, map frame."""
        return GridFrame(self.resolution, *self.origin, *self.shape)

    def to_line(self) -> str:
        """The record as one line of JSON, with its newline."""
        return write_line(self)

    @classmethod
    def from_line(cls, line: str, where: str = "") -> PairRecord:
        """Read a line of the manifest.

        Raises:
            InputFileError: If the line is no record.
        """
        return read_line(cls, line, where, "a record of a pair")


RECORD_FIELDS = tuple(field.name for field in dataclasses.fields(PairRecord))


def write_line(record: Any) -> str:
    """A record as one line of JSON, with its newline."""
    return json.dumps(to_dict(record)) + "\n"


def read_line(kind: type[_Line], line: str, where: str, what: str) -> _Line:
    """Read a line that :func:`write_line` has made.

    Args:
        kind: The dataclass of the record.
        line: The line.
        where: File and number of the line, for errors.
        what: What the record is called in errors.

    Raises:
        InputFileError: If the line is no such record.
    """
    where = where or "manifest line"
    try:
        return from_dict(kind, json.loads(line), where)
    except (ValueError, TypeError) as error:
        raise InputFileError(where, f"is not {what} ({error})") from error


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
    what = f"holds no {manifest.name}" if root.is_dir() else "is no folder"
    raise InputFileError(root, f"{what}; name a folder that `{made_by}` has written")


def manifest_lines(manifest: Path, made_by: str) -> Iterator[tuple[str, str]]:
    """The lines of a manifest, each with its file and number for errors.

    Raises:
        InputFileError: If it is missing; ``made_by`` names the command that writes such folders.
    """
    require_manifest(manifest, made_by)
    with manifest.open(encoding="utf-8") as lines:
        for number, line in enumerate(lines, start=1):
            yield line, f"{manifest}:{number}"


@dataclass(frozen=True)
class FolderLayout:
    """Names that a dataset and a folder of rendered images have in common."""

    root: Path

    @property
    def config(self) -> Path:
        """Settings and version: how the content was made."""
        return self.root / "config.json"

    @property
    def manifest(self) -> Path:
        """One line per pair."""
        return self.root / "manifest.jsonl"

    @property
    def lock(self) -> Path:
        """Held by the run that writes."""
        return self.root / ".lock"


@dataclass(frozen=True)
class Layout(FolderLayout):
    """Names of the files of one dataset."""

    @property
    def rejected(self) -> Path:
        """Plans that could not be explored."""
        return self.root / "rejected.jsonl"

    @property
    def timing(self) -> Path:
        """Seconds per exploration."""
        return self.root / "timing.jsonl"

    @property
    def contact_sheet(self) -> Path:
        """Picture of the pairs."""
        return self.root / "contact_sheet.png"

    @property
    def episodes(self) -> Path:
        """Folder of the explorations."""
        return self.root / "episodes"

    @property
    def incoming(self) -> Path:
        """Folder of what is being written; nothing in it is part of the dataset."""
        return self.root / ".incoming"

    def episode(self, name: str) -> Path:
        """Folder of one exploration."""
        return self.episodes / name

    def image(self, side: str, name: str) -> Path:
        """PNG of one side, ``"A"`` or ``"B"``, of a pair."""
        return self.root / side / f"{name}.png"


def read_manifest(root: Path | str) -> Iterator[PairRecord]:
    """Read the records of a dataset, in the order of their index.

    Raises:
        InputFileError: If the folder holds no dataset, or a line is malformed.
    """
    layout = Layout(Path(root))
    if (layout.root / "train").is_dir() and not layout.episodes.is_dir():
        raise InputFileError(root, "holds rendered images; name the dataset that they were made from")
    for line, where in manifest_lines(layout.manifest, "slamgym generate"):
        yield PairRecord.from_line(line, where)


def read_config(root: Path | str) -> dict[str, Any]:
    """Read a dataset's ``config.json``.

    Raises:
        InputFileError: If there is none or it is no JSON object.
    """
    path = Layout(Path(root)).config
    try:
        values = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputFileError(path, f"can't be read as the settings of a dataset ({error})") from error
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
        raise InputFileError(layout.image("A", name), "has colours; `slamgym dataset check` names all faults")
    if slam.shape != cad.shape:
        raise InputFileError(layout.image("B", name), f"has shape {slam.shape} but A has {cad.shape}")
    return cad, slam


SUMS = "SHA256SUMS"
"""File of the digests of an episode's other files."""


def write_episode(folder: Path, episode: Episode) -> bytes:
    """Write plan, map, trajectories and log of an exploration into an empty folder.

    Returns:
        The content of its ``SHA256SUMS``.

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
    sums = digest_lines(folder)
    write_bytes(folder / SUMS, sums)
    return sums


def digest_lines(folder: Path) -> bytes:
    """The SHA-256 of every file in a folder, sorted by name, in the form of ``sha256sum``."""
    paths = sorted(path for path in folder.iterdir() if path.is_file())
    return "".join(
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in paths
    ).encode()
