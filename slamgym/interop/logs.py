"""One way to open a recorded run, whatever it is stored as."""

from pathlib import Path

from slamgym.core.errors import InputFileError
from slamgym.core.types import Trajectory
from slamgym.interop.carmen import read_carmen
from slamgym.interop.records import Log
from slamgym.interop.rosbag import read_rosbag
from slamgym.interop.tum import read_tum

EPISODE_LOGS = ("scans.log", "scans.log.gz")
BAG_SUFFIXES = (".bag", ".mcap", ".db3")


def open_log(path: Path | str, *, scan_topic: str | None = None, odometry_topic: str | None = None) -> Log:
    """Read a log.

    Args:
        path: A CARMEN log (``.gz`` or plain), a ROS bag (``.bag``, ``.mcap``, ``.db3`` or a rosbag2 folder),
            or the folder of an episode that ``slamgym generate`` has written.
        scan_topic: Of a bag; see :func:`slamgym.interop.rosbag.read_rosbag`.
        odometry_topic: Of a bag.

    Raises:
        InputFileError: If the log can't be read or holds no usable scan.
        ConfigError: If a bag is given and the ``ros`` extra isn't installed.
    """
    path = Path(path)
    if not path.exists():
        raise InputFileError(path, "doesn't exist")
    if path.is_dir():
        episode = episode_log(path)
        if episode is not None:
            return read_carmen(episode)
        if (path / "manifest.jsonl").exists():
            raise InputFileError(path, "is a dataset; name one of the folders in its 'episodes'")
        return read_rosbag(path, scan_topic=scan_topic, odometry_topic=odometry_topic)
    if path.suffix.lower() in BAG_SUFFIXES:
        return read_rosbag(path, scan_topic=scan_topic, odometry_topic=odometry_topic)
    return read_carmen(path)


def episode_log(folder: Path) -> Path | None:
    """The log in an episode's folder, or None if the folder is something else."""
    for name in EPISODE_LOGS:
        if (folder / name).is_file():
            return folder / name
    return None


def read_truth(path: Path | str) -> Trajectory | None:
    """The true trajectory that lies beside a log (``truth.tum``), as in an episode; None without one.

    Raises:
        InputFileError: If the file exists but is malformed.
    """
    path = Path(path)
    truth = (path if path.is_dir() else path.parent) / "truth.tum"
    return read_tum(truth) if truth.is_file() else None
