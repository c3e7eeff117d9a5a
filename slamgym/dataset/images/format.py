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

The folder is a dataset of the Hugging Face hub, too: ``datasets.load_dataset(IMAGES)`` finds the image-folder builder
by the files, the two sides by the head of ``README.md``, and the two pictures of a row by the ``*_file_name`` columns
of each side's ``metadata.jsonl``.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any, Literal

import numpy as np

from slamgym import __version__
from slamgym.core.config import Count, Counted, Measured, Positive, Share, to_dict
from slamgym.core.errors import InputFileError
from slamgym.core.files import replace_file
from slamgym.core.names import FileName
from slamgym.core.pictures import read_png
from slamgym.core.text import markdown
from slamgym.core.types import ByteArray, GridFrame
from slamgym.dataset.faults import MapFault
from slamgym.dataset.format import SIDES, FolderLayout, manifest_lines
from slamgym.dataset.record import ManifestLine, PairRecord

IMAGES_VERSION = 1
Split = Literal["train", "test"]
Scaling = Literal["fit", "fixed"]
SPLITS: tuple[Split, Split] = ("train", "test")
METADATA = "metadata.jsonl"
"""In the folder of each side: one line per pair, for the image-folder builder of Hugging Face's ``datasets``."""
_PARTS = Path(__file__).parent


@dataclass(frozen=True)
class ImageRecord(ManifestLine):
    """One line of the manifest: what a pair of images shows, and where it comes from."""

    noun = "a record of images"
    name: FileName
    """Stem of both files, and name of the exploration in the dataset."""
    split: Split
    plan_id: str
    group: str
    """The plan that stands for all near-duplicates of this one; a group is never on both sides."""
    repetition: Counted
    """Number of explorations of the same plan before this one."""
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
        return cls(
            name=pair.name,
            split=split,
            plan_id=pair.plan_id,
            group=group,
            repetition=pair.repetition,
            seed=pair.seed,
            size=frame.height_px,
            metres_per_px=frame.resolution,
            origin=(frame.origin_x, frame.origin_y),
            coverage=pair.coverage,
            ate=pair.ate,
            map_error=pair.map_error,
            explorer=pair.explorer,
            conditions=pair.conditions,
            sha256=sha256,
        )

    @property
    def frame(self) -> GridFrame:
        """Where the pixels lie, map frame."""
        x, y = self.origin
        return GridFrame(self.metres_per_px, x, y, self.size, self.size)


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


def read_images(root: Path | str, split: Split | None = None) -> list[ImageRecord]:
    """Read the records of one side of the split, or of both.

    Raises:
        InputFileError: If the folder holds no rendered images, or a line is malformed.
    """
    layout = ImageLayout(Path(root))
    if (layout.root / "episodes").is_dir():
        raise InputFileError(
            root, "holds explorations; make images of them by `slamgym dataset render`"
        )
    lines = manifest_lines(layout.manifest, "slamgym dataset render")
    records = [ImageRecord.from_line(line, where) for line, where in lines]
    return [record for record in records if split is None or record.split == split]


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
            raise InputFileError(
                path, f"has shape {image.shape} but the manifest says {record.size}"
            )
    return cad, slam


def write_card(
    layout: ImageLayout,
    records: Sequence[ImageRecord],
    left_out: Mapping[str, MapFault],
    settings: Mapping[str, Any],
    source: str,
) -> None:
    """Write ``README.md`` and both ``metadata.jsonl``.

    Args:
        layout: The folder.
        records: Its pairs.
        left_out: Pairs of the dataset that have no images, and why.
        settings: The content of ``config.json``.
        source: SHA-256 of the manifest of the dataset that the images were made from.
    """
    for split in SPLITS:
        lines = [_metadata_line(record) for record in records if record.split == split]
        replace_file(layout.root / split / METADATA, "".join(lines).encode())
    replace_file(layout.card, _card(records, left_out, settings, source).encode())


def _metadata_line(record: ImageRecord) -> str:
    """A record for the image-folder builder; its conditions are JSON, since columns of a table have one type."""
    pictures = {f"{side}_file_name": f"{side}/{record.name}.png" for side in SIDES}
    conditions = {"conditions": json.dumps(record.conditions)}
    return json.dumps(pictures | to_dict(record) | conditions) + "\n"


def _card(
    records: Sequence[ImageRecord],
    left_out: Mapping[str, MapFault],
    settings: Mapping[str, Any],
    source: str,
) -> str:
    import yaml

    present = [split for split in SPLITS if any(record.split == split for record in records)]
    head = {
        "pretty_name": "SLAM/CAD map pairs",
        "task_categories": ["image-to-image"],
        "tags": ["slam", "floor-plans", "occupancy-grids"],
        "configs": [
            {
                "config_name": "default",
                "drop_labels": True,
                "data_files": [{"split": split, "path": f"{split}/**"} for split in present],
            }
        ],
    }
    headings = ("side", "pairs", "plans", "coverage, median", "position error, median")
    rows = []
    for split in SPLITS:
        on_side = [record for record in records if record.split == split]
        rows.append(_side_row(on_side, split))
    images = settings["images"]
    reasons = Counter(fault.reason for fault in left_out.values())
    missing = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common()) or "none"
    if images["scaling"] == "fit":
        scale = "each pair has a scale of its own, so that both maps together fill the image"
    else:
        scale = f"all pairs have {images['metres_per_px']:g} m per pixel"
    return Template((_PARTS / "card.md").read_text(encoding="utf-8")).substitute(
        head=yaml.safe_dump(head, sort_keys=False).strip(),
        version=__version__,
        source=source,
        size=images["size"],
        scale=scale,
        table=markdown(headings, rows),
        missing=missing,
    )


def _side_row(records: Sequence[ImageRecord], split: str) -> tuple[str, ...]:
    if not records:
        return split, "0", "0", "-", "-"
    coverage = np.median([record.coverage for record in records])
    error = np.median([record.ate for record in records])
    plans = {record.plan_id for record in records}
    return split, str(len(records)), str(len(plans)), f"{100.0 * coverage:.1f} %", f"{error:.3f} m"
