"""The command table and what the user sees when something goes wrong."""

import os
import subprocess
import sys

import pytest
from slamgym.commands.table import load_target

from slamgym import __version__
from slamgym.commands import cli
from slamgym.core.errors import InputFileError


def _raise(error):
    def run(argv):
        raise error

    return run


@pytest.fixture
def command(monkeypatch):
    """Registers a function as the command ``probe``."""

    def register(function, inject=None):
        module = type(sys)("cli_probe")
        module.run = function
        module.injected = "from the table"
        monkeypatch.setitem(sys.modules, "cli_probe", module)
        monkeypatch.setitem(cli.COMMANDS, "probe", cli.Command("cli_probe:run", "a probe", inject or {}))

    return register


def test_help_lists_every_command(capsys):
    assert cli.main(["--help"]) == 0
    shown = capsys.readouterr().out
    for name, entry in cli.COMMANDS.items():
        assert f"  {name}" in shown
        assert entry.help in shown


def test_no_arguments_show_the_help(capsys):
    assert cli.main([]) == 0
    assert "usage: slamgym" in capsys.readouterr().out


def test_version(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"slamgym {__version__}\n"


def test_unknown_command_suggests_the_nearest(capsys):
    assert cli.main(["generat"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("slamgym: error: unknown command 'generat'; did you mean 'generate'?")
    assert error.count("\n") == 1


def test_the_command_gets_the_rest_of_the_arguments_and_its_code_is_returned(command):
    seen = []
    command(lambda argv: seen.append(argv) or 7)
    assert cli.main(["probe", "--a", "b"]) == 7
    assert seen == [["--a", "b"]]


def test_injected_values_are_looked_up(command):
    seen = []
    command(lambda argv, thing: seen.append(thing) or 0, {"thing": "cli_probe:injected"})
    assert cli.main(["probe"]) == 0
    assert seen == ["from the table"]


def test_a_mendable_error_is_one_line(command, capsys):
    command(_raise(InputFileError("plan.json", "is empty")))
    assert cli.main(["probe"]) == 2
    assert capsys.readouterr().err == "slamgym: error: plan.json: is empty\n"


def test_ctrl_c_is_one_line_and_130(command, capsys):
    command(_raise(KeyboardInterrupt()))
    assert cli.main(["probe"]) == 130
    assert capsys.readouterr().err == "slamgym: error: interrupted\n"


def test_a_bug_keeps_its_traceback(command):
    command(_raise(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        cli.main(["probe"])


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_exists(name):
    entry = cli.COMMANDS[name]
    for target in (entry.target, *entry.inject.values()):
        assert callable(load_target(target))


def _python(code, **kwargs):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, **kwargs)


def test_help_needs_no_heavy_import():
    shown = _python(
        "import sys; from slamgym import cli; cli.main(['--help'])\n"
        "heavy = ('numba', 'cv2', 'pymunk', 'shapely', 'torch', 'tyro', 'agents')\n"
        "print([m for m in heavy if m in sys.modules])"
    ).stdout
    assert shown.endswith("[]\n")


def test_a_reader_that_leaves_early_is_no_error():
    read, write = os.pipe()
    os.close(read)
    process = subprocess.Popen(
        [sys.executable, "-m", "slamgym.commands.cli", "--help"], stdout=write, stderr=subprocess.PIPE
    )
    os.close(write)
    _, error = process.communicate(timeout=60)
    assert process.returncode == cli.EXIT_BROKEN_PIPE
    assert error == b""
