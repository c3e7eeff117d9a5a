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

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from slamgym.core.config import Count, Counted, Measured, Positive, Share
from slamgym.core.errors import InputFileError
from slamgym.core.names import FileName
from slamgym.core.pictures import read_png
from slamgym.core.types import ByteArray, GridFrame
from slamgym.dataset.format import SIDES, FolderLayout, manifest_lines
from slamgym.dataset.record import ManifestLine, PairRecord

IMAGES_VERSION = 1
Split = Literal["train", "test"]
Scaling = Literal["fit", "fixed"]
SPLITS: tuple[Split, Split] = ("train", "test")
METADATA = "metadata.jsonl"
"""In the folder of each side: one line per pair, for the image-folder builder of Hugging Face's ``datasets``."""


@dataclass(frozen=True)
class ImageRecord(ManifestLine):
    """One line of the manifest: what a pair of images shows, and where it comes from.

    Fields that have the name of one of :class:`PairRecord` are taken over from the pair.
    """

    noun = "a record of images"
    name: FileName
    """Stem of both files, and name of the exploration in the dataset."""
    split: Split
    plan_id: str
    group: str
    """The plan that stands for all near-duplicates of this one; a group is never on both sides."""
    repetition: Counted
    """How many explorations of the same plan come before this one."""
    seed: int
    """Seed of the exploration."""
    size: Count
    """Rows and columns [px]."""
    metres_per_px: Positive
    origin: tuple[float, float]
    """Outer corner of the bottom-left pixel, map frame [m]."""
    coverage: Share
    """Share of the reachable floor that was truly seen, 0 to 1."""
    ate: Measured
    """Absolute trajectory error of the SLAM estimate: RMSE of the position, not aligned [m]."""
    map_error: Measured
    """Mean distance of the SLAM map's occupied cells to the nearest face of a CAD wall [m]."""
    explorer: str
    conditions: dict[str, Any]
    """Settings of the exploration by name."""
    sha256: dict[str, str]
    """Digests of the files ``A`` and ``B``."""

    @classmethod
    def of_pair(
        cls, pair: PairRecord, frame: GridFrame, split: Split, group: str, sha256: dict[str, str]
    ) -> "ImageRecord":
        """Describe the images of a pair.

        Args:
            pair: The dataset's record of it.
            frame: Where the images' pixels lie, map frame.
            split: Side of its plan.
            group: The plan that stands for its plan's near-duplicates.
            sha256: Digests of the files ``A`` and ``B``.
        """
        values: dict[str, Any] = {entry.name: getattr(pair, entry.name, None) for entry in fields(cls)}
        values |= {"split": split, "group": group, "sha256": sha256}
        values |= {"size": frame.height_px, "metres_per_px": frame.resolution}
        return cls(**values | {"origin": (frame.origin_x, frame.origin_y)})

    @property
    def frame(self) -> GridFrame:
        """Where the pixels lie, map frame."""
        return GridFrame(self.metres_per_px, *self.origin, self.size, self.size)


class ImageLayout(FolderLayout):
    """Names of the files of one folder of images."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.card = root / "README.md"
        """Dataset card."""
        self.skipped = root / "skipped.jsonl"
        """Pairs of the dataset that have no images, and why."""

    def image(self, split: str, side: str, name: str) -> Path:
        """PNG of one side, ``"A"`` or ``"B"``, of a pair."""
        return self.root / split / side / f"{name}.png"


def iterate_images(root: Path | str) -> Iterator[ImageRecord]:
    """Read the records of a folder one by one.

    Raises:
        InputFileError: If the folder holds no rendered images, or a line is malformed.
    """
    layout = ImageLayout(Path(root))
    if (layout.root / "episodes").is_dir():
        raise InputFileError(root, "holds explorations; make images of them by `slamgym dataset render`")
    for line, where in manifest_lines(layout.manifest, "slamgym dataset render"):
        yield ImageRecord.from_line(line, where)


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
