"""The command line: ``slamgym <command> [options]``.

One table names every command, also those of the groups (``slamgym dataset``, ``slamgym agents``, ``slamgym gan``).
Nothing is imported before it is needed, so a help page answers at once.
"""

import contextlib
import errno
import importlib
import io
import os
import shlex
import sys
import typing
from dataclasses import dataclass, field

import tyro

from slamgym import __version__
from slamgym.commands.frame import LEARNING, ROS2, TRANSLATING, Extra, require
from slamgym.core.config import suggest
from slamgym.core.errors import SlamgymError
from slamgym.core.interruption import Terminated, termination_as_interrupt
from slamgym.core.progress import say, tell

QUIET = "--quiet"
"""Option of every command: no progress and no notes, only results and errors."""
EXIT_USER_ERROR = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells report it
EXIT_TERMINATED = 143  # 128 + SIGTERM
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE
_UNWRITABLE = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
_UNUSABLE = (errno.ENAMETOOLONG, errno.EACCES)
"""What makes it an error to ask whether a path exists."""


@dataclass(frozen=True)
class Command:
    """One row of the table."""

    target: str
    """``module:function`` below ``slamgym.commands``. It takes ``arguments``, of the class that it declares, and if it
    declares ``typed``, the whole command line, or ``ros``, ROS's own words; it returns an exit code, or None for 0."""
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
        command = getattr(importlib.import_module(f"slamgym.commands.{module}"), function)
        hints = typing.get_type_hints(command)
        is_quiet = QUIET in argv
        words = [word for word in argv if word != QUIET]
        typed = shlex.join([*name.split(), *words])
        ros: tuple[str, ...] = ()
        if "ros" in hints and "--ros-args" in words:  # what follows is ROS's own
            end = words.index("--ros-args")
            ros = tuple(words[end:])
            words = words[:end]
        arguments = tyro.cli(
            hints["arguments"], args=words, prog=name, config=(tyro.conf.FlagCreatePairsOff,)
        )
        with contextlib.redirect_stderr(io.StringIO()) if is_quiet else contextlib.nullcontext():
            if "typed" in hints:
                status = command(arguments, typed)
            elif "ros" in hints:
                status = command(arguments, ros)
            else:
                status = command(arguments)
            return int(status or 0)


@dataclass(frozen=True)
class Group:
    """Commands under one name."""

    help: str
    """One line for the help above it; a sentence, for the group's own."""
    closing: str = "."
    """End of the last sentence of the help, which names ``--help`` of the commands."""
    default: Command | None = None
    """Runs if the first argument is none of the commands; its help follows the list."""
    commands: dict[str, "Command | Group"] = field(default_factory=dict)

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
        if argv[:1] == [QUIET]:  # it may stand before the command, too
            argv = [*argv[1:], *argv[:1]]
        if not argv or argv[0] in ("-h", "--help", "help", QUIET):
            sys.stdout.write(self.usage(name))
            if self.default is not None:
                with contextlib.suppress(SystemExit):  # a help page ends the program
                    self.default.run(name, ["--help"])
            return 0
        if self.default is not None and argv[0] not in self.commands:
            return self.default.run(name, argv)
        if argv[0] not in self.commands:
            typed = f"{name} {argv[0]}".removeprefix("slamgym ")
            nearest = suggest(argv[0], self.commands)
            raise SlamgymError(
                f"unknown command {typed!r}; {nearest} ({name} --help lists them all)"
            )
        return self.commands[argv[0]].run(f"{name} {argv[0]}", argv[1:])

    def usage(self, name: str) -> str:
        """The help."""
        width = max(map(len, self.commands))
        rows = "\n".join(
            f"  {word:<{width}}  {command.help}" for word, command in self.commands.items()
        )
        return (
            f"usage: {name} <command> [options]\n\n{self.help[0].upper()}{self.help[1:]}.\n\ncommands:\n{rows}\n\n"
            f"{name} <command> --help shows a command's options, {QUIET} hides its progress and notes{self.closing}\n"
        )


GROUPS = {
    "": Group(
        "floor plans to SLAM maps with realistic errors, and back to CAD drawings",
        "; slamgym --version the version.",
    ),
    "plans": Group("fetch, list, check, draw and write floor plans"),
    "dataset": Group(
        "render, clean, split, check and describe what generate has made",
        ". `slamgym generate` makes a dataset.",
    ),
    "agents": Group("train, evaluate and compare explorers"),
    "agents train": Group("train a policy by reinforcement learning"),
    "bench": Group("measure explorers on frozen buildings, starts and seeds, and rank them"),
    "ros2": Group(
        "a simulated robot, the mapper and the explorers as ROS 2 nodes",
        ". `--ros-args` and what follows is ROS's own: remappings (-r) and parameters (-p), called as the options.",
    ),
    "gan": Group("train and use the translators between SLAM maps and CAD drawings"),
    "cad": Group(
        "draw a SLAM map with true dimensions (DXF, SVG, IFC, GeoJSON, JSON, PNG), compare it with a plan",
        ". `slamgym cad MAP` draws:",
        default=Command("cad.draw:main", "draw a map"),
    ),
}
"""Commands under one name, by what the user types for them."""
COMMANDS = {
    "plans list": Command(
        "plans:list_command", "print id, area, rooms and size of every usable plan"
    ),
    "plans check": Command(
        "plans:check_command", "which plans can be explored, what is wrong with others"
    ),
    "plans draw": Command("plans:draw_command", "draw plans on one picture"),
    "plans write": Command("plans:write_command", "write usable plans as HouseExpo files"),
    "plans fetch": Command("plans:fetch_command", "download a public archive of floor plans"),
    "generate": Command("generate:main", "explore floor plans and write SLAM/CAD map pairs"),
    "dataset merge": Command("dataset.folders:merge", "put the shards of a dataset together"),
    "dataset stats": Command("dataset.describe:stats", "what lies in a dataset, as tables or JSON"),
    "dataset show": Command(
        "dataset.describe:show", "draw pairs: a sample, some by name, the worst"
    ),
    "dataset check": Command("dataset.folders:check", "verify every file and name every fault"),
    "dataset clean": Command(
        "dataset.clean:main", "decide which pairs are complete enough to keep"
    ),
    "dataset review": Command(
        "dataset.clean:review", "a page on which a person judges doubtful pairs"
    ),
    "dataset realism": Command(
        "dataset.realism:main", "compare its SLAM maps with those of robots"
    ),
    "dataset split": Command(
        "dataset.folders:split", "put plans, with their near-duplicates, on a side"
    ),
    "dataset render": Command("dataset.render:main", "make uniform square images for training"),
    "dataset pack": Command(
        "dataset.folders:pack", "images as Parquet or WebDataset shards, with card and checksums"
    ),
    "watch": Command("watch:main", "watch an exploration in a window, or write it as MP4 or GIF"),
    "drive": Command("drive:main", "drive the robot by keys in a window, and see its map grow"),
    "agents train frontiers": Command(
        "agents.train:frontiers", "one that chooses frontiers", LEARNING
    ),
    "agents train wheels": Command("agents.train:wheels", "one that drives the wheels", LEARNING),
    "agents train hidden-floor": Command(
        "agents.train:hidden_floor", "the network of the explorer rl", LEARNING
    ),
    "agents evaluate": Command(
        "agents.evaluate:main", "compare explorers on the same plans and seeds"
    ),
    "agents record": Command(
        "agents.record:main", "explorations as a Minari dataset for offline learning"
    ),
    "agents shape": Command("agents.train:shape", "compare reward presets over several seeds"),
    "bench run": Command(
        "agents.evaluate:bench_command", "explore the buildings with one explorer"
    ),
    "bench leaderboard": Command(
        "agents.evaluate:leaderboard_command", "rank result files on a page"
    ),
    "deform": Command("deform:main", "SLAM maps that a robot might have drawn of a floor plan"),
    "slam": Command("slam:main", "make a map from a recorded log (CARMEN, ROS bag, episode)"),
    "merge": Command("merge:main", "make one map of several of one building"),
    "localize": Command("localize:main", "find the robot of a log on a finished map"),
    "export-log": Command("export_log:main", "write an episode or a log as CARMEN log or rosbag2"),
    "ros2 sim": Command("ros2:sim_command", "a TurtleBot3 in a floor plan, without Gazebo", ROS2),
    "ros2 map": Command("ros2:map_command", "map, or localise on a finished map", ROS2),
    "ros2 merge": Command("ros2:merge_command", "one map of several robots' maps", ROS2),
    "ros2 explore": Command(
        "ros2:explore_command", "explore on any mapper's map, driving itself or by Nav2", ROS2
    ),
    "ros2 demo": Command(
        "ros2:demo_command", "all three at once, then the map and its drawing", ROS2
    ),
    "gan train": Command(
        "gan.main:train_command", "train a translator on rendered map pairs", TRANSLATING
    ),
    "gan translate": Command(
        "gan.main:translate_command", "translate SLAM maps to CAD maps", TRANSLATING
    ),
    "gan evaluate": Command(
        "gan.main:evaluate_command", "measure translators on test pairs", TRANSLATING
    ),
    "cad draw": Command(
        "cad.draw:main", "draw a map or a folder of maps; `slamgym cad MAP` is short for it"
    ),
    "cad compare": Command("cad.compare:main", "what a map shows that differs from a floor plan"),
    "reproduce": Command(
        "reproduce.main:main", "the paper's experiments, plans to report", TRANSLATING
    ),
    "warmup": Command("doctor:warmup", "compile the numeric kernels, once after an installation"),
    "doctor": Command("doctor:main", "what is installed, what works, and the fix for what doesn't"),
}
for _words, _command in COMMANDS.items():
    *_path, _word = _words.split()
    for _depth, _name in enumerate(_path):
        _group = GROUPS[" ".join(_path[:_depth])]
        _group.commands[_name] = GROUPS[" ".join(_path[: _depth + 1])]
    GROUPS[" ".join(_path)].commands[_word] = _command
TABLE = GROUPS[""]


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: The arguments after the program's name; None takes them from ``sys.argv``.

    Returns:
        The exit code: 0 success, 2 an error that the user can fix, 130 interrupted, 141 its reader ended, 143 ended by
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
    except OSError as error:
        if error.filename is None or error.errno not in _UNUSABLE:
            raise
        _complain(
            f"{os.fsdecode(error.filename)}: can't be used ({error.strerror}); name another path"
        )
        return EXIT_USER_ERROR
    except Terminated:
        _complain("ended by SIGTERM")
        return EXIT_TERMINATED
    except KeyboardInterrupt:
        _complain("interrupted")
        return EXIT_INTERRUPTED


def _open_streams() -> None:
    """Open those of the standard streams that are closed, lest a file take their place, and let none refuse a text."""
    if sys.stdin is None:
        sys.stdin = _nowhere("r")
    if sys.stdout is None:
        sys.stdout = _nowhere("w")
    if sys.stderr is None:
        sys.stderr = _nowhere("w")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as the standard error does


def _nowhere(mode: typing.Literal["r", "w"]) -> typing.TextIO:
    """A stream of the lowest free number, which child processes inherit as they do the standard streams."""
    descriptor = os.open(os.devnull, os.O_RDWR)
    os.set_inheritable(descriptor, True)
    return os.fdopen(descriptor, mode, encoding="utf-8")


def _abandon_streams() -> None:
    """Drop what couldn't be written, about which the interpreter would complain at exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _complain(message: str) -> None:
    with contextlib.suppress(OSError):  # the exit code says it, too
        say(f"slamgym: error: {message}")
