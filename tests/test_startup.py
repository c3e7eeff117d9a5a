"""Help pages answer at once: they import none of the heavy packages."""

import subprocess
import sys

import pytest

from slamgym.commands import cli

HEAVY = ("numba", "torch", "scipy.stats", "sklearn", "stable_baselines3", "cv2")
# In one process for all: a package that no help page imports is in the end not there.
CODE = f"""
import contextlib, io, sys
from slamgym.commands.cli import main
for line in sys.argv[1:]:
    with contextlib.redirect_stdout(io.StringIO()) as shown, contextlib.suppress(SystemExit):
        main(line.split())
    assert shown.getvalue(), line
    found = [name for name in {(*HEAVY, "shapely")} if name in sys.modules]
    assert not found, f"slamgym {{line}} imports {{found}}"
"""


@pytest.mark.parametrize("lines", [["--help"], [f"{name} --help" for name in cli.COMMANDS]])
def test_help_pages_import_nothing_heavy(lines):
    done = subprocess.run(
        [sys.executable, "-c", CODE, *lines], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "statement", ["import slamgym", "from slamgym.cad import FloorPlan", "import slamgym.metrics"]
)
def test_importing_packages_is_light(statement):
    code = f"import sys; {statement}; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
