"""Checks of single files and of lists of records, which datasets and folders of rendered images have in common."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from slamgym.core.documents import parse_json
from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import byte_lines, sha256_of
from slamgym.core.pictures import read_png
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.dataset.format import read_dataset_config
from slamgym.dataset.images.format import ImageRecord
from slamgym.dataset.record import PairRecord

VALUES: Mapping[str, frozenset[int]] = {
    "A": frozenset({OCCUPIED, FREE}),
    "B": frozenset({OCCUPIED, UNKNOWN, FREE}),
}
"""Allowed pixel values of each side."""

_Record = TypeVar("_Record")


@dataclass(frozen=True)
class FileFault:
    """Something that is wrong with a file."""

    path: Path
    what: str

    def __str__(self) -> str:
        return f"{self.path}: {self.what}"


class ListedRecords:
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


def iterate_records(
    path: Path, parse: Callable[[str, str], _Record], faults: list[FileFault]
) -> Iterator[_Record]:
    """Read a manifest one record at a time, even if some of its lines are wrong; that is added to the faults."""
    line = b"\n"
    try:
        for line, where in byte_lines(path):
            try:
                record = parse(line.decode(errors="replace"), where)
            except SlamgymError as error:
                faults.append(as_fault(Path(where), error))
            else:
                yield record
    except InputFileError as error:  # the rest can't be read
        faults.append(as_fault(path, error))
    if not line.endswith(b"\n"):
        faults.append(FileFault(path, "ends in the middle of a line"))


def read_checked_settings(
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
        return {}, [as_fault(path, error)]
    found = settings.get(version_key)
    if found == version:
        return settings, []
    return settings, [FileFault(path, f"has version {found}, this version knows {version}")]


def check_picture(
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
    yield from check_file(path, sha256)
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


def check_file(
    path: Path, sha256: str, source: str = "the digest in the manifest"
) -> Iterator[FileFault]:
    """Verify that a file is there and has the content of which a source tells the digest."""
    if not path.is_file():
        yield FileFault(path, "is missing")
    elif sha256_of(path) != sha256:
        yield FileFault(path, f"differs from {source}")


def unexpected_files(
    folder: Path, names: Collection[str], what: str = "is not in the manifest"
) -> Iterator[FileFault]:
    """Files and folders that nothing speaks of."""
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name not in names:
            yield FileFault(path, what)


def parse_json_object(line: str, where: str) -> dict[str, Any]:
    """Read a line that holds a JSON object.

    Raises:
        InputFileError: If it is something else.
    """
    value = parse_json(line, where)
    if not isinstance(value, dict):
        raise InputFileError(where, "is not a JSON object")
    return value


def as_fault(path: Path, error: SlamgymError) -> FileFault:
    """The fault that an error tells of: of the file that it names, or of this one."""
    if isinstance(error, InputFileError):
        return FileFault(Path(error.path), error.reason)
    return FileFault(path, str(error))
