"""Verify a folder of rendered images."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

from slamgym.dataset.faults import VALUES, Fault, check_image, doubled, read_records
from slamgym.dataset.format import SIDES, require_manifest
from slamgym.dataset.images.dataset_card import METADATA
from slamgym.dataset.images.format import IMAGES_VERSION, SPLITS, ImageLayout, ImageRecord


def is_image_folder(root: Path | str) -> bool:
    """Whether a folder holds rendered images rather than a dataset of explorations."""
    return any((Path(root) / split).is_dir() for split in SPLITS)


def check_image_folder(root: Path | str, advance: Callable[[], None] = lambda: None) -> list[Fault]:
    """Verify a folder that ``slamgym dataset render`` has written.

    Args:
        root: The folder.
        advance: Called after each pair.

    Raises:
        InputFileError: If the folder has no manifest.
    """
    layout = ImageLayout(Path(root))
    require_manifest(layout.manifest, "slamgym dataset render")
    faults = list(_check_settings(layout))
    records, broken = read_records(layout.manifest, ImageRecord.from_line)
    faults += broken
    faults += doubled(layout.manifest, "name", (record.name for record in records))
    faults += doubled(layout.manifest, "seed", (record.seed for record in records))
    sizes = {record.size for record in records}
    if len(sizes) > 1:
        faults.append(Fault(layout.manifest, f"has images of different sizes: {sorted(sizes)}"))
    for record in records:
        for side, values in VALUES.items():
            path = layout.image(record.split, side, record.name)
            shape = (record.size, record.size)
            faults += check_image(path, side, record.sha256.get(side, ""), shape, values)
        advance()
    faults += _on_both_sides(layout, records)
    faults += _same_pictures(layout, records)
    faults += _unexpected_files(layout, records)
    faults += _check_metadata(layout, records)
    if not layout.card.is_file():
        faults.append(Fault(layout.card, "is missing"))
    return faults


def _check_settings(layout: ImageLayout) -> Iterator[Fault]:
    try:
        settings = json.loads(layout.config.read_text(encoding="utf-8"))
    except OSError:
        yield Fault(layout.config, "is missing")
        return
    except ValueError as error:
        yield Fault(layout.config, f"is not JSON ({error})")
        return
    found = settings.get("images_version") if isinstance(settings, dict) else None
    if found != IMAGES_VERSION:
        yield Fault(layout.config, f"has version {found}, this version knows {IMAGES_VERSION}")


def _on_both_sides(layout: ImageLayout, records: list[ImageRecord]) -> Iterator[Fault]:
    """Plans, and groups of plans that look alike, of which the test side would know what training saw."""
    for what in ("plan_id", "group"):
        sides: dict[str, set[str]] = {}
        for record in records:
            sides.setdefault(getattr(record, what), set()).add(record.split)
        for name, where in sides.items():
            if len(where) > 1:
                noun = "plan" if what == "plan_id" else "group of plans"
                yield Fault(layout.manifest, f"has the {noun} {name} on both sides of the split")


def _same_pictures(layout: ImageLayout, records: list[ImageRecord]) -> Iterator[Fault]:
    owners: dict[str, str] = {}
    for record in records:
        digest = record.sha256.get("B", "")
        if digest in owners:
            path = layout.image(record.split, "B", record.name)
            yield Fault(path, f"is the same picture as that of {owners[digest]}")
        owners.setdefault(digest, record.name)


def _unexpected_files(layout: ImageLayout, records: list[ImageRecord]) -> Iterator[Fault]:
    known = {layout.image(record.split, side, record.name) for record in records for side in SIDES}
    for split in SPLITS:
        for side in SIDES:
            folder = layout.root / split / side
            if not folder.is_dir():
                yield Fault(folder, "is missing")
                continue
            for path in sorted(folder.iterdir()):
                if path not in known:
                    yield Fault(path, "is not in the manifest")


def _check_metadata(layout: ImageLayout, records: list[ImageRecord]) -> Iterator[Fault]:
    """Whether what Hugging Face's library reads tells of the same pairs."""
    for split in SPLITS:
        path = layout.root / split / METADATA
        try:
            names = [json.loads(line)["name"] for line in path.read_text(encoding="utf-8").splitlines()]
        except OSError:
            yield Fault(path, "is missing")
            continue
        except (ValueError, KeyError, TypeError) as error:
            yield Fault(path, f"is malformed ({error})")
            continue
        if names != [record.name for record in records if record.split == split]:
            yield Fault(path, "doesn't list the pairs of the manifest")
