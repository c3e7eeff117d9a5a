"""Names that come from files and become parts of paths or tables.

A dataset's manifest, an archive or a journal may come from anybody. What they call a file is one part of a path,
never a path: :data:`FileName` is the type of every such field, and :func:`as_file_name` makes one of any text.
"""

import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

from slamgym.core.errors import InputFileError

MAX_NAME_BYTES = 200
"""File systems take 255; this leaves room for suffixes and for the temporary name while a file is written."""
_DIGEST_DIGITS = 8


class OneLine(NamedTuple):
    """The rule of a text out of a file that goes into a path, or into a table."""

    noun: str
    forbidden: str
    max_bytes: int = MAX_NAME_BYTES

    def allow(self, text: str) -> bool:
        """Whether a text is what it should be and nothing else."""
        return (
            0 < len(text) <= self.max_bytes
            and text.isprintable()  # neither NUL nor line ends nor half a surrogate pair
            and len(text.encode()) <= self.max_bytes
            and not text.startswith(".")
            and text == text.strip()
            and set(self.forbidden).isdisjoint(text)
        )

    def __str__(self) -> str:
        return (
            f"{self.noun} of at most {self.max_bytes} bytes, without a leading dot or any of {self.forbidden}"
        )


_ONE_PART = OneLine("a plain file name", '/\\:*?"<>|')  # separators, and what Windows forbids besides
FileName = Annotated[str, _ONE_PART]
"""A name out of a file that becomes a part of a path."""
Label = Annotated[str, OneLine("printable text", "|`")]
"""A text out of a file that becomes a cell of a table."""


def is_file_name(text: str) -> bool:
    """Whether a text may be a part of a path as it is."""
    return _ONE_PART.allow(text)


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """What to call that which is made of each file: its stem, with the folder and the suffix where others have it, too.

    Raises:
        InputFileError: If two would have one name even so.
    """
    names = [path.stem for path in paths]
    for form in ("{folder}_{stem}", "{folder}_{stem}_{suffix}"):
        counts = Counter(map(str.casefold, names))  # some file systems know one case alone
        for index, path in enumerate(paths):
            if counts[names[index].casefold()] > 1:
                folder, suffix = path.resolve().parent.name, path.suffix[1:]
                names[index] = form.format(folder=folder, stem=path.stem, suffix=suffix)
    first: dict[str, Path] = {}
    for name, path in zip(names, paths, strict=True):
        if (other := first.setdefault(name.casefold(), path)) is not path:
            raise InputFileError(path, f"would be written as {name!r}, and so would {other}; rename one")
    return names


def as_file_name(text: str, max_bytes: int = MAX_NAME_BYTES) -> str:
    """Make a file name of a text: ``-`` for runs of what is neither a letter, a digit nor one of ``_.-``.

    A text that is too long is cut, and gets a digest of the whole so that it stays unique.
    """
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", text)
    if len(name) > max_bytes:
        digest = hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:_DIGEST_DIGITS]
        name = f"{name[: max_bytes - _DIGEST_DIGITS - 1]}-{digest}"
    return name
