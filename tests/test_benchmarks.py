"""Every benchmark starts and has its place in ``benchmarks/README.md``; stored results name what made them."""

import json
import re
import subprocess
import sys

import pytest
from source_tree import ROOT

SCRIPTS = sorted((ROOT / "benchmarks").glob("*/*.py"))
RESULTS = sorted((ROOT / "benchmarks" / "results").glob("*/*.json"))
# In one process for all: importing torch takes longer than all scripts.
CODE = """
import contextlib, io, runpy, sys
from pathlib import Path
path = list(sys.path)
for script in sys.argv[1:]:
    sys.argv, sys.path = [script, "--help"], [str(Path(script).parent), *path]
    with contextlib.redirect_stdout(io.StringIO()) as shown, contextlib.suppress(SystemExit):
        runpy.run_path(script, run_name="__main__")
    assert "--help" in shown.getvalue() or "__main__" not in Path(script).read_text(), script
"""


def test_every_script_starts(tmp_path):
    for package in ("torch", "matplotlib", "sklearn"):
        pytest.importorskip(package)
    done = subprocess.run(
        [sys.executable, "-c", CODE, *map(str, SCRIPTS)],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_the_readme_names_every_script_and_no_other():
    text = (ROOT / "benchmarks" / "README.md").read_text()
    named = re.findall(r"\bbenchmarks/(\w+/\w+\.py)", text)
    assert set(named) == {str(path.relative_to(ROOT / "benchmarks")) for path in SCRIPTS}
    for place in re.findall(r"\]\(((?:results|\.\./docs)/[\w/.]+)\)", text):
        assert (ROOT / "benchmarks" / place).exists(), place


@pytest.mark.parametrize("path", RESULTS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_result_lies_beside_those_of_its_topic(path):
    command = json.loads(path.read_text()).get("command")
    if command is None or command.startswith("slamgym "):  # what a command wrote
        return
    script = ROOT / command.split()[1]
    assert script in SCRIPTS
    assert path.parent.name == script.parent.name
