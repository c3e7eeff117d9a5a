"""``slamgym completion``: a script by which a shell completes commands, options and files."""

import contextlib
import io
import os
import re
import sys
from typing import Literal
from unittest import mock

import tyro

from slamgym.commands.cli import COMMANDS, GROUPS
from slamgym.core.config import Arguments

_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9.-]*")
_SCRIPT = """\
_slamgym() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} typed="" place found
    for ((place = 1; place < COMP_CWORD; place++)); do
        [[ ${{COMP_WORDS[place]}} == -* ]] || typed+="${{COMP_WORDS[place]}} "
    done
    case "$typed" in
{cases}
        *) found="" ;;
    esac
    COMPREPLY=($(compgen -W "$found" -- "$word"))
}}
complete -o default -F _slamgym slamgym
"""


class CompletionArguments(Arguments):
    """Print a script by which the shell completes slamgym's commands, their options and files.

    Made from the help pages, so it knows this version's options; make it again after an update.
    """

    shell: tyro.conf.Positional[Literal["bash", "zsh"]] = "bash"
    """``source <(slamgym completion bash)`` tries it in the shell at hand."""


def main(arguments: CompletionArguments) -> None:
    """Run the command."""
    if arguments.shell == "zsh":
        sys.stdout.write("autoload -U +X bashcompinit && bashcompinit\n")
    sys.stdout.write(completion_script())


def completion_script() -> str:
    """The script for bash; zsh reads it by its ``bashcompinit``."""
    words: dict[str, list[str]] = {"": ["--version"]}
    for name, page in help_pages().items():
        path = name.split()
        for depth in range(len(path)):
            parent = words.setdefault(" ".join(path[:depth]), [])
            if path[depth] not in parent:
                parent.append(path[depth])
        words.setdefault(name, []).extend(options_of(page))
    # The longest first: an argument after a command's name doesn't end the completion of its options.
    cases = [
        f'        "{name}{" " if name else ""}"{"*" if name else ""}) found="{" ".join(dict.fromkeys(found))}" ;;'
        for name, found in sorted(words.items(), key=lambda item: -len(item[0].split()))
    ]
    return _SCRIPT.format(cases="\n".join(cases))


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
