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
from help_pages import help_pages, options_of

from slamgym.cad import open_plans
from slamgym.commands import cli

ROOT = Path(__file__).parents[1]
MOST_WIDE_TABLE = 120
"""Characters of a line of a table in the README."""
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9.-]*")
SPAN = re.compile(r"(?<!`)`([^`]+)`(?!`)")
SCRIPT = re.compile(r"benchmarks/[\w/]+\.py")
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


def prose_options() -> list[tuple[str, str, str]]:
    """(page, a span of code in its prose, option) of every option that isn't in a block of code."""
    found = []
    for page in PAGES:
        prose = re.sub(
            r"^```.*?^```|<!--.*?-->", "", page.read_text(), flags=re.DOTALL | re.MULTILINE
        )
        for span in SPAN.findall(prose):
            words = " ".join(span.partition("--ros-args")[0].split())
            if words.startswith(("slamgym ", "python benchmarks/", "--")):
                found += [
                    (str(page.relative_to(ROOT)), words, one) for one in OPTION.findall(words)
                ]
    return found


@pytest.fixture(scope="module")
def options() -> dict[str, set[str]]:
    """The options of every command."""
    pages = {name: set(options_of(page)) for name, page in help_pages().items()}
    return {name: own | {"--help"} for name, own in pages.items()}


@pytest.mark.parametrize(("page", "words", "option"), sorted(set(prose_options())))
def test_an_option_named_in_prose_exists(options, page, words, option):
    """An option alone is one of any command, or of a script that the page names."""
    if words.startswith("slamgym "):
        verbs = words.split()[1:]
        names = [" ".join(verbs[:count]) for count in (3, 2, 1)]
        known = next((options[name] for name in names if name in options), {"--help", "--version"})
    elif words.startswith("python "):
        known = script_options(words.split()[1])
        fields = re.findall(r"^    (\w+): ", (ROOT / words.split()[1]).read_text(), re.MULTILINE)
        known |= {"--" + field.replace("_", "-") for field in fields}
    else:
        scripts = SCRIPT.findall((ROOT / page).read_text())
        known = set().union(*options.values(), *map(script_options, scripts))
        known |= {"--renew-golden"}  # pytest's, in tests/golden
    assert option in known, f"{page}: `{words}`"


def script_options(script: str) -> set[str]:
    """The options that stand in a script."""
    return set(OPTION.findall((ROOT / script).read_text()))


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
