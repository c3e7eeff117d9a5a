"""Another place for a scan that fits badly: what the two newest scans see through decides."""

import numpy as np
import pytest

from slamgym.core.types import LaserGeometry, Pose2D
from slamgym.slam.graph import recovery
from slamgym.slam.graph.alignment import Alignment
from slamgym.slam.graph.recovery import Recovery
from slamgym.slam.graph.sight import ScanView, Sight, count_seen_through
from slamgym.slam.graph.submaps import oriented

LASER = LaserGeometry(180, np.radians(-89.5), np.radians(1.0), 0.1, 4.0, Pose2D(0.0, 0.0, 0.0))
USABLE = 3.95
INFORMATION = np.diag([400.0, 400.0, 25.0])  # of wheels that err by 0.05 m and 0.2 rad


def view(pose: np.ndarray, end: float) -> ScanView:
    """A scan in a corridor along x, 2 m wide, that ends at an x [m]."""
    angles = LASER.angles + pose[2]
    ahead, aside = np.cos(angles), np.sin(angles)
    to_side = (np.sign(aside) - pose[1]) / aside
    to_end = np.where(ahead > 0.0, (end - pose[0]) / ahead, np.inf)
    ranges = np.minimum(to_side, to_end)
    ranges[ranges > USABLE] = np.inf
    seen = np.isfinite(ranges)
    points = (ranges * np.array([np.cos(LASER.angles), np.sin(LASER.angles)]))[:, seen].T
    return ScanView(oriented(points, np.zeros(2)), ranges.astype(np.float32))


class Surfaces:
    """Submaps that a scan of so many points fits so well wherever it is put."""

    def __init__(self, fit: float, count: int) -> None:
        self.fits = np.full(count, fit)

    def align_freely(self, seen, start) -> Alignment:
        return Alignment(start, np.zeros((1, 4, 4)), np.zeros(1, np.int64), self.fits)


def place_of(monkeypatch, true: np.ndarray, by_wheels: np.ndarray, other: np.ndarray, end: float):
    """Where a scan is put that was taken at a pose and fits badly where the wheels say, and better elsewhere."""
    scan = view(true, end)
    monkeypatch.setattr(recovery, "_search", lambda *_: other)
    badly = Surfaces(0.4, len(scan.seen.points))
    placed = badly.align_freely(scan.seen, by_wheels)
    start = np.zeros(3)
    well = Surfaces(0.9, len(scan.seen.points))
    before = view(start, end)
    looked = Recovery(Sight(LASER, USABLE))
    return looked.check(well, scan, by_wheels, INFORMATION, placed, before, start).pose


def test_the_end_of_a_corridor_that_comes_into_sight_does_not_say_that_the_robot_stands(
    monkeypatch,
):
    driven = np.array([1.0, 0.0, 0.0])
    assert place_of(monkeypatch, driven, driven, np.zeros(3), end=4.5) is driven


def test_a_turn_that_the_wheels_missed_is_found(monkeypatch):
    turned = np.array([0.0, 0.0, 0.5])
    assert place_of(monkeypatch, turned, np.zeros(3), turned, end=2.0) is turned


@pytest.mark.parametrize(
    ("point", "count"),
    [
        pytest.param((1.0, 0.5), 1, id="in free space"),
        pytest.param((1.0, 1.02), 0, id="on a wall"),
        pytest.param((1.0, 1.5), 0, id="behind a wall"),
        pytest.param((4.2, 0.0), 0, id="beyond the range"),
        pytest.param((-1.0, 0.5), 0, id="behind the robot"),
    ],
)
def test_a_point_says_something_only_where_a_scan_saw_through_it(point, count):
    found = count_seen_through(
        np.array([point]),
        np.zeros(3),
        view(np.zeros(3), 9.0).ranges,
        LASER.angle_min,
        LASER.angle_increment,
        USABLE,
    )
    assert found == count
