"""Accuracy of the mappers: recorded logs with reference relations, and simulated homes with a truth.

    python benchmarks/slam/slam_accuracy.py [--logs LOGS] [--seeds 5] [--episodes 20] [--levels ...] [--modes ...]

The simulated robot explores generated homes for seven minutes with a known pose; the same scans and wheel
readings are then replayed through each mode, so that every row of a table measures the same drives. Errors are
the RMSE of the final path against the truth without any alignment; intervals are 95 % bootstrap intervals of
the mean.
"""

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from slamgym.agents.registry import make_explorer
from slamgym.cad import PlanGeneratorConfig, generate_plan
from slamgym.core.intervals import mean_interval
from slamgym.core.types import Pose2D, Trajectory
from slamgym.envs import EpisodeConfig, ExploreConfig, run_episode
from slamgym.interop import Log, open_log, read_relations
from slamgym.metrics import (
    absolute_trajectory_error,
    normalised_estimation_error_squared,
    poses_at,
    relation_error,
)
from slamgym.sim import odometry_level
from slamgym.slam import SlamConfig, make_mapper
from slamgym.slam.replay import replay, settings_for

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

INSTANTS = 10
"""Number of instants of a drive at which NEES is taken."""
GMAPPING = {
    "mode": "rbpf", "matcher": "hill_climbing", "odometry_weight": 0.0, "learn_odometry": False, "drawn_noise": 1.0,
}  # fmt: skip
GMAPPING_SEARCH = "GMapping's search"
LEVELS = ("ideal", "low", "medium", "high")
MODES = ("dead_reckoning", "scan_matching", "rbpf", "pose_graph", GMAPPING_SEARCH)
LONG_RANGE = 12.0
"""Laser of the last rows [m]."""
MAPPERS: dict[str, dict[str, Any]] = {
    "pose_graph": {},
    "rbpf, 30 particles": {"mode": "rbpf"},
    f"{GMAPPING_SEARCH}, 30 particles": GMAPPING,
}
REAL_COLUMNS = (
    "log", "mapper", "relations [m]", "worst seed [m]", "revisits [m]", "rotation [deg]", "ms per scan",
)  # fmt: skip
SIMULATED_COLUMNS = (
    "odometry", "laser [m]", "mode", "particles", "RMSE [m]", "95 % low", "95 % high", "median [m]", "worst [m]",
    "N_eff share", "NEES", "median NEES", "ms per scan",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=LEVELS)
    parser.add_argument("--modes", nargs="+", choices=MODES, default=MODES)
    arguments = parser.parse_args()
    if arguments.logs is not None:
        rows = [
            real_row(path, name, settings, arguments.seeds)
            for path in sorted(arguments.logs.glob("*.relations"))
            for name, settings in MAPPERS.items()
        ]
        print_and_save(
            "slam/slam_accuracy_logs", f"recorded logs, {arguments.seeds} seeds", rows, REAL_COLUMNS
        )
    if arguments.episodes == 0:
        return
    is_whole = tuple(arguments.modes) == MODES
    rows = simulated_rows(arguments.episodes, arguments.levels, arguments.modes)
    title = f"simulated homes, {arguments.episodes} explorations of 7 minutes"
    name = "slam/slam_accuracy_simulated" if is_whole else "slam/slam_nees"
    print_and_save(name, title, rows, SIMULATED_COLUMNS)


def real_row(relations_file: Path, name: str, settings: dict[str, Any], seeds: int) -> dict[str, Any]:
    """One log with relations: the errors over all of them, and over those between two passes through a place."""
    log = open_log(relations_file.with_suffix(".log.gz"))
    relations = read_relations(relations_file)
    config = settings_for(log.geometry, settings)
    # Without chance in the mapper every seed is the same.
    tried = seeds if config.mode == "rbpf" else 1
    results = [replay(log, config, np.random.default_rng(seed)) for seed in range(tried)]
    errors = [relation_error(result.moments, *relations) for result in results]
    revisits = [relation_error(result.moments, *relations, revisits=True) for result in results]
    means = [error.translation.mean for error in errors]
    return {
        "log": relations_file.stem,
        "mapper": name,
        "relations [m]": round(float(np.mean(means)), 4),
        "worst seed [m]": round(max(means), 4),
        "revisits [m]": round(float(np.mean([error.translation.mean for error in revisits])), 4),
        "rotation [deg]": round(float(np.degrees(np.mean([error.rotation.mean for error in errors]))), 2),
        "ms per scan": round(float(np.median([r.stats.cpu_ms_per_processed_scan for r in results])), 2),
    }


def simulated_rows(episodes: int, levels: Sequence[str], modes: Sequence[str]) -> list[dict[str, Any]]:
    """Error against odometry noise and mode; of all modes, also with a laser that sees across rooms."""
    rows = []
    for level in levels:
        drives = [explore(seed, level, 3.5) for seed in range(episodes)]
        rows += [simulated_row(drives, level, 3.5, mode) for mode in modes]
    if tuple(modes) == MODES:
        drives = [explore(seed, "medium", LONG_RANGE) for seed in range(episodes)]
        rows += [
            simulated_row(drives, "medium", LONG_RANGE, mode)
            for mode in ("scan_matching", "rbpf", "pose_graph")
        ]
    return rows


def explore(seed: int, level: str, range_max: float) -> tuple[Log, Trajectory]:
    """Seven minutes in a separate generated home, driven with a known pose."""
    plan = generate_plan(1_000 + seed, PlanGeneratorConfig(kind="home"))
    env = ExploreConfig().for_explorer()
    lidar = dataclasses.replace(env.lidar, range_max=range_max)
    slam = SlamConfig(mode="ground_truth", max_usable_range=range_max - 0.05)
    env = dataclasses.replace(env, odometry=odometry_level(level), lidar=lidar, slam=slam)
    episode = run_episode(plan, seed, EpisodeConfig("nearest", 7.0, env=env), make_explorer)
    return Log(f"home {seed}", list(episode.records), episode.geometry), episode.truth


def simulated_row(
    drives: Sequence[tuple[Log, Trajectory]], level: str, range_max: float, mode: str
) -> dict[str, Any]:
    """One mode on all drives."""
    errors, shares, nees, times = [], [], [], []
    config = SlamConfig.gmapping()
    if mode != GMAPPING_SEARCH:
        config = SlamConfig(mode=mode, max_usable_range=range_max - 0.05)  # type: ignore[arg-type]
    for seed, (log, truth) in enumerate(drives):
        start = log.records[0].odometry
        mapper = make_mapper(config, log.geometry, Pose2D(0.0, 0.0, start.theta), np.random.default_rng(seed))
        instants = set(np.linspace(0, len(log.records) - 1, INSTANTS + 1).astype(int)[1:].tolist())
        for index, record in enumerate(log.records):
            mapper.update(record.odometry, record.scan)
            if index in instants and config.mode != "dead_reckoning":
                here, (true, _) = np.array([mapper.pose]), poses_at(truth, np.array([record.stamp]))
                nees.append(normalised_estimation_error_squared(here, true, mapper.covariance[None])[0])
        mapper.finish()
        path = mapper.trajectory()
        errors.append(absolute_trajectory_error(path, truth, align=False).translation.rmse)
        shares.append(float(np.mean(mapper.stats.n_eff)) / config.particles if mapper.stats.n_eff else 1.0)
        times.append(mapper.stats.cpu_ms_per_processed_scan)
    interval = mean_interval(np.array(errors))
    return {
        "odometry": level,
        "laser [m]": range_max,
        "mode": mode,
        "particles": config.particles if config.mode == "rbpf" else 1,
        "RMSE [m]": round(float(np.mean(errors)), 3),
        "95 % low": round(interval.low, 3),
        "95 % high": round(interval.high, 3),
        "median [m]": round(float(np.median(errors)), 3),
        "worst [m]": round(max(errors), 3),
        "N_eff share": round(float(np.mean(shares)), 2) if config.mode == "rbpf" else None,
        "NEES": round(float(np.mean(nees)), 1) if nees else None,
        "median NEES": round(float(np.median(nees)), 1) if nees else None,
        "ms per scan": round(float(np.median(times)), 2),
    }


if __name__ == "__main__":
    print(f"NEES of one run of a consistent filter lies in {chi2.interval(0.95, 3)} with 95 %")
    main()
