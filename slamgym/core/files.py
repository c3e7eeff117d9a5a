"""Files that are either complete or absent, and errors that say plainly what is wrong with a disk.

Everything is written under a temporary name in the same folder and renamed at the end: a process that is killed,
or a disk that fills up, leaves no half-written file under the final name.
"""

import contextlib
import errno
import glob
import hashlib
import os
import stat
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from io import BufferedReader
from pathlib import Path

from slamgym.core.errors import InputFileError
from slamgym.core.limits import DOCUMENT_BYTES, FILE_BYTES, Limit

try:
    import fcntl
except ImportError:  # not a POSIX system: no lock between two runs there
    fcntl = None  # type: ignore[assignment]

_FIXES = {
    errno.ENOSPC: "the disk is full; free some space",
    errno.EDQUOT: "the disk quota is used up; free some space",
    errno.EFBIG: "the file would be larger than allowed; raise the limit",
    errno.EACCES: "permission denied; choose a folder that you may write to",
    errno.EPERM: "permission denied; choose a folder that you may write to",
    errno.EROFS: "the file system is read-only; choose another folder",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another folder",
    errno.ENOENT: "the folder can't be made there; choose another one",
    errno.EEXIST: "exists and is not a folder; choose another one",
    errno.EISDIR: "is a folder; name a file",
    errno.EBUSY: "is a folder in use; name a file",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}
_SYNC_THREADS = 16
_MAX_PATH = 1000
_PART_BYTES = 1 << 20


class StorageError(InputFileError):
    """A file can't be written: a full disk, a folder without permission, another run at work in it."""


@contextlib.contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Turn a failure to write inside the block into an error that names the folder and the fix.

    Args:
        path: What is being written, as the user knows it.
    """
    try:
        yield
    except OSError as error:
        reason = _FIXES.get(error.errno or 0, error.strerror or str(error))
        raise StorageError(
            path, f"can't be written ({reason}, then run the same command again)"
        ) from error


@contextlib.contextmanager
def staged(path: Path | str, *, durable: bool = False) -> Iterator[Path]:
    """Give a temporary path to write to; rename it to ``path`` if the block ends well, else remove it.

    Whoever reads the file, whenever the process is killed, sees the old content or the new.

    Args:
        path: The final file. Its folder is made if it is missing.
        durable: Also wait until the disk has it, so that this holds after a power cut.

    Raises:
        StorageError: If the folder or the file can't be written (no permission, disk full).
    """
    path = Path(path)
    part = temporary_name(path)
    with storage_errors(path):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.unlink(missing_ok=True)  # a link that waits here would be written through
            yield part
            if durable:
                _sync(part)
            part.replace(path)
            if durable:
                sync_folder(path.parent)
        finally:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)


def open_regular(path: Path | str, limit: Limit | None = None) -> BufferedReader:
    """Open a file for reading; a device, a pipe or a folder is refused, not waited for.

    Args:
        path: The file.
        limit: Of its bytes.

    Raises:
        InputFileError: If it can't be read, is no regular file, or is larger than the limit.
    """
    try:
        # A pipe without a writer would block here.
        file = open(  # noqa: SIM115 - the caller closes it
            path,
            "rb",
            opener=lambda name, flags: os.open(name, flags | getattr(os, "O_NONBLOCK", 0)),
        )
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputFileError(shown_path(path), f"can't be read ({reason})") from error
    try:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise InputFileError(
                path, "is no regular file but a device, pipe or socket; give a file"
            )
        if limit is not None:
            limit.check(path, found.st_size)
    except InputFileError:
        file.close()
        raise
    return file


def shown_path(path: Path | str) -> str:
    """A path as errors name it, shortened where it is too long for one."""
    text = str(path)
    return text if len(text) <= _MAX_PATH else f"{text[:_MAX_PATH]}..."


def read_bytes(path: Path | str, limit: Limit = FILE_BYTES) -> bytes:
    """Read a whole file.

    Args:
        path: The file.
        limit: Of its bytes.

    Raises:
        InputFileError: If it can't be read, is no regular file, or is larger than the limit.
    """
    with open_regular(path, limit) as file:
        try:
            return file.read(limit.value)
        except OSError as error:
            raise InputFileError(path, f"can't be read ({error.strerror or error})") from error


def read_text(path: Path | str, limit: Limit = FILE_BYTES) -> str:
    """Read a whole UTF-8 text file.

    Args:
        path: The file.
        limit: Of its bytes.

    Raises:
        InputFileError: If it can't be read, is not text, or is larger than the limit.
    """
    try:
        return read_bytes(path, limit).decode()
    except UnicodeDecodeError:
        raise InputFileError(path, "is not a text file") from None


def byte_lines(path: Path | str, limit: Limit = DOCUMENT_BYTES) -> Iterator[tuple[bytes, str]]:
    """The lines of a file of any length, with their ends, each with its place for errors: ``manifest.jsonl:7``.

    Args:
        path: The file.
        limit: Of the bytes of one line.

    Raises:
        InputFileError: If it can't be read, is no regular file, or a line is longer than the limit.
    """
    shown = str(path)
    most = limit.value
    with open_regular(path) as file:
        number = 1
        while line := file.readline(most + 1):
            where = f"{shown}:{number}"
            if len(line) > most:
                limit.check(where, len(line))
            yield line, where
            number += 1


def text_lines(path: Path | str, limit: Limit = DOCUMENT_BYTES) -> Iterator[tuple[str, str]]:
    """The same as :func:`byte_lines` of a UTF-8 file.

    Raises:
        InputFileError: Also if a line is not text.
    """
    for line, where in byte_lines(path, limit):
        try:
            text = line.decode()
        except UnicodeDecodeError:
            raise InputFileError(where, "is not a line of text") from None
        yield text, where


def require_file(path: Path | str, limit: Limit = FILE_BYTES) -> None:
    """Refuse what other readers shouldn't open.

    Raises:
        InputFileError: If it can't be read, is no regular file, or is larger than the limit.
    """
    open_regular(path, limit).close()


def spare_inputs(sources: Iterable[Path], target: Path, role: str = "the input itself") -> None:
    """Refuse to write over what is read; ``role`` says in the error what that is to the command.

    Raises:
        InputFileError: If the target is one of the sources.
    """
    for source in sources:
        with contextlib.suppress(OSError, ValueError):  # one of them isn't there, or is no path
            if target.samefile(source):
                raise InputFileError(
                    target, f"is {role} and would be written over; name another --out"
                )


def sha256_of(path: Path | str) -> str:
    """The SHA-256 of a file, of any length.

    Raises:
        InputFileError: If it can't be read or is no regular file.
    """
    with open_regular(path) as file:
        digest = hashlib.sha256()
        while part := file.read(_PART_BYTES):
            digest.update(part)
        return digest.hexdigest()


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write a whole file at once.

    Raises:
        StorageError: If it can't be written.
    """
    with staged(path) as part:
        part.write_bytes(content)


def write_text(path: Path | str, content: str) -> None:
    """Write a whole UTF-8 text file at once; line ends stay as they are on every system.

    Raises:
        StorageError: If it can't be written.
    """
    write_bytes(path, content.encode(errors="backslashreplace"))


def replace_file(path: Path, content: bytes | Iterable[bytes]) -> None:
    """Write a whole file at once and wait until the disk has it.

    Args:
        path: The file; what the content is made from may be its old content.
        content: Its new content, or chunks of it that need not fit in memory together.

    Raises:
        StorageError: If it can't be written.
    """
    with staged(path, durable=True) as part, part.open("wb") as file:
        file.writelines([content] if isinstance(content, bytes) else content)


def replace_if_changed(path: Path, data: bytes) -> None:
    """The same as :func:`replace_file`, but a file that has the content already stays as it is."""
    if not path.exists() or path.read_bytes() != data:
        replace_file(path, data)


def own_folder(path: Path) -> Path:
    """Make a folder, or find that it is there and no link: what is written into it stays where it belongs.

    Raises:
        StorageError: If it is a link or can't be made.
    """
    with storage_errors(path):
        path.mkdir(parents=True, exist_ok=True)
    if path.is_symlink():
        raise StorageError(path, "is a link out of the folder; put a real folder in its place")
    return path


def _refuse_link(path: Path) -> None:
    """Refuse to change a file in place through a link that somebody put there."""
    if path.is_symlink():
        raise StorageError(path, "is a link and would be written through; remove it")


def append_line(path: Path, line: str, *, durable: bool = False) -> None:
    """Add a line to a log, with one call to the system.

    Args:
        path: The log; made with its first line.
        line: The line with its end.
        durable: Also wait until the disk has it.

    Raises:
        StorageError: If it can't be written, or is a link.
    """
    _refuse_link(path)
    with storage_errors(path):
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
        descriptor = os.open(path, flags, 0o644)
        try:
            os.write(descriptor, line.encode())
            if durable:
                os.fsync(descriptor)
        finally:
            os.close(descriptor)


def drop_torn_line(path: Path) -> None:
    """Cut a log of lines, if there is one, after its last whole line: a run that was killed may have torn it.

    Raises:
        StorageError: If it is a link.
    """
    _refuse_link(path)
    if path.exists():
        data = path.read_bytes()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            os.truncate(path, whole)


def temporary_name(path: Path) -> Path:
    """Where this process writes the new content of a file before it takes the file's place."""
    # The suffix stays last: image and video writers choose the format by it. The folder "." has no name to replace.
    return path.parent / f".{path.stem}.{os.getpid()}.part{path.suffix}"


def remove_leftovers(path: Path) -> None:
    """Remove what killed writers of a file have left; only where a lock keeps other writers out."""
    for leftover in path.parent.glob(f".{glob.escape(path.stem)}.*.part{path.suffix}"):
        leftover.unlink()


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the folder's entries (new names, renames)."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_tree(folder: Path) -> None:
    """Wait until the disk has every file below the folder and their names.

    All files are waited for at once: a journal takes them together, in a third of the time of one after the
    other.
    """
    paths = list(folder.rglob("*"))
    if paths:
        with ThreadPoolExecutor(min(len(paths), _SYNC_THREADS)) as threads:
            list(threads.map(_sync, paths))
    sync_folder(folder)


def _sync(path: Path) -> None:
    if path.is_dir():
        sync_folder(path)
    else:
        with path.open("rb+") as file:
            os.fsync(file.fileno())


@contextlib.contextmanager
def exclusive_lock(path: Path) -> Iterator[None]:
    """Hold a lock file; the system releases it when the process ends, however it ends.

    Raises:
        StorageError: If another process holds it.
    """
    _refuse_link(path)
    with storage_errors(path):
        file = path.open("a")
    with file:
        if fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise StorageError(
                    path.parent,
                    "another run is writing to this folder; wait for it or choose another one",
                ) from None
        yield
