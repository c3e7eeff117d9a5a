"""The files of one exploration, for people and programs that go on from them."""

from pathlib import Path

from slamgym.cad import write_houseexpo
from slamgym.dataset.episode import Episode
from slamgym.interop import write_carmen, write_ros_map, write_tum


def write_episode(folder: Path, episode: Episode) -> None:
    """Write plan, map, trajectories and log of an exploration into an empty folder.

    Raises:
        InputFileError: If a file can't be written.
    """
    write_houseexpo(folder / "plan.json", episode.plan)
    write_ros_map(folder, episode.slam_map)
    write_tum(folder / "truth.tum", episode.truth)
    write_tum(folder / "odometry.tum", episode.odometry)
    write_tum(folder / "estimate.tum", episode.estimate)
    write_carmen(folder / "scans.log", episode.records, episode.geometry)
