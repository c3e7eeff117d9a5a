"""The table of commands and what the user sees when something goes wrong."""

import importlib
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import tyro
from help_pages import help_pages, options_of

from slamgym import __version__
from slamgym.commands import cli, frame
from slamgym.core.config import Arguments
from slamgym.core.errors import InputFileError
from slamgym.core.progress import say, tell


def groups(name="slamgym", group=cli.TABLE):
    """Every group of commands by what the user types for it."""
    yield name, group
    for word, entry in group.commands.items():
        if isinstance(entry, cli.Group):
            yield from groups(f"{name} {word}", entry)


GROUPS = dict(groups())
COMMANDS = {
    f"{name} {word}": command
    for name, group in GROUPS.items()
    for word, command in group.commands.items()
    if isinstance(command, cli.Command)
}


class ProbeArguments(Arguments):
    """A probe."""

    words: tyro.conf.Positional[tuple[str, ...]] = ()
    """Anything."""


def _raise(error):
    def run(words):
        raise error

    return run


@pytest.fixture
def command(monkeypatch):
    """Registers a function as the command ``probe``."""

    def register(function, extra=None):
        def run(arguments: ProbeArguments) -> int | None:
            return function(arguments.words)

        module = type(sys)("slamgym.commands.probe")
        module.run = run
        monkeypatch.setitem(sys.modules, "slamgym.commands.probe", module)
        monkeypatch.setitem(cli.TABLE.commands, "probe", cli.Command("probe:run", "a probe", extra))

    return register


@pytest.mark.parametrize("name", GROUPS)
def test_the_help_lists_every_command_with_its_line(name, capsys):
    for argv in ([], ["-h"], ["--help"], ["help"]):
        assert cli.main([*name.split()[1:], *argv]) == 0
        shown = capsys.readouterr().out
        assert shown.startswith(f"usage: {name} <command>")
        assert all(
            f"  {word}" in shown and entry.help in shown
            for word, entry in GROUPS[name].commands.items()
        )


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_exists(name):
    module, function = COMMANDS[name].target.split(":")
    assert callable(getattr(importlib.import_module(f"slamgym.commands.{module}"), function))


def test_every_command_shows_at_most_twenty_options_and_calls_them_alike():
    pages = help_pages()
    assert pages.keys() >= {"plans list", "cad", "generate", "agents train wheels"}
    options = {name: set(options_of(page)) - {"--help"} for name, page in pages.items()}
    many = {name: own for name, own in options.items() if len(own) > 20}
    assert not many, "give the others as settings: --config and --set"
    assert not {
        n for n, page in pages.items() if "--out" in options_of(page) and " -o " not in page
    }


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"slamgym {__version__}\n"


@pytest.mark.parametrize(
    ("typed", "nearest", "group"),
    [
        ("generat", "generate", "slamgym"),
        ("agents trian", "train", "slamgym agents"),
        ("dataset rendr", "render", "slamgym dataset"),
        ("gan evalute", "evaluate", "slamgym gan"),
    ],
)
def test_a_typo_gets_its_whole_name_and_the_nearest(typed, nearest, group, capsys):
    assert cli.main(typed.split()) == 2
    assert capsys.readouterr().err == (
        f"slamgym: error: unknown command {typed!r}; did you mean {nearest!r}? ({group} --help lists them all)\n"
    )


def test_the_command_gets_the_rest_of_the_arguments_and_its_code_is_returned(command):
    seen = []
    command(lambda words: seen.append(words) or 7)
    assert cli.main(["probe", "a", "b"]) == 7
    assert seen == [("a", "b")]


@pytest.mark.parametrize("typed", ["probe --quiet", "--quiet probe"])
def test_quiet_hides_notes_but_neither_results_nor_errors(command, capsys, typed):
    def run(words):
        say("a note")
        tell("a result")
        raise InputFileError("plan.json", "is empty")

    command(run)
    assert cli.main(typed.split()) == 2
    assert capsys.readouterr() == ("a result\n", "slamgym: error: plan.json: is empty\n")


@pytest.mark.parametrize("words", ["cad nowhere.yaml -o out", "localize nowhere.yaml log -o out"])
def test_a_map_that_is_missing_is_said_before_all_else(words, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(frame, "is_installed", lambda package: package != "torch")
    assert cli.main(words.split()) == 2
    assert "nowhere.yaml: doesn't exist; give a map" in capsys.readouterr().err


def test_an_error_of_the_users_is_one_line(command, capsys):
    command(_raise(InputFileError("plan.json", "is empty")))
    assert cli.main(["probe"]) == 2
    assert capsys.readouterr().err == "slamgym: error: plan.json: is empty\n"


def test_ctrl_c_is_one_line_and_130(command, capsys):
    command(_raise(KeyboardInterrupt()))
    assert cli.main(["probe"]) == 130
    assert capsys.readouterr().err == "slamgym: error: interrupted\n"


@pytest.mark.skipif(os.name != "posix", reason="POSIX signals")
def test_sigterm_ends_a_command_as_ctrl_c_does(command, capsys):
    cleaned = []

    def work(words):
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            cleaned.append(words)
            raise

    before = signal.getsignal(signal.SIGTERM)
    command(work)
    assert cli.main(["probe"]) == 143
    assert capsys.readouterr().err == "slamgym: error: ended by SIGTERM\n"
    assert cleaned == [()]
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_bug_keeps_its_traceback(command):
    command(_raise(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        cli.main(["probe"])


def test_a_missing_extra_is_named_before_the_command_works(command, capsys):
    command(_raise(AssertionError("the command ran")), cli.Extra("gan", ("sys", "no_such_package")))
    assert cli.main(["probe", "--out", "x"]) == 2
    assert capsys.readouterr().err == (
        "slamgym: error: slamgym probe needs the package 'no_such_package'; "
        "install it with: pip install 'slamgym[gan]'\n"
    )


@pytest.mark.parametrize(
    ("typed", "missing", "extra"),
    [
        ("agents train wheels -o run", "stable_baselines3", "agents"),
        ("agents shape -o run", "torch", "agents"),
        ("gan translate map.png -o out.png", "safetensors", "gan"),
        ("gan train images -o run", "torch", "gan"),
        ("cad map.yaml -o out --model own.safetensors", "torch", "gan"),
        ("gan evaluate images -o results", "matplotlib", "gan"),
        ("export-log episode -o bag --format rosbag2", "rosbags", "ros"),
    ],
)
def test_each_command_names_its_extra_at_once(typed, missing, extra, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    Path("map.yaml").touch()
    monkeypatch.setattr(frame, "is_installed", lambda package: package != missing)
    assert cli.main(typed.split()) == 2
    error = capsys.readouterr().err
    assert (
        f"needs the package {missing!r}; install it with: pip install 'slamgym[{extra}]'" in error
    )
    assert error.count("\n") == 1
    assert ("--model slam2cad" in error) == typed.startswith("cad ")  # which can do without
    assert [path.name for path in tmp_path.iterdir()] == ["map.yaml"]


@pytest.mark.parametrize("words", ["slam {} -o out", "cad {} -o out", "cad map.yaml -o {}"])
def test_a_name_that_is_too_long_is_one_line(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.yaml").touch()
    assert cli.main(words.format("a" * 300).split()) == 2
    assert "name too long); name another path" in capsys.readouterr().err


STREAMS = {
    "plans list --count 2 >&-": (0, False),
    "plans list --count 2 >&- 2>&-": (0, False),
    "nonsense 2>&-": (2, False),
    "nonsense 2> /dev/full": (2, False),
    "plans list --count 2 > /dev/full": (2, True),
    "plans list --help > /dev/full": (2, True),
    "--version > /dev/full": (2, True),
    "--help | true": (141, False),
    "plans list --count 2 | true": (141, False),
    "plans list --help | true": (141, False),
}
"""What a shell does with the output: the exit code, and whether a sentence says why."""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize("words", STREAMS)
def test_an_output_that_is_closed_or_full_costs_no_traceback(words):
    program = shlex.join([sys.executable, "-m", "slamgym"])
    code = "exit ${PIPESTATUS[0]}"
    done = subprocess.run(
        ["bash", "-c", f"{program} {words}; {code}"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    expected, has_sentence = STREAMS[words]
    assert done.returncode == expected, done.stderr
    assert len(done.stderr.splitlines()) == has_sentence, done.stderr
