"""The figures of the pages are those of their results files, and say what was measured before a change."""

import importlib.util
import json
import re
import subprocess
import sys

import pytest
from source_tree import ROOT

SPEC = importlib.util.spec_from_file_location("figures", ROOT / "benchmarks" / "figures.py")
figures = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(figures)
report = sys.modules["report"]

RESULTS = sorted(
    path for path in figures.RESULTS.rglob("*.json") if '"command"' in path.read_text()
)
FIGURE = "<!-- figure a/speed part=all gives {CPU [s]:.1f} CPU s -->9.9 CPU s<!-- end -->"
TABLE = """<!-- table
a/speed gives | {part} | {CPU [s]:.2f} | {CPU [loops]:.0f} |
-->
| part | CPU [s] | loops |
|---|---|---|
| all | 9.99 | 9 |
<!-- end -->"""


@pytest.fixture
def results(tmp_path, monkeypatch):
    """A repository with a module, and a results file of its first commit."""
    monkeypatch.setattr(figures, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(report, "RESULTS", tmp_path / "benchmarks" / "results")
    for cached in (figures.load, figures.changed_since):
        cached.cache_clear()
    (tmp_path / "measured").mkdir()
    git(tmp_path, "init", "--quiet")
    commit(tmp_path, "measured/code.py", "1")
    yield tmp_path
    for cached in (figures.load, figures.changed_since):
        cached.cache_clear()


def git(folder, *arguments):
    """A command of git in a folder."""
    who = ["-c", "user.name=nobody", "-c", "user.email=nobody@example.org"]
    done = subprocess.run(
        ["git", *who, *arguments], cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def commit(folder, path, text):
    """Commit a file; returns the commit."""
    (folder / path).write_text(text)
    git(folder, "add", path)
    git(folder, "commit", "--quiet", "-m", "Change")
    return git(folder, "rev-parse", "--short=8", "HEAD")


def write(folder, **more):
    """Write a/speed.json."""
    document = {
        "date": "2026-11-29T00:00:00+00:00",
        "machine": {"cpu": "fast"},
        "rows": [{"part": "SLAM", "CPU [s]": 1.0}, {"part": "all", "CPU [s]": 1.94}],
        "in loops": [{"CPU [loops]": 4.0}, {"CPU [loops]": 8.0}],
        **more,
    }
    path = folder / "results" / "a" / "speed.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(document))


@pytest.mark.parametrize("page", figures.pages(), ids=lambda page: page.name)
def test_a_page_has_the_figures_of_its_results_files(page):
    text = figures.without_notes(page.read_text())
    assert text == figures.fill(text, notes=False), "run: make figures"


def test_the_main_pages_take_their_figures_from_results_files():
    for name in ("README.md", "docs/measured.md", "docs/scale.md", "docs/slam.md", "docs/faq.md"):
        assert "gives " in (ROOT / name).read_text(), name


@pytest.mark.parametrize("path", RESULTS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_results_file_names_the_commit_and_the_modules_that_it_measured(path):
    document = json.loads(path.read_text())
    assert document["modules"]
    assert all((ROOT / module).exists() for module in document["modules"])
    assert len(document["commit"].removesuffix(report.UNCOMMITTED)) == 8


def test_a_figure_and_a_table_are_filled_from_the_file(results):
    write(results)
    assert figures.fill(f"takes {FIGURE}.") == f"takes {FIGURE.replace('9.9 CPU', '1.9 CPU')}."
    filled = figures.fill(TABLE)
    assert filled.splitlines()[3:] == [
        "| part | CPU [s] | loops |",
        "|---|---|---|",
        "| SLAM | 1.00 | 4 |",
        "| all | 1.94 | 8 |",
        "<!-- end -->",
    ]
    assert figures.fill(filled) == filled


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("part=all", "part=none", "a/speed: no row has {'part': 'none'}"),
        ("CPU [s]:", "CPU:", "a/speed: no column 'CPU'; there are date, cpu, part, CPU"),
        ("part=all ", "", "gives 2 figures"),
        (" gives ", " = ", "isn't FILE COLUMN=VALUE ... gives TEMPLATE"),
        ("a/speed", "a/missing", "/results/a/missing.json doesn't exist"),
    ],
)
def test_a_comment_that_names_what_is_not_there_is_refused(results, old, new, message):
    write(results)
    with pytest.raises(ValueError, match=re.escape(message)):
        figures.fill(FIGURE.replace(old, new))


def test_what_was_measured_before_a_change_says_so(results):
    measured = git(results, "rev-parse", "--short=8", "HEAD")
    write(results, commit=measured, modules=["measured"])
    commit(results, "elsewhere.py", "1")
    assert "measured before" not in figures.fill(f"{FIGURE}\n\n{TABLE}")
    first = commit(results, "measured/code.py", "2")
    commit(results, "measured/code.py", "3")
    figures.changed_since.cache_clear()
    page = figures.fill(f"{FIGURE} {FIGURE}\n\n{TABLE}")
    assert page.count(f"1.9 CPU s (measured before {first})<!-- end -->") == 1
    assert page.endswith(f"| all | 1.94 | 8 |\n\n*Measured before {first} (speed).*\n<!-- end -->")
    assert figures.fill(page) == page
    bare = figures.without_notes(page)
    assert bare == figures.fill(page, notes=False)
    assert "measured before" not in bare.lower()


def test_what_was_measured_uncommitted_came_with_the_next_commit(results):
    (results / "measured" / "code.py").write_text("2")
    named = report.commit_of(["measured"])
    assert named == git(results, "rev-parse", "--short=8", "HEAD") + "+"
    write(results, commit=named, modules=["measured"])
    commit(results, "measured/code.py", "2")
    assert figures.changed_since("a/speed") == ""
    second = commit(results, "measured/code.py", "3")
    figures.changed_since.cache_clear()
    assert figures.changed_since("a/speed") == second


@pytest.mark.parametrize("known", ["12345678", None])
def test_without_the_history_a_page_says_nothing(results, monkeypatch, known):
    write(results, commit=known, modules=["measured"])
    assert figures.changed_since("a/speed") == ""
    monkeypatch.setenv("PATH", "")
    figures.changed_since.cache_clear()
    assert figures.changed_since("a/speed") == ""
    assert report.commit_of(["measured"]) is None


def test_a_benchmark_writes_the_commit_and_the_modules(results, capsys):
    path = report.print_and_save("a/b", "title", [[1.0]], ["ms"], ["measured"])
    document = json.loads(path.read_text())
    assert document["commit"] == git(results, "rev-parse", "--short=8", "HEAD")
    assert document["modules"] == ["measured"]
    assert "title" in capsys.readouterr().out


@pytest.mark.parametrize("page", figures.pages(), ids=lambda page: page.name)
def test_the_rows_of_a_table_have_as_many_cells_as_its_head(page):
    text = re.sub(r"<!--.*?-->\n?", "", page.read_text(), flags=re.DOTALL)
    for table in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        cells = [len(re.sub(r"\\\||`[^`]*`", "", row).split("|")) for row in table.splitlines()]
        assert cells[0] == cells[1] == max(cells), table
