"""The state of many robots as arrays, one row an environment, as the kernels take it."""

from typing import Any, NamedTuple

import numpy as np

from slamgym.core.types import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from slamgym.sim.beams import BeamLaw
from slamgym.sim.contact import SKIN, DiscBody
from slamgym.sim.robot import RobotConfig
from slamgym.slam.hit_count_kernels import BeamTable


class Robots(NamedTuple):
    """Bodies and wheels; poses are true."""

    drive: FloatArray  # (N, 8) drive states, see slamgym.sim.motion
    pose: FloatArray  # (N, 3) world frame
    start: FloatArray  # (N, 3) world frame
    path: FloatArray  # (N,) [m]
    odometry: FloatArray  # (N, 3) integrated by the wheels, map frame
    velocity: FloatArray  # (N, 2) measured [m/s, rad/s]
    rolled: FloatArray  # (N, 2) what the encoders counted [m]
    wheels: FloatArray  # (N, 3) gains of the left and right encoder, believed wheel base [m]
    slips: FloatArray  # (N, 3) standard normal draws of this step
    steps: IntArray  # (N,) since the episode began
    contact: BoolArray  # (N,) whether the last step had contact
    collisions: IntArray  # (N,) contacts begun

    @classmethod
    def rest(cls, count: int) -> "Robots":
        """So many robots at rest."""
        drive, pose, start, odometry, velocity, rolled, wheels, slips = (
            np.zeros((count, k)) for k in (8, 3, 3, 3, 2, 2, 3, 3)
        )
        steps, collisions = (np.zeros(count, dtype=np.int64) for _ in range(2))
        path, contact = np.zeros(count), np.zeros(count, dtype=np.bool_)
        return cls(
            drive, pose, start, path, odometry, velocity, rolled, wheels, slips, steps, contact, collisions
        )


class Scenes(NamedTuple):
    """What the robots touch and see; each table has a number of rows that count."""

    segments: FloatArray  # (N, S, 4) [m]
    num_segments: IntArray  # (N,)
    first: IntArray  # (N, F) where each segment's patches begin, see slamgym.sim.surfaces
    num_first: IntArray
    patches: FloatArray  # (N, P, 5)
    num_patches: IntArray
    outside: FloatArray  # (N, K, 4) [m]
    num_outside: IntArray
    materials: IntArray  # (N, 2) how many segments are walls, and the seed of what varies with the place
    roughness: FloatArray  # (N,) [m]
    unseen: BoolArray  # (N, cells) floor still to be seen, row by row
    floor_shape: IntArray  # (N, 2) rows and columns
    floor_corner: FloatArray  # (N, 2) lower left corner [m]
    seen: IntArray  # (N,) cells seen
    floor_cells: IntArray  # (N,) cells of the floor

    @classmethod
    def empty(cls, count: int) -> "Scenes":
        """Room for so many scenes; the tables grow with what is put into them."""

        def numbers() -> IntArray:
            return np.zeros(count, dtype=np.int64)

        return cls(
            np.zeros((count, 0, 4)), numbers(), np.zeros((count, 0), dtype=np.int64), numbers(),
            np.zeros((count, 0, 5)), numbers(), np.zeros((count, 0, 4)), numbers(),
            np.zeros((count, 2), dtype=np.int64), np.zeros(count),
            np.zeros((count, 0), dtype=np.bool_), np.zeros((count, 2), dtype=np.int64), np.zeros((count, 2)),
            numbers(), numbers(),
        )  # fmt: skip


class Scanner(NamedTuple):
    """What all scanners have in common."""

    law: BeamLaw
    mount: tuple[float, float, float]  # in the base frame [m, m, rad]
    directions: FloatArray  # (num_beams, 2) in the sensor frame
    range_min: float  # [m]
    lost: float
    stray: float
    usable: float  # how far coverage follows a beam [m]


class Scans(NamedTuple):
    """Draws and ranges of the newest scans."""

    kind: IntArray  # (N,) a value of ScanKind
    normal: FloatArray  # (N, 2, num_beams) standard normal draws
    fate: FloatArray  # (N, 2, num_beams + 1) even draws
    burst: IntArray  # (N, 2) first beam and number of beams that a burst of cross-talk hits
    pulses: FloatArray  # (N, most) the ranges that it makes [m]
    true: FloatArray  # (N, num_beams) [m]
    ranges: Float32Array  # (N, num_beams) measured [m]

    @classmethod
    def blank(cls, count: int, num_beams: int, longest_burst: int) -> "Scans":
        """So many scans not taken yet."""
        return cls(
            np.zeros(count, dtype=np.int64),
            np.zeros((count, 2, num_beams)),
            np.zeros((count, 2, num_beams + 1)),
            np.zeros((count, 2), dtype=np.int64),
            np.zeros((count, longest_burst)),
            np.zeros((count, num_beams)),
            np.zeros((count, num_beams), dtype=np.float32),
        )


class Maps(NamedTuple):
    """What robots with known poses believe: path and hit counts, see slamgym.slam.PoseTracker."""

    counts: np.ndarray  # (N, cells, 2) int32 hits and visits, row by row, row 0 at the bottom
    cells: ByteArray  # (N, cells) the map as it is shown
    tiles: (
        np.ndarray
    )  # (N, tiles) uint32, see slamgym.envs.compact.pack_tiles; none where nobody asks for them
    kinds: ByteArray  # (N, tiles) likewise
    shape: IntArray  # (N, 2) rows and columns, multiples of four
    corner: IntArray  # (N, 2) row and column of the lattice where they begin
    dirty: IntArray  # (N, 4) rows and columns, half open, that changed since they were classified; empty if none did
    box: IntArray  # (N, 4) first row and column and last row and column of the last scan
    warmth: IntArray  # (N,) no meaning; what fetching the counts leaves, so that the compiler keeps it
    begun: BoolArray  # (N,) whether a scan was taken
    last: FloatArray  # (N, 3) odometry of the last scan
    processed: FloatArray  # (N, 3) odometry of the last processed scan
    anchor: FloatArray  # (N, 3) estimate at the last processed scan
    since: FloatArray  # (N, 3) stamp of the last processed scan [s]; distance [m] and turn [rad] since
    believed: FloatArray  # (N, 3) estimate now
    is_new: BoolArray  # (N,) whether the newest scan was processed

    @classmethod
    def blank(cls, count: int) -> "Maps":
        """So many maps without any cell."""
        last, processed, anchor, since, believed = (np.zeros((count, 3)) for _ in range(5))
        shape, corner, dirty, box = (np.zeros((count, k), dtype=np.int64) for k in (2, 2, 4, 4))
        warmth = np.zeros(count, dtype=np.int64)
        begun, is_new = (np.zeros(count, dtype=np.bool_) for _ in range(2))
        counts, tiles = np.zeros((count, 0, 2), dtype=np.int32), np.zeros((count, 0), dtype=np.uint32)
        cells, kinds = (np.zeros((count, 0), dtype=np.uint8) for _ in range(2))
        return cls(
            counts, cells, tiles, kinds, shape, corner, dirty, box, warmth, begun, last, processed, anchor, since,
            believed, is_new,
        )  # fmt: skip


class MapLaw(NamedTuple):
    """How maps are drawn, and when."""

    beams: BeamTable
    resolution: float  # [m]
    threshold: float
    min_passes: int
    updates: tuple[float, float, float]  # see slamgym.slam.motion_model.update_thresholds
    believes_truth: bool  # else the wheels
    keeps_current: bool  # the shown cells follow every processed scan, else they wait for a publication


class DriveLaw(NamedTuple):
    """What all robots' drives and bodies have in common."""

    dt: float  # duration of a step [s]
    limits: FloatArray  # accelerations and wheel separation, shape (3,)
    radius: float  # within which the body touches something [m]
    body: float  # radius of the body itself [m]
    disc: DiscBody

    @classmethod
    def of(cls, robot: RobotConfig, dt: float) -> "DriveLaw":
        """The law of a robot."""
        limits = np.array([robot.linear_acceleration, robot.angular_acceleration, robot.wheel_separation])
        return cls(dt, limits, robot.radius + SKIN, float(robot.radius), DiscBody.of(robot))


class WheelLaw(NamedTuple):
    """Random errors of the wheel odometry, which all robots have alike."""

    is_ideal: bool
    tick: float  # [m]; 0 for a continuous encoder
    slips: tuple[float, float, float]  # see slamgym.sim.wheel_odometry.slipped_arc


def put(table: Any, index: int, rows: np.ndarray) -> Any:
    """Write rows to the head of one environment's part of a table (N, capacity, ...); returns it, grown at need."""
    if len(rows) > table.shape[1]:
        larger = np.zeros(
            (len(table), max(len(rows), 2 * table.shape[1]), *table.shape[2:]), dtype=table.dtype
        )
        larger[:, : table.shape[1]] = table
        table = larger
    table[index, : len(rows)] = rows
    return table
