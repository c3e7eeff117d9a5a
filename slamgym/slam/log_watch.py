"""The checks of a recorded log while a robot still drives: a node says at once what `doctor` would find afterwards."""

from slamgym.core.types import LaserGeometry
from slamgym.interop.records import Log, LogFinding, LogRecord
from slamgym.slam.laser_changes import noting_changes
from slamgym.slam.laser_check import noting_gaps
from slamgym.slam.odometry_check import check_odometry

WINDOW = 60.0
"""Odometry is checked over so much time [s], which takes 0.4 CPU s at 5 scans a second. Of six public logs with
odometry 0.3 s late, 30, 60 and 120 s show it on the two that have more than a scan a second."""
PAUSE = 1.0
"""A wait for the next scan that may be a gap [s]."""
FEWEST_SCANS = 20
"""So many scans say how long the usual wait is, and are looked at again in the next window."""


class LogWatch:
    """Takes what a robot measures, and finds what is wrong with it.

    Args:
        geometry: Of the scans.
        since: When the run began, which findings count from [s].
    """

    def __init__(self, geometry: LaserGeometry, since: float) -> None:
        self._geometry = geometry
        self._since = since
        self._records: list[LogRecord] = []
        self._found: dict[str, float] = {}  # when each kind of fault was met last [s]

    def take(self, record: LogRecord) -> list[LogFinding]:
        """Take a scan with the odometry at its moment; returns new findings."""
        records = self._records
        records.append(record)
        if len(records) < 2:
            return []
        last = records[-2]
        findings = [*noting_changes(self._log(records[-2:])).findings]
        if record.stamp - last.stamp > PAUSE and len(records) >= FEWEST_SCANS:
            findings += noting_gaps(self._log(records)).findings
        if record.stamp - records[0].stamp >= WINDOW:
            checked = check_odometry(self._log(records), estimate_scan_time=False)
            findings += checked.findings
            self._records = records[-FEWEST_SCANS:]
        by_kind = {finding.kind: finding for finding in reversed(findings)}
        new = [finding for kind, finding in by_kind.items() if kind not in self._found]
        self._found.update(dict.fromkeys(by_kind, record.stamp))
        return new

    def leave_out(self) -> None:
        """Scans were left out: what follows isn't compared with what was before."""
        self._records.clear()

    def doubt(self, stamp: float) -> str:
        """The kinds of faults that were met not long before a moment [s]; empty if there are none."""
        return ", ".join(kind for kind, met in self._found.items() if stamp - met <= WINDOW)

    def _log(self, records: list[LogRecord]) -> Log:
        return Log("", records, self._geometry, since=self._since)
