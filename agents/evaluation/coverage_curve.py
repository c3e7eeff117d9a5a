"""Coverage of a building over time and over path length: explorers are compared by it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamgym.core.types import FloatArray

COVERAGE_LEVELS = (0.5, 0.8, 0.9, 0.95, 0.98, 0.99)
"""Shares of the reachable floor whose first reaching is timed."""

HORIZON_PER_AREA = 3.0
"""Horizon of the area under the curve [s/m2]: Explore Lite is done after 2.4 s/m2 in the median."""
HORIZON_BASE = 60.0
"""Constant part of the horizon of every plan [s]."""

_STEP = 0.0005
"""Smallest gain of coverage that a thinned curve keeps a point for."""


def horizon(area: float) -> float:
    """Time over which the area under the coverage curve is taken, for a plan of some free area [m2]; [s]."""
    return HORIZON_BASE + HORIZON_PER_AREA * area


@dataclass(frozen=True)
class CoverageCurve:
    """Coverage over time and over path length: a step function, known where it changes."""

    time: FloatArray  # (N,) [s], not decreasing
    path: FloatArray  # (N,) [m], not decreasing
    coverage: FloatArray  # (N,) share of the reachable floor in [0, 1], not decreasing

    def __post_init__(self) -> None:
        if not len(self.time) == len(self.path) == len(self.coverage) > 0:
            raise ValueError(
                "a coverage curve needs as many times as paths and coverages, and at least one"
            )

    @property
    def final(self) -> float:
        """Coverage at the end."""
        return float(self.coverage[-1])

    def reached(self, level: float) -> tuple[float, float] | None:
        """When a coverage was first reached [s], and how far the robot had driven [m]; None if it never was."""
        there = np.flatnonzero(self.coverage >= level - 1e-12)
        if len(there) == 0:
            return None
        first = there[0]
        return float(self.time[first]), float(self.path[first])

    def at(self, times: FloatArray) -> FloatArray:
        """Coverage at some times [s]; 0 before the first point, the final coverage after the last."""
        times = np.asarray(times, dtype=np.float64)
        last = np.searchsorted(self.time, times, side="right") - 1
        return np.where(last >= 0, self.coverage[np.maximum(last, 0)], 0.0)

    def mean_until(self, end: float) -> float:
        """Mean coverage from time 0 to ``end`` [s]: the area under the curve, as a share of the most possible.

        After its last point a curve stays level, so an explorer that is done isn't punished for it.
        """
        inside = self.time < end
        if not inside.any():
            return 0.0
        durations = np.diff(np.append(self.time[inside], end))
        return float((durations * self.coverage[inside]).sum() / end)

    def thinned(self) -> "CoverageCurve":
        """The same curve with the points only where coverage changed, and the last one."""
        step = np.floor(self.coverage / _STEP)
        kept = np.append(True, np.diff(step) > 0.0)
        kept[-1] = True
        return CoverageCurve(self.time[kept], self.path[kept], self.coverage[kept])

    def to_dict(self) -> dict[str, list[float]]:
        """JSON form: seconds and metres to the centimetre, shares to four decimals."""
        return {
            "time": np.round(self.time, 2).tolist(),
            "path": np.round(self.path, 2).tolist(),
            "coverage": np.round(self.coverage, 4).tolist(),
        }

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> "CoverageCurve":
        """Read :meth:`to_dict`'s form.

        Raises:
            ValueError: If it is no curve.
        """
        return CoverageCurve(
            time=np.array(values.get("time", ()), np.float64),
            path=np.array(values.get("path", ()), np.float64),
            coverage=np.array(values.get("coverage", ()), np.float64),
        )
