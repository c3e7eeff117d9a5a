"""The wheel holds every package with its data and nothing at the top but slamgym; the sdist holds all else, too."""

import email
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DATA = (
    "py.typed",
    "__init__.pyi",
    "agents/__init__.pyi",
    "agents/bench/v1/NOTICE.md",
    "agents/bench/v1/manifest.json",
    "agents/bench/v1/plans.tar.xz",
    "agents/pretrained/frontier_policy.safetensors",
    "agents/rl/hyperparams/ppo.yml",
    "cad/bundled/home_000000.json",
    "dataset/curate/pretrained/completeness.npz",
    "dataset/curate/review_page/page.html",
    "dataset/generate/recipes/reference.yaml",
    "gan/pretrained/model32.safetensors",
    "gan/pretrained/modelprog.safetensors",
    "gan/pretrained/slam2cad-metric.json",
    "gan/pretrained/slam2cad-metric.safetensors",
    "gan/pretrained/slam2cad.json",
    "gan/pretrained/slam2cad.safetensors",
    "planning/pretrained/remaining.safetensors",
    "pretrained.sha256",
)
BUILD = "import setuptools.build_meta as b, sys; out = sys.argv[1]; b.build_wheel(out); b.build_sdist(out)"
BESIDE = (
    "pyproject.toml", "README.md", "LICENSE", "MANIFEST.in", "CITATION.cff", "CHANGELOG.md", "CONTRIBUTING.md",
    "Makefile", "constraints.txt", "mkdocs.yml",
)  # fmt: skip


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder of a wheel and an sdist that were built from a copy, so that no build folder is left in the repository."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in BESIDE:
        shutil.copy(ROOT / name, source)
    ignored = shutil.ignore_patterns("__pycache__")
    # As links, where they are links: setuptools has to follow them.
    for name in ("slamgym", "docs", "examples", "tests"):
        shutil.copytree(ROOT / name, source / name, ignore=ignored, symlinks=True)
    for link in ("agents", "gan"):
        if (source / "slamgym" / link).is_symlink():
            shutil.copytree(ROOT / link, source / link, ignore=ignored)
    done = subprocess.run(
        [sys.executable, "-c", BUILD, str(folder)],
        cwd=source, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    (path,) = built.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        return archive.namelist()


@pytest.fixture(scope="module")
def about(built):
    """What an index shows of the wheel."""
    (path,) = built.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        name = next(name for name in archive.namelist() if name.endswith("METADATA"))
        return email.message_from_bytes(archive.read(name))


def test_the_sdist_holds_what_the_tests_and_the_site_need(built, wheel):
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert set(BESIDE) <= names
    assert {
        "docs/dataset.md",
        "docs/site_pages.py",
        "examples/own_reward.py",
        "tests/test_packaging.py",
    } <= names
    assert {"docs/images/drawing.png", "docs/tutorials/own_reward.md", "tests/golden/golden.json"} <= names
    assert {name for name in wheel if name.startswith("slamgym/")} <= names
    assert not [name for name in names if "__pycache__" in name]


def test_the_index_is_told_who_under_which_licence_and_what_is_needed(about):
    assert about["Author"] == "The slamgym authors"
    assert about["License-Expression"] == "MIT"
    assert about["License-File"] == "LICENSE"
    assert about["Requires-Python"] == ">=3.11"
    base = [text for text in about.get_all("Requires-Dist") if "extra ==" not in text]
    assert not [
        text for text in base if text.startswith(("torch", "matplotlib", "imageio-ffmpeg", "pyarrow"))
    ]
    assert about.get_payload().startswith("# slamgym")


def test_the_citation_has_the_version_of_the_package():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()


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
