"""Robot: a recorded log to a map, and the map to a drawing with dimensions. Needs no extra but for ROS bags (`ros`).

Run: ``python examples/log_to_drawing.py [LOG]`` with a CARMEN log or a ROS bag; without one the simulated robot drives.
"""

import sys
from pathlib import Path

import numpy as np

from slamgym.agents import make_explorer
from slamgym.cad import open_plans
from slamgym.dataset import DatasetConfig, build_dataset, read_manifest
from slamgym.drawing import make_drawing, write_drawing
from slamgym.envs import EpisodeConfig
from slamgym.interop import open_log, write_ros_map, write_tum
from slamgym.slam import SlamConfig
from slamgym.slam.replay import replay


def simulated_log(out: Path) -> Path:
    """Let the simulated robot explore a home; its episode holds a log as a robot would have recorded it."""
    config = DatasetConfig(seed=3, episode=EpisodeConfig(explorer="nearest", minutes=2.0))
    build_dataset(out / "pairs", open_plans("bundled"), config, make_explorer, pairs=1)
    name = next(read_manifest(out / "pairs")).name
    return out / "pairs" / "episodes" / name / "scans.log.gz"


def main(log_path: Path | None) -> None:
    """From the log to DXF, in a folder ``log_to_drawing`` here."""
    out = Path("log_to_drawing")
    log = open_log(log_path or simulated_log(out))
    print(f"{len(log)} scans over {log.duration:.0f} s")
    result = replay(log, SlamConfig(mode="pose_graph"), np.random.default_rng(0))
    (out / "map").mkdir(parents=True, exist_ok=True)
    write_ros_map(out / "map", result.grid)
    write_tum(out / "trajectory.tum", result.trajectory)
    drawing = make_drawing(result.grid, "home", model="none")
    files = write_drawing(drawing, out / "home", ["dxf", "svg", "png"])
    rooms = ", ".join(f"{room.area:.1f} m2" for room in drawing.rooms)
    print(f"{len(drawing.walls)} walls, {len(drawing.doors)} doors, rooms: {rooms}")
    print(*files, sep="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
