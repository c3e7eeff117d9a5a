"""The command line: ``slamgym <command> [options]``.

One table names every command, also those of the groups (``slamgym dataset``, ``slamgym agents``, ``slamgym gan``).
Nothing is imported before it is needed, so a help page answers at once.
"""

import contextlib
import errno
import importlib
import io
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass

from slamgym import __version__
from slamgym.commands.extras import LEARNING, TRANSLATING, Extra, require
from slamgym.core.config import suggest
from slamgym.core.errors import SlamgymError
from slamgym.core.interruption import Terminated, termination_as_interrupt
from slamgym.core.progress import say, tell

EXIT_USER_ERROR = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells report it
EXIT_TERMINATED = 143  # 128 + SIGTERM
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE
_UNWRITABLE = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


@dataclass(frozen=True)
class Command:
    """One row of the table."""

    target: str
    """``module:function`` below ``slamgym.commands``; it takes the arguments after the command's name and returns
    an exit code."""
    help: str
    """One line for the help."""
    extra: Extra | None = None
    """The extra that the command can't work without; where only an option needs one, the command asks for it."""

    def run(self, name: str, argv: list[str]) -> int:
        """Run it.

        Raises:
            SlamgymError: If a package that it needs isn't installed. Help pages need none.
        """
        if self.extra is not None and not {"-h", "--help"} & set(argv):
            require(self.extra, name)
        module, function = self.target.split(":")
        return int(getattr(importlib.import_module(f"slamgym.commands.{module}"), function)(argv))


@dataclass(frozen=True)
class Group:
    """Commands under one name."""

    help: str
    """One line for the help above it; a sentence, for the group's own."""
    commands: Mapping[str, "Command | Group"]
    closing: str = "."
    """How the help's last sentence, which names ``--help`` of the commands, ends."""
    default: Command | None = None
    """What runs where the first argument is none of the commands; its help follows the list."""

    def run(self, name: str, argv: list[str]) -> int:
        """Run one command, or show the help where none is named.

        Args:
            name: What the user typed so far: ``slamgym``, or ``slamgym dataset``.
            argv: The arguments after it.

        Returns:
            The exit code.

        Raises:
            SlamgymError: If there is no such command; the error suggests the nearest.
        """
        if not argv or argv[0] in ("-h", "--help", "help"):
            sys.stdout.write(self.usage(name))
            if self.default is not None:
                with contextlib.suppress(SystemExit):  # a help page ends the program
                    self.default.run(name, ["--help"])
            return 0
        if self.default is not None and argv[0] not in self.commands:
            return self.default.run(name, argv)
        if argv[0] not in self.commands:
            typed = f"{name} {argv[0]}".removeprefix("slamgym ")
            raise SlamgymError(
                f"unknown command {typed!r}; {suggest(argv[0], self.commands)} ({name} --help lists them all)"
            )
        return self.commands[argv[0]].run(f"{name} {argv[0]}", argv[1:])

    def usage(self, name: str) -> str:
        """The help."""
        width = max(map(len, self.commands))
        rows = "\n".join(f"  {word:<{width}}  {command.help}" for word, command in self.commands.items())
        return (
            f"usage: {name} <command> [options]\n\n{self.help[0].upper()}{self.help[1:]}.\n\ncommands:\n{rows}\n\n"
            f"{name} <command> --help shows a command's options{self.closing}\n"
        )


TABLE = Group(
    "floor plan in, honest SLAM map out, and the way back to CAD",
    {
        "plans": Command("plans:main", "fetch, list, check, draw and write floor plans"),
        "generate": Command("generate:main", "explore floor plans and write SLAM/CAD map pairs"),
        "dataset": Group(
            "render, clean, split, check and describe what generate has made",
            {
                "merge": Command("dataset.merge:main", "put the shards of a dataset together"),
                "stats": Command("dataset.stats:main", "what lies in a dataset, as tables or JSON"),
                "show": Command("dataset.show:main", "draw pairs: a sample, some by name, the worst"),
                "check": Command("dataset.check:main", "verify every file and name every fault"),
                "clean": Command("dataset.clean:main", "decide which pairs are complete enough to keep"),
                "review": Command("dataset.review:main", "a page on which a person judges doubtful pairs"),
                "realism": Command("dataset.realism:main", "compare its SLAM maps with those of robots"),
                "split": Command("dataset.split:main", "put plans, with their near-duplicates, on a side"),
                "render": Command("dataset.render:main", "make uniform square images for training"),
                "pack": Command("dataset.pack:main", "images as shards that stream (WebDataset, Parquet)"),
            },
            closing=". `slamgym generate` makes a dataset.",
        ),
        "watch": Command("watch:main", "watch an exploration in a window, or write it as MP4 or GIF"),
        "drive": Command("drive:main", "explore a building by keyboard, and keep the pair"),
        "agents": Group(
            "train, evaluate and compare explorers",
            {
                "train": Command("agents.train:main", "train a policy by reinforcement learning", LEARNING),
                "evaluate": Command("agents.evaluate:main", "compare explorers on the same plans and seeds"),
                "record": Command(
                    "agents.record:main", "explorations as a Minari dataset, for offline learning"
                ),
                "shape": Command("agents.shape:main", "compare reward presets over several seeds"),
            },
        ),
        "bench": Group(
            "measure explorers on frozen buildings, starts and seeds, and rank them",
            {
                "run": Command("agents.bench:run_command", "explore the buildings with one explorer"),
                "leaderboard": Command("agents.bench:leaderboard_command", "rank result files on a page"),
            },
        ),
        "deform": Command("deform:main", "SLAM maps that a robot might have drawn of a floor plan"),
        "calibrate-odometry": Command(
            "calibrate_odometry:main", "measure the simulated robot's odometry errors"
        ),
        "slam": Command("slam:main", "make a map from a recorded log (CARMEN, ROS bag, episode)"),
        "localize": Command("localize:main", "find the robot of a log on a finished map"),
        "export-log": Command("export_log:main", "write an episode or a log as CARMEN log or rosbag2"),
        "gan": Group(
            "train and use the translators between SLAM maps and CAD drawings",
            {
                "train": Command(
                    "gan.main:train_command",
                    "train a translator on a folder of rendered map pairs",
                    TRANSLATING,
                ),
                "translate": Command(
                    "gan.main:translate_command",
                    "translate SLAM maps (images, ROS maps, folders) to CAD maps",
                    TRANSLATING,
                ),
                "evaluate": Command(
                    "gan.main:evaluate_command",
                    "measure a translator on held-out pairs, beside the baselines",
                    TRANSLATING,
                ),
                "publish": Command(
                    "gan.main:publish_command",
                    "put a run's weights among the pretrained ones",
                    TRANSLATING,
                ),
            },
        ),
        "cad": Group(
            "draw a SLAM map with true dimensions (DXF, SVG, IFC, GeoJSON, JSON, PNG), compare it with a plan",
            {
                "draw": Command(
                    "cad.draw:main", "draw a map or a folder of maps; `slamgym cad MAP` is short for it"
                ),
                "compare": Command("cad.compare:main", "what a map shows that differs from a floor plan"),
            },
            closing=". `slamgym cad MAP` draws:",
            default=Command("cad.draw:main", "draw a map"),
        ),
        "reproduce": Command(
            "reproduce.main:main",
            "the paper's experiments, from plans to a report, by one command",
            TRANSLATING,
        ),
        "warmup": Command("warmup:main", "compile the numeric kernels, once after an installation"),
        "doctor": Command("doctor:main", "what is installed, what works, and the fix for what doesn't"),
        "completion": Command(
            "completion:main", "a script by which bash or zsh completes commands and options"
        ),
    },
    closing="; slamgym --version the version.",
)


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: The arguments after the program's name; None takes them from ``sys.argv``.

    Returns:
        The exit code: 0 success, 2 an error that the user can fix, 130 interrupted, 141 nobody reads on, 143 ended by
        SIGTERM.
    """
    _open_streams()
    try:
        try:
            return _run(sys.argv[1:] if argv is None else argv)
        finally:
            sys.stdout.flush()  # also after a help page, which ends the program
    except OSError as error:
        if error.filename is not None or error.errno not in _UNWRITABLE:
            raise
        _abandon_streams()
        if error.errno == errno.EPIPE:
            return EXIT_BROKEN_PIPE  # the reader (`| head`) has gone: nothing is wrong
        _complain(f"standard output can't be written ({error.strerror}); send it elsewhere")
        return EXIT_USER_ERROR


def _run(arguments: list[str]) -> int:
    try:
        if arguments[:1] in (["-V"], ["--version"]):
            tell(f"slamgym {__version__}")
            return 0
        with termination_as_interrupt():
            return TABLE.run("slamgym", arguments)
    except SlamgymError as error:
        _complain(str(error))
        return EXIT_USER_ERROR
    except Terminated:
        _complain("ended by SIGTERM")
        return EXIT_TERMINATED
    except KeyboardInterrupt:
        _complain("interrupted")
        return EXIT_INTERRUPTED


def _open_streams() -> None:
    """Open those of the standard streams that are closed, lest a file take their place, and let none refuse a text."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)  # the lowest free number
            os.set_inheritable(descriptor, True)
            setattr(sys, name, os.fdopen(descriptor, mode, encoding="utf-8"))
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as the standard error does


def _abandon_streams() -> None:
    """Drop what couldn't be written, about which the interpreter would complain at exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _complain(message: str) -> None:
    with contextlib.suppress(OSError):  # the exit code says it where nobody reads the sentence
        say(f"slamgym: error: {message}")
