"""``slamgym doctor`` and ``warmup``: the installation, what works of it, and compiling the numeric kernels."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import tyro
from packaging.requirements import Requirement

from slamgym import __version__
from slamgym.commands.log_input import LogReading
from slamgym.core.config import Arguments
from slamgym.core.errors import SlamgymError
from slamgym.core.progress import tell

_FOR_DEVELOPERS = {"dev", "all", "site"}
_FAILURES = (
    SlamgymError,
    ImportError,
    OSError,
    RuntimeError,
    ValueError,
    subprocess.SubprocessError,
)
"""Errors of a damaged installation."""


PartState = Literal["ok", "missing", "broken"]


class Finding(NamedTuple):
    """One line of the report."""

    what: str
    state: PartState
    """``missing``: an option that isn't installed; ``broken``: something that every user needs."""
    found: str
    fix: str = ""


class DoctorArguments(LogReading):
    """Say what is installed, what works, and the fix for what doesn't; or, of a log, what it holds and what is wrong.

    The exit status is 1 if something is broken that every command needs (extras may be missing), or something is wrong
    with the log.
    """

    log: tyro.conf.Positional[Path | None] = None
    """A recorded log, as for `slamgym slam`; without one the installation is looked at."""


class WarmupArguments(Arguments):
    """Compile the numeric kernels of exploration, which the first exploration would wait for otherwise."""

    batched: bool = False
    """Also those of many environments at once (``slamgym.envs.BatchExploreEnv``, the explorer ``wheels``)."""


def warmup(arguments: WarmupArguments) -> None:
    """Run ``slamgym warmup``."""
    from slamgym.core.jit import cache_folder
    from slamgym.core.parallel.backlog import available_cores
    from slamgym.envs.warmup import BATCHED, KERNEL_PARTS, compile_kernels

    compile_kernels(
        KERNEL_PARTS.keys() - (set() if arguments.batched else {BATCHED}), available_cores()
    )
    tell(f"the kernels are compiled and kept in {cache_folder()}")


def main(arguments: DoctorArguments) -> int:
    """Run ``slamgym doctor``; returns the exit code."""
    if arguments.log is not None:
        from slamgym.commands.log_facts import show_facts

        return show_facts(arguments.log, arguments)
    states = []
    for finding in findings():
        states.append(finding.state)
        fix = [f"{'':>9}fix: {finding.fix}"] if finding.fix else []
        tell(f"{finding.state:<7}  {finding.what}: {finding.found}", *fix)
        sys.stdout.flush()
    return 1 if "broken" in states else 0


def findings() -> Iterator[Finding]:
    """Everything that is looked at, in the order in which a user needs it."""
    yield from installed()
    yield _try(
        "what comes with the package", _pretrained, "install slamgym again, or git restore them"
    )
    yield _try("numeric kernels", _kernels, "run slamgym warmup, and see what it says")
    yield _try("films (ffmpeg)", _films, "pip install 'slamgym[films]'", "missing")
    if _version("torch"):
        yield _try(
            "torch", _torch, "install torch again, see https://pytorch.org/get-started", "missing"
        )


def installed() -> Iterator[Finding]:
    """The versions of slamgym and Python, of the packages of the base installation, and of those of each extra."""
    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    yield Finding("slamgym", "ok", f"{__version__} in {Path(__file__).parents[1]}; {system}")
    try:
        requirements = [Requirement(line) for line in importlib.metadata.requires("slamgym") or []]
        named = set(importlib.metadata.metadata("slamgym").get_all("Provides-Extra") or [])
    except importlib.metadata.PackageNotFoundError:
        fix = f"pip install {Path(__file__).parents[2]}"
        yield Finding("packages", "broken", "slamgym is not installed, only on the path", fix)
        return
    extras = ["", *(named - _FOR_DEVELOPERS)]
    groups: dict[str, list[str]] = {}
    for one in requirements:
        askers = [
            name for name in extras if one.marker is None or one.marker.evaluate({"extra": name})
        ]
        if askers:  # none on this platform, or developers only
            groups.setdefault(askers[0], []).append(one.name)
    for extra_name, names in sorted(groups.items()):
        found = {name: _version(name) for name in names}
        shown = ", ".join(f"{name} {version or 'missing'}" for name, version in found.items())
        what = f"extra {extra_name}" if extra_name else "packages"
        if all(found.values()):
            yield Finding(what, "ok", shown)
        elif extra_name:
            yield Finding(what, "missing", shown, f"pip install 'slamgym[{extra_name}]'")
        else:
            yield Finding(what, "broken", shown, "pip install slamgym")


def _version(package: str) -> str:
    """The installed version; empty where there is none."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _try(what: str, check: Callable[[], str], fix: str, otherwise: PartState = "broken") -> Finding:
    """Run a check; an error is a finding, too."""
    try:
        return Finding(what, "ok", check())
    except _FAILURES as error:
        return Finding(what, otherwise, " ".join(str(error).split()) or type(error).__name__, fix)


def _pretrained() -> str:
    from slamgym.core.provenance import current_checksums, read_checksums

    expected = read_checksums()
    found = current_checksums()
    wrong = sorted(name for name in expected if found.get(name) != expected[name])
    if wrong:
        raise SlamgymError(f"{len(wrong)} files are missing or changed, such as {wrong[0]}")
    return f"{len(expected)} files, as their authors left them"


def _kernels() -> str:
    from slamgym.core.jit import cache_folder, is_compiled
    from slamgym.sim.raycast import cast_sweep

    state = "compiled" if is_compiled(cast_sweep) else "not compiled yet (slamgym warmup does it)"
    return f"{state}, kept in {cache_folder()}"


def _films() -> str:
    import imageio_ffmpeg

    asked = [imageio_ffmpeg.get_ffmpeg_exe(), "-version"]
    shown = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=30).stdout
    return " ".join(shown.split()[:3])


def _torch() -> str:
    torch = importlib.import_module("torch")
    total = float(torch.ones(3).sum())
    if total != 3.0:
        raise RuntimeError(f"the sum of three ones is {total}")
    devices = [torch.cuda.get_device_name(number) for number in range(torch.cuda.device_count())]
    return (
        f"{torch.__version__}, {', '.join(devices) or 'no GPU'}, {torch.get_num_threads()} threads"
    )
