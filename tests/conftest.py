"""How hypothesis searches, and fixtures for the tests of planning and explorers: a grid of truth and a scanner."""

import math
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    GridFrame,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
    Twist2D,
)
from slamgym.planning import ExplorerContext

# No test fails because the machine is busy.
_CALM = {
    "deadline": None,
    "print_blob": True,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
}
settings.register_profile("fixed", derandomize=True, database=None, **_CALM)
settings.register_profile("fuzz", **_CALM)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))

RESOLUTION = 0.05


def pytest_addoption(parser):
    """Options must stand here: pytest reads no conftest.py below ``testpaths`` before the command line."""
    parser.addoption(
        "--renew-golden",
        action="store_true",
        help="store what the golden tests measure as the expected values",
    )


class GridWorld:
    """A round robot in a grid; it stops at obstacles."""

    def __init__(self, cells, context):
        self.truth = OccupancyGrid(
            np.asarray(cells, np.uint8), GridFrame(RESOLUTION, 0.0, 0.0, *np.shape(cells))
        )
        self.context = context
        self.pose = Pose2D(0.0, 0.0, 0.0)
        self.obstacles = np.argwhere(self.truth.cells == OCCUPIED)
        self.contacts = 0
        self.glass = np.zeros(
            self.truth.cells.shape, np.bool_
        )  # of what stops the body: seen along x only
        self.map = np.full(self.truth.cells.shape, UNKNOWN, np.uint8)

    def place(self, row, col, theta=0.0):
        x, y = self.truth.frame.to_point(row, col)
        self.pose = Pose2D(float(x), float(y), theta)

    def point(self, row, col):
        x, y = self.truth.frame.to_point(row, col)
        return float(x), float(y)

    def scan(self):
        """Ranges, and the cells that the beams crossed are entered into the map."""
        laser = self.context.geometry
        steps = np.arange(0.0, laser.range_max, RESOLUTION / 2)
        angles = self.pose.theta + laser.angles
        x = self.pose.x + np.outer(np.cos(angles), steps)
        y = self.pose.y + np.outer(np.sin(angles), steps)
        row, col = self.truth.frame.to_cell(x, y)
        inside = (
            (row >= 0)
            & (row < self.truth.cells.shape[0])
            & (col >= 0)
            & (col < self.truth.cells.shape[1])
        )
        values = np.where(
            inside, self.truth.cells[np.where(inside, row, 0), np.where(inside, col, 0)], OCCUPIED
        )
        through = inside & self.glass[np.where(inside, row, 0), np.where(inside, col, 0)]
        through &= np.abs(np.sin(angles))[:, None] > math.sin(math.radians(4.0))
        hit = (values == OCCUPIED) & ~through
        first = np.where(hit.any(1), hit.argmax(1), len(steps))
        seen = np.arange(len(steps)) < first[:, None]
        self.map[row[seen], col[seen]] = FREE
        for beam in np.flatnonzero(first < len(steps)):
            if inside[beam, first[beam]]:
                self.map[row[beam, first[beam]], col[beam, first[beam]]] = OCCUPIED
        return np.where(first < len(steps), first * RESOLUTION / 2, laser.range_max).astype(
            np.float32
        )

    def drive(self, command: Twist2D):
        dt = self.context.control_step
        theta = self.pose.theta + command.angular * dt
        middle = self.pose.theta + 0.5 * command.angular * dt
        x = self.pose.x + command.linear * dt * math.cos(middle)
        y = self.pose.y + command.linear * dt * math.sin(middle)
        ox, oy = self.truth.frame.to_point(self.obstacles[:, 0], self.obstacles[:, 1])
        if len(ox) and np.hypot(ox - x, oy - y).min() < self.context.robot_radius - RESOLUTION / 2:
            self.contacts += 1
            x, y = self.pose.x, self.pose.y
        self.pose = Pose2D(x, y, math.remainder(theta, 2.0 * math.pi))

    def observation(self, time):
        return {
            "map": self.map.copy()[np.newaxis],
            "scan": self.scan(),
            "pose": np.array(self.pose, np.float32),
            "velocity": np.zeros(2, np.float32),
            "time": np.array([time], np.float32),
        }


def context_for(shape):
    return ExplorerContext(
        frame=GridFrame(RESOLUTION, 0.0, 0.0, *shape),
        geometry=LaserGeometry(180, -math.pi / 2, math.pi / 179, 0.12, 3.5),
    )


@pytest.fixture(scope="session")
def make_world():
    """Build a world from cells."""

    def make(cells):
        return GridWorld(cells, context_for(np.shape(cells)))

    return make
