"""What numba keeps of compiled kernels, from version to version, and where."""

import importlib.util
import os
import pickle
import sys
import tempfile
from pathlib import Path

import numba
import pytest

import slamgym
from slamgym.core import jit
from slamgym.core.jit import cache_folder, is_compiled, use_temporary_cache

SOURCE = """
from slamgym.core.jit import kernel

@kernel
def scaled(value, factor):
    return value * factor

@kernel
def scaled_by_five(value):
    return scaled(value, 2) + scaled(value, 3)
"""


@pytest.fixture
def load(tmp_path, monkeypatch):
    """A function that imports the source anew; its kernels are kept below the same folder."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(jit, "_user_caches", lambda: tmp_path)
    path = tmp_path / "scaling.py"
    path.write_text(SOURCE)

    def load():
        spec = importlib.util.spec_from_file_location("scaling", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


@pytest.mark.parametrize(
    "gone", [b"cslamgym.core.jit\nGone\n.", b"cslamgym.core.gone\nGone\n.", b""]
)
def test_an_index_that_names_what_is_gone_counts_as_none(load, tmp_path, gone):
    """Fails when numba reads its index by another method: then a renamed class makes every old cache a traceback."""
    first = load().scaled
    assert first(2, 3) == 6
    assert is_compiled(first)
    (index,) = cache_folder().glob("*/*.nbi")
    good = index.read_bytes()
    index.write_bytes(pickle.dumps(numba.__version__) + gone)
    assert load().scaled(2, 3) == 6
    assert index.read_bytes() == good


def test_other_packages_kernels_are_kept_where_they_were(load):
    assert load().scaled(2, 3) == 6
    own = numba.njit(cache=True)(load)
    assert not Path(own.stats.cache_path).is_relative_to(cache_folder())


def test_each_version_of_the_package_keeps_its_own(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(jit, "_user_caches", lambda: tmp_path)
    folders = set()
    for version in ("1.0", "1.1"):
        monkeypatch.setattr(slamgym, "__version__", version)
        folders.add(cache_folder())
    assert len(folders) == 2
    assert all(folder.is_relative_to(tmp_path) for folder in folders)


@pytest.mark.parametrize(
    ("platform", "variable"), [("linux", "XDG_CACHE_HOME"), ("win32", "LOCALAPPDATA")]
)
def test_the_users_cache_folder_is_that_of_the_system(monkeypatch, tmp_path, platform, variable):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setenv(variable, str(tmp_path))
    assert cache_folder().parent == tmp_path / "slamgym"


def test_calls_with_different_literals_share_a_compilation(load):
    """Fails when numba finds callees by another method: then each literal in a kernel costs a compilation."""
    module = load()
    assert module.scaled_by_five(1.0) == 5.0
    assert module.scaled.dispatcher.signatures == [(numba.float64, numba.int64)]


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """The path of the temporary cache."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path / f"slamgym-kernels-{os.getuid()}"


@pytest.mark.skipif(sys.platform == "win32", reason="no owners and modes")
class TestTemporaryCache:
    def test_a_private_folder_is_used_again(self, kernels, capsys):
        assert use_temporary_cache() == str(kernels)
        assert kernels.stat().st_mode & 0o777 == 0o700
        assert use_temporary_cache() == os.environ["NUMBA_CACHE_DIR"] == str(kernels)
        assert str(kernels) in capsys.readouterr().err

    @pytest.mark.parametrize("mode", [0o720, 0o702, 0o777])
    def test_a_folder_that_others_can_write_to_is_not(self, kernels, mode):
        kernels.mkdir()
        kernels.chmod(mode)
        self.check_another_is_used(kernels)

    def test_a_folder_of_another_user_is_not(self, kernels, monkeypatch):
        stranger = os.getuid() + 1
        monkeypatch.setattr(os, "getuid", lambda: stranger)
        planted = kernels.with_name(f"slamgym-kernels-{stranger}")
        planted.mkdir(mode=0o700)
        self.check_another_is_used(planted)

    def test_a_link_to_a_folder_is_not(self, kernels):
        elsewhere = kernels.with_name("elsewhere")
        elsewhere.mkdir(mode=0o700)
        kernels.symlink_to(elsewhere)
        self.check_another_is_used(kernels)

    def check_another_is_used(self, planted):
        used = Path(use_temporary_cache())
        assert used.resolve() != planted.resolve()
        assert used.parent == planted.parent
        assert used.stat().st_mode & 0o777 == 0o700
        assert os.environ["NUMBA_CACHE_DIR"] == str(used)
