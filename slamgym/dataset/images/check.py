"""Verify a folder of rendered images."""

from collections.abc import Callable, Iterator
from pathlib import Path

from slamgym.core.documents import parse_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import text_lines
from slamgym.core.types import FREE
from slamgym.dataset.check import (
    VALUES,
    FileFault,
    check_image,
    doubled,
    iterate_records,
    read_settings,
    same_images,
)
from slamgym.dataset.format import SIDES, require_manifest
from slamgym.dataset.images.dataset_card import METADATA
from slamgym.dataset.images.format import IMAGES_VERSION, SPLITS, ImageLayout, ImageRecord


def is_image_folder(root: Path | str) -> bool:
    """Whether a folder holds rendered images rather than a dataset of explorations."""
    return any((Path(root) / split).is_dir() for split in SPLITS)


def check_image_folder(root: Path | str, advance: Callable[[], None] = lambda: None) -> list[FileFault]:
    """Verify a folder that ``slamgym dataset render`` has written.

    Args:
        root: The folder.
        advance: Called after each pair.

    Raises:
        InputFileError: If the folder has no manifest.
    """
    layout = ImageLayout(Path(root))
    require_manifest(layout.manifest, "slamgym dataset render")
    settings, faults = read_settings(layout.config, "images_version", IMAGES_VERSION)
    broken: list[FileFault] = []
    records = list(iterate_records(layout.manifest, ImageRecord.from_line, broken))
    faults += broken
    faults += doubled(layout.manifest, "name", (record.name for record in records))
    faults += doubled(layout.manifest, "seed", (record.seed for record in records))
    sizes = {record.size for record in records}
    if len(sizes) > 1:
        faults.append(FileFault(layout.manifest, f"has images of different sizes: {sorted(sizes)}"))
    allowed = dict(VALUES)
    if settings.get("images", {}).get("edge_px") == 0.0:
        allowed["A"] = frozenset(range(FREE + 1))  # shares of floor
    for record in records:
        for side, values in allowed.items():
            path = layout.image(record.split, side, record.name)
            shape = (record.size, record.size)
            faults += check_image(path, side, record.sha256.get(side, ""), shape, values)
        advance()
    faults += _on_both_sides(layout, records)
    faults += same_images(
        (layout.image(r.split, "B", r.name), r.sha256.get("B", ""), r.name) for r in records
    )
    faults += _unexpected_files(layout, records)
    faults += _check_metadata(layout, records)
    if not layout.card.is_file():
        faults.append(FileFault(layout.card, "is missing"))
    return faults


def _on_both_sides(layout: ImageLayout, records: list[ImageRecord]) -> Iterator[FileFault]:
    """Plans, and groups of plans that look alike, of which the test side would know what training saw."""
    for what in ("plan_id", "group"):
        sides: dict[str, set[str]] = {}
        for record in records:
            sides.setdefault(getattr(record, what), set()).add(record.split)
        for name, where in sides.items():
            if len(where) > 1:
                noun = "plan" if what == "plan_id" else "group of plans"
                yield FileFault(layout.manifest, f"has the {noun} {name} on both sides of the split")


def _unexpected_files(layout: ImageLayout, records: list[ImageRecord]) -> Iterator[FileFault]:
    known = {layout.image(record.split, side, record.name) for record in records for side in SIDES}
    for split in SPLITS:
        for side in SIDES:
            folder = layout.root / split / side
            if not folder.is_dir():
                yield FileFault(folder, "is missing")
                continue
            for path in sorted(folder.iterdir()):
                if path not in known:
                    yield FileFault(path, "is not in the manifest")


def _check_metadata(layout: ImageLayout, records: list[ImageRecord]) -> Iterator[FileFault]:
    """Whether what Hugging Face's library reads lists the same pairs."""
    for split in SPLITS:
        path = layout.root / split / METADATA
        if not path.is_file():
            yield FileFault(path, "is missing")
            continue
        try:
            names = [parse_json(line, where)["name"] for line, where in text_lines(path)]
        except (InputFileError, KeyError, TypeError) as error:
            yield FileFault(path, f"is malformed ({error})")
            continue
        if names != [record.name for record in records if record.split == split]:
            yield FileFault(path, "doesn't list the pairs of the manifest")
