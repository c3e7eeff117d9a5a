"""The largest range of a laser, by what its log says and by the readings themselves."""

from collections.abc import Sequence

import numpy as np

from slamgym.core.types import Float32Array, FloatArray, IntArray
from slamgym.interop.records import LogFinding

DEFAULT_RANGE_MAX = 80.0
"""Limit where a log tells nothing [m]: a SICK LMS reports 81.91 m or so where nothing came back."""
LONGEST = 1000.0
"""No scanner sees further [m]."""
SAMPLED_SCANS = 500
"""So many scans of a log are looked at, or a few more."""
OUTSTANDING = 10
"""A reading stands for no return if so many times more readings are the same than share any other value near it."""
LEAST_BEAMS = 8
"""It must be found in so many beams: each beam of a robot at rest always reads the same."""


def range_limit(
    scans: Sequence[Float32Array], declared: float | None, wanted: float | None
) -> tuple[float, tuple[LogFinding, ...]]:
    """The range from which on a reading means no return [m], and what is wrong with the log's own.

    Args:
        scans: Ranges of each scan as logged [m].
        declared: What the log says; None if it doesn't.
        wanted: What the user says.
    """
    if wanted is not None:
        return wanted, ()
    sample = scans[:: max(1, len(scans) // SAMPLED_SCANS)]
    with np.errstate(invalid="ignore"):  # what is no number may be of the kind that signals it
        ranges = np.concatenate(sample).astype(np.float64)
    beams = np.concatenate([np.arange(len(scan)) for scan in sample])
    measured = np.isfinite(ranges) & (ranges > 0.0)
    ranges = ranges[measured]
    beams = beams[measured]
    if declared is None:
        return _no_return(ranges, beams) or DEFAULT_RANGE_MAX, ()
    beyond = ranges[ranges >= declared]
    is_exceeded = len(beyond) > 0.5 * len(ranges) and np.ptp(beyond) > 0.1
    if 0.0 < declared <= LONGEST and not is_exceeded:
        below = ranges < declared - 1e-4
        constant = _no_return(ranges[below], beams[below])
        if constant is None:
            return declared, ()
        share = np.count_nonzero(ranges == constant) / len(ranges)
        finding = LogFinding(
            "no return",
            f"{share:.1%} of the readings are {constant:.6g} m, below the laser's limit of {declared:.6g} m: taken for "
            f"no return (--range-max {declared:.6g} takes them for walls)",
        )
        return constant, (finding,)
    longest = float(ranges.max()) + 0.01 if len(ranges) else DEFAULT_RANGE_MAX
    limit = _no_return(ranges, beams) or longest
    finding = LogFinding(
        "range_max",
        f"the laser's range_max can't be {declared:g} m: {limit:.6g} m is taken (--range-max sets it)",
    )
    return limit, (finding,)


def _no_return(ranges: FloatArray, beams: IntArray) -> float | None:
    """The reading that stands for no return, if there is one: no surface is so often exactly as far away."""
    values, counts = np.unique(ranges, return_counts=True)
    far = values > 0.9 * values.max(initial=0.0)
    if not far.any():
        return None
    values = values[far]
    counts = counts[far]
    top = int(np.argmax(np.where(values > 0.98 * values[-1], counts, 0)))
    second = np.delete(counts, top).max(initial=0)
    stands_out = counts[top] >= OUTSTANDING * max(2, second)
    in_many = len(np.unique(beams[ranges == values[top]])) >= LEAST_BEAMS
    return float(values[top]) if stands_out and in_many else None
