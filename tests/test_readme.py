"""The commands and code in the README and the docs run."""

import contextlib
import functools
import io
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from slamgym.cad import open_plans
from slamgym.commands import cli

ROOT = Path(__file__).parents[1]
MOST_WIDE_TABLE = 120
"""Characters of a line of a table in the README."""
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(language: str) -> list[tuple[str, str]]:
    """(page name, code) of every fenced block in a language."""
    fence = re.compile(rf"^```{language}\n(.*?)^```", re.DOTALL | re.MULTILINE)
    return [(page.name, code) for page in PAGES for code in fence.findall(page.read_text())]


def slamgym_commands() -> list[tuple[str, str]]:
    """(page name, command line) of every `slamgym ...` line in a shell block."""
    found = []
    for page, code in blocks("sh"):
        for line in code.replace("\\\n", " ").splitlines():
            command = line.split("#")[0].strip()
            if command.startswith("slamgym "):
                found.append((page, command))
    return found


@pytest.mark.parametrize(("page", "code"), blocks("python"))
def test_python_blocks_run(page, code, tmp_path):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{page}:\n{code}\n{done.stderr}"


def test_there_are_commands_to_check():
    assert slamgym_commands()


@pytest.fixture(scope="module")
def help_of():
    """The help of a command, asked for once."""

    @functools.cache
    def ask(*verbs: str) -> str:
        shown = io.StringIO()
        with (
            pytest.MonkeyPatch.context() as patch,
            contextlib.redirect_stdout(shown),
            contextlib.suppress(SystemExit),
        ):
            patch.setenv("COLUMNS", "200")
            cli.main([*verbs, "--help"])
        return shown.getvalue()

    return ask


@pytest.mark.parametrize(("page", "command"), sorted(set(slamgym_commands())))
def test_commands_exist_and_know_their_options(help_of, page, command):
    words = shlex.split(command.partition(" --ros-args")[0])[1:]  # what follows is ROS's own
    depth, entry = 0, cli.TABLE
    while isinstance(entry, cli.Group) and words[depth] in entry.commands:
        depth, entry = depth + 1, entry.commands[words[depth]]
    help_text = help_of(*words[:depth])
    assert "usage: slamgym" in help_text
    for option in (word.split("=")[0] for word in words if word.startswith("--")):
        assert re.search(rf"{option}(?![\w-])", help_text), (
            f"{page}: {command}: {option} is unknown"
        )


def test_floor_plans_named_in_commands_exist():
    named = {
        plans
        for _, command in slamgym_commands()
        for plans in re.findall(r"--plans (\S+)", command)
    }
    for name in {part.partition("=")[0] for plans in named for part in plans.split(",")}:
        if not name.isdigit() and "." not in name:  # neither a number of them nor a file
            assert open_plans(name).ids


def test_make_targets_named_in_the_readme_exist():
    makefile = (ROOT / "Makefile").read_text()
    targets = {
        target
        for _, code in blocks("sh")
        for target in re.findall(r"^make (\w+)", code, re.MULTILINE)
    }
    assert {"demo", "test"} <= targets
    assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_fence_has_a_language_and_included_files_exist(page):
    fences = re.findall(r"^```(.*)$", page.read_text(), re.MULTILINE)
    assert all(fences[::2]), f"{page.name}: a fence without a language"
    for path in re.findall(r'^--8<-- "(.+)"$', page.read_text(), re.MULTILINE):
        assert (ROOT / path).is_file()


def test_tables_of_the_readme_are_narrow():
    lines = (ROOT / "README.md").read_text().splitlines()
    assert [line for line in lines if line.startswith("|") and len(line) > MOST_WIDE_TABLE] == []


def test_linked_files_exist():
    for page in PAGES:
        for link in re.findall(r"\]\((?!https?://|#)([^)#]+)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name} links to {link}"
