"""The command line: ``slamgym <command> [options]``.

This is the one module that knows the packages built on top of ``slamgym``: commands that need explorers get
their factory from here, so that ``slamgym`` itself never imports ``agents``. Nothing is imported before it is
needed, so ``slamgym --help`` answers at once.
"""

import os
import sys

from slamgym import __version__
from slamgym.commands.table import Command, CommandTable
from slamgym.core.errors import SlamgymError

EXIT_USER_ERROR = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells report it
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE


_EXPLORERS = {"make_explorer": "slamgym.agents.registry:make_explorer"}

COMMANDS: dict[str, Command] = {
    "plans": Command("slamgym.commands.plans:main", "list, check, draw and write floor plans"),
    "generate": Command(
        "slamgym.commands.generate:main",
        "explore floor plans and write SLAM/CAD map pairs",
        _EXPLORERS,
    ),
    "dataset": Command(
        "slamgym.commands.dataset.table:main",
        "render, clean, split, check and describe what generate has made",
    ),
    "watch": Command(
        "slamgym.commands.watch:main",
        "watch an exploration in a window, or write it as MP4 or GIF",
        _EXPLORERS,
    ),
    "agents": Command("slamgym.commands.agents.table:main", "train, evaluate and compare explorers"),
    "deform": Command(
        "slamgym.commands.deform:main",
        "deform a floor plan into SLAM-like maps by the parametric model",
        {**_EXPLORERS, "record_path": "slamgym.envs.episode:record_path"},
    ),
    "calibrate-odometry": Command(
        "slamgym.commands.calibrate_odometry:main", "measure the simulated robot's odometry errors"
    ),
    "slam": Command(
        "slamgym.commands.slam:main", "make a map from a recorded log (CARMEN, ROS bag, episode)"
    ),
    "export-log": Command(
        "slamgym.commands.export_log:main", "write an episode or a log as CARMEN log or rosbag2"
    ),
    "gan": Command(
        "slamgym.commands.gan.table:main", "train and use the translators between SLAM maps and CAD drawings"
    ),
}

TABLE = CommandTable(
    "slamgym",
    COMMANDS,
    about="Floor plan in, honest SLAM map out, and the way back to CAD.",
    closing="; slamgym --version the version.",
)


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
    if arguments and arguments[0] in ("-V", "--version"):
        sys.stdout.write(f"slamgym {__version__}\n")
        return 0
    return TABLE.run(arguments)


def _complain(message: str) -> None:
    sys.stderr.write(f"slamgym: error: {message}\n")


if __name__ == "__main__":
    sys.exit(main())
