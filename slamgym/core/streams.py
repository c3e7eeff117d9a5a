"""Streams that stop at the limits: compressed files, and files from the network."""

import bz2
import contextlib
import gzip
import io
import lzma
import urllib.error
import urllib.request
import zlib
from collections.abc import Callable, Iterator
from http import HTTPStatus
from http.client import HTTPException, InvalidURL
from pathlib import Path
from typing import Any, BinaryIO

from slamgym.core.errors import SlamgymError
from slamgym.core.files import open_regular, staged
from slamgym.core.limits import EXPANSION, EXPANSION_FROM, FILE_BYTES

_OPENERS = {b"\x1f\x8b": gzip.open, b"\xfd7": lzma.open, b"BZ": bz2.open}
"""What opens a compressed file, by its first two bytes."""
_CHUNK = 1 << 18
"""Bytes of a compressed file that are expanded at once."""
_DOWNLOADED = 1 << 16
"""Bytes of a download that are counted at once."""
SCHEMES = ("https://",)
"""How addresses begin from which files are fetched."""
_TIMEOUT = 30.0
"""Patience with a silent server [s]."""

DAMAGED = (EOFError, lzma.LZMAError, zlib.error, gzip.BadGzipFile)
"""Errors that reading damaged compressed data raises."""


class _Expanded(io.RawIOBase):
    """The content of a compressed file, counted while it is read.

    Args:
        path: Named in errors.
        raw: The compressed file.
        content: The decompressed stream of it.
    """

    def __init__(self, path: Path, raw: BinaryIO, content: Any) -> None:
        self._path = path
        self._raw = raw
        self._content = content
        self._expanded = 0

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer as far as there is something at hand.

        Raises:
            InputFileError: If the file expands beyond the limits.
        """
        chunk = self._content.read1(len(buffer))
        self._expanded += len(chunk)
        FILE_BYTES.check(self._path, self._expanded)
        if self._content is not self._raw and self._expanded > EXPANSION_FROM:
            EXPANSION.check(self._path, self._expanded // max(self._raw.tell(), 1))
        buffer[: len(chunk)] = chunk
        return len(chunk)


@contextlib.contextmanager
def open_expanded(path: Path) -> Iterator[io.BufferedReader]:
    """Open a plain, gzip, xz or bzip2 file, known by how it begins.

    Raises:
        InputFileError: If it can't be read or is no regular file; while it is read, if it expands beyond the limits.
    """
    with open_regular(path) as raw:
        opener: Any = _OPENERS.get(raw.read(2))
        raw.seek(0)
        content = opener(raw) if opener else raw
        yield io.BufferedReader(_Expanded(path, raw, content), _CHUNK)


def check_expansion(path: Path, opener: Callable[[BinaryIO], Any]) -> None:
    """Refuse a compressed file that expands beyond the limits, before somebody else expands it.

    Args:
        path: The file.
        opener: Gives the decompressed stream of an open file.

    Raises:
        InputFileError: If it can't be read, is no regular file, or expands beyond the limits.
    """
    with open_regular(path, FILE_BYTES) as raw:
        content = io.BufferedReader(_Expanded(path, raw, opener(raw)), _CHUNK)
        with contextlib.suppress(*DAMAGED, OSError):  # the reader says what is wrong with it
            while content.read1(_CHUNK):
                pass


class DownloadError(SlamgymError):
    """A file can't be fetched: no network, no such address, or the connection broke off."""


def download(url: str, path: Path, advance: Callable[[int, int], None] | None = None) -> None:
    """Fetch a file.

    Args:
        url: ``https://...``.
        path: Where it goes; its folder is made.
        advance: Called with the bytes that are there and those of the whole file, 0 where the server doesn't say.

    Raises:
        DownloadError: If the address is no web address or can't be fetched whole.
        InputFileError: If it is larger than any file may be.
        StorageError: If it can't be written.
    """
    with staged(path) as part, part.open("wb") as file:
        for chunk in _chunks(url, advance):
            file.write(chunk)


def _require_safe(url: str) -> None:
    """Refuse an address from which a file could be changed on its way."""
    if not url.lower().startswith(SCHEMES):
        raise DownloadError(f"{url!r} is no web address; give one that begins with https://")


class _SafeRedirects(urllib.request.HTTPRedirectHandler):
    """Goes on to other addresses only if they are safe, too."""

    def redirect_request(
        self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str
    ) -> Any:
        """The request of the other address."""
        _require_safe(newurl)
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _chunks(url: str, advance: Callable[[int, int], None] | None) -> Iterator[bytes]:
    """The body piece by piece; an error if it is cut short."""
    _require_safe(url)
    try:
        request = urllib.request.Request(
            url, headers={"User-Agent": "slamgym", "Accept-Encoding": "identity"}
        )
        opener = urllib.request.build_opener(_SafeRedirects)
        with opener.open(request, timeout=_TIMEOUT) as answer:
            if answer.status != HTTPStatus.OK:  # a part that wasn't asked for, or nothing
                raise DownloadError(f"{url} can't be fetched ({answer.status} {answer.reason})")
            done = 0
            total = answer.length or 0
            while chunk := answer.read(_DOWNLOADED):
                done += len(chunk)
                FILE_BYTES.check(url, done)
                if advance is not None:
                    advance(done, total)
                yield chunk
        if done < total:
            raise ConnectionError(f"after {done:,} of {total:,} bytes")
    except urllib.error.HTTPError as error:
        raise DownloadError(f"{url} can't be fetched ({error.code} {error.reason})") from None
    except urllib.error.URLError as error:
        reason = getattr(error.reason, "strerror", None) or error.reason
        raise DownloadError(f"{url} can't be reached ({reason}); is there a network?") from None
    except (InvalidURL, ValueError) as error:
        raise DownloadError(f"{url!r} is no web address ({error})") from None
    except (HTTPException, OSError) as error:
        raise DownloadError(f"{url}: the connection broke off ({error}); run it again") from None
