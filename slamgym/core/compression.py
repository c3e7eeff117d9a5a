"""Compressed files as streams that stop at the limits of expansion."""

import bz2
import contextlib
import gzip
import lzma
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from slamgym.core.errors import InputFileError
from slamgym.core.files import open_regular
from slamgym.core.limits import Limit, check_expansion

_OPENERS = {b"\x1f\x8b": gzip.open, b"\xfd7": lzma.open, b"BZ": bz2.open}
_CHUNK = 1 << 18

DAMAGED = (EOFError, lzma.LZMAError, zlib.error, gzip.BadGzipFile)
"""What reading damaged compressed data raises."""
DAMAGED_ZIP = (
    EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, struct.error,
)  # fmt: skip
"""What reading a damaged zip archive raises, and numpy's files of several arrays are such."""


class ExpandedFile:
    """The content of a compressed file, counted while it is read.

    Args:
        path: Named in errors.
        raw: The compressed file.
        content: The decompressed stream of it.
    """

    def __init__(self, path: Path, raw: BinaryIO, content: BinaryIO) -> None:
        self._path, self._raw, self._content = path, raw, content
        self._expanded = 0

    def read(self, size: int) -> bytes:
        """Up to so many bytes; none at the end.

        Raises:
            InputFileError: If the file expands beyond the limits.
        """
        chunk = self._content.read(min(size, _CHUNK))
        self._expanded += len(chunk)
        check_expansion(
            self._path, self._expanded, self._raw.tell() if self._content is not self._raw else 1 << 62
        )
        return chunk

    def read_all(self) -> bytes:
        """Everything.

        Raises:
            InputFileError: If the file expands beyond the limits.
        """
        return b"".join(iter(lambda: self.read(_CHUNK), b""))


def check_zip(path: Path | str, limit: Limit) -> None:
    """Refuse a zip archive whose entries say that they expand to more than a limit; other files pass.

    Raises:
        InputFileError: If it can't be read, is no regular file or damaged, or is or becomes too large.
    """
    with open_regular(path) as file:
        limit.check(path, os.fstat(file.fileno()).st_size)
        if zipfile.is_zipfile(file):
            try:
                with zipfile.ZipFile(file) as archive:
                    limit.check(path, sum(entry.file_size for entry in archive.infolist()))
            except DAMAGED_ZIP as error:
                raise InputFileError(path, f"is a damaged archive ({error})") from None


@contextlib.contextmanager
def open_expanded(path: Path) -> Iterator[ExpandedFile]:
    """Open a plain, gzip, xz or bzip2 file, known by how it begins.

    Raises:
        InputFileError: If it can't be read or is no regular file.
    """
    with open_regular(path) as raw:
        opener = _OPENERS.get(raw.read(2))
        raw.seek(0)
        yield ExpandedFile(path, raw, opener(raw) if opener else raw)  # type: ignore[operator]
