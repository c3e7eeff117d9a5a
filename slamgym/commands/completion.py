"""``slamgym completion``: a script by which a shell completes commands, options and files."""

import sys
from typing import Literal

import tyro

from slamgym.core.config import Arguments

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


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(CompletionArguments, args=argv, prog="slamgym completion")
    if arguments.shell == "zsh":
        sys.stdout.write("autoload -U +X bashcompinit && bashcompinit\n")
    sys.stdout.write(completion_script())
    return 0


def completion_script() -> str:
    """The script for bash; zsh reads it by its ``bashcompinit``."""
    from slamgym.commands.help_pages import help_pages, options_of

    words: dict[str, list[str]] = {"": ["--version"]}
    for name, page in help_pages().items():
        path = name.split()
        for depth in range(len(path)):
            parent = words.setdefault(" ".join(path[:depth]), [])
            if path[depth] not in parent:
                parent.append(path[depth])
        words.setdefault(name, []).extend(["--help", *options_of(page)])
    # The longest first: whatever a command takes after its name, its own options go on being offered.
    cases = [
        f'        "{name}{" " if name else ""}"{"*" if name else ""}) found="{" ".join(dict.fromkeys(found))}" ;;'
        for name, found in sorted(words.items(), key=lambda item: -len(item[0].split()))
    ]
    return _SCRIPT.format(cases="\n".join(cases))
