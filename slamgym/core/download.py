"""A file from the network: resumed where it stopped, and under its name only when it is whole."""

import contextlib
import urllib.error
import urllib.request
from collections.abc import Callable
from http import HTTPStatus
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from urllib.parse import urlsplit

from slamgym.core.errors import SlamgymError
from slamgym.core.files import storage_errors

_CHUNK = 1 << 16
_TIMEOUT = 30.0
"""Of a silent server [s]."""


class DownloadError(SlamgymError):
    """A file can't be fetched: no network, no such address, or the connection broke off."""


def download(url: str, path: Path, advance: Callable[[int, int], None] | None = None) -> None:
    """Fetch a file; what an earlier call left in ``NAME.part`` is kept if the server still has that version.

    Args:
        url: ``https://...`` or ``http://...``.
        path: Where it goes; its folder is made.
        advance: Called with the bytes that are there and those of the whole file, 0 where the server doesn't say.

    Raises:
        DownloadError: If the address is no web address or can't be fetched whole.
        StorageError: If it can't be written.
    """
    if urlsplit(url).scheme not in {"http", "https"}:
        raise DownloadError(f"{url!r} is no web address; give one that begins with https://")
    part, tag_file = path.with_name(f"{path.name}.part"), path.with_name(f"{path.name}.part.etag")
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        tag = tag_file.read_text() if tag_file.is_file() else ""
        there = part.stat().st_size if tag and part.is_file() else 0
    headers = {"User-Agent": "slamgym", "Accept-Encoding": "identity"}
    if there:
        headers |= {"Range": f"bytes={there}-", "If-Range": tag}
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=_TIMEOUT) as answer:
            _receive(answer, part, tag_file, advance)
    except urllib.error.HTTPError as error:
        if error.code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
            part.unlink(missing_ok=True)  # it is longer than the file: of no version that the server has
            raise DownloadError(
                f"{url}: what was left of an earlier download is of no use; run it again"
            ) from None
        raise DownloadError(f"{url} can't be fetched ({error.code} {error.reason})") from None
    except urllib.error.URLError as error:
        reason = getattr(error.reason, "strerror", None) or error.reason
        raise DownloadError(f"{url} can't be reached ({reason}); is there a network?") from None
    except (HTTPException, ConnectionError, TimeoutError) as error:
        raise DownloadError(f"{url}: the connection broke off ({error}); run it again to go on") from None
    with storage_errors(path):
        part.replace(path)
        tag_file.unlink(missing_ok=True)


def _receive(
    answer: HTTPResponse, part: Path, tag_file: Path, advance: Callable[[int, int], None] | None
) -> None:
    """Write the body behind what is there, or anew if the server sends the whole file."""
    resumed = answer.status == HTTPStatus.PARTIAL_CONTENT
    with storage_errors(part):
        if not resumed:
            # Without a tag nobody could tell whether the rest belongs to the beginning.
            tag_file.unlink(missing_ok=True)
            if tag := answer.headers.get("ETag"):
                tag_file.write_text(tag)
        file = part.open("ab" if resumed else "wb")
    with file:
        done = file.tell()
        left = int(answer.headers.get("Content-Length") or 0)
        total = done + left if left else 0
        with contextlib.closing(answer):
            while chunk := answer.read(_CHUNK):
                with storage_errors(part):
                    file.write(chunk)
                done += len(chunk)
                if advance is not None:
                    advance(done, total)
    if done < total:
        raise ConnectionError(f"after {done:,} of {total:,} bytes")
