"""The documentation site is built without a warning, and holds what is generated for it."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import notebooks
import pytest

import slamgym

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
    api = (tmp_path / "site" / "reference" / "api" / "slamgym.dataset.html").read_text()
    assert 'id="slamgym.dataset.DatasetConfig"' in api, "names are those that people import"
    largest = max((tmp_path / "site").rglob("*.html"), key=lambda path: path.stat().st_size)
    assert largest.stat().st_size < 1_000_000, largest
    # Search in a site that is opened as files: its index is a script, and the worker has a stand-in of our own.
    assert (tmp_path / "site" / "search" / "search_index.js").is_file()
    assert (tmp_path / "site" / "iframe-worker.js").is_file()
    start = (tmp_path / "site" / "index.html").read_text()
    assert "https://fonts" not in start
    assert "unpkg.com" not in start
    # A line of code that is wider than the page must not be cut off at its edge.
    assert 'href="site.css"' in start
    assert "white-space: pre-wrap" in (tmp_path / "site" / "site.css").read_text()


@pytest.mark.parametrize("script", notebooks.tutorials(), ids=lambda script: script.stem)
def test_a_notebook_installs_the_package_and_holds_its_script(script):
    """``make site`` runs them; the scripts themselves are run by tests/examples."""
    text = script.with_suffix(".ipynb").read_text()
    assert text == notebooks.notebook_of(script), "python docs/notebooks.py writes it anew"
    install, about, _, *code = json.loads(text)["cells"]
    assert "%pip install" in install["source"]
    assert f"slamgym{notebooks.EXTRAS[script.stem]} @" in install["source"]
    assert about["cell_type"] == "markdown"
    shown = 1 if script.stem in notebooks.PICTURES else 0
    joined = "\n".join(cell["source"] for cell in code[: len(code) - shown])
    assert ast.dump(ast.parse(joined)) == ast.dump(
        ast.Module(ast.parse(script.read_text()).body[1:], [])
    )


def test_a_notebook_is_run_and_keeps_what_it_printed(tmp_path):
    pytest.importorskip("ipykernel")
    cells = json.loads((ROOT / "examples" / "own_reward.ipynb").read_text())
    only = dict(cells["cells"][0], source="import slamgym\nprint(slamgym.__version__)")
    path = tmp_path / "small.ipynb"
    path.write_text(json.dumps({**cells, "cells": [only]}))
    notebooks.run_notebook(path, tmp_path / "out")
    (done,) = json.loads((tmp_path / "out" / "small.ipynb").read_text())["cells"]
    assert "".join(done["outputs"][0]["text"]).strip() == slamgym.__version__
    only["source"] = "raise ValueError"
    path.write_text(json.dumps({**cells, "cells": [only]}))
    with pytest.raises(Exception, match="ValueError"):
        notebooks.run_notebook(path, tmp_path / "out")
