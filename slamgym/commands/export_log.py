"""``slamgym export-log``: a log in the form that other SLAM programs replay."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from slamgym.commands.extras import Extra, require
from slamgym.core.config import Arguments
from slamgym.core.errors import InputFileError
from slamgym.core.types import OccupancyGrid
from slamgym.interop.rosbag_writer import Storage


class ExportArguments(Arguments):
    """Write an episode (or any other log) as a CARMEN log or as a rosbag2."""

    log: tyro.conf.Positional[Path]
    """Folder of an episode that `slamgym generate` wrote, a CARMEN log or a ROS bag."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """The file (CARMEN; compressed if it ends in .gz) or folder (rosbag2) to write."""

    format: Literal["carmen", "rosbag2"] = "carmen"
    """What to write. A rosbag2 holds /scan, /odom, /tf, /tf_static and, if the episode has a map, /map."""

    message: Literal["FLASER", "ROBOTLASER1"] | None = None
    """CARMEN: the message type. By default FLASER for a scanner of 180 degrees, else ROBOTLASER1."""

    storage: Storage = "sqlite3"
    """rosbag2: how messages are stored."""

    map: Path | None = None
    """rosbag2: the yaml file of the map to publish. By default the episode's own."""

    overwrite: bool = False
    """CARMEN: replace an existing file."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(ExportArguments, args=argv, prog="slamgym export-log")
    from slamgym.interop.carmen import write_carmen
    from slamgym.interop.logs import open_log
    from slamgym.interop.rosbag_writer import write_rosbag2

    if arguments.format == "rosbag2":
        require(Extra("ros", ("rosbags",)), "--format rosbag2")
    log = open_log(arguments.log)
    for sentence in log.warnings.sentences():
        sys.stderr.write(f"slamgym: warning: {sentence}\n")
    if arguments.format == "carmen":
        if arguments.out.exists() and not arguments.overwrite:
            raise InputFileError(arguments.out, "exists already; give --overwrite to replace it")
        write_carmen(arguments.out, log.records, log.geometry, message=arguments.message)
    else:
        write_rosbag2(
            arguments.out, log.records, log.geometry, grid=_map(arguments), storage=arguments.storage
        )
    sys.stdout.write(f"{arguments.out}: {len(log)} scans over {log.duration:.1f} s\n")
    return 0


def _map(arguments: ExportArguments) -> OccupancyGrid | None:
    from slamgym.interop.ros_map import read_ros_map

    if arguments.map is not None:
        return read_ros_map(arguments.map)
    beside = arguments.log / "map.yaml"
    return read_ros_map(beside) if beside.is_file() else None
