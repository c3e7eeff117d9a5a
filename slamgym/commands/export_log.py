"""``slamgym export-log``: a log in the form that other SLAM programs replay."""

from typing import Literal

from slamgym.commands.frame import Extra, Out, require
from slamgym.commands.log_input import LogAndOut, LogReading, read_log
from slamgym.core.errors import InputFileError
from slamgym.core.progress import counted, tell
from slamgym.core.types import Trajectory
from slamgym.interop.rosbag_writer import Storage

FIRST_STAMP = 1.7e9
"""14 November 2023, 22:13:20 UTC: the same every time, so that the same episode gives the same bag [s since 1970]."""
SIMULATED_CLOCK = 1e8
"""Logs that begin before have no date [s]."""


class ExportArguments(LogReading, LogAndOut):
    """Write an episode (or any other log) as a CARMEN log or as a rosbag2."""

    out: Out
    """The file (CARMEN; compressed if it ends in .gz) or folder (rosbag2) to write."""

    format: Literal["carmen", "rosbag2"] = "carmen"
    """The form. A rosbag2 holds /scan, /odom with speeds, /tf, /tf_static, /clock and, of an episode, /map and
    /ground_truth."""

    storage: Storage = "sqlite3"
    """rosbag2: how messages are stored."""

    localised: bool = False
    """rosbag2: also publish map -> odom as the episode's own SLAM estimated it, to look at the run without a SLAM
    program, which would publish that transform itself."""


def main(arguments: ExportArguments) -> None:
    """Run the command."""
    from slamgym.interop.carmen_writer import write_carmen
    from slamgym.interop.ros_map import read_ros_map
    from slamgym.interop.rosbag_writer import BagTracks, write_rosbag2

    if arguments.format == "rosbag2":
        require(Extra("ros", ("rosbags",)), "--format rosbag2")
    log = read_log(arguments.log, arguments)
    if arguments.format == "carmen":
        if arguments.out.exists():
            raise InputFileError(arguments.out, "exists already; name another file")
        write_carmen(arguments.out, log.records, log.geometry)
    else:
        own_map = arguments.log / "map.yaml"
        undated = bool(log.records) and log.records[0].stamp < SIMULATED_CLOCK
        write_rosbag2(
            arguments.out,
            log.records,
            log.geometry,
            grid=read_ros_map(own_map) if own_map.is_file() else None,
            tracks=BagTracks(
                _track(arguments, "truth"), _track(arguments, "estimate", arguments.localised)
            ),
            first_stamp=FIRST_STAMP if undated else None,
            storage=arguments.storage,
        )
    tell(f"{arguments.out}: {counted(len(log), 'scan')} over {log.duration:.1f} s")


def _track(arguments: ExportArguments, name: str, wanted: bool = True) -> Trajectory | None:
    """A trajectory of the episode, if it is one and the track is wanted."""
    from slamgym.interop.tum import read_tum

    path = arguments.log / f"{name}.tum"
    if wanted and path.is_file():
        return read_tum(path)
    if wanted and arguments.localised:
        raise InputFileError(
            path, "is missing; --localised needs an episode that `slamgym generate` wrote"
        )
    return None
