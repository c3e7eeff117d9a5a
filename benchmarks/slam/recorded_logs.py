"""Judging maps of recorded logs, which have no truth: by relations, by what several passes saw, by another path.

A log also has variants: as another laser would have recorded it, and with turns that are measured wrong.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from faults import doubtful_spans, with_steps
from map_log import map_log
from scipy.spatial import cKDTree

from slamgym.core.geometry import compose, unit_vectors
from slamgym.core.types import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    LaserGeometry,
    Pose2D,
    Trajectory,
)
from slamgym.interop import Log, LogRecord, Relations, open_log, read_relations
from slamgym.interop.records import longest_ordered
from slamgym.metrics import absolute_trajectory_error, relation_error, relative_poses
from slamgym.slam.replay import ReplayResult

REVISIT_GAP = 60
"""Scans further apart than this belong to different passes."""
REVISIT_RANGE = 20.0
MOST_SCANS, MOST_BLOCKS = 1_000, 60
"""More scans than this are thinned out; each block of them takes a search tree of all others."""
SHORTER_RANGES = (12.0, 8.0, 4.0)
"""Ranges of lasers that would have seen less [m]."""
FEWER_BEAMS = (2, 4)
"""Of so many beams one is kept."""
WRONG_TURNS = (0.9, 1.1)
"""Factors of the odometry's turns."""
MORE_NOISE = 0.001
"""Standard deviation of noise that no mapper should feel [m]: whatever it changes is chance."""
COLUMNS = (
    "log", "mode", "relations [m]", "worst [m]", "revisits [m]", "rotation [deg]", "revisit [m]",
    "worst revisit [m]", "disturbed revisit [m]", "from reference [m]", "doubts", "ms per scan",
)  # fmt: skip


def log_rows(folder: Path, modes: Sequence[str], seeds: int) -> list[dict[str, Any]]:
    """A row for each log and mode; the path of the last mode is the reference."""
    rows = []
    for path in sorted(folder.glob("*.log.gz")):
        log, name = open_log(path), path.name.removesuffix(".log.gz")
        relations_file = path.with_name(f"{name}.relations")
        relations = read_relations(relations_file) if relations_file.exists() else None
        results = {mode: runs(log, mode, seeds) for mode in modes}
        reference = list(results.values())[-1].plain[0].trajectory
        for mode, some in results.items():
            rows.append({"log": name, "mode": mode} | judged(log, some, relations, reference))
            print(rows[-1], file=sys.stderr, flush=True)
    return rows


class Runs(NamedTuple):
    """Runs of one mode on a log."""

    plain: list[ReplayResult]  # with several seeds; one where there is no chance in the mapper
    disturbed: list[ReplayResult]  # with worse odometry


def runs(log: Log, mode: str, seeds: int) -> Runs:
    """Runs with so many seeds, and with so many disturbed odometries less one."""
    few = replace(log, records=log.records[:5], recorded_track=None)
    map_log(few, mode)  # compiles the kernels
    plain = [map_log(log, mode)]
    for seed in range(1, seeds):
        other = map_log(log, mode, seed)
        if (other.trajectory.poses == plain[0].trajectory.poses).all():
            break
        plain.append(other)
    worse = [disturbed(log, seed) for seed in range(1, seeds)]
    return Runs(plain, [map_log(one, mode) for one in worse])


def judged(
    log: Log, some: Runs, relations: Relations | None, reference: Trajectory
) -> dict[str, Any]:
    """Figures of one mode's runs on a log."""
    plain = some.plain
    row: dict[str, Any] = dict.fromkeys(COLUMNS[2:])
    if relations is not None:
        errors = [relation_error(result.moments, *relations) for result in plain]
        means = [error.translation.mean for error in errors]
        again = [relation_error(result.moments, *relations, revisits=True) for result in plain]
        row["relations [m]"], row["worst [m]"] = rounded(means), round(max(means), 4)
        row["revisits [m]"] = rounded([error.translation.mean for error in again])
        row["rotation [deg]"] = round(
            float(np.degrees(np.mean([e.rotation.mean for e in errors]))), 2
        )
    revisits = [revisit(log, result) for result in plain]
    disturbed_revisits = [revisit(log, result) for result in some.disturbed]
    paths = [absolute_trajectory_error(result.trajectory, reference) for result in plain]
    return row | {
        "revisit [m]": rounded(revisits),
        "worst revisit [m]": round(max(revisits), 4),
        "disturbed revisit [m]": rounded(disturbed_revisits) if disturbed_revisits else None,
        "from reference [m]": rounded([path.translation.rmse for path in paths]),
        "doubts": rounded([len(doubtful_spans(result.stats)) for result in plain]),
        "ms per scan": round(
            float(np.median([r.stats.cpu_ms_per_processed_scan for r in plain])), 2
        ),
    }


def rounded(values: Sequence[float]) -> float:
    """Mean for a table."""
    return round(float(np.mean(values)), 4)


def revisit(log: Log, result: ReplayResult) -> float:
    """Mean disagreement between passes [m]."""
    every = math.ceil(len(log) / MOST_SCANS)
    points, owners = end_points(
        log.records[::every], result.trajectory.poses[::every], REVISIT_RANGE
    )
    return revisit_disagreement(points, owners, gap=REVISIT_GAP // every)


def revisit_disagreement(
    points: FloatArray, owners: IntArray, *, gap: int, radius: float = 0.5, stride: int = 5
) -> float:
    """Mean distance from end points to the nearest end point that another pass saw [m]; nan if no place was seen twice.

    Args:
        points: End points of all scans in the map frame, shape (N, 2) [m].
        owners: Index of each point's scan, shape (N,), ascending.
        gap: Scans whose indices differ by at least this belong to different passes.
        radius: Points with nothing of another pass within this distance were seen once only, or belong to
            something that moved; they don't count [m].
        stride: Measure every so many points.
    """
    num_scans = int(owners[-1]) + 1 if len(owners) else 0
    block = max(1, gap // 4, num_scans // MOST_BLOCKS)
    distances: list[FloatArray] = []
    # Points of one block of scans are compared with all scans that are at least a gap away.
    for first in range(0, num_scans, block):
        own = (owners >= first) & (owners < first + block)
        other: BoolArray = (owners <= first - gap) | (owners >= first + block - 1 + gap)
        if own.any() and other.any():
            found, _ = cKDTree(points[other]).query(
                points[own][::stride], distance_upper_bound=radius
            )
            distances.append(np.asarray(found, dtype=np.float64)[np.isfinite(found)])
    return float(np.concatenate(distances).mean()) if distances else math.nan


def end_points(
    records: Sequence[LogRecord], poses: FloatArray, range_max: float
) -> tuple[FloatArray, IntArray]:
    """End points of scans in the map frame.

    Args:
        records: The scans; at least one.
        poses: Their robot poses, shape (scans, 3).
        range_max: Longer returns are left out [m].

    Returns:
        Points (N, 2) [m] and the index of each point's scan (N,).
    """
    geometry = records[0].scan.geometry
    ranges = np.array([record.scan.ranges for record in records], dtype=np.float64)
    owners, beams = np.nonzero(np.isfinite(ranges) & (ranges < range_max))
    rays = unit_vectors(geometry.angles + geometry.mount.theta)
    seen = ranges[owners, beams][:, None] * rays[beams] + geometry.mount[:2]
    ahead = unit_vectors(poses[owners, 2])
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    return poses[owners, :2] + seen[:, [0]] * ahead + seen[:, [1]] * left, owners


def disturbed(log: Log, seed: int) -> Log:
    """The log with worse odometry: 2 % scale, 0.6 deg/m bias, 3 % and 1 deg/m noise (standard deviations)."""
    rng = np.random.default_rng(seed)
    scale, bias = 1.0 + 0.02 * rng.standard_normal(), 0.01 * rng.standard_normal()

    def changed(step: Pose2D, stamp: float) -> Pose2D:
        del stamp
        length = float(np.hypot(step.x, step.y))
        noise = length * np.array([0.03, 0.02, 0.02]) * rng.standard_normal(3)
        turn = step.theta * (1.0 + 0.02 * rng.standard_normal()) + bias * length + noise[2]
        return Pose2D(scale * step.x + noise[0], step.y + noise[1], turn)

    return with_steps(log, changed)


class JudgedLog(NamedTuple):
    """A recorded log and what is known of its true path: relations, a path, or nothing."""

    log: Log
    relations: Relations | None
    path: Trajectory | None

    @property
    def kind(self) -> str:
        """What a path is held against."""
        if self.relations is not None:
            return "relations"
        return "own path" if self.path is None else "path"

    def error(
        self, scans: Trajectory, moments: Trajectory, whole: Trajectory | None
    ) -> float | None:
        """Mean error of the relations; else RMSE to the reference path after alignment [m].

        Args:
            scans: A pose for every scan.
            moments: A pose for every moment of which the log holds the odometry.
            whole: The reference where the log has none; without it there is no error.
        """
        if self.relations is not None:
            return relation_error(moments, *self.relations).translation.mean
        reference = whole if self.path is None else self.path
        if reference is None:
            return None
        return absolute_trajectory_error(scans, reference).translation.rmse


def read_judged_log(path: Path) -> JudgedLog:
    """A log with its relations (NAME.relations) or corrected path.

    NAME.corr has a line for each scan: time [s], x, y [m], heading [rad].
    """
    stem = path.name.removesuffix(".log.gz")
    relations = path.with_name(f"{stem}.relations")
    corrected = path.with_name(f"{stem}.corr")
    log = open_log(path)
    reference = None
    if corrected.exists():
        table = np.loadtxt(corrected)
        # The log lacks the scans at which time goes backwards, if it has a clock.
        is_whole = len(table) == len(log)
        kept = slice(None) if is_whole else longest_ordered(table[:, 0].tolist())
        reference = Trajectory(np.array([record.stamp for record in log]), table[kept, 1:])
    return JudgedLog(log, read_relations(relations) if relations.exists() else None, reference)


def variants(log: Log) -> Iterator[tuple[str, Log]]:
    """The log by the name of each variant, the first as it is."""
    yield "whole", log
    for limit in SHORTER_RANGES:
        if limit < log.geometry.range_max:
            yield f"to {limit:g} m", with_range(log, limit)
    for every in FEWER_BEAMS:
        yield f"1 of {every} beams", with_fewer_beams(log, every)
    for factor in WRONG_TURNS:
        yield f"turns x {factor:g}", with_turns(log, factor)


def with_noise(log: Log, seed: int) -> Log:
    """The log with ``MORE_NOISE`` in its ranges, another for each seed; as it is for seed 0."""
    if seed == 0:
        return log
    rng = np.random.default_rng(seed)
    ranges = []
    for record in log:
        noise = rng.normal(0.0, MORE_NOISE, len(record.scan.ranges))
        ranges.append((record.scan.ranges + noise).astype(np.float32))
    return with_scans(log, ranges, log.geometry)


def with_range(log: Log, limit: float) -> Log:
    """The log of a laser that sees less far [m]."""
    geometry = log.geometry._replace(range_max=limit)
    ranges = [np.where(r.scan.ranges > limit, np.float32(np.inf), r.scan.ranges) for r in log]
    return with_scans(log, ranges, geometry)


def with_fewer_beams(log: Log, every: int) -> Log:
    """The log of a laser that has one of so many beams."""
    ranges = [record.scan.ranges[::every] for record in log]
    old = log.geometry
    geometry = old._replace(
        num_beams=len(ranges[0]),
        angle_increment=every * old.angle_increment,
        time_increment=every * old.time_increment,
    )
    return with_scans(log, ranges, geometry)


def with_scans(log: Log, ranges: Sequence[Float32Array], geometry: LaserGeometry) -> Log:
    """The log with other ranges, by another laser."""
    records = [
        record._replace(scan=replace(record.scan, ranges=some, geometry=geometry))
        for record, some in zip(log, ranges, strict=True)
    ]
    return replace(log, records=records, geometry=geometry)


def with_turns(log: Log, factor: float) -> Log:
    """The log with turns of the odometry times a factor, also between the scans."""
    track = log.track
    steps = relative_poses(track.poses[:-1], track.poses[1:])
    steps[:, 2] *= factor
    poses = [Pose2D(*track.poses[0].tolist())]
    for step in steps.tolist():
        poses.append(compose(poses[-1], Pose2D(*step)))
    records = []
    for record, place in zip(log, track.scans.tolist(), strict=True):
        motion = record.scan.motion
        turned = motion._replace(theta=factor * motion.theta)
        records.append(
            record._replace(odometry=poses[place], scan=replace(record.scan, motion=turned))
        )
    recorded = log.recorded_track and track._replace(poses=np.array(poses))
    return replace(log, records=records, recorded_track=recorded)
