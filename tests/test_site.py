"""The documentation site is built without a warning, and holds what is generated for it."""

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
    pages = {path.relative_to(tmp_path / "site").as_posix() for path in (tmp_path / "site").rglob("*.html")}
    assert {
        "index.html",
        "reference/commands.html",
        "reference/api.html",
        "tutorials/own_reward.html",
    } <= pages
    commands = (tmp_path / "site" / "reference" / "commands.html").read_text()
    assert "slamgym plans fetch" in commands
    assert "slamgym.cad.sources.open_plans" in (tmp_path / "site" / "reference" / "api.html").read_text()
    assert "https://fonts" not in (tmp_path / "site" / "index.html").read_text()
