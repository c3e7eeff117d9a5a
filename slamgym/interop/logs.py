"""How to open a recorded run, whatever it is stored as, and the truth or the relations it is compared with."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import read_text
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Trajectory
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


class Relations(NamedTuple):
    """Known relative poses between moments of a log: the reference of the SLAM benchmark."""

    start_stamps: FloatArray  # (N,) [s]
    end_stamps: FloatArray  # (N,) [s]
    relative: FloatArray  # (N, 3), pose at the end seen from the pose at the start


def read_relations(path: Path | str) -> Relations:
    """Read a relations file: one ``t1 t2 x y z roll pitch yaw`` per line.

    Raises:
        InputFileError: If the file is missing or empty, or a line has no eight finite numbers.
    """
    lines = read_text(path).splitlines()
    rows: list[tuple[float, float, float, float, float]] = []
    for number, line in enumerate(lines, start=1):
        fields = line.split("#", 1)[0].split()
        if not fields:
            continue
        try:
            start, end, x, y, z, roll, pitch, yaw = (float(field) for field in fields)
        except ValueError as error:
            raise InputFileError(
                f"{path}:{number}",
                "is not a line of 't1 t2 x y z roll pitch yaw'; eight numbers are expected",
            ) from error
        if not all(math.isfinite(value) for value in (start, end, x, y, z, roll, pitch, yaw)):
            raise InputFileError(f"{path}:{number}", "holds a value that is not finite")
        rows.append((start, end, x, y, wrap_angle(yaw)))
    if not rows:
        raise InputFileError(path, "holds no relation")
    table = np.array(rows, dtype=np.float64)
    return Relations(table[:, 0], table[:, 1], table[:, 2:])
