"""Every table of commands: its help, its errors, and that what it names exists."""

import sys

import pytest

import agents.commands
import gan.commands
import slamgym.dataset.commands
from slamgym import cli
from slamgym.command_table import load_target
from slamgym.errors import SlamgymError

TABLES = [cli.TABLE, slamgym.dataset.commands.TABLE, agents.commands.TABLE, gan.commands.TABLE]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.program)
def test_the_help_lists_every_command_with_its_line(table, capsys):
    for argv in ([], ["-h"], ["--help"], ["help"]):
        assert table.run(argv) == 0
        shown = capsys.readouterr().out
        assert shown.startswith(f"usage: {table.program} <command>")
        assert all(f"  {name}" in shown and entry.help in shown for name, entry in table.commands.items())


@pytest.mark.parametrize(
    ("group", "typed", "nearest"),
    [("agents", "trian", "train"), ("dataset", "rendr", "render"), ("gan", "evalute", "evaluate")],
)
def test_a_typo_in_a_group_gets_its_whole_name_and_the_nearest(group, typed, nearest, capsys):
    assert cli.main([group, typed]) == 2
    assert capsys.readouterr().err == (
        f"slamgym: error: unknown command '{group} {typed}'; did you mean '{nearest}'? "
        f"(slamgym {group} --help lists them all)\n"
    )


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.program)
def test_every_command_of_every_table_exists(table):
    for entry in table.commands.values():
        for target in (entry.target, *entry.inject.values()):
            assert callable(load_target(target))


def test_a_missing_package_of_the_extra_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in [name for name in sys.modules if name.startswith("gan.")]:
        if name != "gan.commands":
            monkeypatch.delitem(sys.modules, name)
    with pytest.raises(SlamgymError, match=r"the package 'torch' is missing; .*slamgym\[gan\]"):
        gan.commands.main(["train", "--help"])


def test_another_missing_package_is_no_error_of_the_users(monkeypatch):
    monkeypatch.setitem(sys.modules, "gan.train_command", None)
    with pytest.raises(ModuleNotFoundError):
        gan.commands.main(["train"])
