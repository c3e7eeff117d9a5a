"""Names: parts of paths and tables, functions of the user's own, and the random choices that follow from them.

A dataset's manifest, an archive or a journal may come from anybody. What they call a file is one part of a path,
never a path: :data:`FileName` is the type of every such field, and :func:`as_file_name` makes one of any text.
"""

import hashlib
import importlib
import re
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from slamgym.core.errors import ConfigError, InputFileError

MAX_NAME_BYTES = 200
"""File systems take 255; this leaves room for suffixes and for the temporary name while a file is written."""
_DIGEST_DIGITS = 8


class OneLine(NamedTuple):
    """The rule of a text out of a file that goes into a path, or into a table."""

    noun: str
    forbidden: str
    max_bytes: int = MAX_NAME_BYTES

    def allow(self, text: str) -> bool:
        """True if a text is what it should be and nothing else."""
        return (
            0 < len(text) <= self.max_bytes
            and text.isprintable()  # neither NUL nor line ends nor half a surrogate pair
            and len(text.encode()) <= self.max_bytes
            and not text.startswith(".")
            and text == text.strip()
            and set(self.forbidden).isdisjoint(text)
        )

    def __str__(self) -> str:
        return f"{self.noun} of at most {self.max_bytes} bytes, without a leading dot or any of {self.forbidden}"


_SEPARATORS = '/\\:*?"<>|'
"""Of parts of paths, and what Windows forbids besides."""
_ONE_PART = OneLine("a plain file name", _SEPARATORS)
FileName = Annotated[str, _ONE_PART]
"""A name out of a file that becomes a part of a path."""
Label = Annotated[str, OneLine("printable text", "|`")]
"""A text out of a file that becomes a cell of a table."""


def is_file_name(text: str) -> bool:
    """True if a text may be a part of a path as it is."""
    return _ONE_PART.allow(text)


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """Names for what is made of each file: its stem, with the folder and the suffix where others have it, too.

    Raises:
        InputFileError: If two would have one name even so.
    """
    names = [path.stem for path in paths]
    for form in ("{folder}_{stem}", "{folder}_{stem}_{suffix}"):
        counts = Counter(map(str.casefold, names))  # some file systems know one case alone
        for index, path in enumerate(paths):
            if counts[names[index].casefold()] > 1:
                folder = path.resolve().parent.name
                names[index] = form.format(folder=folder, stem=path.stem, suffix=path.suffix[1:])
    first: dict[str, Path] = {}
    for name, path in zip(names, paths, strict=True):
        other = first.setdefault(name.casefold(), path)
        if other is not path:
            raise InputFileError(
                path, f"would be written as {name!r}, and so would {other}; rename one"
            )
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


def is_own_explorer(name: str) -> bool:
    """True if an explorer's name is ``module:function``, and neither weights (``rl:FILE``) nor ``rl@98%:95%``."""
    module, colon, _ = name.partition("@")[0].partition(":")
    return bool(colon) and module not in ("rl", "wheels")


def own_function(spec: str, what: str) -> Callable[..., Any]:
    """Import a function; its module is looked for in the current folder, too.

    An installed command doesn't look there by itself. The module's code is run, as the user who names it wants.

    Args:
        spec: ``module:function``.
        what: What names it, for errors.

    Raises:
        ConfigError: If it can't be imported, or is no function.
    """
    module, _, name = spec.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        function = getattr(importlib.import_module(module), name) if module and name else None
    except Exception as error:
        raise ConfigError(
            f"{what} {spec!r} can't be imported ({error}); give module:function"
        ) from error
    if not callable(function):
        raise ConfigError(f"{what} {spec!r} is no function; give module:function")
    return function


def exploration_seed(seed: int, plan_id: str, repetition: int) -> int:
    """The seed of one exploration of a plan, 0 to 2^63 - 1."""
    return _first_64_bits(f"{seed}/{plan_id}/{repetition}") >> 1


def uniform_share(name: str) -> float:
    """A number in [0, 1) that follows from a name."""
    return _first_64_bits(name) / 2.0**64


def shuffled(names: Sequence[str], seed: int | tuple[int, int]) -> list[str]:
    """The names in an order that follows from the seed."""
    import numpy as np  # here, because help pages need the names alone

    return [names[place] for place in np.random.default_rng(seed).permutation(len(names))]


def _first_64_bits(text: str) -> int:
    digest = hashlib.sha256(text.encode(errors="surrogatepass")).digest()
    return int.from_bytes(digest[:8], "big")
