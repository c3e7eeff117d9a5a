"""Verify a dataset or a folder of rendered images: every file, and that the lists and the files agree.

A fault is a sentence about one file. Checking continues after it, so that all faults are reported at once.
"""

import hashlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from slamgym.core.config import STAMPS, config_hash
from slamgym.core.documents import parse_json
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import byte_lines, read_bytes, sha256_of
from slamgym.core.limits import DOCUMENT_BYTES
from slamgym.core.names import exploration_seed, is_file_name
from slamgym.core.pictures import read_png
from slamgym.core.progress import counted
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.dataset.curate.split import read_split, split_path
from slamgym.dataset.curate.verdicts import VERDICTS_FILE, iterate_verdicts
from slamgym.dataset.folder import is_whole, pair_names
from slamgym.dataset.format import (
    FORMAT_VERSION,
    SIDES,
    SUMS,
    Layout,
    read_dataset_config,
    require_manifest,
    shard_folders,
)
from slamgym.dataset.images.format import IMAGES_VERSION, METADATA, SPLITS, ImageLayout, ImageRecord
from slamgym.dataset.record import PairRecord

VALUES: Mapping[str, frozenset[int]] = {
    "A": frozenset({OCCUPIED, FREE}),
    "B": frozenset({OCCUPIED, UNKNOWN, FREE}),
}
"""Allowed pixel values of each side."""
EPISODE_FILES = (
    "plan.json", "map.pgm", "map.yaml", "truth.tum", "odometry.tum", "estimate.tum", "scans.log.gz",
)  # fmt: skip
"""Files of an exploration, besides its record and its digests."""

_Record = TypeVar("_Record")


@dataclass(frozen=True)
class FileFault:
    """Something that is wrong with a file."""

    path: Path
    what: str

    def __str__(self) -> str:
        return f"{self.path}: {self.what}"


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
    settings, faults = _read_settings(layout.config, "format_version", FORMAT_VERSION)
    expected_hash = _hash_of(settings)
    listed, plans, last = _Listed(layout.manifest), set[str](), -1
    for record in _iterate_records(layout.manifest, PairRecord.from_line, faults):
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
            faults += _check_image(path, side, record.sha256.get(side, ""), record.shape, values)
        faults += _check_episode(layout.episode(record.name), record)
        advance()
    for side in SIDES:
        faults += _unexpected_files(layout.root / side, {f"{name}.png" for name in listed.names})
    faults += _unexpected_files(layout.episodes, listed.names)
    if layout.incoming.exists():
        what = "is what a run left that is at work or was killed; run it again"
        faults.append(FileFault(layout.incoming, what))
    faults += _unmerged(layout, listed.names)
    for path in (layout.rejected, layout.timing):
        if path.exists():
            list(_iterate_records(path, _json_object, faults))
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
    settings, faults = _read_settings(layout.config, "images_version", IMAGES_VERSION)
    records = list(_iterate_records(layout.manifest, ImageRecord.from_line, faults))
    sizes = {record.size for record in records}
    if len(sizes) > 1:
        faults.append(FileFault(layout.manifest, f"has images of different sizes: {sorted(sizes)}"))
    allowed = dict(VALUES)
    if settings.get("images", {}).get("edge_px") == 0.0:
        allowed["A"] = frozenset(range(FREE + 1))  # shares of floor
    listed = _Listed(layout.manifest)
    for record in records:
        faults += listed.add(record, layout.image(record.split, "B", record.name))
        for side, values in allowed.items():
            path = layout.image(record.split, side, record.name)
            shape = (record.size, record.size)
            faults += _check_image(path, side, record.sha256.get(side, ""), shape, values)
        advance()
    faults += _on_both_sides(layout, records)
    for split in SPLITS:
        names = [record.name for record in records if record.split == split]
        for side in SIDES:
            folder = layout.root / split / side
            if not folder.is_dir():
                faults.append(FileFault(folder, "is missing"))
            faults += _unexpected_files(folder, {f"{name}.png" for name in names})
        metadata = layout.root / split / METADATA
        if metadata.is_file():
            rows = list(_iterate_records(metadata, _json_object, faults))
            if [row.get("name") for row in rows] != names:
                faults.append(FileFault(metadata, "doesn't list the pairs of the manifest"))
    needed = (layout.card, *(layout.root / split / METADATA for split in SPLITS))
    faults += [FileFault(path, "is missing") for path in needed if not path.is_file()]
    return faults


class _Listed:
    """Compact form of a million records, to check whether they agree with each other."""

    def __init__(self, manifest: Path) -> None:
        self._manifest = manifest
        self.names: dict[str, None] = {}
        """In the order of the manifest."""
        self._seeds: set[int] = set()
        self._owners: dict[int, str] = {}

    def add(self, record: PairRecord | ImageRecord, picture: Path) -> Iterator[FileFault]:
        """Compare a record with those before it: two explorations never give the same SLAM map to the last bit."""
        if record.name in self.names:
            yield FileFault(self._manifest, f"has the name {record.name} twice")
        if record.seed in self._seeds:
            yield FileFault(self._manifest, f"has the seed {record.seed} twice")
        digest = hash(record.sha256.get("B", ""))
        if digest in self._owners:
            yield FileFault(picture, f"is the same picture as that of {self._owners[digest]}")
        self.names[record.name] = None
        self._seeds.add(record.seed)
        self._owners.setdefault(digest, record.name)


def _iterate_records(
    path: Path, parse: Callable[[str, str], _Record], faults: list[FileFault]
) -> Iterator[_Record]:
    """Read a manifest one record at a time, even if some of its lines are wrong; that is added to the faults."""
    line = b"\n"
    try:
        for line, where in byte_lines(path):
            try:
                record = parse(line.decode(errors="replace"), where)
            except SlamgymError as error:
                faults.append(_as_fault(Path(where), error))
            else:
                yield record
    except InputFileError as error:  # the rest can't be read
        faults.append(_as_fault(path, error))
    if not line.endswith(b"\n"):
        faults.append(FileFault(path, "ends in the middle of a line"))


def _read_settings(
    path: Path, version_key: str, version: int
) -> tuple[dict[str, Any], list[FileFault]]:
    """Read a ``config.json``; empty if it can't be used.

    Args:
        path: The file.
        version_key: Name of the format's version in it.
        version: The version that is known here.
    """
    if not path.is_file():
        return {}, [FileFault(path, "is missing")]
    try:
        settings = read_dataset_config(path.parent)
    except InputFileError as error:
        return {}, [_as_fault(path, error)]
    found = settings.get(version_key)
    wrong = FileFault(path, f"has version {found}, this version knows {version}")
    return settings, [] if found == version else [wrong]


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


def _check_image(
    path: Path, side: str, sha256: str, shape: tuple[int, int], values: frozenset[int]
) -> Iterator[FileFault]:
    """Verify one picture: that it is there, unchanged, and of the right kind, size and values.

    Args:
        path: The picture.
        side: ``"A"`` or ``"B"``.
        sha256: Digest that the manifest gives.
        shape: (rows, cols) that the manifest gives.
        values: What the pixels may be.
    """
    yield from _check_file(path, sha256)
    if not path.is_file():
        return
    try:
        image = read_png(path)
    except InputFileError as error:
        yield FileFault(path, error.reason)
        return
    if image.ndim != 2 or image.dtype != np.uint8:
        yield FileFault(
            path, f"has shape {image.shape} and type {image.dtype}, not one channel of uint8"
        )
        return
    if image.shape != tuple(shape):
        yield FileFault(path, f"has shape {image.shape}, the manifest says {tuple(shape)}")
    strange = sorted({int(value) for value in np.unique(image)} - values)
    if strange:
        known = ", ".join(map(str, sorted(values)))
        yield FileFault(path, f"has the pixel value {strange[0]}; side {side} has {known} only")


def _check_episode(folder: Path, record: PairRecord) -> Iterator[FileFault]:
    """Verify the folder of one exploration."""
    if not folder.is_dir():
        yield FileFault(folder, "is missing")
        return
    line = hashlib.sha256(record.to_line().encode()).hexdigest()
    yield from _check_file(folder / "episode.json", line, "the manifest's line")
    sums = folder / SUMS
    yield from _check_file(sums, record.sha256.get("episode", ""))
    if not sums.is_file():
        return
    try:
        content = read_bytes(sums, DOCUMENT_BYTES)
    except InputFileError as error:
        yield _as_fault(sums, error)
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
        yield from _check_file(folder / name, digest, f"its digest in {SUMS}")
    yield from _unexpected_files(
        folder, {*listed, SUMS, "episode.json"}, "is no file of an exploration"
    )


def _check_file(
    path: Path, sha256: str, source: str = "the digest in the manifest"
) -> Iterator[FileFault]:
    """Verify that a file is there and has the content of which a source tells the digest."""
    if not path.is_file():
        yield FileFault(path, "is missing")
    elif sha256_of(path) != sha256:
        yield FileFault(path, f"differs from {source}")


def _unexpected_files(
    folder: Path, names: Collection[str], what: str = "is not in the manifest"
) -> Iterator[FileFault]:
    """Files and folders that nothing speaks of."""
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name not in names:
            yield FileFault(path, what)


def _unmerged(layout: Layout, names: Collection[str]) -> Iterator[FileFault]:
    """Shards below the dataset may stay, but hold nothing that was not put into it."""
    for folder in shard_folders(layout.root):
        shard = Layout(folder)
        there = (name for _, name in pair_names(shard.episodes) if name not in names)
        left = sorted(name for name in there if is_whole(shard, name))
        if left:
            what = f"has {counted(len(left), 'pair')} beyond the dataset's, such as {left[0]}"
            yield FileFault(folder, f"{what}; run `slamgym dataset merge {layout.root}` again")


def _json_object(line: str, where: str) -> dict[str, Any]:
    value = parse_json(line, where)
    if not isinstance(value, dict):
        raise InputFileError(where, "is not a JSON object")
    return value


def _check_side_files(
    root: Path, plans: Collection[str], names: Collection[str]
) -> Iterator[FileFault]:
    """Verify that the split and the verdicts, where there are any, know the pairs."""
    lists: tuple[tuple[Path, str, Collection[str], Callable[[], Collection[str]]], ...] = (
        (split_path(root), "plan", plans, lambda: read_split(root).plans),
        (
            root / VERDICTS_FILE,
            "pair",
            names,
            lambda: {verdict.name for verdict in iterate_verdicts(root)},
        ),
    )
    for path, noun, wanted, read in lists:
        if not path.exists():
            continue
        try:
            known = read()
        except SlamgymError as error:
            yield _as_fault(path, error)
            continue
        missing = [name for name in wanted if name not in known]
        if missing:
            yield FileFault(
                path, f"doesn't know {counted(len(missing), noun)}, such as {missing[0]}"
            )


def _on_both_sides(layout: ImageLayout, records: Sequence[ImageRecord]) -> Iterator[FileFault]:
    """Plans, and groups of plans that look alike, of which the test side would know what training saw."""
    for what, noun in (("plan_id", "plan"), ("group", "group of plans")):
        train, test = ({getattr(r, what) for r in records if r.split == split} for split in SPLITS)
        for name in sorted(train & test):
            yield FileFault(layout.manifest, f"has the {noun} {name} on both sides of the split")


def _as_fault(path: Path, error: SlamgymError) -> FileFault:
    if isinstance(error, InputFileError):
        return FileFault(Path(error.path), error.reason)
    return FileFault(path, str(error))
