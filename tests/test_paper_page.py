"""docs/paper.md names everything of the paper, and what it names exists: functions, tests, settings."""

import importlib
import json
import re
from collections import defaultdict
from typing import NamedTuple

import pytest
import tyro
from source_tree import ROOT, modules

from slamgym.commands.dataset.render import RenderArguments
from slamgym.commands.deforming.arguments import DeformArguments
from slamgym.commands.generate import GenerateArguments
from slamgym.commands.settings import SettingsOptions
from slamgym.core.config import to_dict
from slamgym.dataset.curate.cleaning import CleanConfig
from slamgym.parametric.config import ParametricConfig

PAGE = (ROOT / "docs" / "paper.md").read_text()
WHAT = [
    *(f"({number}) " for number in range(1, 21)),
    "Table I:",
    "Table II:",
    *(f"Figure {number}:" for number in range(1, 10)),
]
STEPS = (
    "7-minute explorations", "stuck", "squaring", "resizing", "pixel values", "thickness of CAD edges", "15 features",
    "Extra Trees", "band 0.4 to 0.8", "4,224 pairs to train, 21 and 9", "Adam, rate 0.0002, betas 0.55 and 0.99",
    "the rate falls after 70 %", "Model32", "Modelprog grows", "no augmentation",
)  # fmt: skip
SETTING = re.compile(r"`(gan|images|clean|parametric|deform|generate): ([\w.]+)=([^`]+)`")
COMMANDS = {
    "images": (RenderArguments, ["pairs", "--out", "images"]),
    "deform": (DeformArguments, ["bundled", "--out", "maps", "--method", "parametric"]),
    "generate": (GenerateArguments, ["--out", "pairs"]),
}
"""Program to its arguments, and those that it needs anyway."""


class Row(NamedTuple):
    """A line of a table."""

    what: str
    code: str
    test: str
    difference: str


ROWS = [
    Row(*(cell.strip() for cell in line.strip("|").split(" | ")))
    for line in PAGE.splitlines()
    if line.startswith("| ") and not line.startswith(("| of the paper", "| step of the paper"))
]
every_row = pytest.mark.parametrize("row", ROWS, ids=lambda row: row.what[:30])


@pytest.mark.parametrize("what", [*WHAT, *STEPS])
def test_everything_of_the_paper_has_one_row(what):
    assert sum(row.what.startswith(what) for row in ROWS) == 1


def test_the_page_says_that_nothing_on_it_is_deleted():
    assert re.search(r"Nothing on this page is\s+ever deleted for size", PAGE)


@every_row
def test_what_is_named_exists(row):
    names = re.findall(r"`([\w.]+)`", row.code)
    assert names
    for name in names:
        if name.startswith("slamgym.gan"):
            pytest.importorskip("torch")
        found, rest = module_of(name)
        for part in rest:
            found = getattr(found, part)


def module_of(name):
    """The longest module of a dotted name, imported, and the parts of the name behind it."""
    parts = name.split(".")
    if parts[0] == "benchmarks":  # no package
        path = ROOT.joinpath(*parts[:-1]).with_suffix(".py")
        assert f"def {parts[-1]}(" in path.read_text()
        return None, []
    for count in range(len(parts), 0, -1):
        module = ".".join(parts[:count])
        if module in modules():
            return importlib.import_module(module), parts[count:]
    raise AssertionError(f"no module of {name}")


@every_row
def test_its_tests_exist(row):
    names = re.findall(r"`(tests/[\w/.]+\.py)(?:::(\w+))?`", row.test)
    assert names
    for path, test in names:
        text = (ROOT / path).read_text()
        assert not test or re.search(rf"(def|class) {test}\b", text), f"{path}::{test}"


@every_row
def test_its_settings_are_taken(row):
    by_program = defaultdict(list)
    for program, name, value in SETTING.findall(row.difference):
        by_program[program].append((name, value))
    for program, settings in by_program.items():
        if program in COMMANDS:
            kind, words = COMMANDS[program]
            options = [[f"--{name.replace('_', '-')}", value] for name, value in settings]
            tyro.cli(kind, args=[*words, *(word for option in options for word in option)])
            continue
        for name, value in settings:
            taken = SettingsOptions(set=((f"{name}={value}",),)).configured(default(program), {})
            found = to_dict(taken)
            for part in name.split("."):
                found = found[part]
            is_word = value[0].isalpha() and value not in ("true", "false")
            assert found == (value if is_word else json.loads(value))


def default(program):
    """The settings that a program begins with."""
    if program == "gan":
        pytest.importorskip("torch")
        return importlib.import_module("slamgym.gan.presets").find_preset("model32")
    return CleanConfig() if program == "clean" else ParametricConfig()


def test_presets_that_are_named_exist():
    presets = pytest.importorskip("slamgym.gan.presets").TRANSLATOR_PRESETS
    assert set(re.findall(r"--preset ([\w-]+)", PAGE)) == {"model32", "modelprog"}
    assert {"model32", "modelprog", "model32-cpu"} <= presets.keys()


def test_no_code_span_is_a_setting_of_an_unknown_program():
    spans = re.findall(r"`(\w+: [^`]+=[^`]+)`", PAGE)
    known = [f"{program}: {name}={value}" for program, name, value in SETTING.findall(PAGE)]
    assert [span for span in spans if span != "program: name=value"] == known
