"""The wheel holds every package with its data, and nothing at the top but slamgym."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DATA = (
    "py.typed",
    "__init__.pyi",
    "agents/__init__.pyi",
    "agents/pretrained/frontier_policy.safetensors",
    "agents/rl/hyperparams/ppo.yml",
    "agents/rl/hyperparams/sac.yml",
    "cad/bundled/home_000000.json",
    "dataset/curate/pretrained/completeness.npz",
    "dataset/curate/review_page/page.html",
    "dataset/generate/recipes/reference.yaml",
    "gan/pretrained/model32.safetensors",
    "gan/pretrained/modelprog.safetensors",
    "gan/pretrained/slam2cad.json",
    "gan/pretrained/slam2cad.safetensors",
    "planning/pretrained/remaining.safetensors",
    "pretrained.sha256",
)
BUILD = "import setuptools.build_meta as b, sys; b.build_wheel(sys.argv[1])"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Names of the files of a wheel that was built from a copy, so that no build folder is left in the repository."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE", "MANIFEST.in"):
        shutil.copy(ROOT / name, source)
    # As links, where they are links: setuptools has to follow them.
    shutil.copytree(
        ROOT / "slamgym", source / "slamgym", ignore=shutil.ignore_patterns("__pycache__"), symlinks=True
    )
    for link in ("agents", "gan"):
        if (source / "slamgym" / link).is_symlink():
            shutil.copytree(ROOT / link, source / link, ignore=shutil.ignore_patterns("__pycache__"))
    done = subprocess.run(
        [sys.executable, "-c", BUILD, str(folder)],
        cwd=source, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (path,) = folder.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        return archive.namelist()


def test_the_wheel_holds_nothing_at_the_top_but_slamgym(wheel):
    tops = {name.split("/")[0] for name in wheel}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"slamgym"}


def test_the_wheel_holds_every_module(wheel):
    modules = {
        str((Path(folder) / name).relative_to(ROOT))
        for folder, _, names in os.walk(ROOT / "slamgym", followlinks=True)
        for name in names
        if name.endswith((".py", ".pyi"))
    }
    assert modules <= set(wheel)
    assert any(name.startswith("slamgym/gan/training/") for name in modules)


@pytest.mark.parametrize("name", DATA)
def test_the_wheel_holds_the_data(wheel, name):
    assert f"slamgym/{name}" in wheel


def test_the_wheel_holds_no_caches(wheel):
    assert [name for name in wheel if "__pycache__" in name or name.endswith((".nbi", ".nbc"))] == []
