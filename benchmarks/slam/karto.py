"""Karto's mapper, as a rival: the pip package ``yag-slam`` holds the scan matcher of SRI's OpenKarto behind Python.

``pip install yag-slam`` brings it. Its settings are those of the package, but for those below, which are OpenKarto's
own (``Mapper.cpp``): with the 0.5 m and 0.5 rad of the package's ROS node it is twice as far off on the Intel log. It
takes all beams of a scan for simultaneous.
"""

import contextlib
import importlib
import io
import math
import time
from typing import Any, NamedTuple

import numpy as np

from slamgym.core.geometry import between, compose, inverse
from slamgym.core.types import FloatArray, LaserScan, Pose2D, Trajectory
from slamgym.interop import Log
from slamgym.slam.motion_model import poses_between

TRAVEL_DISTANCE = 0.2
"""A scan is processed after this distance [m] (``MinimumTravelDistance``) ..."""
TRAVEL_HEADING = math.radians(10.0)
"""... or this turn [rad] (``MinimumTravelHeading``)."""
RANGE_THRESHOLD = 12.0
"""Longer returns are not used [m] (``RangeThreshold``)."""


class KartoPath(NamedTuple):
    """Path of a log by Karto."""

    scans: Trajectory  # a pose for every scan
    moments: Trajectory  # a pose for every moment of which the log holds the odometry
    milliseconds: float  # CPU time per processed scan


class Yag(NamedTuple):
    """Modules of the package."""

    graph_slam: Any
    models: Any
    scan_matching: Any


def load_yag() -> Yag:
    """The package's modules.

    Raises:
        SystemExit: If it isn't installed.
    """
    names = [f"yag_slam.{name}" for name in Yag._fields]
    try:
        return Yag(*[importlib.import_module(name) for name in names])
    except ImportError as error:
        raise SystemExit(
            f"the mode karto needs the package yag-slam ({error}): pip install yag-slam"
        ) from None


def karto_path(log: Log) -> KartoPath:
    """Map a log with Karto.

    Its scans have no mount, so it is fed the poses of the laser, and its poses are turned back into the robot's.

    Raises:
        SystemExit: If ``yag-slam`` isn't installed.
    """
    yag = load_yag()
    farthest = min(log.geometry.range_max, RANGE_THRESHOLD)
    matching = {"range_threshold": farthest}
    matcher = yag.scan_matching.Scan2DMatcherCpp(matching)
    loop_matcher = yag.scan_matching.Scan2DMatcherCpp(matching, loop=True)
    slam = yag.graph_slam.GraphSlam(matcher, loop_matcher)
    processed = _due_scans(log)
    scans = []
    begin = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):  # it prints warnings there
        for index in processed:
            record = log.records[index]
            scans.append(_karto_scan(yag, record.scan, record.odometry, farthest))
            slam.process_scan(scans[-1])
    seconds = time.process_time() - begin
    corrected = [scan.corrected_pose for scan in scans]
    lasers = [Pose2D(pose.x, pose.y, pose.euler[-1]) for pose in corrected]
    back = inverse(log.geometry.mount)
    poses = np.array([compose(laser, back) for laser in lasers])
    return _filled(log, processed, poses, 1e3 * seconds / len(processed))


def _due_scans(log: Log) -> list[int]:
    """Scans that are far enough from the one processed before."""
    due = [0]
    for index, record in enumerate(log):
        x, y, turn = between(log.records[due[-1]].odometry, record.odometry)
        if math.hypot(x, y) >= TRAVEL_DISTANCE or abs(turn) >= TRAVEL_HEADING:
            due.append(index)
    return due


def _karto_scan(yag: Yag, scan: LaserScan, odometry: Pose2D, farthest: float) -> Any:
    """A scan as the package has them; what is no return lies beyond the range."""
    geometry = scan.geometry
    beyond = geometry.range_max + 1.0
    ranges = np.nan_to_num(scan.ranges, nan=beyond, posinf=beyond, neginf=beyond)
    last = geometry.angle_min + (geometry.num_beams - 1) * geometry.angle_increment
    return yag.models.LocalizedRangeScan(
        ranges.astype(np.float64),
        geometry.angle_min,
        last,
        geometry.angle_increment,
        geometry.range_min,
        geometry.range_max,
        farthest,
        *compose(odometry, geometry.mount),
    )


def _filled(log: Log, processed: list[int], poses: FloatArray, milliseconds: float) -> KartoPath:
    """The path at every scan and moment, with the odometry between processed scans."""
    track = log.track
    every = poses_between(poses, track.scans[processed], track.poses)
    in_time = np.argsort(track.stamps, kind="stable")
    return KartoPath(
        Trajectory(track.stamps[track.scans], every[track.scans]),
        Trajectory(track.stamps[in_time], every[in_time]),
        milliseconds,
    )
