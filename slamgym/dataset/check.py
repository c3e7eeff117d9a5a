"""Verify a dataset or a folder of rendered images: every file, and that the lists and the files agree.

A fault is a sentence about one file. Checking continues after it, so that all faults are reported at once.
"""

import hashlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from slamgym.core.config import STAMPS, config_hash
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import read_bytes
from slamgym.core.limits import DOCUMENT_BYTES
from slamgym.core.names import exploration_seed, is_file_name
from slamgym.core.progress import counted
from slamgym.core.types import FREE
from slamgym.dataset.curate.split import read_split, split_path
from slamgym.dataset.curate.verdicts import VERDICTS_FILE, iterate_verdicts
from slamgym.dataset.file_checks import (
    VALUES,
    FileFault,
    ListedRecords,
    as_fault,
    check_file,
    check_picture,
    iterate_records,
    parse_json_object,
    read_checked_settings,
    unexpected_files,
)
from slamgym.dataset.folder import is_whole, pair_names
from slamgym.dataset.format import (
    FORMAT_VERSION,
    SIDES,
    SUMS,
    Layout,
    require_manifest,
    shard_folders,
)
from slamgym.dataset.images.format import IMAGES_VERSION, METADATA, SPLITS, ImageLayout, ImageRecord
from slamgym.dataset.record import PairRecord

EPISODE_FILES = (
    "plan.json", "map.pgm", "map.yaml", "truth.tum", "odometry.tum", "estimate.tum", "scans.log.gz",
)  # fmt: skip
"""Files of an exploration, besides its record and its digests."""


def check_dataset(root: Path | str, advance: Callable[[], None] = lambda: None) -> list[FileFault]:
    """Verify a folder that ``slamgym generate`` has written.

    Args:
        root: The dataset.
        advance: Called after each pair.

    Raises:
        InputFileError: If the folder holds no dataset at all.
    """
    layout = Layout(Path(root))
    require_manifest(layout.manifest, "slamgym generate")
    settings, faults = read_checked_settings(layout.config, "format_version", FORMAT_VERSION)
    expected_hash = _hash_of(settings)
    listed = ListedRecords(layout.manifest)
    plans: set[str] = set()
    last = -1
    for record in iterate_records(layout.manifest, PairRecord.from_line, faults):
        faults += listed.add(record, layout.image("B", record.name))
        if record.index <= last:
            faults.append(
                FileFault(layout.manifest, f"is not in the order of the index at {record.name}")
            )
        plans.add(record.plan_id)
        last = max(last, record.index)
        faults += _check_record(layout, record, settings, expected_hash)
        for side, values in VALUES.items():
            path = layout.image(side, record.name)
            faults += check_picture(path, side, record.sha256.get(side, ""), record.shape, values)
        faults += _check_episode(layout.episode(record.name), record)
        advance()
    for side in SIDES:
        faults += unexpected_files(layout.root / side, {f"{name}.png" for name in listed.names})
    faults += unexpected_files(layout.episodes, listed.names)
    if layout.incoming.exists():
        faults.append(
            FileFault(
                layout.incoming, "is what a run left that is at work or was killed; run it again"
            )
        )
    faults += _unmerged(layout, listed.names)
    for path in (layout.rejected, layout.timing):
        if path.exists():
            list(iterate_records(path, parse_json_object, faults))
    faults += _check_side_files(layout.root, sorted(plans), listed.names)
    return faults


def is_image_folder(root: Path | str) -> bool:
    """True if a folder holds rendered images rather than a dataset of explorations."""
    return any((Path(root) / split).is_dir() for split in SPLITS)


def check_image_folder(
    root: Path | str, advance: Callable[[], None] = lambda: None
) -> list[FileFault]:
    """Verify a folder that ``slamgym dataset render`` has written.

    Args:
        root: The folder.
        advance: Called after each pair.

    Raises:
        InputFileError: If the folder has no manifest.
    """
    layout = ImageLayout(Path(root))
    require_manifest(layout.manifest, "slamgym dataset render")
    settings, faults = read_checked_settings(layout.config, "images_version", IMAGES_VERSION)
    records = list(iterate_records(layout.manifest, ImageRecord.from_line, faults))
    sizes = {record.size for record in records}
    if len(sizes) > 1:
        faults.append(FileFault(layout.manifest, f"has images of different sizes: {sorted(sizes)}"))
    allowed = dict(VALUES)
    if settings.get("images", {}).get("edge_px") == 0.0:
        allowed["A"] = frozenset(range(FREE + 1))  # shares of floor
    listed = ListedRecords(layout.manifest)
    for record in records:
        faults += listed.add(record, layout.image(record.split, "B", record.name))
        for side, values in allowed.items():
            path = layout.image(record.split, side, record.name)
            shape = (record.size, record.size)
            faults += check_picture(path, side, record.sha256.get(side, ""), shape, values)
        advance()
    faults += _on_both_sides(layout, records)
    for split in SPLITS:
        names = [record.name for record in records if record.split == split]
        for side in SIDES:
            folder = layout.root / split / side
            if not folder.is_dir():
                faults.append(FileFault(folder, "is missing"))
            faults += unexpected_files(folder, {f"{name}.png" for name in names})
        metadata = layout.root / split / METADATA
        if metadata.is_file():
            rows = list(iterate_records(metadata, parse_json_object, faults))
            if [row.get("name") for row in rows] != names:
                faults.append(FileFault(metadata, "doesn't list the pairs of the manifest"))
    needed = (layout.card, *(layout.root / split / METADATA for split in SPLITS))
    faults += [FileFault(path, "is missing") for path in needed if not path.is_file()]
    return faults


def _hash_of(settings: Mapping[str, Any]) -> str:
    """Hash that :func:`~slamgym.core.config.config_hash` gave when the ``config.json`` was written."""
    own = {name: value for name, value in settings.items() if name not in STAMPS}
    return config_hash(own)


def _check_record(
    layout: Layout, record: PairRecord, settings: Mapping[str, Any], expected_hash: str
) -> Iterator[FileFault]:
    """Compare a record with the settings."""
    where = Path(f"{layout.manifest}: {record.name}")
    if record.slot.name != record.name:
        yield FileFault(
            where, f"its index {record.index} and plan {record.plan_id!r} give another name"
        )
    if not settings:
        return
    if record.config_hash != expected_hash:
        yield FileFault(where, "was made with other settings than config.json holds")
    if record.seed != exploration_seed(settings.get("seed", 0), record.plan_id, record.repetition):
        yield FileFault(
            where, "its seed doesn't follow from the dataset's seed, its plan and its repetition"
        )


def _check_episode(folder: Path, record: PairRecord) -> Iterator[FileFault]:
    """Verify the folder of one exploration."""
    if not folder.is_dir():
        yield FileFault(folder, "is missing")
        return
    line = hashlib.sha256(record.to_line().encode()).hexdigest()
    yield from check_file(folder / "episode.json", line, "the manifest's line")
    sums = folder / SUMS
    yield from check_file(sums, record.sha256.get("episode", ""))
    if not sums.is_file():
        return
    try:
        content = read_bytes(sums, DOCUMENT_BYTES)
    except InputFileError as error:
        yield as_fault(sums, error)
        return
    listed = {}
    for line in content.decode(errors="replace").splitlines():
        digest, _, name = line.partition("  ")
        if is_file_name(name):
            listed[name] = digest
        else:
            yield FileFault(sums, f"lists {name!r}, which is no file of its folder")
    for name in EPISODE_FILES:
        if name not in listed:
            yield FileFault(sums, f"doesn't list {name}")
    for name, digest in listed.items():
        yield from check_file(folder / name, digest, f"its digest in {SUMS}")
    yield from unexpected_files(
        folder, {*listed, SUMS, "episode.json"}, "is no file of an exploration"
    )


def _unmerged(layout: Layout, names: Collection[str]) -> Iterator[FileFault]:
    """Shards below the dataset may stay, but hold nothing that was not put into it."""
    for folder in shard_folders(layout.root):
        shard = Layout(folder)
        there = (name for _, name in pair_names(shard.episodes) if name not in names)
        left = sorted(name for name in there if is_whole(shard, name))
        if left:
            yield FileFault(
                folder,
                f"has {counted(len(left), 'pair')} beyond the dataset's, such as {left[0]}; "
                f"run `slamgym dataset merge {layout.root}` again",
            )


def _check_side_files(
    root: Path, plans: Collection[str], names: Collection[str]
) -> Iterator[FileFault]:
    """Verify that the split and the verdicts, where there are any, know the pairs."""
    split = split_path(root)
    if split.exists():
        yield from _missing(split, "plan", plans, lambda: read_split(root).plans)
    verdicts = root / VERDICTS_FILE
    if verdicts.exists():
        yield from _missing(
            verdicts, "pair", names, lambda: {verdict.name for verdict in iterate_verdicts(root)}
        )


def _missing(
    path: Path, noun: str, wanted: Collection[str], read: Callable[[], Collection[str]]
) -> Iterator[FileFault]:
    """Verify that a list knows all that is wanted; ``read`` gives what it knows."""
    try:
        known = read()
    except SlamgymError as error:
        yield as_fault(path, error)
        return
    missing = [name for name in wanted if name not in known]
    if missing:
        yield FileFault(path, f"doesn't know {counted(len(missing), noun)}, such as {missing[0]}")


def _on_both_sides(layout: ImageLayout, records: Sequence[ImageRecord]) -> Iterator[FileFault]:
    """Plans, and groups of plans that look alike, of which the test side would know what training saw."""
    train = [record for record in records if record.split == "train"]
    test = [record for record in records if record.split == "test"]
    plans = {record.plan_id for record in train} & {record.plan_id for record in test}
    for plan in sorted(plans):
        yield FileFault(layout.manifest, f"has the plan {plan} on both sides of the split")
    groups = {record.group for record in train} & {record.group for record in test}
    for group in sorted(groups):
        yield FileFault(
            layout.manifest, f"has the group of plans {group} on both sides of the split"
        )
