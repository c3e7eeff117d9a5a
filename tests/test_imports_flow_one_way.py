"""Which package may import which, kept by walking every import statement."""

import ast
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALLOWED = {
    "core": [],
    "metrics": ["core"],
    "interop": ["core"],
    "cad": ["core", "interop"],
    "sim": ["core", "cad"],
    "viz": ["core", "cad", "metrics"],
    "slam": ["core", "interop", "metrics"],
    "planning": ["core"],
    "envs": ["core", "cad", "sim", "slam", "planning", "metrics", "interop", "viz"],
    "parametric": ["core", "cad", "sim", "planning", "metrics", "interop"],
    "dataset": ["core", "cad", "sim", "slam", "envs", "interop", "metrics", "viz", "planning"],
    "agents": ["core", "cad", "sim", "slam", "planning", "envs", "metrics", "viz"],
    "gan": ["core", "cad", "metrics", "interop", "viz", "dataset.format", "dataset.images.format"],
}
"""``slam`` and ``planning`` see neither world, floor plan nor anything true. ``commands`` imports what it wants, and
nothing imports it."""

LEARNING = ("torch", "stable_baselines3", "sb3_contrib")
"""Packages that the base installation doesn't have."""


def modules() -> list[Path]:
    """Every module, also of the packages that are symbolic links."""
    return sorted(
        Path(folder) / name
        for folder, _, names in os.walk(ROOT / "slamgym", followlinks=True)
        for name in names
        if name.endswith((".py", ".pyi"))
    )


def package_of(path: Path) -> str:
    return path.relative_to(ROOT / "slamgym").parts[0]


def imported_modules(path: Path) -> Iterator[str]:
    """Absolute names; a name that is imported from a module stands behind it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_every_package_has_its_rule():
    packages = {package_of(path) for path in modules() if path.parent != ROOT / "slamgym"}
    assert packages == {*ALLOWED, "commands"}


@pytest.mark.parametrize("package", ALLOWED)
def test_a_package_imports_only_what_it_may(package):
    allowed = tuple(f"slamgym.{name}." for name in (package, *ALLOWED[package]))
    found = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in modules()
        if package_of(path) == package
        for name in imported_modules(path)
        if name.startswith("slamgym.")
        and name != "slamgym.__version__"
        and not f"{name}.".startswith(allowed)
    ]
    assert found == []


def test_the_base_installation_needs_no_torch():
    for path in modules():
        if package_of(path) not in ("gan", "agents", "commands"):
            assert not {name.split(".")[0] for name in imported_modules(path)} & {*LEARNING}, path
