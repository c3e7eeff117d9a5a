"""CPU time of the mappers per processed scan, against particles, beams and the size of the map.

    python benchmarks/slam/slam_speed.py

A simulated TurtleBot3 explores a generated home for seven minutes; its scans are replayed with one setting
changed at a time. The size of the map is changed by letting the same filter map the same home again and
again, each time 40 m further on, and timing the last round. GMapping's own times for such a log (C++, -O2,
one thread) are shown with them.
"""

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.registry import make_explorer
from slamgym.cad import PlanGeneratorConfig, generate_plan
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.envs import EpisodeConfig, ExploreConfig, run_episode
from slamgym.interop import LogRecord
from slamgym.slam import SlamConfig, make_mapper

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/slam",)
"""What is measured."""

GMAPPING_MS = {8: 10.6, 30: 40.0, 100: 128.0}
"""CPU time of GMapping per processed scan with 180 beams, by particles [ms]."""

REPEATS = 2
COLUMNS = (
    "changed",
    "particles",
    "beams",
    "map [m2]",
    "ms per scan",
    "GMapping [ms]",
    "times faster",
    "of the filter's",
    "memory [MB]",
)


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    records, geometry = drive()
    time_mapper(records, geometry, SlamConfig(mode="rbpf"))  # compiles the kernels
    rows = [
        row("particles", records, geometry, SlamConfig(mode="rbpf", particles=count))
        for count in (1, 8, 30, 100, 300)
    ]
    rows += [
        row("beams", *thinned(records, geometry, skip), SlamConfig(mode="rbpf")) for skip in (4, 2)
    ]
    rows += [
        row(
            "map size",
            visiting(records, laps),
            geometry,
            SlamConfig(mode="rbpf"),
            judged=len(records),
        )
        for laps in (1, 4, 16)
    ]
    rows.append(row("pose_graph", records, geometry, SlamConfig(mode="pose_graph")))
    usual = next(one["ms per scan"] for one in rows if one["particles"] == SlamConfig.particles)
    for one in rows:
        one["of the filter's"] = round(one["ms per scan"] / usual, 3)
    title = "particle filter, CPU time per processed scan"
    print_and_save("slam/slam_speed", title, rows, COLUMNS, MODULES, times=("ms per scan",))


def drive() -> tuple[list[LogRecord], LaserGeometry]:
    """Seven minutes of scans and wheel odometry in a home."""
    plan = generate_plan(1_001, PlanGeneratorConfig(kind="home"))
    env = dataclasses.replace(ExploreConfig(slam=SlamConfig(mode="ground_truth")).for_explorer())
    episode = run_episode(plan, 1, EpisodeConfig("explore_lite", 7.0, env=env), make_explorer)
    return list(episode.records), episode.geometry


def thinned(
    records: Sequence[LogRecord], geometry: LaserGeometry, skip: int
) -> tuple[list[LogRecord], LaserGeometry]:
    """The same scans with every so many beams only."""
    count = len(range(0, geometry.num_beams, skip))
    coarse = geometry._replace(num_beams=count, angle_increment=geometry.angle_increment * skip)
    scans = [
        LogRecord(r.stamp, r.odometry, LaserScan(r.stamp, r.scan.ranges[::skip], coarse))
        for r in records
    ]
    return scans, coarse


def visiting(records: Sequence[LogRecord], laps: int) -> list[LogRecord]:
    """The same drive again and again, each time 40 m further on, so that the map grows with the laps."""
    duration = records[-1].stamp + 1.0
    far = []
    for lap in range(laps):
        shift, late = 40.0 * lap, duration * lap
        for r in records:
            pose = Pose2D(r.odometry.x + shift, r.odometry.y, r.odometry.theta)
            stamp = r.stamp + late
            far.append(LogRecord(stamp, pose, LaserScan(stamp, r.scan.ranges, r.scan.geometry)))
    return far


def row(
    changed: str,
    records: Sequence[LogRecord],
    geometry: LaserGeometry,
    config: SlamConfig,
    judged: int | None = None,
) -> dict[str, Any]:
    """Measure one setting; ``judged`` restricts the time to the last so many scans."""
    runs = [time_mapper(records, geometry, config, judged) for _ in range(REPEATS)]
    milliseconds, area, memory = min(runs)
    is_filter = config.mode == "rbpf" and geometry.num_beams == 180
    known = GMAPPING_MS.get(config.particles) if is_filter else None
    return {
        "changed": changed,
        "particles": config.particles if config.mode == "rbpf" else 1,
        "beams": geometry.num_beams,
        "map [m2]": round(area),
        "ms per scan": round(milliseconds, 2),
        "GMapping [ms]": known,
        "times faster": round(known / milliseconds, 1) if known else None,
        "memory [MB]": round(memory, 1),
    }


def time_mapper(
    records: Sequence[LogRecord],
    geometry: LaserGeometry,
    config: SlamConfig,
    judged: int | None = None,
) -> tuple[float, float, float]:
    """CPU time per processed scan [ms], extent of the map [m2] and memory [MB]."""
    start = records[0].odometry
    mapper = make_mapper(config, geometry, Pose2D(0.0, 0.0, start.theta), np.random.default_rng(0))
    first = len(records) - (judged or len(records))
    before = (0.0, 0)
    for index, record in enumerate(records):
        if index == first:
            before = (mapper.stats.cpu_seconds, mapper.stats.processed)
        mapper.update(record.odometry, record.scan)
    grid = mapper.occupancy_grid()
    stats = mapper.stats
    spent, processed = stats.cpu_seconds - before[0], stats.processed - before[1]
    area = grid.cells.size * grid.frame.resolution**2
    return 1e3 * spent / processed, area, stats.memory_bytes / 1e6


if __name__ == "__main__":
    main()
