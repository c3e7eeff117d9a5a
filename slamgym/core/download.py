"""A file from the network, under its name only when it is whole."""

import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from http import HTTPStatus
from http.client import HTTPException, InvalidURL
from pathlib import Path

from slamgym.core.errors import SlamgymError
from slamgym.core.files import staged
from slamgym.core.limits import FILE_BYTES

_CHUNK = 1 << 16
_TIMEOUT = 30.0
"""Of a silent server [s]."""


class DownloadError(SlamgymError):
    """A file can't be fetched: no network, no such address, or the connection broke off."""


def download(url: str, path: Path, advance: Callable[[int, int], None] | None = None) -> None:
    """Fetch a file.

    Args:
        url: ``https://...`` or ``http://...``.
        path: Where it goes; its folder is made.
        advance: Called with the bytes that are there and those of the whole file, 0 where the server doesn't say.

    Raises:
        DownloadError: If the address is no web address or can't be fetched whole.
        InputFileError: If it is larger than any file may be.
        StorageError: If it can't be written.
    """
    with staged(path) as part, part.open("wb") as file:
        file.writelines(_chunks(url, advance or (lambda done, total: None)))  # noqa: ARG005 - nobody looks


def _chunks(url: str, advance: Callable[[int, int], None]) -> Iterator[bytes]:
    """The body piece by piece; an error if it is cut short."""
    if not url.lower().startswith(("http://", "https://")):
        raise DownloadError(f"{url!r} is no web address; give one that begins with https://")
    try:
        request = urllib.request.Request(
            url, headers={"User-Agent": "slamgym", "Accept-Encoding": "identity"}
        )
        with urllib.request.urlopen(request, timeout=_TIMEOUT) as answer:
            if answer.status != HTTPStatus.OK:  # a part that nobody asked for, or nothing
                raise DownloadError(f"{url} can't be fetched ({answer.status} {answer.reason})")
            done, total = 0, answer.length or 0
            while chunk := answer.read(_CHUNK):
                done += len(chunk)
                FILE_BYTES.check(url, done)
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
