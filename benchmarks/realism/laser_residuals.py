"""Failures of real robots' beams: residuals of recorded logs against the maps made of them.

    python benchmarks/realism/laser_residuals.py LOGS --logs aces intel urg4m_lab csail [--simulated 6] [--level real]

A log is mapped (with the pose graph, or with the particle filter where the laser is too short for it); then every
beam of the processed scans is compared with the map. The range expected is that of the first occupied cell along
the beam, at the line through the mean of the end points in the cell. A beam is *short* or *long* if it is off by
more than 0.25 m and by a twentieth of the range, and *none* if it has no return although the map has a wall within
the usable range. Beams within two of a jump of the expected ranges are counted apart ("edge"), for there the smallest
error of the pose looks like a failure. Edges have a separate figure, from the scans alone: of the jumps between
two smooth stretches of neighbouring beams, how many have one beam that ends in between, at least a quarter of the
jump from either side.

What the map can't say: glass that never returns isn't in it (those beams count as open), what moved counts as
short or long, and the spread of the inliers holds the error of the poses as well.
"""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter

from slamgym.agents.registry import make_explorer
from slamgym.cad import PlanGeneratorConfig, generate_plan
from slamgym.core.jit import kernel
from slamgym.core.types import OCCUPIED, FloatArray, IntArray, LaserGeometry, OccupancyGrid
from slamgym.envs import EpisodeConfig, ExploreConfig, run_episode
from slamgym.interop import Log, open_log
from slamgym.sim import ClutterConfig, lidar_level
from slamgym.slam import SlamConfig
from slamgym.slam.replay import replay

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/sim",)
"""What is measured."""

COLUMNS = (
    "log", "beams", "part", "short", "long", "none", "sigma [m]",
)  # fmt: skip
RUN_COLUMNS = (
    "log", "failing", "mean run", "by chance", "alone", "in runs of 3+", "next scan", "next visit", "else",
    "places with 80 %",
)  # fmt: skip
TOLERANCE = 0.25  # [m]
TOLERANCE_RELATIVE = 0.05
SMOOTH = 0.1  # [m] most between neighbours on one surface
JUMPS = ((0.3, 0.6), (0.6, 1.2), (1.2, 5.0))  # [m]
JUMP = 0.3  # [m] between the expected ranges of neighbours
RANGES = ((0.0, 1.0), (1.0, 2.0), (2.0, 3.5), (3.5, 6.0), (6.0, 12.0))  # [m]
INCIDENCES = ((0, 30), (30, 60), (60, 75), (75, 85), (85, 90))  # [deg]
MANY = 500  # beams that a share is taken of
POSE_GRAPH_RANGE = 10.0  # [m] lasers from this on
REVISIT = 20  # processed scans after which a place that is seen again counts as visited again
INLIER, SHORT, LONG, NONE, OPEN = range(5)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", nargs="+", required=True)
    parser.add_argument("--simulated", type=int, default=0, help="furnished homes of our own, too")
    parser.add_argument("--level", default="real", help="error level of the simulated laser")
    arguments = parser.parse_args()
    logs = {name: open_log(arguments.folder / f"{name}.log.gz") for name in arguments.logs}
    for seed in range(arguments.simulated):
        logs[f"simulated {seed}"] = simulated(seed, arguments.level)
    rows, runs, mixed = [], [], []
    pooled: list[dict[str, np.ndarray]] = []
    for name, log in logs.items():
        beams = log_beams(log)
        if name.startswith("simulated"):
            beams["place"] += sum(int(other["place"].max()) + 1 for other in pooled) * (
                beams["place"] >= 0
            )
            pooled.append(beams)
            if len(pooled) < arguments.simulated:
                continue
            name = f"simulated, {arguments.level}"
            beams = {key: np.concatenate([other[key] for other in pooled]) for key in beams}
        rows += share_rows(name, beams)
        runs.append(run_row(name, beams))
        mixed.append(mixed_row(name, beams["measured"]))
    print_and_save(
        "realism/laser_residuals",
        "beams against the final map, in % of the part's",
        rows,
        COLUMNS,
        MODULES,
    )
    print_and_save(
        "realism/laser_residual_runs", "how failures keep together", runs, RUN_COLUMNS, MODULES
    )
    title = "jumps with a beam in between, in % by the jump's height"
    print_and_save("realism/laser_residual_edges", title, mixed, list(mixed[0]), MODULES)


def simulated(seed: int, level: str) -> Log:
    """Five minutes in a separate furnished home."""
    plan = generate_plan(2_000 + seed, PlanGeneratorConfig(kind="home"))
    env = dataclasses.replace(
        ExploreConfig().for_explorer(),
        lidar=lidar_level(level),
        clutter=ClutterConfig(furniture=1.0),
    )
    episode = run_episode(plan, seed, EpisodeConfig("nearest", 5.0, env=env), make_explorer)
    return Log(f"simulated {seed}", list(episode.records), episode.geometry)


def log_beams(log: Log) -> dict[str, np.ndarray]:
    """Every beam of a log's processed scans against the final map; arrays of shape (scans, num_beams)."""
    overrides: dict[str, Any] = {"mode": "pose_graph"}
    if log.geometry.range_max < POSE_GRAPH_RANGE:
        overrides = {"linear_update": 0.1, "angular_update": 0.1, "temporal_update": None}
    config = dataclasses.replace(
        SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams), **overrides
    )
    processed: list[int] = []
    result = replay(
        log,
        config,
        np.random.default_rng(0),
        lambda index, _, is_processed: processed.append(index) if is_processed else None,
    )
    count = len(processed)
    poses = result.processed.poses
    ranges = np.array([log.records[i].scan.ranges for i in processed], dtype=np.float64)
    geometry = log.geometry
    usable = min(config.max_usable_range, 0.95 * geometry.range_max, RANGES[-1][1])
    print(f"{log.source}: {geometry}, {count} scans, usable to {usable:.1f} m", flush=True)
    lines = wall_lines(result.grid, poses, ranges, geometry, usable)
    shape = ranges.shape
    expected, incidence, place = np.empty(shape), np.empty(shape), np.empty(shape, dtype=np.int64)
    origin = (result.grid.frame.origin_x, result.grid.frame.origin_y)
    for k, (x, y, theta) in enumerate(poses):
        mount = geometry.mount
        sensor_x = x + mount.x * np.cos(theta) - mount.y * np.sin(theta)
        sensor_y = y + mount.x * np.sin(theta) + mount.y * np.cos(theta)
        angles = theta + mount.theta + geometry.angles
        expect(
            sensor_x, sensor_y, angles, lines, *origin, usable, expected[k], incidence[k], place[k]
        )
    return classified(ranges, expected, geometry) | {"incidence": incidence, "place": place}


def wall_lines(
    grid: OccupancyGrid,
    poses: FloatArray,
    ranges: FloatArray,
    geometry: LaserGeometry,
    usable: float,
) -> FloatArray:
    """Mean of the end points and direction of the wall in each cell, shape (rows, cols, 4), row 0 at the bottom.

    nan where a cell is not occupied or was hit less than three times.
    """
    frame, mount = grid.frame, geometry.mount
    theta = poses[:, 2:] + mount.theta + geometry.angles
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x = poses[:, :1] + mount.x * cos - mount.y * sin + ranges * np.cos(theta)
    y = poses[:, 1:2] + mount.x * sin + mount.y * cos + ranges * np.sin(theta)
    kept = np.isfinite(ranges) & (ranges >= geometry.range_min) & (ranges < usable)
    shape = (frame.height_px, frame.width_px)
    col = np.floor((x[kept] - frame.origin_x) / frame.resolution).astype(np.int64)
    row = np.floor((y[kept] - frame.origin_y) / frame.resolution).astype(np.int64)
    inside = (col >= 0) & (row >= 0) & (col < shape[1]) & (row < shape[0])
    flat = row[inside] * shape[1] + col[inside]
    count = np.bincount(flat, minlength=shape[0] * shape[1]).astype(np.float64)
    mean_x = np.bincount(flat, x[kept][inside], len(count)) / np.maximum(count, 1)
    mean_y = np.bincount(flat, y[kept][inside], len(count)) / np.maximum(count, 1)
    wall = ((grid.cells[::-1] == OCCUPIED).ravel() & (count >= 3)).reshape(shape)
    mean_x, mean_y = mean_x.reshape(shape), mean_y.reshape(shape)
    weight = np.where(wall, count.reshape(shape), 0.0)

    def around(values: FloatArray) -> FloatArray:
        return np.asarray(uniform_filter(np.where(wall, values, 0.0) * weight, 5) / total)

    # Relative to the cell's own place, or the second moments of metres far from the origin lose their digits.
    total = np.maximum(uniform_filter(weight, 5), 1e-9)
    local_x, local_y = mean_x - mean_x[wall].mean(), mean_y - mean_y[wall].mean()
    mx, my = around(local_x), around(local_y)
    xx = around(local_x**2) - mx**2
    xy = around(local_x * local_y) - mx * my
    yy = around(local_y**2) - my**2
    direction = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    lines = np.stack([mean_x, mean_y, np.cos(direction), np.sin(direction)], axis=-1)
    lines[~wall] = np.nan
    return lines


@kernel
def expect(
    x: float,
    y: float,
    angles: FloatArray,
    lines: FloatArray,
    origin_x: float,
    origin_y: float,
    usable: float,
    expected: FloatArray,
    incidence: FloatArray,
    place: IntArray,
) -> None:
    """Write the range to the first occupied cell, the incidence there [deg], and the cell; inf, nan, -1 if none."""
    for i in range(len(angles)):
        ux, uy = np.cos(angles[i]), np.sin(angles[i])
        expected[i], incidence[i], place[i] = np.inf, np.nan, -1
        r = 0.1
        while r < usable:
            col = int(np.floor((x + r * ux - origin_x) / 0.05))
            row = int(np.floor((y + r * uy - origin_y) / 0.05))
            if (
                0 <= row < lines.shape[0]
                and 0 <= col < lines.shape[1]
                and not np.isnan(lines[row, col, 0])
            ):
                mx, my, dx, dy = lines[row, col]
                across = abs(ux * dy - uy * dx)
                along_line = (
                    ((mx - x) * dy - (my - y) * dx) / (ux * dy - uy * dx) if across > 0.1 else r
                )
                # The line holds near its cell only.
                expected[i] = along_line if abs(along_line - r) < 0.1 else r + 0.025
                incidence[i] = np.degrees(np.arccos(min(1.0, across)))
                place[i] = row * lines.shape[1] + col
                break
            r += 0.02


def classified(
    ranges: FloatArray, expected: FloatArray, geometry: LaserGeometry
) -> dict[str, np.ndarray]:
    """Class of each beam; whether it is at an edge of what it should see; whether it ends in between."""
    with np.errstate(invalid="ignore"):
        residual = ranges - expected
    limit = np.maximum(TOLERANCE, TOLERANCE_RELATIVE * expected)
    fate = np.full(ranges.shape, INLIER)
    with np.errstate(invalid="ignore"):
        fate[residual < -limit] = SHORT
        fate[residual > limit] = LONG
        # slam_gmapping's drivers give 0 or the largest range for no return.
        fate[
            ~np.isfinite(ranges)
            | (ranges >= 0.99 * geometry.range_max)
            | (ranges < geometry.range_min)
        ] = NONE
    fate[np.isinf(expected)] = OPEN
    nearest, furthest = expected.copy(), expected.copy()
    for shift in (-2, -1, 1, 2):
        moved = np.roll(expected, shift, axis=1)
        nearest, furthest = np.minimum(nearest, moved), np.maximum(furthest, moved)
    with np.errstate(invalid="ignore"):
        edge = furthest - nearest > JUMP
    return {"range": expected, "residual": residual, "fate": fate, "edge": edge, "measured": ranges}


def share_rows(name: str, beams: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """Shares of the failures over all, at edges, by range and by incidence."""
    known = beams["fate"] != OPEN
    smooth = known & ~beams["edge"]
    head_on = smooth & (beams["incidence"] < 60)
    parts = {"all": known, "edge": known & beams["edge"], "away from edges": smooth}
    parts |= {
        f"{a:g}-{b:g} m": head_on & (beams["range"] >= a) & (beams["range"] < b) for a, b in RANGES
    }
    parts |= {
        f"{a}-{b} deg": smooth & (beams["incidence"] >= a) & (beams["incidence"] < b)
        for a, b in INCIDENCES
    }
    rows = []
    for part, mask in parts.items():
        fate = beams["fate"][mask]
        if len(fate) < MANY:
            continue
        residuals = beams["residual"][mask & (beams["fate"] == INLIER)]
        spread = np.percentile(residuals, (15.87, 84.13))
        rows.append(
            {
                "log": name,
                "beams": int(mask.sum()),
                "part": part,
                "short": percent(fate == SHORT),
                "long": percent(fate == LONG),
                "none": percent(fate == NONE),
                "sigma [m]": round(float(spread[1] - spread[0]) / 2.0, 4),
            }
        )
    return rows


def run_row(name: str, beams: dict[str, np.ndarray]) -> dict[str, Any]:
    """Length of failures, over neighbouring beams, from scan to scan and from visit to visit."""
    known = (beams["fate"] != OPEN) & ~beams["edge"]
    failing = known & (beams["fate"] != INLIER)
    padded = np.pad(failing, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    begin, end = np.nonzero(steps == 1)[1], np.nonzero(steps == -1)[1]
    lengths = end - begin
    share = failing.sum() / known.sum()
    again = np.zeros((3, 2))
    places = np.zeros((int(beams["place"].max()) + 1, 2))
    follow(beams["place"], known, failing, again, places)
    seen_often = places[:, 0] >= REVISIT
    rate = places[seen_often, 1] / places[seen_often, 0]
    # The smallest share of the places that holds 80 % of the failures.
    held = np.cumsum(np.sort(places[seen_often, 1])[::-1])
    few = np.searchsorted(held, 0.8 * held[-1]) / len(rate)
    chance = again[:, 1] / np.maximum(again[:, 0], 1)
    return {
        "log": name,
        "failing": percent(failing[known]),
        "mean run": round(float(lengths.mean()), 2),
        "by chance": round(1.0 / (1.0 - share), 2),
        "alone": percent(np.repeat(lengths == 1, lengths)),
        "in runs of 3+": percent(np.repeat(lengths >= 3, lengths)),
        "next scan": round(100 * chance[0], 1),
        # A log of a minute or two sees too little again.
        "next visit": round(100 * chance[1], 1) if again[1:, 0].min() > MANY else None,
        "else": round(100 * chance[2], 1) if again[1:, 0].min() > MANY else None,
        "places with 80 %": round(100.0 * float(few), 1),
    }


def mixed_row(name: str, ranges: FloatArray) -> dict[str, Any]:
    """Share of the jumps between smooth stretches with a beam in between, in % by the jump's height."""
    row: dict[str, Any] = {"log": name}
    with np.errstate(invalid="ignore", divide="ignore"):
        step = np.diff(ranges, axis=1)
        smooth = np.abs(step) < SMOOTH
        across = ranges[:, 3:-1] - ranges[:, 1:-3]  # from beam i-1 to beam i+1
        share = (ranges[:, 2:-2] - ranges[:, 1:-3]) / across
        direct = np.abs(step[:, 1:-1])
        for low, high in JUMPS:
            on_one = smooth[:, :-3] & smooth[:, 3:]
            height = np.abs(across)
            mixed = on_one & (height >= low) & (height < high) & (share > 0.25) & (share < 0.75)
            clean = smooth[:, :-2] & smooth[:, 2:] & (direct >= low) & (direct < high)
            row[f"{low:g}-{high:g} m"] = round(
                100.0 * float(mixed.sum() / (mixed.sum() + clean.sum())), 1
            )
    return row


@kernel
def follow(
    place: IntArray, known: np.ndarray, failing: np.ndarray, again: FloatArray, places: FloatArray
) -> None:
    """Count beams, and failures among them, that see a place which failed a scan ago, a visit ago, or not then."""
    num_places = len(places)
    last_scan = np.full(num_places, -1)
    failed_last = np.zeros(num_places)
    visit = np.zeros((num_places, 2))
    failed_before = np.full(num_places, -1)
    for k in range(place.shape[0]):
        for i in range(place.shape[1]):
            p = place[k, i]
            if p < 0 or not known[k, i]:
                continue
            places[p, 0] += 1
            places[p, 1] += failing[k, i]
            if last_scan[p] >= 0 and k - last_scan[p] > REVISIT:
                failed_before[p] = 1 if 2 * visit[p, 1] > visit[p, 0] else 0
                visit[p] = 0.0
            elif last_scan[p] >= 0 and k > last_scan[p] and failed_last[p] > 0:
                again[0, 0] += 1
                again[0, 1] += failing[k, i]
            if failed_before[p] >= 0:
                group = 1 if failed_before[p] == 1 else 2
                again[group, 0] += 1
                again[group, 1] += failing[k, i]
            visit[p, 0] += 1
            visit[p, 1] += failing[k, i]
            failed_last[p] = failing[k, i]
            last_scan[p] = k


def percent(mask: np.ndarray) -> float:
    """Share of True in %, rounded."""
    return round(100.0 * float(np.mean(mask)), 2)


if __name__ == "__main__":
    main()
