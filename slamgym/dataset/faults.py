"""What checking a dataset and checking a folder of rendered images have in common."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.png import read_png
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN

VALUES: Mapping[str, frozenset[int]] = {
    "A": frozenset({OCCUPIED, FREE}),
    "B": frozenset({OCCUPIED, UNKNOWN, FREE}),
}
"""What the pixels of each side may be."""

_Record = TypeVar("_Record")


@dataclass(frozen=True)
class Fault:
    """Something that is wrong with a file."""

    path: Path
    what: str

    def __str__(self) -> str:
        return f"{self.path}: {self.what}"


def check_image(
    path: Path, side: str, sha256: str, shape: tuple[int, int], values: frozenset[int]
) -> Iterator[Fault]:
    """Verify one picture: that it is there, unchanged, and of the right kind, size and values.

    Args:
        path: The picture.
        side: ``"A"`` or ``"B"``.
        sha256: Digest that the manifest gives.
        shape: (rows, cols) that the manifest gives.
        values: What the pixels may be.
    """
    if not path.is_file():
        yield Fault(path, "is missing")
        return
    if hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
        yield Fault(path, "differs from the digest in the manifest")
    try:
        image = read_png(path)
    except InputFileError as error:
        yield Fault(path, error.reason)
        return
    if image.ndim != 2 or image.dtype != np.uint8:
        yield Fault(path, f"has shape {image.shape} and type {image.dtype}, not one channel of uint8")
        return
    if image.shape != tuple(shape):
        yield Fault(path, f"has shape {image.shape}, the manifest says {tuple(shape)}")
    strange = sorted({int(value) for value in np.unique(image)} - values)
    if strange:
        known = ", ".join(map(str, sorted(values)))
        yield Fault(path, f"has the pixel value {strange[0]}; side {side} has {known} only")


def read_records(path: Path, parse: Callable[[str, str], _Record]) -> tuple[list[_Record], list[Fault]]:
    """Read a manifest, whatever is wrong with some of its lines."""
    records: list[_Record] = []
    faults = []
    text = path.read_text(encoding="utf-8", errors="replace")
    if text and not text.endswith("\n"):
        faults.append(Fault(path, "ends in the middle of a line"))
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            records.append(parse(line, f"{path}:{number}"))
        except SlamgymError as error:
            reason = error.reason if isinstance(error, InputFileError) else str(error)
            faults.append(Fault(Path(f"{path}:{number}"), reason))
    return records, faults


def doubled(path: Path, what: str, values: Iterable[Any]) -> Iterator[Fault]:
    """Name every value that a manifest has twice."""
    seen = set()
    for value in values:
        if value in seen:
            yield Fault(path, f"has the {what} {value} twice")
        seen.add(value)
