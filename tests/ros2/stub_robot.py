"""A flat, a mapper that sees it from where the robot stands, and another navigation that drives, or gives up."""

import math

import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, LaserGeometry, LaserScan, Pose2D
from slamgym.ros2.exploration import Exploration, ExplorationState
from slamgym.ros2.foreign_maps import LATTICE_CELL, ForeignMap
from slamgym.ros2.parameters import ExploreParameters

STEP = 0.5  # [s]
MAP_EVERY = 4  # steps
BEGAN = 1.7e9  # [s]
SCANNER = LaserGeometry(180, -math.pi, 2.0 * math.pi / 180, 0.1, 3.5)


def two_rooms():
    """Two rooms of 4 x 4 m side by side with a door of 0.9 m between them; row 0 at the bottom, from (0, 0)."""
    cells = np.full((86, 170), FREE, np.uint8)
    cells[:3], cells[-3:], cells[:, :3], cells[:, -3:] = OCCUPIED, OCCUPIED, OCCUPIED, OCCUPIED
    cells[:, 83:86] = OCCUPIED
    cells[34:52, 83:86] = FREE
    return cells


class StubRobot:
    """Runs an exploration in the flat.

    Args:
        aborts: Says of a time [s] and a goal if the navigation gives it up.
        truth: The flat, row 0 at the bottom, from (0, 0).
        settings: Of the exploration.
    """

    def __init__(self, aborts=lambda time, goal: False, truth=None, **settings):
        self.truth = two_rooms() if truth is None else truth
        self.aborts, self.pose, self.time = aborts, Pose2D(2.0, 2.0, 0.0), 0.0
        self.known = np.full(self.truth.shape, UNKNOWN, np.uint8)
        self.exploration = Exploration(
            ExploreParameters(**({"drive": "goals", "explorer": "tour"} | settings))
        )
        self.maps = ForeignMap("/map")
        self.steps, self.number = 0, 0
        self.looked_from, self.ranges = None, None
        self.goals, self.states, self.texts = [], [], []

    @property
    def state(self):
        return self.exploration.state

    def seen_share(self):
        """Share of the free floor that the map shows."""
        return np.count_nonzero(self.known == FREE) / np.count_nonzero(self.truth == FREE)

    def look(self):
        """Cast rays: what they pass is known."""
        if self.looked_from == self.pose:
            return LaserScan(self.time, self.ranges, SCANNER)
        self.looked_from = self.pose
        lengths = np.arange(0.0, 3.5, 0.4 * LATTICE_CELL)
        angles = (self.pose.theta + SCANNER.angles)[:, None]
        row = (
            ((self.pose.y + lengths * np.sin(angles)) / LATTICE_CELL)
            .astype(int)
            .clip(0, self.truth.shape[0] - 1)
        )
        col = (
            ((self.pose.x + lengths * np.cos(angles)) / LATTICE_CELL)
            .astype(int)
            .clip(0, self.truth.shape[1] - 1)
        )
        hit = self.truth[row, col] == OCCUPIED
        end = np.where(hit.any(axis=1), hit.argmax(axis=1), len(lengths) - 1)
        passed = np.arange(len(lengths))[None] <= end[:, None]
        self.known[row[passed], col[passed]] = self.truth[row[passed], col[passed]]
        self.ranges = np.where(hit.any(axis=1), lengths[end], np.inf).astype(np.float32)
        return LaserScan(self.time, self.ranges, SCANNER)

    def publish(self):
        """Hand the known part over: the map grows and its origin moves."""
        rows, cols = (np.flatnonzero((self.known != UNKNOWN).any(axis=axis)) for axis in (1, 0))
        part = self.known[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
        values = np.where(part == OCCUPIED, 100, np.where(part == FREE, 0, -1)).astype(np.int8)
        origin = Pose2D(cols[0] * LATTICE_CELL, rows[0] * LATTICE_CELL, 0.0)
        self.exploration.take_map(self.maps.take(values, *values.shape[::-1], LATTICE_CELL, origin))

    def step(self, **given):
        """One step of everything; returns the order."""
        scan = self.look()
        if self.steps % MAP_EVERY == 0:
            self.publish()
        order = self.exploration.step(
            **({"pose": self.pose, "scan": scan, "stamp": BEGAN + self.time} | given)
        )
        if order.number != self.number and order.goal is not None:
            self.goals.append((self.time, order.goal))
        self.number = order.number
        if order.goal is not None:
            self._drive(order)
        self.steps, self.time = self.steps + 1, self.time + STEP
        for history, value in ((self.states, self.state), (self.texts, self.exploration.text)):
            history += [] if history[-1:] == [value] else [value]
        return order

    def _drive(self, order):
        """The navigation: 0.5 m/s along the path, or it gives up."""
        path = self.exploration.view().path
        if self.aborts(self.time, order.goal) or len(path) == 0:
            self.exploration.goal_ended(order.number, reached=False)
            return
        here = int(np.argmin(np.hypot(*(path - self.pose[:2]).T)))
        x, y = path[min(here + 5, len(path) - 1)].tolist()
        self.pose = Pose2D(x, y, math.atan2(y - self.pose.y, x - self.pose.x))
        if math.dist(self.pose[:2], order.goal[:2]) < 0.1:
            self.pose = order.goal
            self.exploration.goal_ended(order.number, reached=True)

    def run(self, seconds=600.0, until=ExplorationState.DONE):
        """Step until a state, or for so long [s]."""
        end = self.time + seconds
        while self.time < end and self.state is not until:
            self.step()
        return self
