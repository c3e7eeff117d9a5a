"""The documentation site is built without a warning, and holds what is generated for it."""

import ast
import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mkdocs")
pytest.importorskip("material")
pytest.importorskip("mkdocstrings")
ROOT = Path(__file__).parents[1]


def test_the_site_is_built_in_strict_mode(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT, capture_output=True, text=True, timeout=900, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pages = {
        path.relative_to(tmp_path / "site").as_posix()
        for path in (tmp_path / "site").rglob("*.html")
    }
    assert {
        "index.html",
        "reference/commands.html",
        "reference/api.html",
        "tutorials/own_reward.html",
        "gallery.html",
    } <= pages
    tutorial = (tmp_path / "site" / "tutorials" / "own_reward.html").read_text()
    assert "keep_moving" in tutorial, "the script is shown"
    assert 'href="own_reward.ipynb"' in tutorial
    assert {path.stem for path in (tmp_path / "site" / "tutorials").glob("*.ipynb")} == {
        path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md")
    }
    gallery = (tmp_path / "site" / "gallery.html").read_text()
    assert 'src="images/coverage_over_time.png"' in gallery
    commands = (tmp_path / "site" / "reference" / "commands.html").read_text()
    assert "slamgym plans fetch" in commands
    assert (
        "slamgym.cad.sources.open_plans"
        in (tmp_path / "site" / "reference" / "api.html").read_text()
    )
    start = (tmp_path / "site" / "index.html").read_text()
    assert "https://fonts" not in start
    # A line of code that is wider than the page must not be cut off at its edge.
    assert 'href="site.css"' in start
    assert "white-space: pre-wrap" in (tmp_path / "site" / "site.css").read_text()


@pytest.mark.parametrize(
    "name", sorted(path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md"))
)
def test_a_notebook_holds_its_script_and_nothing_else(name):
    spec = importlib.util.spec_from_file_location("site_pages", ROOT / "docs" / "site_pages.py")
    site_pages = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(site_pages)
    script = ROOT / "examples" / f"{name}.py"
    cells = json.loads(site_pages.notebook_of(script))["cells"]
    text, no_arguments, *code = cells
    assert text["cell_type"] == "markdown"
    compile(no_arguments["source"], name, "exec")
    assert all(cell["cell_type"] == "code" for cell in code)
    # The scripts themselves are run by tests/examples.
    joined = "\n".join(cell["source"] for cell in code)
    assert ast.dump(ast.parse(joined)) == ast.dump(
        ast.Module(ast.parse(script.read_text()).body[1:], [])
    )
