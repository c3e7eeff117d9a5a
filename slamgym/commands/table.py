"""A table of commands: its help, what runs a command, and what is said of a name that it doesn't hold.

``slamgym`` and each group of commands below it (``slamgym dataset``, ``slamgym agents``, ``slamgym gan``) are one
table each. Nothing is imported before it is needed, so a help page answers at once.
"""

import importlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from slamgym.core.config import suggest
from slamgym.core.errors import SlamgymError


@dataclass(frozen=True)
class Command:
    """One row of a table."""

    target: str
    """``module:function``; it takes the arguments after the command's name and returns an exit code."""
    help: str
    """One line for the table's help."""
    inject: Mapping[str, str] = field(default_factory=dict)
    """Keyword arguments of the function, each a ``module:attribute``."""


@dataclass(frozen=True)
class CommandTable:
    """Commands under one name."""

    program: str
    """What the user types before a command: ``slamgym``, or ``slamgym dataset``."""
    commands: Mapping[str, Command]
    about: str = ""
    """One sentence for the help."""
    closing: str = "."
    """How the help's last sentence, which names ``--help`` of the commands, ends."""

    def run(self, argv: list[str]) -> int:
        """Run one command, or show the help where none is named.

        Args:
            argv: The arguments after the program's name.

        Returns:
            The exit code.

        Raises:
            SlamgymError: If there is no such command; the error suggests the nearest.
        """
        if not argv or argv[0] in ("-h", "--help", "help"):
            sys.stdout.write(self.usage())
            return 0
        name, rest = argv[0], argv[1:]
        if name not in self.commands:
            typed = " ".join([*self.program.split()[1:], name])
            raise SlamgymError(
                f"unknown command {typed!r}; {suggest(name, self.commands)} "
                f"({self.program} --help lists them all)"
            )
        command = self.commands[name]
        injected = {key: load_target(target) for key, target in command.inject.items()}
        run: Callable[..., int] = load_target(command.target)
        return int(run(rest, **injected))

    def usage(self) -> str:
        """The help."""
        width = max(map(len, self.commands))
        rows = "\n".join(f"  {name:<{width}}  {command.help}" for name, command in self.commands.items())
        about = f"{self.about}\n\n" if self.about else ""
        return (
            f"usage: {self.program} <command> [options]\n\n{about}commands:\n{rows}\n\n"
            f"{self.program} <command> --help shows a command's options{self.closing}\n"
        )


def load_target(target: str) -> Any:
    """Import what ``module:attribute`` names."""
    module, attribute = target.split(":")
    return getattr(importlib.import_module(module), attribute)
