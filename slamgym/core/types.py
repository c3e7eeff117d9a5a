"""The records that travel between the stages.

Units are metres, radians and seconds. Frames: x right, y up, theta counter-clockwise from +x in (-pi, pi].
``world`` is the frame of the floor plan; ``map`` is the frame of the robot's belief: its origin is the start
position and its axes are parallel to the world's, so a map doesn't reveal where in the building it began.
Grid arrays are ``[row, col]`` with row 0 at the top (largest y), as ROS map_server images are.
What numba kernels take is a NamedTuple: it goes into them whole.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ByteArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]

OCCUPIED = 0
UNKNOWN = 205
FREE = 254
"""Cell values as ROS map_server writes them."""


class Pose2D(NamedTuple):
    """A planar pose: x [m], y [m], theta [rad]."""

    x: float
    y: float
    theta: float


AT_REST = Pose2D(0.0, 0.0, 0.0)
"""No motion."""


class Twist2D(NamedTuple):
    """A velocity of a differential drive: forward [m/s], counter-clockwise [rad/s]."""

    linear: float
    angular: float


class LaserGeometry(NamedTuple):
    """Geometry of a scanner's beams, apart from what they measured.

    Beam ``i`` points to ``angle_min + i * angle_increment`` in the sensor frame, counter-clockwise.
    ``time_increment`` is 0 where all beams are measured at once, and negative where a laser that hangs upside down
    measures the last one first.
    """

    num_beams: int
    angle_min: float  # [rad], sensor frame
    angle_increment: float  # [rad]
    range_min: float  # [m]
    range_max: float  # [m]
    mount: Pose2D = Pose2D(0.0, 0.0, 0.0)  # sensor in the robot's base frame
    time_increment: float = 0.0  # from a beam to the next [s]

    @property
    def field_of_view(self) -> float:
        """Angle from the first beam to the last [rad]; negative if they are numbered clockwise."""
        return self.angle_increment * (self.num_beams - 1)

    @property
    def scan_time(self) -> float:
        """Time from the first beam that is measured to the last [s]."""
        return abs(self.time_increment) * (self.num_beams - 1)

    def taking(self, seconds: float) -> "LaserGeometry":
        """The same laser with another time from the first beam that is measured to the last [s]."""
        each = seconds / max(self.num_beams - 1, 1)
        return self._replace(time_increment=math.copysign(each, self.time_increment))

    @property
    def angles(self) -> FloatArray:
        """Beam directions in the sensor frame, shape (num_beams,) [rad]."""
        return self.angle_min + self.angle_increment * np.arange(self.num_beams, dtype=np.float64)


@dataclass(frozen=True)
class LaserScan:
    """One sweep of the scanner.

    Convention: ``stamp`` is the moment of the beam that is measured first, as in ROS, and the odometry that comes with
    a scan is of that moment. Ranges follow ROS REP 117: ``+inf`` no return within ``range_max``, ``-inf`` closer than
    ``range_min``, ``nan`` erroneous.
    """

    stamp: float  # [s]
    ranges: Float32Array  # (num_beams,) [m]
    geometry: LaserGeometry
    motion: Pose2D = AT_REST
    """Of the robot's base until the last beam, by odometry, seen from where it was at the first."""


@dataclass(frozen=True)
class Trajectory:
    """Poses over time, all in one frame."""

    stamps: FloatArray  # (N,) [s], not decreasing
    poses: FloatArray  # (N, 3) x [m], y [m], theta [rad]

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def length(self) -> float:
        """Path length [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())


class GridFrame(NamedTuple):
    """Where the cells of a grid lie.

    Convention: ``origin_x, origin_y`` is the outer corner of the bottom-left cell, i.e. of
    ``[height_px - 1, 0]``; x grows with the column, y falls with the row.
    """

    resolution: float  # [m/cell]
    origin_x: float  # [m]
    origin_y: float  # [m]
    height_px: int
    width_px: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.height_px, self.width_px

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(min x, min y, max x, max y) [m]."""
        return (
            self.origin_x,
            self.origin_y,
            self.origin_x + self.width_px * self.resolution,
            self.origin_y + self.height_px * self.resolution,
        )

    def to_cell(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Convert points [m] to (row, col), which may lie outside the grid."""
        if isinstance(x, float) and isinstance(y, float):  # most calls are for one point
            across = (x - self.origin_x) / self.resolution
            up = (y - self.origin_y) / self.resolution
            return self.height_px - 1 - math.floor(up), math.floor(across)
        col = np.floor((np.asarray(x) - self.origin_x) / self.resolution).astype(np.int64)
        above = np.floor((np.asarray(y) - self.origin_y) / self.resolution).astype(np.int64)
        return self.height_px - 1 - above, col

    def to_point(self, row: Any, col: Any) -> tuple[Any, Any]:
        """Convert cells to the points (x, y) [m] of their centres."""
        if isinstance(row, (float, int)) and isinstance(col, (float, int)):
            right = (col + 0.5) * self.resolution
            up = (self.height_px - row - 0.5) * self.resolution
            return self.origin_x + right, self.origin_y + up
        cols = np.asarray(col, dtype=np.float64)
        rows = np.asarray(row, dtype=np.float64)
        x = self.origin_x + (cols + 0.5) * self.resolution
        y = self.origin_y + (self.height_px - rows - 0.5) * self.resolution
        return x, y

    def to_points(self, row: Any, col: Any) -> FloatArray:
        """Convert arrays of cells, of any shape (...), to the points of their centres, shape (..., 2) [m]."""
        points = np.empty((*np.shape(row), 2))
        points[..., 0], points[..., 1] = self.to_point(row, col)
        return points

    @staticmethod
    def covering(
        bounds: tuple[float, float, float, float], resolution: float, margin: float = 0.0
    ) -> "GridFrame":
        """The smallest frame that covers ``bounds`` (min x, min y, max x, max y) plus ``margin`` [m]."""
        min_x, min_y, max_x, max_y = bounds
        return GridFrame(
            resolution=resolution,
            origin_x=min_x - margin,
            origin_y=min_y - margin,
            height_px=max(1, int(np.ceil((max_y - min_y + 2 * margin) / resolution - 1e-9))),
            width_px=max(1, int(np.ceil((max_x - min_x + 2 * margin) / resolution - 1e-9))),
        )


@dataclass(frozen=True)
class OccupancyGrid:
    """A map as ROS map_server stores it: 0 occupied, 205 unknown, 254 free, row 0 at the top."""

    cells: ByteArray  # (rows, cols)
    frame: GridFrame

    def __post_init__(self) -> None:
        if self.cells.shape != self.frame.shape:
            raise ValueError(
                f"cells have shape {self.cells.shape} but the frame says {self.frame.shape}"
            )

    @property
    def known_area(self) -> float:
        """Area of the cells that are not unknown [m2]."""
        return float(np.count_nonzero(self.cells != UNKNOWN)) * self.frame.resolution**2


Observation = dict[str, Any]
"""Contents of an observation of an environment: arrays by the names of its observation space."""


class Explorer(Protocol):
    """A policy, as Stable-Baselines3's ``PolicyPredictor`` defines it, that knows when it is done.

    ``predict`` takes an observation and returns an action and the next hidden state.
    """

    @property
    def fingerprint(self) -> str:
        """Short hash of all that decides what it does: its settings, and its weights if it has some."""
        ...

    @property
    def finished(self) -> bool:
        """True if nothing that the robot can get to is left to explore."""
        ...

    @property
    def decisions(self) -> int:
        """Number of times that it has chosen where to go."""
        ...

    def predict(
        self,
        observation: Observation,
        state: tuple[NDArray[Any], ...] | None = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], tuple[NDArray[Any], ...] | None]:
        """Choose an action."""
        ...
