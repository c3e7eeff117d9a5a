"""What the exploration loop believes: the newest pose, scan and map, when they came, and what earlier scans saw."""

import math

import numpy as np

from slamgym.core.types import (
    ByteArray,
    Float32Array,
    FloatArray,
    Observation,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning.context import ExplorerContext
from slamgym.planning.view_history import ViewHistory


class LoopBelief:
    """The newest observation.

    Args:
        context: Of the robot; maps that come without a frame have its.

    Attributes:
        pose: The robot in the map frame.
        time: [s].
        scan: Shape (num_beams,) [m].
        mates: Poses (K, 3) of the robots of its team that are heard now, in the map frame.
        views: All scans.
    """

    def __init__(self, context: ExplorerContext) -> None:
        self._canvas = context.frame
        self._frame = context.frame
        self.views = ViewHistory(context)
        self._cells: ByteArray | None = None
        self.pose = Pose2D(0.0, 0.0, 0.0)
        self.time = 0.0
        self.scan: Float32Array = np.zeros(0, np.float32)
        self.mates: FloatArray = np.zeros((0, 3))

    @property
    def has_map(self) -> bool:
        """True from the first map on."""
        return self._cells is not None

    def take_pose(self, observation: Observation) -> float:
        """Take over pose, time and scan; returns how far the pose has moved [m]."""
        last = self.pose
        self.pose = Pose2D(*observation["pose"].tolist())
        self.time = float(observation["time"][0])
        self.scan = observation["scan"]
        self.views.note(self.pose, self.scan)
        if "mates" in observation:
            rows = observation["mates"]
            self.mates = rows[rows[:, 0] > 0.5, 1:].astype(np.float64)
        return math.dist(self.pose[:2], last[:2])

    def take_map(self, published: ByteArray | OccupancyGrid) -> bool:
        """Take over a published map; returns True if its cells are new."""
        if isinstance(published, OccupancyGrid):
            cells = published.cells
            self._frame = published.frame
        else:
            cells = published
            self._frame = self._canvas
        last = self._cells
        # The environment publishes a new read-only array for a new map; any other array may have been
        # written to in place, so it is compared.
        if not cells.flags.writeable:
            self._cells = cells
            return cells is not last
        self._cells = cells.copy()
        return last is None or not np.array_equal(cells, last)

    def known_map(self) -> OccupancyGrid:
        """The newest map, on the whole canvas."""
        assert self._cells is not None, "there is a map from the first observation on"
        return OccupancyGrid(self._cells.reshape(self._frame.shape), self._frame)
