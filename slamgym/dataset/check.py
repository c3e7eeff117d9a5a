"""Verify a dataset or a folder of rendered images: every file, and whether the lists and the files agree.

A fault is a sentence about one file. Checking goes on after it, so that all faults are reported at once.
"""

import hashlib
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from slamgym.core.documents import parse_json, read_json
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import byte_lines, read_bytes, sha256_of
from slamgym.core.limits import DOCUMENT_BYTES
from slamgym.core.names import is_file_name
from slamgym.core.png import read_png
from slamgym.core.progress import counted
from slamgym.core.seeding import exploration_seed
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.dataset.folder import is_whole, pair_names
from slamgym.dataset.format import FORMAT_VERSION, SUMS, Layout, require_manifest
from slamgym.dataset.manifest_file import SlotSet
from slamgym.dataset.record import PairRecord
from slamgym.dataset.shard import shard_folders

VALUES: Mapping[str, frozenset[int]] = {
    "A": frozenset({OCCUPIED, FREE}),
    "B": frozenset({OCCUPIED, UNKNOWN, FREE}),
}
"""What the pixels of each side may be."""

_Record = TypeVar("_Record")


@dataclass(frozen=True)
class FileFault:
    """Something that is wrong with a file."""

    path: Path
    what: str

    def __str__(self) -> str:
        return f"{self.path}: {self.what}"


def check_image(
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
    if not path.is_file():
        yield FileFault(path, "is missing")
        return
    if sha256_of(path) != sha256:
        yield FileFault(path, "differs from the digest in the manifest")
    try:
        image = read_png(path)
    except InputFileError as error:
        yield FileFault(path, error.reason)
        return
    if image.ndim != 2 or image.dtype != np.uint8:
        yield FileFault(path, f"has shape {image.shape} and type {image.dtype}, not one channel of uint8")
        return
    if image.shape != tuple(shape):
        yield FileFault(path, f"has shape {image.shape}, the manifest says {tuple(shape)}")
    strange = sorted({int(value) for value in np.unique(image)} - values)
    if strange:
        known = ", ".join(map(str, sorted(values)))
        yield FileFault(path, f"has the pixel value {strange[0]}; side {side} has {known} only")


def iterate_records(
    path: Path, parse: Callable[[str, str], _Record], faults: list[FileFault]
) -> Iterator[_Record]:
    """Read a manifest one record at a time, whatever is wrong with some of its lines; that is added to the faults."""
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


def doubled(path: Path, what: str, values: Iterable[Any]) -> Iterator[FileFault]:
    """Name every value that a manifest has twice."""
    seen = set()
    for value in values:
        if value in seen:
            yield FileFault(path, f"has the {what} {value} twice")
        seen.add(value)


EPISODE_FILES = (
    "plan.json", "map.pgm", "map.yaml", "truth.tum", "odometry.tum", "estimate.tum", "scans.log.gz",
)  # fmt: skip
"""Files of an exploration, besides its record and its digests."""
_SETTINGS_BESIDE = ("format_version", "version", "plans")
"""Keys of ``config.json`` that are not part of the settings' hash."""


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
    settings, faults = read_settings(layout.config, "format_version", FORMAT_VERSION)
    listed = _Listed(layout)
    for record in iterate_records(layout.manifest, PairRecord.from_line, faults):
        listed.add(record)
        faults += _check_record(layout, record, settings)
        faults += _check_pair_images(layout, record)
        faults += check_episode(layout.episode(record.name), record)
        advance()
    faults += listed.faults
    faults += _unexpected_files(layout, listed.names)
    faults += _unmerged(layout, listed.names)
    for path in (layout.rejected, layout.timing):
        faults += _check_lines(path)
    faults += _check_side_files(layout.root, listed)
    return faults


class _Listed:
    """What is kept of a million records to see whether they agree with each other."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.names: dict[str, None] = {}
        """In the order of the manifest."""
        self.plans: set[str] = set()
        self.faults: list[FileFault] = []
        self._indices, self._seeds, self._last = SlotSet(), set[int](), -1
        self._owners: dict[int, str] = {}

    def add(self, record: PairRecord) -> None:
        """Compare a record with those before it."""
        manifest = self._layout.manifest
        known = {"name": record.name in self.names, "index": record.index in self._indices}
        known["seed"] = record.seed in self._seeds
        for what, again in known.items():
            if again:
                self.faults.append(FileFault(manifest, f"has the {what} {getattr(record, what)} twice"))
        if record.index < self._last:
            self.faults.append(FileFault(manifest, f"is not in the order of the index at {record.name}"))
        self.names[record.name] = None
        self.plans.add(record.plan_id)
        self._indices.add(record.index)
        self._seeds.add(record.seed)
        self._last = max(self._last, record.index)
        picture, path = hash(record.sha256.get("B", "")), self._layout.image("B", record.name)
        if picture in self._owners:
            self.faults.append(FileFault(path, f"is the same picture as that of {self._owners[picture]}"))
        self._owners.setdefault(picture, record.name)


def check_episode(folder: Path, record: PairRecord) -> Iterator[FileFault]:
    """Verify the folder of one exploration."""
    if not folder.is_dir():
        yield FileFault(folder, "is missing")
        return
    own = folder / "episode.json"
    if not own.is_file():
        yield FileFault(own, "is missing")
    elif sha256_of(own) != hashlib.sha256(record.to_line().encode()).hexdigest():
        yield FileFault(own, "differs from the manifest's line")
    yield from _check_sums(folder, record.sha256.get("episode", ""))


def read_settings(path: Path, version_key: str, version: int) -> tuple[dict[str, Any], list[FileFault]]:
    """Read a ``config.json``; empty if it can't be used.

    Args:
        path: The file.
        version_key: Name of the format's version in it.
        version: The version that is known here.
    """
    if not path.is_file():
        return {}, [FileFault(path, "is missing")]
    try:
        settings = read_json(path)
    except InputFileError as error:
        return {}, [_as_fault(path, error)]
    if not isinstance(settings, dict):
        return {}, [FileFault(path, "is not a JSON object")]
    found = settings.get(version_key)
    wrong = FileFault(path, f"has version {found}, this version knows {version}")
    return settings, [] if found == version else [wrong]


def dataset_settings_hash(settings: Mapping[str, Any]) -> str:
    """The hash that every record of a dataset with this ``config.json`` carries."""
    inner = {name: value for name, value in settings.items() if name not in _SETTINGS_BESIDE}
    return hashlib.sha256(json.dumps(inner, sort_keys=True).encode()).hexdigest()[:12]


def _check_record(layout: Layout, record: PairRecord, settings: Mapping[str, Any]) -> Iterator[FileFault]:
    """Whether a record follows from the settings."""
    where = Path(f"{layout.manifest}: {record.name}")
    if record.slot.name != record.name:
        yield FileFault(where, f"its index {record.index} and plan {record.plan_id!r} give another name")
    if not settings:
        return
    if record.config_hash != dataset_settings_hash(settings):
        yield FileFault(where, "was made with other settings than config.json holds")
    if record.seed != exploration_seed(settings.get("seed", 0), record.plan_id, record.repetition):
        yield FileFault(where, "its seed doesn't follow from the dataset's seed, its plan and its repetition")


def _check_pair_images(layout: Layout, record: PairRecord) -> Iterator[FileFault]:
    for side, values in VALUES.items():
        path = layout.image(side, record.name)
        yield from check_image(path, side, record.sha256.get(side, ""), record.shape, values)


def _check_sums(folder: Path, sha256: str) -> Iterator[FileFault]:
    """Whether the files of an exploration are those that its digests, and the manifest's digest, list."""
    sums = folder / SUMS
    if not sums.is_file():
        yield FileFault(sums, "is missing")
        return
    try:
        content = read_bytes(sums, DOCUMENT_BYTES)
    except InputFileError as error:
        yield _as_fault(sums, error)
        return
    if hashlib.sha256(content).hexdigest() != sha256:
        yield FileFault(sums, "differs from the digest in the manifest")
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
        path = folder / name
        if not path.is_file():
            yield FileFault(path, "is missing")
        elif sha256_of(path) != digest:
            yield FileFault(path, f"differs from its digest in {SUMS}")
    for path in sorted(folder.iterdir()):
        if path.name not in {*listed, SUMS, "episode.json"}:
            yield FileFault(path, "is no file of an exploration")


def _unexpected_files(layout: Layout, names: Collection[str]) -> Iterator[FileFault]:
    """Files and folders that no record speaks of."""
    for side in VALUES:
        folder = layout.root / side
        for path in sorted(folder.iterdir()) if folder.is_dir() else ():
            if path.suffix != ".png" or path.stem not in names:
                yield FileFault(path, "is not in the manifest")
    for path in sorted(layout.episodes.iterdir()) if layout.episodes.is_dir() else ():
        if path.name not in names:
            yield FileFault(path, "is not in the manifest")
    if layout.incoming.exists():
        yield FileFault(layout.incoming, "is what a run left that is at work or was killed; run it again")


def _unmerged(layout: Layout, names: Collection[str]) -> Iterator[FileFault]:
    """Shards below the dataset may stay, but hold nothing that was not put into it."""
    for folder in shard_folders(layout.root):
        shard = Layout(folder)
        left = sorted(
            name for _, name in pair_names(shard.episodes) if name not in names and is_whole(shard, name)
        )
        if left:
            yield FileFault(
                folder,
                f"has {counted(len(left), 'pair')} beyond the dataset's, such as {left[0]}; "
                f"run `slamgym dataset merge {layout.root}` again",
            )


def same_images(entries: Iterable[tuple[Path, str, str]]) -> Iterator[FileFault]:
    """SLAM maps that are the same to the last bit: two explorations never are."""
    owners: dict[str, str] = {}
    for path, sha256, name in entries:
        if sha256 in owners:
            yield FileFault(path, f"is the same picture as that of {owners[sha256]}")
        else:
            owners[sha256] = name


def _check_lines(path: Path) -> Iterator[FileFault]:
    """Whether a list of JSON objects is whole."""
    if not path.exists():
        return
    try:
        for line, where in byte_lines(path):
            try:
                whole = isinstance(parse_json(line, where), dict)
            except InputFileError:
                whole = False
            if not whole:
                yield FileFault(Path(where), "is not a JSON object")
    except InputFileError as error:
        yield _as_fault(path, error)


def _check_side_files(root: Path, listed: _Listed) -> Iterator[FileFault]:
    """Whether the split and the verdicts, where there are any, know the pairs."""
    # Imported here, as reading a dataset needs neither.
    from slamgym.dataset.curate.split import read_split, split_path
    from slamgym.dataset.curate.verdicts import VERDICTS_FILE, iterate_verdicts

    if split_path(root).exists():
        try:
            plans = read_split(root).plans
            missing = sorted(listed.plans - plans.keys())
            if missing:
                yield FileFault(
                    split_path(root), f"doesn't know {counted(len(missing), 'plan')}, such as {missing[0]}"
                )
        except SlamgymError as error:
            yield _as_fault(split_path(root), error)
    if (root / VERDICTS_FILE).exists():
        try:
            names = {verdict.name for verdict in iterate_verdicts(root)}
            missing = [name for name in listed.names if name not in names]
            if missing:
                yield FileFault(
                    root / VERDICTS_FILE,
                    f"doesn't know {counted(len(missing), 'pair')}, such as {missing[0]}",
                )
        except SlamgymError as error:
            yield _as_fault(root / VERDICTS_FILE, error)


def _as_fault(path: Path, error: SlamgymError) -> FileFault:
    if isinstance(error, InputFileError):
        return FileFault(Path(error.path), error.reason)
    return FileFault(path, str(error))
