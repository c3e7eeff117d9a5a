"""Every package states what is public, and what it states exists."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = sorted(
    ".".join(path.parent.relative_to(ROOT).parts)
    for top in ("slamgym", "agents")
    for path in (ROOT / top).rglob("__init__.py")
)


@pytest.mark.parametrize("name", PACKAGES)
def test_all_is_explicit_and_true(name: str) -> None:
    module = importlib.import_module(name)
    assert len(set(module.__all__)) == len(module.__all__)
    for public in module.__all__:
        assert hasattr(module, public), f"{name}.__all__ names {public}, which doesn't exist"
