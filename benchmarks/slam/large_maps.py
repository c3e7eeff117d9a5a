"""Maps of the large buildings of slamgym-bench: how far their paths are off, and what they cost towards the end.

The first twelve buildings of the track ``large``: schools and offices of others, and generated ones. The robot is the
default one, with the sweep of its laser; it explores with a known pose until it is done. *end*: CPU time from the last
scan to the finished and judged map.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from drives import Conditions, Drive, drive
from zoo import verdict_of

from slamgym.agents.bench.manifest import open_bench_plans, read_bench
from slamgym.cad import FloorPlan
from slamgym.metrics import absolute_trajectory_error
from slamgym.slam.mapper import Mapper
from slamgym.slam.replay import replay

TRACK = "large"
"""Track of the benchmark whose first buildings are mapped."""
CASE = Conditions(minutes=180.0, sweep=0.1)
"""The default robot, for three hours at most."""
LATE_SHARE = 0.1
"""The last scans are this share of all."""
COLUMNS = (
    "building", "area [m2]", "minutes", "mode", "start [m]", "aligned [m]", "says", "ms per scan", "ms at the end",
    "end [s]",
)  # fmt: skip

Rows = list[dict[str, Any]]


@dataclass
class ScanClock:
    """CPU times at which a mapper was done with each processed scan."""

    times: list[float]

    def __call__(self, index: int, mapper: Mapper, is_processed: bool) -> None:
        """Note the time of a processed scan."""
        del index, mapper
        if is_processed:
            self.times.append(time.process_time())

    def milliseconds(self, share: float) -> float:
        """Mean time per processed scan over the last share of them [ms]."""
        last = max(2, round(share * len(self.times)))
        return 1e3 * float(np.mean(np.diff(self.times[-last:])))


def large_buildings() -> Iterator[tuple[FloorPlan, int]]:
    """The buildings, each with the seed of its drive."""
    track = read_bench().track(TRACK).quick()
    plans = open_bench_plans(track, "")
    return ((plans.load(one.plan), one.seed) for one in track.buildings)


def large_rows(modes: list[str], cache: Path) -> Rows:
    """A row for each building and mode."""
    rows = []
    for plan, seed in large_buildings():
        one = drive(plan, seed, CASE, cache)
        for mode in modes:
            building = {
                "building": plan.id,
                "area [m2]": round(plan.area),
                "minutes": round(float(np.ptp(one.truth.stamps)) / 60.0, 1),
                "mode": mode,
            }
            rows.append(building | building_row(one, mode))
            print(rows[-1], flush=True)
    return rows


def building_row(one: Drive, mode: str) -> dict[str, Any]:
    """Figures of a mode on one drive."""
    clock = ScanClock([time.process_time()])
    result = replay(one.log, CASE.mapper(mode), np.random.default_rng(0), clock)
    end = time.process_time() - clock.times[-1]
    start, aligned = (
        absolute_trajectory_error(result.processed, one.truth, align=align).translation.rmse
        for align in (False, True)
    )
    return {
        "start [m]": round(start, 3),
        "aligned [m]": round(aligned, 3),
        "says": verdict_of(result.stats),
        "ms per scan": round(clock.milliseconds(1.0), 2),
        "ms at the end": round(clock.milliseconds(LATE_SHARE), 2),
        "end [s]": round(end, 2),
    }
