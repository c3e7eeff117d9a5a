"""The command line: ``slamgym <command> [options]``.

This is the one module that knows the packages built on top of ``slamgym``: commands that need explorers get
their factory from here, so that ``slamgym`` itself never imports ``agents``. Nothing is imported before it is
needed, so ``slamgym --help`` answers at once.
"""

import importlib
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from slamgym import __version__
from slamgym.config import suggest
from slamgym.errors import SlamgymError

EXIT_USER_ERROR = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells report it
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE


@dataclass(frozen=True)
class Command:
    """One row of the command table."""

    target: str
    """``module:function``; it takes the arguments after the command's name and returns an exit code."""
    help: str
    """One line for ``slamgym --help``."""
    inject: Mapping[str, str] = field(default_factory=dict)
    """Keyword arguments of the function, each a ``module:attribute``."""


_EXPLORERS = {"make_explorer": "agents.registry:make_explorer"}

COMMANDS: dict[str, Command] = {
    "plans": Command("slamgym.cad.plans_command:main", "list, check, draw and write floor plans"),
    "generate": Command(
        "slamgym.dataset.generate_command:main",
        "explore floor plans and write SLAM/CAD map pairs",
        _EXPLORERS,
    ),
    "dataset": Command(
        "slamgym.dataset.commands:main", "render, clean, split, check and describe what generate has made"
    ),
    "watch": Command(
        "slamgym.dataset.watch_command:main",
        "watch an exploration in a window, or write it as MP4 or GIF",
        _EXPLORERS,
    ),
    "agents": Command("agents.commands:main", "train, evaluate and compare explorers"),
    "deform": Command(
        "slamgym.parametric.deform_command:main",
        "deform a floor plan into SLAM-like maps by the parametric model",
        {**_EXPLORERS, "record_path": "slamgym.dataset.recorded_path:record_path"},
    ),
    "calibrate-odometry": Command(
        "slamgym.dataset.calibrate_command:main", "measure the simulated robot's odometry errors"
    ),
    "slam": Command(
        "slamgym.slam.replay_command:main", "make a map from a recorded log (CARMEN, ROS bag, episode)"
    ),
    "export-log": Command(
        "slamgym.interop.export_command:main", "write an episode or a log as CARMEN log or rosbag2"
    ),
    "gan": Command("gan.commands:main", "train and use the translators between SLAM maps and CAD drawings"),
}


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: The arguments after the program's name; None takes them from ``sys.argv``.

    Returns:
        The exit code: 0 success, 2 an error that the user can mend, 130 interrupted.
    """
    arguments = sys.argv[1:] if argv is None else argv
    try:
        code = _dispatch(arguments)
        sys.stdout.flush()
        return code
    except SlamgymError as error:
        _complain(str(error))
        return EXIT_USER_ERROR
    except KeyboardInterrupt:
        _complain("interrupted")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader (`| head`) has gone: nothing is wrong, but the interpreter would complain at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BROKEN_PIPE


def _dispatch(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        sys.stdout.write(_usage())
        return 0
    name, rest = arguments[0], arguments[1:]
    if name in ("-V", "--version"):
        sys.stdout.write(f"slamgym {__version__}\n")
        return 0
    if name not in COMMANDS:
        raise SlamgymError(
            f"unknown command {name!r}; {suggest(name, COMMANDS)} (slamgym --help lists them all)"
        )
    command = COMMANDS[name]
    injected = {key: load_target(target) for key, target in command.inject.items()}
    run: Callable[..., int] = load_target(command.target)
    return run(rest, **injected)


def load_target(target: str) -> Any:
    """Import what ``module:attribute`` names."""
    module, attribute = target.split(":")
    return getattr(importlib.import_module(module), attribute)


def _usage() -> str:
    width = max(map(len, COMMANDS))
    rows = "\n".join(f"  {name:<{width}}  {command.help}" for name, command in COMMANDS.items())
    return (
        "usage: slamgym <command> [options]\n\n"
        "Floor plan in, honest SLAM map out, and the way back to CAD.\n\n"
        f"commands:\n{rows}\n\n"
        "slamgym <command> --help shows a command's options; slamgym --version the version.\n"
    )


def _complain(message: str) -> None:
    sys.stderr.write(f"slamgym: error: {message}\n")


if __name__ == "__main__":
    sys.exit(main())
