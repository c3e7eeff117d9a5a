import numpy as np
import pytest

from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.interop import LogRecord


@pytest.fixture
def geometry():
    """A small scanner behind the axle."""
    return LaserGeometry(19, -np.pi / 2, np.pi / 18, 0.12, 3.5, Pose2D(-0.064, 0.0, 0.0))


@pytest.fixture
def records(geometry):
    """Ten scans along an arc, each with a beam without return, one too close and one broken."""
    rng = np.random.default_rng(0)
    scans = []
    for k in range(10):
        ranges = rng.uniform(0.2, 3.4, geometry.num_beams).astype(np.float32)
        ranges[3], ranges[4], ranges[5] = np.inf, -np.inf, np.nan
        stamp = 100.0 + 0.2 * k
        pose = Pose2D(0.05 * k, 0.001 * k * k, 0.02 * k)
        scans.append(LogRecord(stamp, pose, LaserScan(stamp, ranges, geometry)))
    return scans
