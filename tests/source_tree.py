"""The package's own source as data, for the tests of its architecture: modules, imports, definitions."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = "slamgym"
FOLDERS = {
    PACKAGE: ROOT / PACKAGE,
    f"{PACKAGE}.agents": ROOT / "agents",
    f"{PACKAGE}.gan": ROOT / "gan",
}
NO_ROOM = {PACKAGE, f"{PACKAGE}.__main__"}


@functools.cache
def modules() -> dict[str, Path]:
    """Every module by its dotted name; ``slamgym.agents`` and ``slamgym.gan`` lie beside the package."""
    found = {}
    for prefix, folder in FOLDERS.items():
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            found[".".join([prefix, *parts])] = path
    return found


@functools.cache
def tree_of(module: str) -> ast.Module:
    """The syntax tree of a module."""
    return ast.parse(modules()[module].read_text())


def imported_names(module: str) -> Iterator[str]:
    """What a module imports, at its head or inside a function; ``from a import b`` gives ``a`` and ``a.b``."""
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room_of(name: str) -> str:
    """The package below ``slamgym`` that a dotted name belongs to: ``slam`` of ``slamgym.slam.graph.solver``."""
    return name.split(".")[1]


@functools.cache
def imports_between_rooms() -> dict[tuple[str, str], set[str]]:
    """For each pair of packages, which module of the first imports what of the second."""
    found: dict[tuple[str, str], set[str]] = {}
    for module in modules():
        for name in imported_names(module):
            if name.startswith(f"{PACKAGE}.") and module not in NO_ROOM and is_in_package(name):
                pair = room_of(module), room_of(name)
                if pair[0] != pair[1]:
                    found.setdefault(pair, set()).add(f"{module} -> {name}")
    return found


def is_in_package(name: str) -> bool:
    """Whether a dotted name lies in a package below ``slamgym``, rather than being a name of its face."""
    return f"{PACKAGE}.{room_of(name)}" in modules()
