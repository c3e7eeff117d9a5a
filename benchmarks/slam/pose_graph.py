"""Accuracy and time of ``pose_graph`` and of the particle filter, on recorded and simulated logs.

    python benchmarks/slam/pose_graph.py LOGS [--seeds 3] [--episodes DATASET/episodes]

Real logs have no truth. ``relations`` is the error over all reference relations (``NAME.relations`` next to
``NAME.log.gz``), ``revisits`` that over those of more than ten seconds; ``revisit`` is the mean distance between what
different passes through a place saw. Episodes of ``slamgym generate`` have a truth; for them the ATE after alignment is
given.
"""

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from slamgym.core.geometry import between, compose
from slamgym.core.types import BoolArray, FloatArray, IntArray, Pose2D
from slamgym.interop import Log, LogRecord, Relations, open_log, read_relations, read_truth
from slamgym.metrics import absolute_trajectory_error, relation_error
from slamgym.slam.replay import ReplayResult, replay, settings_for

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save
from slam_accuracy import MAPPERS

REVISIT_GAP = 60
"""Scans further apart than this belong to different passes."""
REVISIT_RANGE = 20.0
COLUMNS = (
    "log", "mode", "relations [m]", "revisits [m]", "rotation [deg]", "revisit [m]", "worst revisit [m]", "doubtful",
    "CPU [s]", "ms per scan",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=Path)
    arguments = parser.parse_args()
    rows = [
        real_row(path, name, settings, arguments.seeds)
        for path in sorted(arguments.logs.glob("*.log.gz"))
        for name, settings in MAPPERS.items()
    ]
    title = f"recorded logs, means over {arguments.seeds} seeds (rbpf) or disturbed odometries (pose_graph)"
    print_and_save("slam/pose_graph", title, rows, COLUMNS, times=("CPU [s]",))
    if arguments.episodes is not None:
        folders = sorted(path for path in arguments.episodes.iterdir() if path.is_dir())
        episodes = [episode_row(folder) for folder in folders]
        print_and_save(
            "slam/pose_graph_simulated",
            "simulated episodes: ATE [m] and CPU [s]",
            episodes,
            tuple(episodes[0]),
            times=[column for column in episodes[0] if "CPU [s]" in column],
        )


def real_row(path: Path, mode: str, settings: dict[str, Any], seeds: int) -> dict[str, Any]:
    """One log by one mapper. ``pose_graph`` itself has no randomness: later runs disturb the odometry."""
    log = open_log(path)
    config = settings_for(log.geometry, settings)
    replay(replace(log, records=log.records[:5]), config, np.random.default_rng(0))  # compiles the kernels
    results = [
        replay(
            disturbed(log, seed) if mode == "pose_graph" and seed else log,
            config,
            np.random.default_rng(seed),
        )
        for seed in range(seeds)
    ]
    relations_file = path.with_name(path.name.removesuffix(".log.gz") + ".relations")
    at_scans = again = rotation = None
    if relations_file.exists():
        relations = read_relations(relations_file)
        errors = [relation_error(result.moments, *relations) for result in results]
        at_scans = round(float(np.mean([error.translation.mean for error in errors])), 4)
        again = round(float(np.mean([revisits_error(result, relations) for result in results])), 4)
        rotation = round(float(np.degrees(np.mean([error.rotation.mean for error in errors]))), 2)
    revisits = [revisit(log, result) for result in results]
    return {
        "log": path.name.removesuffix(".log.gz"),
        "mode": mode,
        "relations [m]": at_scans,
        "revisits [m]": again,
        "rotation [deg]": rotation,
        "revisit [m]": round(float(np.mean(revisits)), 4),
        "worst revisit [m]": round(max(revisits), 4),
        "doubtful": round(float(np.mean([len(result.stats.doubtful) for result in results])), 1),
        "CPU [s]": round(float(np.mean([result.stats.cpu_seconds for result in results])), 1),
        "ms per scan": round(float(np.mean([r.stats.cpu_ms_per_processed_scan for r in results])), 2),
    }


def revisits_error(result: ReplayResult, relations: Relations) -> float:
    """Mean translational error over the relations between two passes [m]."""
    return relation_error(result.moments, *relations, revisits=True).translation.mean


def revisit(log: Log, result: ReplayResult) -> float:
    """Mean disagreement between passes [m]."""
    angles = log.geometry.angles + log.geometry.mount.theta
    points, owners = end_points(
        np.array([record.scan.ranges for record in log], dtype=np.float64),
        np.column_stack([np.cos(angles), np.sin(angles)]),
        np.array(log.geometry.mount[:2]),
        result.trajectory.poses,
        REVISIT_RANGE,
    )
    return revisit_disagreement(points, owners, gap=REVISIT_GAP)


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
    block = max(1, gap // 4)
    distances: list[FloatArray] = []
    # Points of one block of scans are compared with all scans that are at least a gap away.
    for first in range(0, num_scans, block):
        own = (owners >= first) & (owners < first + block)
        other: BoolArray = (owners <= first - gap) | (owners >= first + block - 1 + gap)
        if own.any() and other.any():
            found, _ = cKDTree(points[other]).query(points[own][::stride], distance_upper_bound=radius)
            distances.append(np.asarray(found, dtype=np.float64)[np.isfinite(found)])
    return float(np.concatenate(distances).mean()) if distances else math.nan


def end_points(
    ranges: FloatArray, directions: FloatArray, mount: FloatArray, poses: FloatArray, range_max: float
) -> tuple[FloatArray, IntArray]:
    """End points of scans in the map frame.

    Args:
        ranges: (scans, num_beams) [m]; only finite ones below ``range_max`` count.
        directions: (num_beams, 2) unit vectors of the beams in the robot frame.
        mount: (2,) sensor position in the robot frame [m].
        poses: (scans, 3) robot poses.
        range_max: Longer returns are left out [m].

    Returns:
        Points (N, 2) [m] and the index of each point's scan (N,).
    """
    usable = np.isfinite(ranges) & (ranges < range_max)
    owners, beams = np.nonzero(usable)
    local = ranges[owners, beams][:, None] * directions[beams] + mount
    cos, sin = np.cos(poses[owners, 2]), np.sin(poses[owners, 2])
    x = poses[owners, 0] + cos * local[:, 0] - sin * local[:, 1]
    y = poses[owners, 1] + sin * local[:, 0] + cos * local[:, 1]
    return np.column_stack([x, y]), owners


def disturbed(log: Log, seed: int) -> Log:
    """The log with worse odometry: 2 % scale, 0.6 deg/m bias, 3 % and 1 deg/m noise (standard deviations)."""
    rng = np.random.default_rng(seed)
    scale, bias = 1.0 + 0.02 * rng.standard_normal(), 0.01 * rng.standard_normal()
    pose = last = log.records[0].odometry
    records: list[LogRecord] = []
    for record in log:
        step, last = between(last, record.odometry), record.odometry
        length = float(np.hypot(step.x, step.y))
        noise = length * np.array([0.03, 0.02, 0.02]) * rng.standard_normal(3)
        turn = step.theta * (1.0 + 0.02 * rng.standard_normal()) + bias * length + noise[2]
        pose = compose(pose, Pose2D(scale * step.x + noise[0], step.y + noise[1], turn))
        records.append(LogRecord(record.stamp, pose, record.scan))
    return replace(log, records=records)


def episode_row(folder: Path) -> dict[str, Any]:
    """One simulated exploration in all modes."""
    log, truth = open_log(folder), read_truth(folder)
    assert truth is not None, f"{folder} has no truth.tum"
    row: dict[str, Any] = {"episode": folder.name, "path [m]": round(truth.length)}
    for mode in ("dead_reckoning", "rbpf", "pose_graph"):
        config = settings_for(log.geometry, {"mode": mode})
        result = replay(log, config, np.random.default_rng(0))
        error = absolute_trajectory_error(result.trajectory, truth)
        row[f"{mode} ATE [m]"] = round(error.translation.rmse, 3)
        row[f"{mode} CPU [s]"] = round(result.stats.cpu_seconds, 1)
    return row


if __name__ == "__main__":
    main()
