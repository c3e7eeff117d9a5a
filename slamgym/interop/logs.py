"""Open a recorded run by its kind of file, and the truth or the relations it is compared with."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, Trajectory
from slamgym.interop.bag_topics import BAG_SUFFIXES, NO_ODOMETRY, BagChoices
from slamgym.interop.carmen import read_carmen
from slamgym.interop.map_files import MAP_SUFFIXES
from slamgym.interop.odometry import retimed, without_odometry
from slamgym.interop.records import Log
from slamgym.interop.rosbag import read_rosbag
from slamgym.interop.scan_times import BEAM_TIMES, with_scan_time
from slamgym.interop.tum import read_tum, rows_of_eight

EPISODE_LOGS = ("scans.log", "scans.log.gz")


def open_log(path: Path | str, choices: BagChoices = BagChoices()) -> Log:  # noqa: B008 - it can't change
    """Read a log.

    Args:
        path: A CARMEN log (``.gz`` or plain), a ROS bag (``.bag``, ``.mcap``, ``.db3`` or a rosbag2 folder),
            or the folder of an episode that ``slamgym generate`` has written.
        choices: What to read of a bag; see :func:`slamgym.interop.rosbag.read_rosbag`. Of other logs the largest range,
            times and no odometry can be chosen.

    Raises:
        InputFileError: If the log can't be read or holds no usable scan.
        ConfigError: If a bag is given and the ``ros`` extra isn't installed.
    """
    path = Path(path)
    if not path.exists():
        raise InputFileError(path, "doesn't exist")
    if path.suffix.lower() in MAP_SUFFIXES and path.is_file():
        raise InputFileError(
            path, "has a map's name; a log of scans is wanted (slamgym cad draws maps)"
        )
    text = episode_log(path) if path.is_dir() else path
    if text is not None and text.suffix.lower() not in BAG_SUFFIXES:
        read = read_carmen(text, choices.range_max, choices.scan_rate)
        log = retimed(read, choices.time_offset)
        if choices.odometry_topic == NO_ODOMETRY:
            log = without_odometry(log)
        return _with_chosen_time(log, choices.scan_time)
    if (path / "manifest.jsonl").exists():
        raise InputFileError(path, "is a dataset; name one of the folders in its 'episodes'")
    return _with_chosen_time(read_rosbag(path, choices), choices.scan_time)


def _with_chosen_time(log: Log, scan_time: float | None) -> Log:
    """The log with the time of a scan that the user gives [s]; None: its own."""
    if scan_time is None:
        return log
    others = tuple(finding for finding in log.findings if finding.kind != BEAM_TIMES)
    return with_scan_time(replace(log, findings=others), scan_time)


def episode_log(folder: Path) -> Path | None:
    """The log in an episode's folder, or None if the folder is something else."""
    for name in EPISODE_LOGS:
        path = folder / name
        if path.is_file():
            return path
    return None


def read_truth(path: Path | str) -> Trajectory | None:
    """The true trajectory in the folder of a log (``truth.tum``), as in an episode; None without one.

    Raises:
        InputFileError: If the file exists but is malformed.
    """
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    truth = folder / "truth.tum"
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
    rows = [row for _, row in rows_of_eight(path, "t1 t2 x y z roll pitch yaw")]
    if not rows:
        raise InputFileError(path, "holds no relation")
    table = np.array(rows, dtype=np.float64)
    yaw = wrap_angle(table[:, 7])
    return Relations(table[:, 0], table[:, 1], np.column_stack([table[:, 2:4], yaw]))
