"""Do the parametric model's maps look like SLAM maps?

Explores HouseExpo-format plans with the simulated robot and its SLAM, makes the parametric model's map of the
same plan and the same true path, and asks a classifier to distinguish the two kinds. Plans are split into two
halves by their ids: presets are tuned on the one and reported on the other.

Run: ``python benchmarks/parametric_realism.py --plans PATH --real PATH --episodes FOLDER``. Explorations are
kept in the episodes folder, so that a second run takes minutes.
"""

import argparse
import dataclasses
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import cv2
import numpy as np
from report import print_and_save

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, check_plan, open_plans
from slamgym.core.errors import SlamgymError
from slamgym.core.types import FREE, UNKNOWN, ByteArray, FloatArray, GridFrame, Trajectory
from slamgym.envs.episode import EpisodeConfig, run_episode
from slamgym.interop import read_ros_map
from slamgym.metrics.map_statistics import displacement_statistics, map_statistics
from slamgym.metrics.two_sample import CLASSIFIERS, two_sample_test
from slamgym.parametric import ParametricConfig, deform, from_recorded, preset

RESOLUTION = 0.05
SHOWN = (
    "share_unknown",
    "share_occupied",
    "share_free",
    "wall_thickness_px",
    "holes_per_100m2",
    "blobs_per_100m2",
    "open_border",
    "displacement_p50_m",
    "displacement_p95_m",
    "missed_share",
    "displacement_correlation_0.25m",
    "displacement_correlation_1m",
    "displacement_correlation_2.5m",
)


@dataclasses.dataclass(frozen=True)
class Exploration:
    """A simulated exploration on the grid that its map and the parametric maps share."""

    plan: FloorPlan
    path: Trajectory  # true, world frame
    frame: GridFrame  # world frame, on the SLAM map's lattice
    slam: ByteArray


def explore(plan: FloorPlan, folder: Path) -> Exploration:
    """Explore a plan, or read the exploration that an earlier run kept."""
    kept = folder / f"{plan.id}.npz"
    if not kept.exists():
        episode = run_episode(plan, 7, EpisodeConfig(), make_explorer)
        frame = episode.slam_map.frame
        np.savez_compressed(
            kept,
            start=np.array(episode.start),
            ts=episode.truth.stamps,
            tp=episode.truth.poses,
            cells=episode.slam_map.cells,
            frame=np.array([frame.resolution, frame.origin_x, frame.origin_y]),
        )
    with np.load(kept) as data:
        start, cells, (r, x, y) = data["start"], data["cells"], data["frame"]
        path = data["tp"] + np.array([start[0], start[1], 0.0])
        frame = lattice_frame(plan, start)
        slam = np.full(frame.shape, UNKNOWN, dtype=np.uint8)
        paste(slam, cells, frame, x + start[0], y + start[1], r)
        return Exploration(plan, Trajectory(data["ts"], path), frame, slam)


def lattice_frame(plan: FloorPlan, start: FloatArray, margin: float = 1.0) -> GridFrame:
    """The plan with a margin on cells whose borders lie at multiples of the resolution from the start."""
    low, high = np.array(plan.bounds[:2]) - start[:2], np.array(plan.bounds[2:]) - start[:2]
    first = np.floor((low - margin) / RESOLUTION)
    count = (np.ceil((high + margin) / RESOLUTION) - first).astype(int)
    origin = first * RESOLUTION + start[:2]
    return GridFrame(RESOLUTION, float(origin[0]), float(origin[1]), int(count[1]), int(count[0]))


def paste(canvas: ByteArray, cells: ByteArray, frame: GridFrame, x: float, y: float, r: float) -> None:
    """Copy a map on to a canvas of the same lattice, as far as it extends."""
    col = round((x - frame.origin_x) / r)
    row = frame.height_px - round((y - frame.origin_y) / r) - cells.shape[0]
    top, left = max(row, 0), max(col, 0)
    bottom, right = min(row + cells.shape[0], frame.height_px), min(col + cells.shape[1], frame.width_px)
    canvas[top:bottom, left:right] = cells[top - row : bottom - row, left - col : right - col]


def elastic(plan: FloorPlan, frame: GridFrame, rng: np.random.Generator) -> ByteArray:
    """The baseline: the CAD map, unknown outside, bent by a smooth random field (Simard et al. 2003)."""
    cells = plan.raster(RESOLUTION, frame, outside=UNKNOWN, wall_thickness=0.1).cells
    noise = rng.standard_normal((2, *frame.shape)).astype(np.float32)
    field = np.stack([cv2.GaussianBlur(n, (0, 0), 20.0) for n in noise])
    field *= np.float32(3.0) / field.std()  # [px], as large as the displacements of the simulated maps
    rows, cols = np.indices(frame.shape, dtype=np.float32)
    bent: ByteArray = cv2.remap(
        cells, cols + field[0], rows + field[1], cv2.INTER_NEAREST, borderValue=float(UNKNOWN)
    )
    return bent


def statistics(cells: ByteArray, exploration: Exploration) -> dict[str, float]:
    cad = exploration.plan.raster(RESOLUTION, exploration.frame).cells != FREE
    displaced = displacement_statistics(cells, cad, RESOLUTION, np.random.default_rng(0))
    return map_statistics(cells, RESOLUTION) | displaced


def model_map(exploration: Exploration, config: ParametricConfig, seed: list[int]) -> ByteArray:
    rng = np.random.default_rng(seed)
    return deform(
        exploration.plan, from_recorded(exploration.path), config, rng, exploration.frame
    ).grid.cells


def useful_plans(spec: str, count: int) -> list[FloorPlan]:
    """The first ``count`` plans, in a shuffled order, that are homes of 3 to 15 rooms and 30 to 140 m2."""
    source = open_plans(spec)
    ids = list(source.ids)
    np.random.default_rng(12345).shuffle(ids)
    plans: list[FloorPlan] = []
    for plan_id in ids:
        if len(plans) == count:
            break
        try:
            plan = source.load(plan_id)
            if not (30 <= plan.area <= 140 and 3 <= len(plan.rooms) <= 15 and plan.num_vertices < 600):
                continue
            check_plan(plan)
        except SlamgymError:
            continue
        plans.append(plan)
    return plans


def kinds() -> dict[str, ParametricConfig]:
    realistic = preset("realistic")
    return {
        "realistic": realistic,
        "realistic, warped instead of drawn": dataclasses.replace(
            realistic, render=dataclasses.replace(realistic.render, renderer="warp")
        ),
        "faithful": preset("faithful"),
        "faithful, ekf_schur": dataclasses.replace(preset("faithful"), method="ekf_schur"),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", default="procedural", help="floor plans")
    parser.add_argument("--count", type=int, default=100, help="number of plans, both halves together")
    parser.add_argument("--half", choices=("tune", "report"), default="report")
    parser.add_argument("--episodes", type=Path, default=Path("out/realism_episodes"))
    parser.add_argument("--real", type=Path, help="folder of ROS maps of real robots")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    arguments.episodes.mkdir(parents=True, exist_ok=True)
    wanted = 1 if arguments.half == "report" else 0
    # The half follows from the id's first hexadecimal digit; other ids alternate.
    chosen = [
        plan
        for i, plan in enumerate(useful_plans(arguments.plans, arguments.count))
        if (int(plan.id[0], 16) if plan.id[0] in "0123456789abcdef" else i) % 2 == wanted
    ]
    explorations = [explore(plan, arguments.episodes) for plan in chosen]
    plan_ids = [exploration.plan.id for exploration in explorations]
    sets = {"simulated SLAM": [statistics(e.slam, e) for e in explorations]}
    for name, config in kinds().items():
        sets[name] = [statistics(model_map(e, config, [0, i]), e) for i, e in enumerate(explorations)]
    sets["elastic deformation"] = [
        statistics(elastic(e.plan, e.frame, np.random.default_rng(i)), e) for i, e in enumerate(explorations)
    ]
    report_two_sample(sets, plan_ids, arguments.half)
    report_statistics(sets, arguments.real, arguments.half)


def report_two_sample(sets: dict[str, list[dict[str, float]]], plan_ids: list[str], half: str) -> None:
    simulated = sets["simulated SLAM"]
    rows = []
    for name, values in sets.items():
        if name == "simulated SLAM":
            continue
        for learner in CLASSIFIERS:
            result = two_sample_test(simulated, values, plan_ids, plan_ids, learner)
            telling = ", ".join(f"{statistic} {distance:.2f}" for statistic, distance in result.telling[:3])
            interval = f"[{result.low:.2f}, {result.high:.2f}]"
            rows.append((name, learner, round(result.accuracy, 3), interval, telling))
    columns = ("maps", "classifier", "accuracy", "95 % interval", "most telling statistics (KS distance)")
    title = f"Distinguishing parametric from simulated SLAM maps, {len(plan_ids)} plans, half: {half}; 0.5 is perfect"
    print_and_save(
        "parametric/parametric_realism" + ("" if half == "report" else "_tune"), title, rows, columns
    )


def report_statistics(sets: dict[str, list[dict[str, float]]], real: Path | None, half: str) -> None:
    shown = dict(sets)
    if real is not None:
        shown["real robots"] = real_statistics(real)
    rows = []
    for statistic in SHOWN:
        medians = [
            round(float(np.median([row[statistic] for row in values])), 3) if statistic in values[0] else None
            for values in shown.values()
        ]
        rows.append((statistic, *medians))
    title = f"Medians of map statistics, half: {half}"
    name = "parametric/parametric_statistics" + ("" if half == "report" else "_tune")
    print_and_save(name, title, rows, ("statistic", *shown))


def real_statistics(folder: Path) -> list[dict[str, float]]:
    """Statistics of the ROS maps in a folder, brought to 5 cm cells; maps that can't be read are left out."""
    found = []
    for path in sorted(folder.rglob("*.yaml")):
        try:
            grid = read_ros_map(path)
        except SlamgymError:
            continue
        if not 0.01 <= grid.frame.resolution <= 0.11:
            continue
        scale = grid.frame.resolution / RESOLUTION
        size = tuple(max(8, round(n * scale)) for n in grid.cells.shape[::-1])
        found.append(
            map_statistics(cv2.resize(grid.cells, size, interpolation=cv2.INTER_NEAREST), RESOLUTION)
        )
    return found


if __name__ == "__main__":
    main()
