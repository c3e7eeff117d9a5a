"""Every package states what is public, and what it states exists."""

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest
from source_tree import modules

PACKAGES = sorted(name for name, path in modules().items() if path.name == "__init__.py")


def test_all_packages_are_found():
    assert {"slamgym", "slamgym.agents.rl", "slamgym.gan.training", "slamgym.core.parallel"} <= set(
        PACKAGES
    )


@pytest.mark.parametrize("name", PACKAGES)
def test_all_is_explicit_and_true(name):
    module = importlib.import_module(name)
    assert len(set(module.__all__)) == len(module.__all__)
    for public in module.__all__:
        assert hasattr(module, public), f"{name}.__all__ names {public}, which doesn't exist"


@pytest.mark.parametrize("name", PACKAGES)
def test_the_stub_that_type_checkers_read_says_the_same(name):
    module = importlib.import_module(name)
    stub = Path(module.__file__).with_suffix(".pyi")
    if not stub.exists():
        assert module.__all__ == []
        return
    (stated,) = [
        ast.literal_eval(node.value)
        for node in ast.parse(stub.read_text()).body
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__"
    ]
    assert sorted(stated) == sorted(module.__all__)


def test_the_first_names_of_the_package_are_documented():
    import slamgym

    names = [name for name in slamgym.__all__ if not inspect.ismodule(getattr(slamgym, name))]
    assert 12 <= len(names) <= 24
    assert [name for name in names if name not in slamgym.__doc__] == []
    for name in names:
        assert getattr(slamgym, name).__doc__, name


def test_a_name_that_is_also_a_modules_stays_the_function():
    """``slamgym.metrics.improvement`` is both, and importing the module must not hide the function."""
    code = (
        "import slamgym.metrics.improvement; from slamgym.metrics import improvement; "
        "import slamgym.parametric.model; from slamgym.parametric import warp; "
        "assert callable(improvement) and callable(warp)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
