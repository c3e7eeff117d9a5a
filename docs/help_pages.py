"""Help pages of the command line as text, for the site (site_pages.py) and for the tests."""

import contextlib
import io
import os
import re
from unittest import mock

from slamgym.commands.cli import COMMANDS, GROUPS

_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9.-]*")


def help_pages() -> dict[str, str]:
    """Every command by what the user types for it, without ``slamgym``, and its help page as plain text."""
    commands = COMMANDS | {name: group.default for name, group in GROUPS.items() if group.default}
    pages = {}
    with mock.patch.dict(os.environ, {"COLUMNS": "110", "NO_COLOR": "1", "TERM": "dumb"}):
        for name, command in commands.items():
            shown = io.StringIO()
            with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
                command.run(f"slamgym {name}", ["--help"])
            pages[name] = shown.getvalue()
    return pages


def options_of(page: str) -> list[str]:
    """The long options that a help page names, in their order; in sentences it names those of other commands, too."""
    rows = (line for line in page.splitlines() if re.match(r"\W ?-", line))
    return list(dict.fromkeys(found for row in rows for found in _OPTION.findall(row)))
