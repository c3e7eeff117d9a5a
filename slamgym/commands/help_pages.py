"""The help page of every command, for shell completion and for the command reference."""

import contextlib
import io
import os
import re
from collections.abc import Iterator
from unittest import mock

from slamgym.commands.cli import TABLE, Command, Group

_WIDTH = 110
_VERBS = re.compile(r"\{([a-z,]+)\}\s*$")
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9.-]*")


def help_pages() -> dict[str, str]:
    """Every command by what the user types for it, without ``slamgym``, and its help page as plain text."""
    with mock.patch.dict(os.environ, {"COLUMNS": str(_WIDTH), "NO_COLOR": "1", "TERM": "dumb"}):
        return {
            words: page for name, command in _commands(TABLE, "") for words, page in _pages(name, command)
        }


def options_of(page: str) -> list[str]:
    """The long options that a help page names, in their order."""
    return list(dict.fromkeys(_OPTION.findall(page)))


def _commands(group: Group, prefix: str) -> Iterator[tuple[str, Command]]:
    for word, entry in group.commands.items():
        if isinstance(entry, Group):
            if entry.default is not None:
                yield f"{prefix}{word}", entry.default
            yield from _commands(entry, f"{prefix}{word} ")
        else:
            yield f"{prefix}{word}", entry


def _pages(name: str, command: Command) -> Iterator[tuple[str, str]]:
    """The page of a command; of one with verbs of its own, theirs too."""
    page = _help_of(command, name, [])
    yield name, page
    verbs = _VERBS.search(page.splitlines()[0])
    for verb in verbs[1].split(",") if verbs else ():
        yield f"{name} {verb}", _help_of(command, name, [verb])


def _help_of(command: Command, name: str, verbs: list[str]) -> str:
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
        command.run(name, [*verbs, "--help"])
    return shown.getvalue()
