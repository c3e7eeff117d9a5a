"""The wheel holds every package with its data and nothing at the top but slamgym; the sdist holds all else, too.

Every kind of installation imports ``slamgym.agents`` and ``slamgym.gan``, which lie beside the package in a checkout.
"""

import email
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from source_tree import FOLDERS, modules

import slamgym

ROOT = Path(__file__).parents[1]
DATA = (
    "py.typed",
    "__init__.pyi",
    "agents/__init__.pyi",
    "agents/bench/frozen/NOTICE.md",
    "agents/bench/frozen/manifest.json",
    "agents/bench/frozen/plans.tar.xz",
    "agents/pretrained/hidden_floor.safetensors",
    "agents/rl/hyperparams/ppo.yml",
    "cad/bundled/home_000000.json",
    "dataset/curate/pretrained/completeness.json",
    "drawing/pretrained/boundaries.json",
    "dataset/curate/review_page/page.html",
    "drawing/formats/report.js",
    "dataset/generate/recipes/reference.yaml",
    "gan/pretrained/model32.safetensors",
    "gan/pretrained/modelprog.safetensors",
    "gan/pretrained/slam2cad.json",
    "gan/pretrained/slam2cad.safetensors",
    "planning/pretrained/promises.safetensors",
    "pretrained.sha256",
    "ros2/launch/demo.launch.xml",
    "ros2/views/slamgym.rviz",
)
BESIDE = (
    "setup.py", "pyproject.toml", "README.md", "LICENSE", "MANIFEST.in", "CITATION.cff", "CHANGELOG.md",
    "CONTRIBUTING.md", "SECURITY.md", "Dockerfile", "Makefile", "constraints.txt", "mkdocs.yml",
)  # fmt: skip

# Programs see this interpreter's packages, but not by its .pth files: those of an installed slamgym may be among them.
BEGIN = f"import os, site, sys; sys.path.append({str(Path(np.__file__).parents[1])!r})\n"
BUILD = (
    BEGIN + "import setuptools.build_meta as meta; meta.{}(sys.argv[1], {{'editable_mode': '{}'}})"
)
IMPORT = (
    BEGIN
    + """
import importlib
for folder in sys.argv[1:]:
    sys.path.insert(0, folder)
    site.addsitedir(folder)
for name in sys.stdin.read().split():
    try:
        print(name, os.path.realpath(importlib.import_module(name).__file__))
    except ModuleNotFoundError as error:
        if error.name.startswith("slamgym"):
            raise
        print(name, "needs", error.name)
"""
)


def run(place, code, *arguments, names=()):
    """Run a program in a folder; returns the lines that it prints."""
    done = subprocess.run(
        [sys.executable, "-ES", "-c", code, *map(str, arguments)], cwd=place, input=" ".join(names),
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of the checkout, so that no build folder is left in it."""
    source = tmp_path_factory.mktemp("source")
    for name in BESIDE:
        shutil.copy(ROOT / name, source)
    for name in ("slamgym", "agents", "gan", "docs", "examples", "tests"):
        shutil.copytree(
            ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"), symlinks=True
        )
    return source


@pytest.fixture(scope="module")
def built(tmp_path_factory, source):
    """Folder of an sdist and of a wheel that was built from what the sdist holds."""
    folder = tmp_path_factory.mktemp("wheel")
    run(source, BUILD.format("build_sdist", ""), folder)
    (sdist,) = folder.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    run(folder / sdist.name.removesuffix(".tar.gz"), BUILD.format("build_wheel", ""), folder)
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


def test_the_sdist_holds_what_the_tests_and_the_site_need(built):
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
    assert {
        "docs/images/drawing.png",
        "docs/tutorials/own_reward.md",
        "tests/golden/golden.json",
    } <= names
    assert not [name for name in names if "__pycache__" in name]


def test_the_index_is_told_who_under_which_licence_and_what_is_needed(about):
    assert about["Author"] == "The slamgym authors"
    assert about["License-Expression"] == "MIT"
    assert about["License-File"] == "LICENSE"
    assert about["Requires-Python"] == ">=3.10"
    base = [text for text in about.get_all("Requires-Dist") if "extra ==" not in text]
    assert not [
        text
        for text in base
        if text.startswith(("torch", "matplotlib", "imageio-ffmpeg", "pyarrow"))
    ]
    assert about.get_payload().startswith("# slamgym")


def test_the_citation_has_the_version_of_the_package():
    (version,) = re.findall(r'^version = "(.*)"$', (ROOT / "pyproject.toml").read_text(), re.M)
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert version == slamgym.__version__


def test_the_pythons_that_the_index_is_told_of_are_those_that_are_tested(about):
    promised = re.findall(r"Python :: (3\.\d+)", "\n".join(about.get_all("Classifier")))
    checks = yaml.safe_load((ROOT / ".github" / "workflows" / "checks.yml").read_text())
    assert promised == checks["jobs"]["pythons"]["strategy"]["matrix"]["python"]
    assert about["Requires-Python"] == f">={promised[0]}"


def test_the_image_installs_extras_that_exist(about):
    (extras,) = re.findall(r"^ARG EXTRAS=(.*)$", (ROOT / "Dockerfile").read_text(), re.M)
    assert set(extras.split(",")) <= set(about.get_all("Provides-Extra"))


def test_the_wheel_holds_nothing_at_the_top_but_slamgym(wheel):
    tops = {name.split("/")[0] for name in wheel}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"slamgym"}


def test_the_wheel_holds_every_module(wheel):
    sources = {
        f"{package.replace('.', '/')}/{path.relative_to(folder).as_posix()}"
        for package, folder in FOLDERS.items()
        for path in folder.rglob("*.py*")
        if path.suffix in {".py", ".pyi"}
    }
    assert sources <= set(wheel)
    assert any(name.startswith("slamgym/gan/training/") for name in sources)


def test_every_module_of_the_wheel_is_imported_from_it(built, tmp_path):
    (path,) = built.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "site")
    lines = run(tmp_path, IMPORT, tmp_path / "site", names=modules().keys() - {"slamgym.__main__"})
    assert len(lines) == len(modules()) - 1
    assert [
        line for line in lines if " needs " not in line and str(tmp_path / "site") not in line
    ] == []


def test_a_checkout_holds_no_links(source):
    assert [path for path in source.rglob("*") if path.is_symlink()] == []


@pytest.mark.parametrize(
    ("mode", "before"),
    [("lenient", "pass"), ("", "pass"), ("", "del os.symlink")],
    ids=["lenient", "strict", "hard"],
)
def test_an_editable_installation_leads_to_the_checkout(source, tmp_path, mode, before):
    (tmp_path / "site").mkdir()
    run(
        source,
        BUILD.replace("import setuptools", f"{before}; import setuptools").format(
            "build_editable", mode
        ),
        tmp_path,
    )
    (path,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "site")
    names = ("slamgym", "slamgym.agents.rules", "slamgym.gan.config", "slamgym.core.types")
    for line in run(tmp_path, IMPORT, tmp_path / "site", names=names):
        name, found = line.split(" ", 1)
        assert Path(found).samefile(source / modules()[name].relative_to(ROOT))
    if mode == "lenient":
        return
    (link,) = (tmp_path / "site").glob("*.pth")
    tree = Path(link.read_text().strip())
    # Type checkers follow a .pth file that names a folder, and find types there.
    assert all((tree / "slamgym" / name).is_file() for name in DATA)


def test_a_checkout_is_imported_where_it_lies(source):
    (line,) = run(source, IMPORT, names=["slamgym.agents.rules"])
    assert line == f"slamgym.agents.rules {(source / 'agents' / 'rules.py').resolve()}"


@pytest.mark.parametrize("name", DATA)
def test_the_wheel_holds_the_data(wheel, name):
    assert f"slamgym/{name}" in wheel


def test_the_wheel_holds_no_caches(wheel):
    assert [
        name for name in wheel if "__pycache__" in name or name.endswith((".nbi", ".nbc"))
    ] == []
