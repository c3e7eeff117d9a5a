"""What numba keeps of compiled kernels, from version to version."""

import importlib.util
import pickle

import numba
import pytest

from slamgym.core.jit import is_compiled

SOURCE = """
from slamgym.core.jit import kernel

@kernel
def twice(value):
    return 2 * value
"""


@pytest.mark.parametrize(
    "gone", [b"cslamgym.core.jit\nGone\n.", b"cslamgym.core.gone\nGone\n.", b""]
)
def test_an_index_that_names_what_is_gone_counts_as_none(tmp_path, monkeypatch, gone):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    path = tmp_path / "doubling.py"
    path.write_text(SOURCE)

    def load():
        spec = importlib.util.spec_from_file_location("doubling", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.twice

    first = load()
    assert first(2) == 4
    assert is_compiled(first)
    (index,) = (tmp_path / "__pycache__").glob("*.nbi")
    good = index.read_bytes()
    index.write_bytes(pickle.dumps(numba.__version__) + gone)
    assert load()(2) == 4
    assert index.read_bytes() == good
