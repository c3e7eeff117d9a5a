"""``slamgym agents <command>``: train, evaluate and compare explorers."""

import sys
from collections.abc import Callable
from typing import NamedTuple

from slamgym.cli import load_target
from slamgym.config import suggest
from slamgym.errors import SlamgymError


class Command(NamedTuple):
    """One row of the table."""

    target: str  # ``module:function``; takes the arguments after the name and returns an exit code
    help: str


COMMANDS: dict[str, Command] = {
    "train": Command("agents.train_command:main", "train a policy by reinforcement learning"),
    "evaluate": Command("agents.evaluate_command:main", "compare explorers on the same plans and seeds"),
    "shape": Command("agents.shape_command:main", "compare reward presets over several seeds"),
}


def main(argv: list[str]) -> int:
    """Run one of the commands; returns the exit code."""
    if not argv or argv[0] in ("-h", "--help", "help"):
        sys.stdout.write(_usage())
        return 0
    name, rest = argv[0], argv[1:]
    if name not in COMMANDS:
        raise SlamgymError(f"unknown command 'agents {name}'; {suggest(name, COMMANDS)}")
    run: Callable[[list[str]], int] = load_target(COMMANDS[name].target)
    return run(rest)


def _usage() -> str:
    width = max(map(len, COMMANDS))
    rows = "\n".join(f"  {name:<{width}}  {command.help}" for name, command in COMMANDS.items())
    return (
        f"usage: slamgym agents <command> [options]\n\ncommands:\n{rows}\n\n"
        "slamgym agents <command> --help shows a command's options.\n"
    )
