"""The layout of a folder of rendered images: all that a reader needs to know.

::

    IMAGES/
      config.json                  how the images were made, from which dataset
      README.md                    dataset card
      manifest.jsonl               one line per pair, in the order of the dataset
      train/A/<name>.png           CAD map: 0 walls and outside, 254 inside
      train/B/<name>.png           SLAM map: 0 occupied, 205 unknown, 254 free
      test/A/<name>.png            the same for plans that no training image shows
      test/B/<name>.png

All images are square, of one size, with one channel of uint8. The two of a pair have the same name and show
the same place at the same scale.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from slamgym.config import from_dict, to_dict
from slamgym.errors import InputFileError
from slamgym.types import ByteArray, GridFrame

IMAGES_VERSION = 1
SIDES: tuple[Literal["A"], Literal["B"]] = ("A", "B")
Split = Literal["train", "test"]
SPLITS: tuple[Split, Split] = ("train", "test")


@dataclass(frozen=True)
class ImageRecord:
    """One line of the manifest: what a pair of images shows, and where it comes from."""

    name: str
    """Stem of both files, and name of the exploration in the dataset."""
    split: Split
    plan_id: str
    group: str
    """The plan that stands for all near-duplicates of this one; a group is never on both sides."""
    repetition: int
    """How many explorations of the same plan come before this one."""
    seed: int
    """Seed of the exploration."""
    size: int
    """Rows and columns [px]."""
    metres_per_px: float
    origin: tuple[float, float]
    """Outer corner of the bottom-left pixel, map frame [m]."""
    coverage: float
    """Share of the reachable floor that was truly seen, 0 to 1."""
    ate: float
    """Absolute trajectory error of the SLAM estimate: RMSE of the position, not aligned [m]."""
    map_error: float
    """Mean distance of the SLAM map's occupied cells to the nearest face of a CAD wall [m]."""
    explorer: str
    conditions: dict[str, Any]
    """Settings of the exploration by name."""
    sha256: dict[str, str]
    """Digests of the files ``A`` and ``B``."""

    @property
    def frame(self) -> GridFrame:
        """Where the pixels lie, map frame."""
        return GridFrame(self.metres_per_px, *self.origin, self.size, self.size)

    def to_line(self) -> str:
        """The record as one line of JSON, with its newline."""
        return json.dumps(to_dict(self)) + "\n"

    @classmethod
    def from_line(cls, line: str, where: str = "") -> "ImageRecord":
        """Read a line of the manifest.

        Raises:
            InputFileError: If the line is no record.
        """
        try:
            record = from_dict(cls, json.loads(line), where)
        except (ValueError, TypeError) as error:
            raise InputFileError(where or "manifest line", f"is not a record of images ({error})") from error
        if record.split not in SPLITS:
            raise InputFileError(
                where or "manifest line", f"has the split {record.split!r}; known: train, test"
            )
        return record


@dataclass(frozen=True)
class ImageLayout:
    """Names of the files of one folder of images."""

    root: Path

    @property
    def config(self) -> Path:
        """How the images were made."""
        return self.root / "config.json"

    @property
    def manifest(self) -> Path:
        """One line per pair."""
        return self.root / "manifest.jsonl"

    @property
    def card(self) -> Path:
        """Dataset card."""
        return self.root / "README.md"

    @property
    def skipped(self) -> Path:
        """Pairs of the dataset that have no images, and why."""
        return self.root / "skipped.jsonl"

    @property
    def lock(self) -> Path:
        """Held by the run that writes."""
        return self.root / ".lock"

    def image(self, split: str, side: str, name: str) -> Path:
        """PNG of one side, ``"A"`` or ``"B"``, of a pair."""
        return self.root / split / side / f"{name}.png"


def iterate_images(root: Path | str) -> Iterator[ImageRecord]:
    """Read the records of a folder one by one.

    Raises:
        InputFileError: If the folder holds no rendered images, or a line is malformed.
    """
    path = ImageLayout(Path(root)).manifest
    if not path.is_file():
        raise InputFileError(
            root, "holds no manifest.jsonl; name a folder that `slamgym dataset render` has written"
        )
    with path.open(encoding="utf-8") as lines:
        for number, line in enumerate(lines, start=1):
            yield ImageRecord.from_line(line, f"{path}:{number}")


def read_images(root: Path | str, split: Split | None = None) -> list[ImageRecord]:
    """Read the records of one side of the split, or of both.

    Raises:
        InputFileError: If the folder holds no rendered images, or a line is malformed.
    """
    return [record for record in iterate_images(root) if split is None or record.split == split]


def load_images(root: Path | str, record: ImageRecord) -> tuple[ByteArray, ByteArray]:
    """Read the two images of a pair: A (CAD) and B (SLAM), each (size, size) uint8.

    Raises:
        InputFileError: If one is missing, no PNG picture, or of another size than the manifest says.
    """
    layout = ImageLayout(Path(root))
    cad, slam = (read_png(layout.image(record.split, side, record.name)) for side in SIDES)
    for side, image in zip(SIDES, (cad, slam), strict=True):
        if image.shape != (record.size, record.size):
            path = layout.image(record.split, side, record.name)
            raise InputFileError(path, f"has shape {image.shape} but the manifest says {record.size}")
    return cad, slam


def read_png(path: Path) -> ByteArray:
    """Read a picture as it is, shape (rows, cols) or (rows, cols, channels).

    Raises:
        InputFileError: If it is missing or no picture.
    """
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise InputFileError(path, f"can't be read ({error.strerror or error})") from error
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise InputFileError(path, "is not a PNG picture")
    return image
