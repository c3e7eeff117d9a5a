"""Every table of commands: its help, its errors, and that what it names exists."""

import sys

import pytest
import slamgym.commands.agents.table
import slamgym.commands.dataset.table
import slamgym.commands.gan.table
from slamgym.commands.table import load_target

from slamgym.commands import cli
from slamgym.core.errors import SlamgymError

TABLES = [
    cli.TABLE,
    slamgym.commands.dataset.table.TABLE,
    slamgym.commands.agents.table.TABLE,
    slamgym.commands.gan.table.TABLE,
]


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
        if name != "slamgym.commands.gan.table":
            monkeypatch.delitem(sys.modules, name)
    with pytest.raises(SlamgymError, match=r"the package 'torch' is missing; .*slamgym\[gan\]"):
        slamgym.commands.gan.table.main(["train", "--help"])


def test_another_missing_package_is_no_error_of_the_users(monkeypatch):
    monkeypatch.setitem(sys.modules, "slamgym.commands.gan.train", None)
    with pytest.raises(ModuleNotFoundError):
        slamgym.commands.gan.table.main(["train"])
