"""Judging maps of recorded logs, which have no truth: by relations, by what several passes saw, by another path."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from faults import doubtful_spans, with_steps
from scipy.spatial import cKDTree

from slamgym.core.geometry import unit_vectors
from slamgym.core.types import BoolArray, FloatArray, IntArray, Pose2D, Trajectory
from slamgym.interop import Log, LogRecord, Relations, open_log, read_relations
from slamgym.metrics import absolute_trajectory_error, relation_error
from slamgym.slam import SlamConfig
from slamgym.slam.replay import ReplayResult, replay

REVISIT_GAP = 60
"""Scans further apart than this belong to different passes."""
REVISIT_RANGE = 20.0
MOST_SCANS, MOST_BLOCKS = 1_000, 60
"""More scans than this are thinned out; each block of them takes a search tree of all others."""
COLUMNS = (
    "log", "mode", "relations [m]", "worst [m]", "revisits [m]", "rotation [deg]", "revisit [m]",
    "worst revisit [m]", "disturbed revisit [m]", "from reference [m]", "doubts", "ms per scan",
)  # fmt: skip


def log_rows(
    folder: Path, modes: Mapping[str, Mapping[str, Any]], seeds: int
) -> list[dict[str, Any]]:
    """A row for each log and mode; the path of the last mode is the reference."""
    rows = []
    for path in sorted(folder.glob("*.log.gz")):
        log, name = open_log(path), path.name.removesuffix(".log.gz")
        relations_file = path.with_name(f"{name}.relations")
        relations = read_relations(relations_file) if relations_file.exists() else None
        results = {mode: runs(log, settings, seeds) for mode, settings in modes.items()}
        reference = list(results.values())[-1].plain[0].trajectory
        for mode, some in results.items():
            rows.append({"log": name, "mode": mode} | judged(log, some, relations, reference))
            print(rows[-1], file=sys.stderr, flush=True)
    return rows


class Runs(NamedTuple):
    """Runs of one mode on a log."""

    plain: list[ReplayResult]  # with several seeds; one where there is no chance in the mapper
    disturbed: list[ReplayResult]  # with worse odometry


def runs(log: Log, settings: Mapping[str, Any], seeds: int) -> Runs:
    """Runs with so many seeds, and with so many disturbed odometries less one."""
    config = replace(SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams), **settings)
    replay(
        replace(log, records=log.records[:5]), config, np.random.default_rng(0)
    )  # compiles the kernels
    plain = [replay(log, config, np.random.default_rng(0))]
    for seed in range(1, seeds):
        other = replay(log, config, np.random.default_rng(seed))
        if (other.trajectory.poses == plain[0].trajectory.poses).all():
            break
        plain.append(other)
    worse = [disturbed(log, seed) for seed in range(1, seeds)]
    return Runs(plain, [replay(one, config, np.random.default_rng(0)) for one in worse])


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
