"""Table II: how long the parametric model's conversions from odometry errors to map errors take, timed in one run."""

import math
import re
from pathlib import Path
from typing import NamedTuple

from slamgym.commands.reproduce.verdicts import Claim, exact, judge
from slamgym.core.intervals import Interval


class Conversion(NamedTuple):
    """A row of Table II."""

    folder: str
    """Of its maps, below ``deformed`` of the reproduction."""
    name: str
    side: str
    """Of the map [px]."""
    paper: str
    """Seconds in the paper's Matlab."""


EKF_A = Conversion("ekf_64", "EKF (a)", "64", "15-94")
"""EKF-SLAM on a map of 64 x 64."""
EKF_B = Conversion("ekf_64_to_256", "EKF (b)", "64, enlarged to 256", "-")
"""The same, whose displacements are enlarged; the paper gives no time for the enlargement alone."""
TWO_PHASE = Conversion("two_phase", "[26] (two_phase)", "256", "2.6-3.6")
"""The paper's fast method, after Souza et al. 2008."""
OURS = Conversion("ekf_schur", "ekf_schur, this package's own", "256", "-")
"""EKF-SLAM's answer at once, which is no filter."""
CONVERSIONS = (EKF_A, EKF_B, TWO_PHASE, OURS)

_SECONDS = re.compile(r" took ([0-9.]+) s")
_FINISHED = re.compile(r" in [0-9.]+ s: (.+)$")


def read_seconds(deformed: str) -> dict[str, list[float]]:
    """CPU seconds of each map but the first, which waits for its kernels, by the folder of the maps.

    Args:
        deformed: What ``slamgym deform`` printed, one run after the other; each ends with its folder.
    """
    found: dict[str, list[float]] = {}
    seconds: list[float] = []
    for line in deformed.splitlines():
        took = _SECONDS.search(line)
        finished = _FINISHED.search(line)
        if took:
            seconds.append(float(took[1]))
        elif finished:
            found[Path(finished[1]).name] = seconds[1:] or seconds
            seconds = []
    return found


def table_two(seconds: dict[str, list[float]]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: each conversion in the paper's Matlab and here.

    Args:
        seconds: As :func:`read_seconds` gives them.
    """
    rows = []
    for conversion in CONVERSIONS:
        found = _range(seconds.get(conversion.folder, []))
        rows.append([conversion.name, conversion.side, conversion.paper, found])
    return ["conversion", "side [px]", "the paper, Matlab [s]", "here [CPU s]"], rows


def conversion_claims(seconds: dict[str, list[float]]) -> list[Claim]:
    """Whether the fast method is faster than each form of the EKF."""
    claims = []
    fast = seconds.get(TWO_PHASE.folder)
    for conversion in (EKF_A, EKF_B):
        slow = seconds.get(conversion.folder)
        if not fast or not slow:
            continue
        times_faster = sum(slow) / sum(fast)
        any_faster = Interval(1.0, 1.0, math.inf)
        paper = f"{TWO_PHASE.paper} s against the EKF's {EKF_A.paper} s at 64 px"
        own = f"{_range(fast)} s against {_range(slow)} s"
        question = f"Table II: is {TWO_PHASE.name} at 256 px faster than {conversion.name}?"
        verdict = judge(exact(times_faster), any_faster, 1.0)
        claims.append(Claim(question, paper, own, verdict))
    return claims


def _range(seconds: list[float]) -> str:
    """The least and the most [s]."""
    if not seconds:
        return "not timed"
    least = f"{min(seconds):.2g}"
    most = f"{max(seconds):.2g}"
    return least if least == most else f"{least}-{most}"
