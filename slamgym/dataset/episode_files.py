"""The files of one exploration, for people and programs that go on from them."""

import hashlib
from pathlib import Path

from slamgym.cad import write_houseexpo
from slamgym.core.staged import write_bytes
from slamgym.envs.episode import Episode
from slamgym.interop import write_carmen, write_ros_map, write_tum

SUMS = "SHA256SUMS"
"""File of the digests of an episode's other files."""


def write_episode(folder: Path, episode: Episode) -> bytes:
    """Write plan, map, trajectories and log of an exploration into an empty folder.

    Returns:
        The content of its ``SHA256SUMS``.

    Raises:
        InputFileError: If a file can't be written.
    """
    write_houseexpo(folder / "plan.json", episode.plan)
    write_ros_map(folder, episode.slam_map)
    write_tum(folder / "truth.tum", episode.truth)
    write_tum(folder / "odometry.tum", episode.odometry)
    write_tum(folder / "estimate.tum", episode.estimate)
    # Text of 300 scans a minute: compressed it takes a sixth of the space.
    write_carmen(folder / "scans.log.gz", episode.records, episode.geometry)
    sums = digest_lines(folder)
    write_bytes(folder / SUMS, sums)
    return sums


def digest_lines(folder: Path) -> bytes:
    """The SHA-256 of every file in a folder, sorted by name, in the form of ``sha256sum``."""
    paths = sorted(path for path in folder.iterdir() if path.is_file())
    return "".join(
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in paths
    ).encode()
