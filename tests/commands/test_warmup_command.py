"""Compiling the kernels: the command, the word about it, and where they are kept."""

import importlib
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numba.core.event
import pytest

from slamgym.commands.cli import main
from slamgym.core import jit
from slamgym.envs.warmup import BATCHED, KERNEL_PARTS
from slamgym.sim.raycast import cast_sweep

KERNEL = """
from slamgym.core.jit import kernel

@kernel
def inner(x):
    return x + 1.0

@kernel
def outer(x):
    return 2.0 * inner(x)
"""


@pytest.fixture
def fresh():
    """What is said once in a process may be said again."""
    jit.announce_compilation.cache_clear()
    numba.core.event._registered.pop("numba:compile", None)


def test_an_installation_without_compiled_kernels_says_so_once(
    fresh, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(jit, "kernel_cache", lambda function: tmp_path)
    jit.announce_compilation(cast_sweep)
    jit.announce_compilation(cast_sweep)
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "compiling the numeric kernels, once after installation" in message


def test_a_long_compilation_says_how_many_kernels_and_seconds_it_is_at(
    fresh, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(jit, "LINE_INTERVAL", 0.0)
    monkeypatch.setattr(jit, "is_compiled", lambda function: False)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "counted_kernels.py").write_text(KERNEL)
    jit.announce_compilation(cast_sweep)
    assert importlib.import_module("counted_kernels").outer(3.0) == 8.0
    lines = capsys.readouterr().err.splitlines()[1:]
    assert [re.fullmatch(r"(\d+) kernels? compiled, \d+ s", line)[1] for line in lines] == [
        "1",
        "2",
    ]


def test_compiled_kernels_need_no_word(fresh, tmp_path, monkeypatch, capsys):
    (tmp_path / "raycast.cast_sweep-1.py311.nbi").touch()
    monkeypatch.setattr(jit, "kernel_cache", lambda function: tmp_path)
    jit.announce_compilation(cast_sweep)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("options", [[], ["--batched"]])
def test_warming_up_compiles_and_leaves_a_cache(options, capsys):
    assert main(["warmup", *options]) == 0
    assert all(
        jit.is_compiled(last)
        for name, (_, last) in KERNEL_PARTS.items()
        if options or name != BATCHED
    )
    assert str(jit.cache_folder()) in capsys.readouterr().out


def kernels_in(called: set[jit.Kernel]) -> set[jit.Kernel]:
    """Kernels that were called, and those that they call, which are compiled with them."""
    found: set[jit.Kernel] = set()
    waiting = list(called)
    while waiting:
        one = waiting.pop()
        if one not in found:
            found.add(one)
            function = one.__wrapped__
            named = [function.__globals__.get(name) for name in function.__code__.co_names]
            waiting.extend(other for other in named if isinstance(other, jit.Kernel))
    return found


@pytest.mark.parametrize("name", KERNEL_PARTS)
def test_each_part_compiles_the_kernel_that_tells_whether_it_was_compiled(name, monkeypatch):
    """Else it would be compiled anew at every call, or never."""
    called = set()
    call = jit.Kernel.__call__

    def noting_call(self, *args):
        called.add(self)
        return call(self, *args)

    monkeypatch.setattr(jit.Kernel, "__call__", noting_call)
    compile_part, last_kernel = KERNEL_PARTS[name]
    compile_part()
    assert last_kernel in kernels_in(called)


def test_an_exploration_compiles_nothing_that_was_not_warmed_up(tmp_path):
    """In a process of its own, in which every kernel that was called is known by what it was called with."""
    code = f"""
import gc, sys
from slamgym.commands.cli import main
from slamgym.core.jit import Kernel
from slamgym.envs.warmup import KERNEL_PARTS

def compiled():
    kernels = [one for one in gc.get_objects() if type(one) is Kernel and "dispatcher" in vars(one)]
    return {{(str(one), *map(str, signature)) for one in kernels for signature in one.dispatcher.overloads}}

for name in ("pose_graph", "drive", "navigate", "decide"):
    KERNEL_PARTS[name][0]()
before = compiled()
line = "generate --pairs 2 --minutes 1 --engine in_process -o {tmp_path}"
assert main(line.split()) == 0
print(sorted(compiled() - before))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=600
    )
    assert done.stdout.splitlines()[-1:] == ["[]"], done.stdout + done.stderr


def run_kernel(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    (folder / "some_kernels.py").write_text(KERNEL)
    code = "import some_kernels; print(some_kernels.outer(3.0))"
    variables = {
        key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"
    } | environment
    return subprocess.run(
        [sys.executable, "-B", "-c", code],
        cwd=folder, capture_output=True, text=True, check=False, env=variables, timeout=300,
    )  # fmt: skip


def test_kernels_are_kept_in_a_temporary_folder_where_nothing_else_is_writable(tmp_path):
    package = tmp_path / "package"
    temporary = tmp_path / "tmp"
    package.mkdir()
    temporary.mkdir()
    # Files in the place of folders: not even root can write below them.
    (package / "__pycache__").touch()
    (tmp_path / "home").touch()
    home = str(tmp_path / "home")
    for _ in range(2):
        done = run_kernel(package, HOME=home, XDG_CACHE_HOME=home, TMPDIR=str(temporary))
        assert (done.returncode, done.stdout) == (0, "8.0\n"), done.stderr
        (folder,) = temporary.iterdir()
        assert (
            done.stderr
            == f"slamgym: no cache folder is writable; compiled kernels are kept in {folder}\n"
        )
        assert folder.stat().st_mode & 0o777 == 0o700
        assert list(folder.rglob("*.outer-*.nbi"))
    # A folder that others can write to is not trusted.
    shutil.rmtree(folder)
    folder.mkdir()
    folder.chmod(0o777)
    done = run_kernel(package, HOME=home, XDG_CACHE_HOME=home, TMPDIR=str(temporary))
    assert (done.returncode, done.stdout) == (0, "8.0\n"), done.stderr
    assert not list(folder.iterdir())


def test_kernels_are_kept_in_the_users_cache_without_a_word(tmp_path):
    """Beside the sources they would outlive `pip uninstall`, after which an empty package could be imported."""
    package = tmp_path / "package"
    package.mkdir()
    done = run_kernel(package, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert (done.returncode, done.stdout, done.stderr) == (0, "8.0\n", "")
    assert list((tmp_path / "cache" / "slamgym").rglob("some_kernels.outer-*.nbi"))
    assert [path.name for path in package.rglob("*")] == ["some_kernels.py"]


def test_a_kernel_is_pickled_by_its_name():
    assert pickle.loads(pickle.dumps(cast_sweep)) is cast_sweep
