"""Localisation on finished maps: simulated second drives in homes that were mapped before, and a recorded log.

    python benchmarks/slam/localization.py [--homes 20] [--log intel.log.gz]

Each home is explored once with mode ``pose_graph``, which gives its map. Then the robot starts somewhere else, with new
errors of wheels and laser, drives for three minutes, and must find itself on that map or on the true one, knowing
nothing of its start. *Right* is a pose within 0.5 m and 17 degrees of where the map says the place is: a map that SLAM
made is distorted, so there the reference is the true pose moved by the mapping drive's own error nearby. *Right within
60 s* asks for ``localised`` and right; *wrong* is the share of all scans with ``localised`` and not right.
"""

import argparse
import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, PlanGeneratorConfig, generate_plan
from slamgym.core.geometry import between, compose, wrap_angle
from slamgym.core.intervals import mean_interval
from slamgym.core.types import UNKNOWN, FloatArray, OccupancyGrid, Pose2D, Trajectory
from slamgym.envs import Episode, EpisodeConfig, ExploreConfig, run_episode
from slamgym.interop import Log, LogRecord, open_log
from slamgym.metrics import normalised_estimation_error_squared, poses_at
from slamgym.sim import ClutterConfig, odometry_level
from slamgym.slam import SlamConfig
from slamgym.slam.config import LocalizationConfig
from slamgym.slam.localization.logs import LocalizationResult, localize_log
from slamgym.slam.replay import replay

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/slam",)
"""What is measured."""

FIRST_HOME = 5000
"""Homes from this number on were not used when the settings were chosen."""
SECONDS = 60.0
RIGHT_METRES, RIGHT_RADIANS = 0.5, 0.3
INSTANTS = 20
"""Number of instants of a drive at which NEES is taken."""
HERE = Pose2D(0.0, 0.0, 0.0)
COLUMNS = (
    "case", "drives", "right within 60 s [%]", "median time [s]", "error [m]", "95 % low", "95 % high", "heading [deg]",
    "in the building [m]", "localised [%]", "wrong [% of scans]", "drives with any wrong", "NEES", "ms per scan",
)  # fmt: skip


class Drive(NamedTuple):
    """A log with the truth in the frame of the map that it is localised on."""

    log: Log
    truth: Trajectory
    carried_at: float = 0.0  # when the robot was carried off [s]


class Outcome(NamedTuple):
    """One drive on one map."""

    seconds: float  # until right for the first time; infinite if never
    errors: FloatArray  # (n,) of localised right scans, against what the map says [m]
    headings: FloatArray  # (n,) [rad]
    plain: FloatArray  # (n,) against the building [m]
    localised: float  # share of scans
    wrong: float  # share of scans
    nees: FloatArray
    ms: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--homes", type=int, default=20)
    parser.add_argument("--log", type=Path)
    arguments = parser.parse_args()
    cases: dict[str, list[Outcome]] = {}
    last: tuple[OccupancyGrid, Episode] | None = None
    for seed in range(arguments.homes):
        plan = generate_plan(FIRST_HOME + seed, PlanGeneratorConfig(kind="home"))
        first = explore(plan, seed, "pose_graph")
        second, third = (explore(plan, 1000 * k + seed, "ground_truth", 3.0) for k in (1, 2))
        drive = placed(second, first.start)
        true = plan.raster(0.05, offset=(first.start.x, first.start.y), outside=UNKNOWN)
        add(cases, "true map", on_map(drive, true, None))
        add(cases, "map of the graph", on_map(drive, first.slam_map, first))
        carried = joined(drive, placed(third, first.start))
        add(
            cases,
            "map of the graph, carried off after 90 s",
            on_map(carried, first.slam_map, first),
        )
        furnished = explore(plan, seed, "pose_graph", furniture=0.3)
        moved = explore(plan, 3000 + seed, "ground_truth", 3.0, furniture=0.3)
        add(
            cases,
            "map of the graph, all furniture moved",
            on_map(placed(moved, furnished.start), furnished.slam_map, furnished),
        )
        if last is not None:
            add(cases, "another building", on_map(drive, last[0], None, elsewhere=True))
        last = first.slam_map, first
        print(
            seed,
            {name: f"{outcomes[-1].seconds:.0f} s" for name, outcomes in cases.items()},
            flush=True,
        )
    rows = [row(name, outcomes) for name, outcomes in cases.items()]
    if arguments.log is not None:
        rows.append(
            row(
                f"{arguments.log.name}: second half on the map of the first",
                [recorded(arguments.log)],
            )
        )
    title = f"localisation in {arguments.homes} homes"
    print_and_save("slam/localization", title, rows, COLUMNS, MODULES, times=("ms per scan",))


def add(cases: dict[str, list[Outcome]], name: str, outcome: Outcome) -> None:
    cases.setdefault(name, []).append(outcome)


def explore(
    plan: FloorPlan, seed: int, mode: str, minutes: float = 7.0, furniture: float = 0.0
) -> Episode:
    """A drive with medium odometry, in a home that each seed furnishes differently."""
    env = dataclasses.replace(
        ExploreConfig(),
        odometry=odometry_level("medium"),
        slam=SlamConfig(mode=mode),  # type: ignore[arg-type]
        clutter=ClutterConfig(furniture=furniture),
    )
    return run_episode(plan, seed, EpisodeConfig("nearest", minutes, env=env), make_explorer)


def placed(episode: Episode, origin: Pose2D) -> Drive:
    """A drive with its truth in the frame of a map whose origin is a place in the building."""
    shift = np.array([episode.start.x - origin.x, episode.start.y - origin.y, 0.0])
    log = Log("drive", list(episode.records), episode.geometry)
    return Drive(log, Trajectory(episode.truth.stamps, episode.truth.poses + shift))


def joined(first: Drive, second: Drive) -> Drive:
    """The first half of a drive, then another: the robot is carried there, and its wheels notice nothing."""
    half = min(len(first.log), len(second.log)) // 2
    records, other = list(first.log.records[:half]), second.log.records
    end = records[-1]
    after = end.stamp + 0.2 - other[0].stamp
    for record in other:
        odometry = compose(end.odometry, between(other[0].odometry, record.odometry))
        scan = dataclasses.replace(record.scan, stamp=record.stamp + after)
        records.append(LogRecord(record.stamp + after, odometry, scan))
    stamps = np.concatenate([first.truth.stamps[:half], second.truth.stamps + after])
    poses = np.vstack([first.truth.poses[:half], second.truth.poses])
    return Drive(
        Log("carried", records, first.log.geometry), Trajectory(stamps, poses), end.stamp + 0.1
    )


def on_map(
    drive: Drive, grid: OccupancyGrid, mapping: Episode | None, elsewhere: bool = False
) -> Outcome:
    """Localise a drive.

    Args:
        drive: The log and the truth.
        grid: The map.
        mapping: The drive that made the map; None for a map without errors.
        elsewhere: Whether the map is of another building, so that nothing is right.
    """
    begin = time.process_time()
    result = localize_log(drive.log, grid, HERE, LocalizationConfig())
    ms = 1e3 * (time.process_time() - begin) / len(result.beliefs)
    stamps = np.array([belief.stamp for belief in result.beliefs])
    truth, _ = poses_at(drive.truth, stamps)
    reference = truth + (0.0 if mapping is None else distortion(mapping, truth))
    return outcome(result, reference, truth, drive, ms, elsewhere)


def distortion(mapping: Episode, poses: FloatArray) -> FloatArray:
    """Error of the map at poses (n, 3): that of the drive that made it, where it came nearest."""
    true, _ = poses_at(mapping.truth, mapping.estimate.stamps)
    error = mapping.estimate.poses - true
    error[:, 2] = wrap_angle(error[:, 2])
    away = np.hypot(true[:, 0, None] - poses[:, 0], true[:, 1, None] - poses[:, 1])
    away += 0.5 * np.abs(wrap_angle(true[:, 2, None] - poses[:, 2]))
    nearest: FloatArray = error[np.argmin(away, axis=0)]
    return nearest


def outcome(
    result: LocalizationResult,
    reference: FloatArray,
    truth: FloatArray,
    drive: Drive,
    ms: float,
    elsewhere: bool,
) -> Outcome:
    """Compare beliefs with the references (n, 3) at the same moments."""
    stamps = np.array([belief.stamp for belief in result.beliefs])
    poses = np.array([belief.pose for belief in result.beliefs])
    localised = np.array([belief.state == "localised" for belief in result.beliefs])
    error = poses - reference
    error[:, 2] = wrap_angle(error[:, 2])
    away = np.hypot(error[:, 0], error[:, 1])
    right = localised & (away < RIGHT_METRES) & (np.abs(error[:, 2]) < RIGHT_RADIANS)
    right &= not elsewhere
    begin = max(drive.carried_at, drive.log.records[0].stamp)
    later = np.flatnonzero(right & (stamps >= begin))
    at = np.flatnonzero(right)
    at = at[np.linspace(0, len(at) - 1, min(INSTANTS, len(at))).astype(int)] if len(at) else at
    covariances = np.array([result.beliefs[index].covariance for index in at.tolist()]).reshape(
        -1, 3, 3
    )
    plain = np.hypot(*(poses[:, :2] - truth[:, :2]).T)
    return Outcome(
        float(stamps[later[0]] - begin) if len(later) else np.inf,
        away[right],
        np.abs(error[right, 2]),
        plain[right],
        float(localised.mean()),
        float((localised & ~right).mean()),
        normalised_estimation_error_squared(poses[at], reference[at], covariances)
        if len(at)
        else np.zeros(0),
        ms,
    )


def recorded(path: Path) -> Outcome:
    """The second half of a log on the map of its first half; the reference is the path over the whole log."""
    log = open_log(path)
    half = len(log) // 2
    parts = [
        dataclasses.replace(log, records=part, recorded_track=None)
        for part in (log.records[:half], log.records[half:])
    ]
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    mapped, whole = (replay(part, config, np.random.default_rng(0)) for part in (parts[0], log))
    # The whole path has the same first half but for closures that came later: its map frame is the same.
    truth = Trajectory(whole.trajectory.stamps[half:], whole.trajectory.poses[half:])
    return on_map(Drive(parts[1], truth), mapped.grid, None)


def row(name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """All drives of one case."""
    errors = np.array([one.errors.mean() for one in outcomes if len(one.errors)])
    found = len(errors) > 0
    interval = mean_interval(errors) if len(errors) > 1 else None
    seconds = np.array([one.seconds for one in outcomes])
    nees = np.concatenate([one.nees for one in outcomes])
    return {
        "case": name,
        "drives": len(outcomes),
        "right within 60 s [%]": round(100.0 * float((seconds <= SECONDS).mean()), 1),
        "median time [s]": round(float(np.median(seconds)), 1)
        if np.isfinite(np.median(seconds))
        else None,
        "error [m]": round(float(errors.mean()), 3) if found else None,
        "95 % low": round(interval.low, 3) if interval else None,
        "95 % high": round(interval.high, 3) if interval else None,
        "heading [deg]": round(
            float(np.degrees(np.mean([o.headings.mean() for o in outcomes if len(o.headings)]))), 2
        )
        if found
        else None,
        "in the building [m]": round(
            float(np.mean([o.plain.mean() for o in outcomes if len(o.plain)])), 3
        )
        if found
        else None,
        "localised [%]": round(100.0 * float(np.mean([one.localised for one in outcomes])), 1),
        "wrong [% of scans]": round(100.0 * float(np.mean([one.wrong for one in outcomes])), 2),
        "drives with any wrong": sum(one.wrong > 0.0 for one in outcomes),
        "NEES": round(float(nees.mean()), 1) if len(nees) else None,
        "ms per scan": round(float(np.median([one.ms for one in outcomes])), 2),
    }


if __name__ == "__main__":
    main()
