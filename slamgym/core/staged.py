"""Files that are either complete or absent.

Everything is written under a temporary name in the same folder and renamed at the end: a process that is
killed, or a disk that fills up, leaves no half-written file under the final name.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from slamgym.core.errors import InputFileError


@contextmanager
def staged(path: Path | str) -> Iterator[Path]:
    """Give a temporary path to write to; rename it to ``path`` if the block ends well, else remove it.

    Args:
        path: The final file. Its folder is made if it is missing.

    Raises:
        InputFileError: If the folder or the file can't be written (no permission, disk full).
    """
    path = Path(path)
    # The suffix stays last: image and video writers choose the format by it.
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(path)
    except OSError as error:
        raise InputFileError(path, f"can't be written ({error.strerror or error})") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write a whole file at once.

    Raises:
        InputFileError: If it can't be written.
    """
    with staged(path) as part:
        part.write_bytes(content)


def write_text(path: Path | str, content: str) -> None:
    """Write a whole UTF-8 text file at once; line ends stay as they are on every system.

    Raises:
        InputFileError: If it can't be written.
    """
    write_bytes(path, content.encode())
