"""``slamgym dataset <command>``: what can be done with explorations that exist."""

import importlib
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

from slamgym.config import suggest
from slamgym.errors import SlamgymError


class Command(NamedTuple):
    """One row of the table."""

    target: str  # ``module:function``; takes the arguments after the name and returns an exit code
    help: str


COMMANDS: dict[str, Command] = {
    "merge": Command("slamgym.dataset.merge_command:main", "put the shards of a dataset together"),
    "stats": Command("slamgym.dataset.stats_command:main", "what lies in a dataset, as tables or JSON"),
    "show": Command("slamgym.dataset.show_command:main", "draw pairs: a sample, some by name, the worst"),
    "check": Command("slamgym.dataset.check_command:main", "verify every file and name every fault"),
    "clean": Command("slamgym.dataset.clean_command:main", "decide which pairs are complete enough to keep"),
    "review": Command(
        "slamgym.dataset.review_command:main", "a page on which a person judges doubtful pairs"
    ),
    "split": Command(
        "slamgym.dataset.split_command:main", "put plans, with their near-duplicates, on a side"
    ),
    "render": Command("slamgym.dataset.render_command:main", "make uniform square images for training"),
}


def main(argv: list[str]) -> int:
    """Run one of the commands.

    Args:
        argv: The arguments after ``slamgym dataset``.

    Returns:
        The exit code.

    Raises:
        SlamgymError: If there is no such command.
    """
    if not argv or argv[0] in ("-h", "--help", "help"):
        sys.stdout.write(_usage())
        return 0
    name, rest = argv[0], argv[1:]
    if name not in COMMANDS:
        raise SlamgymError(
            f"unknown command 'dataset {name}'; {suggest(name, COMMANDS)} (slamgym dataset --help lists them all)"
        )
    module, _, attribute = COMMANDS[name].target.partition(":")
    run: Callable[[list[str]], Any] = getattr(importlib.import_module(module), attribute)
    return int(run(rest))


def _usage() -> str:
    width = max(map(len, COMMANDS))
    rows = "\n".join(f"  {name:<{width}}  {command.help}" for name, command in COMMANDS.items())
    return (
        f"usage: slamgym dataset <command> [options]\n\ncommands:\n{rows}\n\n"
        "slamgym dataset <command> --help shows a command's options. `slamgym generate` makes a dataset.\n"
    )
