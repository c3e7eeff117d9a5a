"""One map in the making: scans and odometry from messages into the mapper, and its files. Works without rclpy."""

import gzip
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import StorageError, storage_errors
from slamgym.core.geometry import compose, inverse, part_of
from slamgym.core.types import LaserScan, OccupancyGrid, Pose2D
from slamgym.interop import write_ros_map, write_tum
from slamgym.interop.carmen import read_carmen
from slamgym.interop.carmen_writer import carmen_lines
from slamgym.interop.odometry import FASTEST_DRIVE
from slamgym.interop.records import BrokenMessageError, LogRecord
from slamgym.ros2.frames import RobotFrames
from slamgym.ros2.laser import LaserReader
from slamgym.ros2.parameters import MapParameters
from slamgym.ros2.run_files import LOG, MAP, OF_A_DRIVE, OF_A_MAP, TRAJECTORY, put_files_aside
from slamgym.ros2.stamps import Warn
from slamgym.slam import Mapper, SlamConfig, make_mapper
from slamgym.slam.graph.relative import moved_by
from slamgym.slam.laser_odometry import LaserTracker
from slamgym.slam.log_watch import LogWatch

Configure = Callable[[SlamConfig], SlamConfig]


class KnownPlace(NamedTuple):
    """What a robot is given that localises itself."""

    grid: OccupancyGrid
    start: Pose2D | None = None  # None: it has to find itself


class MapRun:
    """A mapper with what feeds it.

    The map's frame is the odometry's where the run begins, so ``map`` -> ``odom`` begins as the identity.

    Args:
        parameters: Of the node.
        configure: Changes the settings that suit the laser to those that are wanted.
        known: A finished map, to localise on it instead.
        frames: Where the laser is.
        warn: Told what is wrong.
        older: The log of a run to go on with: it is mapped once more before the first scan.

    Attributes:
        mapper: None before the first scan.
        map_from_odom: The odometry frame on the map; None before the first scan.
        stamp: Of the newest scan [s].
        odometry: At the newest scan.
    """

    def __init__(
        self,
        parameters: MapParameters,
        configure: Configure,
        known: KnownPlace | None,
        frames: RobotFrames,
        warn: Warn,
        older: Path | None = None,
    ) -> None:
        self.mapper: Mapper | None = None
        self.map_from_odom: Pose2D | None = None
        self.stamp = -np.inf
        self._parameters = parameters
        self._configure = configure
        self._known = known
        self._warn = warn
        self._older = older
        self._laser = LaserReader(frames, parameters, warn)
        self._tracker: LaserTracker | None = None
        self._watch: LogWatch | None = None
        self._broken_at = -np.inf  # [s]
        self.odometry = Pose2D(0.0, 0.0, 0.0)
        self._log: IO[str] | None = None
        self._is_logged = False

    def add(self, message: Any, stamp: float, odometry: Pose2D | None) -> bool:
        """Take a LaserScan with the odometry at its moment; None follows the laser alone.

        Returns:
            True if the map may have changed.

        Raises:
            BrokenMessageError: If no laser sends such a message.
            StorageError: If the log can't be made.
        """
        try:
            scan = self._laser.read(message, stamp, odometry)
        except BrokenMessageError:
            self._broken_at = stamp
            self.leave_out()
            raise
        if self._older is not None:
            self._go_on(self._older, scan, odometry)
            self._older = None
        if odometry is None:
            scan = self._follow(scan)
        else:
            self.odometry = odometry
            self._check(LogRecord(stamp, odometry, scan))
        self.stamp = stamp
        return self._map(scan)

    def _check(self, record: LogRecord) -> None:
        """Say what is wrong with laser and odometry, as `slamgym doctor` would of the log."""
        if self._watch is None:
            self._watch = LogWatch(record.scan.geometry, record.stamp)
        for finding in self._watch.take(record):
            self._warn(finding.kind, f"{finding.kind}: {finding.fault}; the map may be wrong there")

    def leave_out(self) -> None:
        """Scans were left out before the next one."""
        if self._watch is not None:
            self._watch.leave_out()

    @property
    def doubt(self) -> str:
        """Why the pose may be wrong now; empty if nothing speaks against it."""
        reasons = [] if self._watch is None else [self._watch.doubt(self.stamp)]
        if self._broken_at > self.stamp:
            reasons.append("scans are left out")
        if self.mapper is not None and self.mapper.stats.is_doubtful:
            reasons.append("the map doesn't fit")
        return ", ".join(filter(None, reasons))

    def _map(self, scan: LaserScan) -> bool:
        """Map a scan at the odometry as it is now, and log it."""
        if self.mapper is None:
            self.mapper = self._make_mapper(scan)
            self._open_log()
        processed = self.mapper.update(self.odometry, scan)
        self.map_from_odom = compose(self.mapper.pose, inverse(self.odometry))
        if self._log is not None and np.isfinite(scan.ranges).any():
            self._write(scan)
        return processed

    def _go_on(self, path: Path, scan: LaserScan, odometry: Pose2D | None) -> None:
        """Map an older log, unless the robot can't have come to a scan from its end."""
        try:
            records = read_carmen(path).records
        except InputFileError as error:
            self._warn("continue", f"the map begins anew: {error}")
            return
        last = records[-1]
        passed = scan.stamp - last.stamp
        here = last.odometry if odometry is None else odometry
        apart = np.hypot(here.x - last.odometry.x, here.y - last.odometry.y)
        is_same_laser = len(last.scan.ranges) == len(scan.ranges)
        if passed <= 0.0 or apart > FASTEST_DRIVE * passed or not is_same_laser:
            self._warn(
                "continue",
                f"the map begins anew: clock, odometry or laser aren't those of {path} any more",
            )
            return
        for record in records:
            self.odometry = record.odometry
            self._map(replace(record.scan, geometry=scan.geometry))
        if odometry is None:
            self.stamp = last.stamp
            self._tracker = LaserTracker(replace(last.scan, geometry=scan.geometry))
        self._warn("continue", f"the map goes on from the {len(records)} scans of {path}")

    def _open_log(self) -> None:
        out = self._parameters.out
        with storage_errors(out):
            out.mkdir(parents=True, exist_ok=True)
            self._log = gzip.open(out / LOG, "wt", compresslevel=1)  # noqa: SIM115 - close() does

    def _follow(self, scan: LaserScan) -> LaserScan:
        """Move on by the laser alone; the scan comes back with the motion that its beams saw, at the same speed."""
        if self._tracker is None:
            self._tracker = LaserTracker(scan)
            return scan
        step = self._tracker.move(scan)
        x, y, theta = moved_by(np.array(self.odometry), step).tolist()
        self.odometry = Pose2D(x, y, theta)
        share = scan.geometry.scan_time / (scan.stamp - self.stamp)
        return replace(scan, motion=part_of(Pose2D(*step.tolist()), share))

    def _make_mapper(self, scan: LaserScan) -> Mapper:
        geometry = scan.geometry
        config = self._configure(SlamConfig.for_log(geometry.range_max, geometry.num_beams))
        rng = np.random.default_rng(0)
        if self._known is None:
            return make_mapper(config, geometry, self.odometry, rng, None)
        grid, start = self._known
        localization = replace(config.localization, start="known" if start else "global")
        config = replace(config, mode="map", localization=localization)
        return make_mapper(config, geometry, start or self.odometry, rng, grid)

    def _write(self, scan: LaserScan) -> None:
        """Note a scan; a disk that is full ends the log, not the map."""
        assert self._log is not None
        record = LogRecord(scan.stamp, self.odometry, scan)
        lines = list(carmen_lines([record], scan.geometry))
        try:
            with storage_errors(self._parameters.out / LOG):
                self._log.writelines(lines[self._is_logged :])  # the head once
        except StorageError as error:
            self._warn("log", f"the log ends here: {error}")
            self._log = None
        self._is_logged = True

    def save(self) -> str:
        """Write map.yaml, map.pgm, trajectory.tum and what there is of the log; returns what to say.

        A map that was there already stays where a robot localises itself.

        Raises:
            SlamgymError: If no scan has come, or they can't be written.
        """
        if self.mapper is None:
            raise SlamgymError("nothing to save: no scan has come yet")
        out = self._parameters.out
        with storage_errors(out):
            out.mkdir(parents=True, exist_ok=True)
        if self._known is None or not (out / MAP).exists():
            write_ros_map(out, self.mapper.occupancy_grid())
        write_tum(out / TRAJECTORY, self.mapper.trajectory())
        if self._log is not None:
            with storage_errors(out):
                self._log.flush()
        return f"{out / MAP}"

    def close(self) -> None:
        """Complete the log."""
        log = self._log
        self._log = None
        if log is not None:
            with storage_errors(self._parameters.out / LOG):
                log.close()

    def put_aside(self) -> str:
        """End the run: its files go to the first of the folders run1, run2, ... that is free; returns what to say.

        Raises:
            StorageError: If they can't be written.
        """
        out = self._parameters.out
        if self._known is not None:
            self.close()
            put_files_aside(out, OF_A_DRIVE)
            return "the map stays"
        if self.mapper is None:
            return "there was no map yet"
        self.save()
        self.close()
        return f"the map until now is in {put_files_aside(out, OF_A_MAP)}"
