"""The pages that are made from the registry are what it makes, and what it names exists."""

import importlib
import importlib.util
import re

import pytest
from source_tree import ROOT, modules

SPEC = importlib.util.spec_from_file_location("registry", ROOT / "docs" / "registry.py")
registry = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(registry)

ENTRIES = [*registry.TERMS, *registry.MEASURES]
NEEDS_TORCH = ("slamgym.gan", "slamgym.agents.rl")


@pytest.mark.parametrize("name", registry.PAGES)
def test_the_page_is_what_the_registry_makes(name):
    page = (ROOT / "docs" / name).read_text()
    assert page == registry.PAGES[name](), "run: python docs/registry.py"


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_a_home_exists(entry):
    module, _, name = entry.home.partition(":")
    if module.startswith(NEEDS_TORCH):
        pytest.importorskip("torch")
    home = importlib.import_module(module)
    assert not name or hasattr(home, name)


def test_names_are_unique_and_in_order():
    names = [term.name.lower() for term in registry.TERMS]
    assert names == sorted(set(names))


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=lambda page: page.name)
def test_modules_and_files_named_in_the_docs_exist(page):
    text = page.read_text()
    for name in re.findall(r"`(slamgym(?:\.[a-z_]+)+)`", text):
        assert exists(name), f"{page.name}: {name}"
    for path in re.findall(
        r"`((?:slamgym|agents|gan|benchmarks|tests)/[\w/.]+\.(?:py|yaml|yml|json|npz))`", text
    ):
        assert (ROOT / path).exists() or "/results/" in path, f"{page.name}: {path}"


def exists(name):
    """Whether a dotted name is a module, or what a module holds."""
    module, _, attribute = name.rpartition(".")
    return name in modules() or (
        module in modules() and hasattr(importlib.import_module(module), attribute)
    )


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")], ids=lambda page: page.name
)
def test_pages_install_from_the_checkout_as_no_index_has_the_package(page):
    text = page.read_text().replace("install it with: pip install", "")  # an error that is quoted
    assert re.findall(r"pip install '?slamgym.*", text) == []


def test_the_twelve_files_to_read_first_are_short():
    listed = re.findall(
        r"^\| `([\w/]+\.py)`", (ROOT / "docs" / "reading.md").read_text(), re.MULTILINE
    )
    lines = sum(len((ROOT / name).read_text().splitlines()) for name in listed)
    assert len(set(listed)) == 12
    assert lines <= 2800
