"""The state of many robots as arrays, one row an environment, as the kernels take it."""

from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from slamgym.core.types import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from slamgym.sim.beams import BeamModel
from slamgym.sim.contact import SKIN
from slamgym.sim.robot import RobotConfig
from slamgym.slam.hit_count_kernels import BeamTable

PLACE = 0.5
"""Side of a place whose visits are counted [m]: a little more than the robot."""


_T = TypeVar("_T")


def _numbers(*shape: int) -> FloatArray:
    """A table of zeros."""
    return np.zeros(shape)


def _integers(*shape: int) -> IntArray:
    """A table of whole zeros."""
    return np.zeros(shape, dtype=np.int64)


def _flags(*shape: int) -> BoolArray:
    """A table of flags, none of them set."""
    return np.zeros(shape, dtype=np.bool_)


class Robots(NamedTuple):
    """Bodies and wheels; poses are true."""

    drive: FloatArray  # (N, 8) drive states, see slamgym.sim.motion
    pose: FloatArray  # (N, 3) world frame
    start: FloatArray  # (N, 3) world frame
    driven: FloatArray  # (N, 3) true motion of this step, seen from before it
    odometry: FloatArray  # (N, 3) integrated by the wheels, map frame
    moved: FloatArray  # (N, 3) motion of this step by the wheels, seen from before it
    velocity: FloatArray  # (N, 2) measured [m/s, rad/s]
    rolled: FloatArray  # (N, 2) what the encoders counted [m]
    wheels: FloatArray  # (N, 3) gains of the left and right encoder, believed wheel base [m]
    slips: FloatArray  # (N, 3) standard normal draws of this step
    path: FloatArray  # (N,) [m]
    left: FloatArray  # (N,) time of the step that was left when something was touched [s]
    steps: IntArray  # (N,) since the episode began
    collisions: IntArray  # (N,) contacts begun
    place: IntArray  # (N,) the place that the robot is in
    revisits: IntArray  # (N,) earlier visits of the place to which this step has led
    contact: BoolArray  # (N,) the last step had contact
    exact: BoolArray  # (N,) scans without errors

    @classmethod
    def rest(cls, count: int) -> "Robots":
        """So many robots at rest."""
        return cls(
            drive=_numbers(count, 8),
            pose=_numbers(count, 3),
            start=_numbers(count, 3),
            driven=_numbers(count, 3),
            odometry=_numbers(count, 3),
            moved=_numbers(count, 3),
            velocity=_numbers(count, 2),
            rolled=_numbers(count, 2),
            wheels=_numbers(count, 3),
            slips=_numbers(count, 3),
            path=_numbers(count),
            left=_numbers(count),
            steps=_integers(count),
            collisions=_integers(count),
            place=_integers(count),
            revisits=_integers(count),
            contact=_flags(count),
            exact=_flags(count),
        )


class Scenes(NamedTuple):
    """Objects that the robots touch and see; each table has a number of rows that count."""

    segments: FloatArray  # (N, S, 4) [m]
    discs: FloatArray  # (N, D, 3) people and other robots: x, y, radius [m]
    patches: FloatArray  # (N, P, 5)
    outside: FloatArray  # (N, K, 4) [m]
    roughness: FloatArray  # (N,) [m]
    shares: FloatArray  # (N,) of the reachable floor that were seen
    floor_corner: FloatArray  # (N, 2) lower left corner [m]
    first: IntArray  # (N, F) where each segment's patches begin, see slamgym.sim.surfaces
    num_obstacles: IntArray  # (N,) segments that can be touched, the first ones
    num_segments: IntArray  # (N,)
    num_discs: IntArray  # (N,)
    num_first: IntArray  # (N,)
    num_patches: IntArray  # (N,)
    num_outside: IntArray  # (N,)
    materials: IntArray  # (N, 2) number of walls, and the seed of what varies with the place
    floor_shape: IntArray  # (N, 2) rows and columns
    seen: IntArray  # (N,) cells seen
    floor_cells: IntArray  # (N,) cells of the floor
    visits: IntArray  # (N, places) how often the robot has come to each, row by row
    unseen: BoolArray  # (N, cells) floor still to be seen, row by row

    @classmethod
    def empty(cls, count: int) -> "Scenes":
        """Room for so many scenes; the tables grow with what is put into them."""
        return cls(
            segments=_numbers(count, 0, 4),
            discs=_numbers(count, 0, 3),
            patches=_numbers(count, 0, 5),
            outside=_numbers(count, 0, 4),
            roughness=_numbers(count),
            shares=np.ones(count),
            floor_corner=_numbers(count, 2),
            first=_integers(count, 0),
            num_obstacles=_integers(count),
            num_segments=_integers(count),
            num_discs=_integers(count),
            num_first=_integers(count),
            num_patches=_integers(count),
            num_outside=_integers(count),
            materials=_integers(count, 2),
            floor_shape=_integers(count, 2),
            seen=_integers(count),
            floor_cells=_integers(count),
            visits=_integers(count, 0),
            unseen=_flags(count, 0),
        )


class ScanModel(NamedTuple):
    """Common properties of all scanners."""

    law: BeamModel
    mount: tuple[float, float, float]  # in the base frame [m, m, rad]
    directions: FloatArray  # (num_beams, 2) in the sensor frame
    range_min: float  # [m]
    lost: float
    stray: float
    usable: float  # how far coverage follows a beam [m]
    sweep: float  # share of a step that a scan takes


class Scans(NamedTuple):
    """Draws and ranges of the newest scans."""

    normal: FloatArray  # (N, 2, num_beams) standard normal draws
    fate: FloatArray  # (N, 2, num_beams + 1) even draws
    pulses: FloatArray  # (N, most) the ranges that a burst of cross-talk makes [m]
    true: FloatArray  # (N, num_beams) without errors, from where the robots are now [m]
    burst: IntArray  # (N, 2) first beam and number of beams that a burst hits
    ranges: Float32Array  # (N, num_beams) measured [m]

    @classmethod
    def blank(cls, count: int, num_beams: int, longest_burst: int) -> "Scans":
        """So many scans not taken yet."""
        return cls(
            normal=_numbers(count, 2, num_beams),
            fate=_numbers(count, 2, num_beams + 1),
            pulses=_numbers(count, longest_burst),
            true=_numbers(count, num_beams),
            burst=_integers(count, 2),
            ranges=np.zeros((count, num_beams), dtype=np.float32),
        )


class Maps(NamedTuple):
    """Beliefs of robots with known poses: path and hit counts, see slamgym.slam.PoseTracker."""

    last: FloatArray  # (N, 3) odometry of the last scan
    processed: FloatArray  # (N, 3) odometry of the last processed scan
    anchor: FloatArray  # (N, 3) estimate at the last processed scan
    since: FloatArray  # (N, 3) stamp of the last processed scan [s]; distance [m] and turn [rad]
    believed: FloatArray  # (N, 3) estimate now
    shape: IntArray  # (N, 2) rows and columns, multiples of four
    corner: IntArray  # (N, 2) row and column of the lattice where they begin, multiples of four
    known: IntArray  # (N, 4) rows and columns, half open, beyond which all is unknown
    begun: BoolArray  # (N,) a scan was taken
    is_new: BoolArray  # (N,) the newest scan was processed
    counts: np.ndarray  # (N, cells, 2) int32 hits and visits, row by row, row 0 at the bottom
    cells: ByteArray  # (N, cells) the map as it is shown

    @classmethod
    def blank(cls, count: int) -> "Maps":
        """So many maps without any cell."""
        return cls(
            last=_numbers(count, 3),
            processed=_numbers(count, 3),
            anchor=_numbers(count, 3),
            since=_numbers(count, 3),
            believed=_numbers(count, 3),
            shape=_integers(count, 2),
            corner=_integers(count, 2),
            known=_integers(count, 4),
            begun=_flags(count),
            is_new=_flags(count),
            counts=np.zeros((count, 0, 2), dtype=np.int32),
            cells=np.zeros((count, 0), dtype=np.uint8),
        )


class MapModel(NamedTuple):
    """Settings of map drawing, and when it is done."""

    beams: BeamTable
    resolution: float  # [m]
    threshold: float
    min_passes: int
    updates: tuple[float, float, float]  # see slamgym.slam.motion_model.update_thresholds
    believes_truth: bool  # else the wheels
    keeps_current: bool  # shown cells follow every processed scan, else they wait for a publication


class DriveModel(NamedTuple):
    """Common properties of all robots' drives and bodies."""

    dt: float  # duration of a step [s]
    limits: FloatArray  # accelerations and wheel separation, shape (3,)
    radius: float  # of the body with its skin [m]

    @classmethod
    def of(cls, robot: RobotConfig, dt: float) -> "DriveModel":
        """The model of a robot."""
        limits = [robot.linear_acceleration, robot.angular_acceleration, robot.wheel_separation]
        return cls(dt=dt, limits=np.array(limits), radius=robot.radius + SKIN)


class WheelModel(NamedTuple):
    """Random errors of the wheel odometry, which all robots have alike."""

    is_ideal: bool
    tick: float  # [m]; 0 for a continuous encoder
    slips: tuple[float, float, float]  # see slamgym.sim.wheel_odometry.slipped_arc


def bare(record: _T) -> _T:
    """A named tuple without its names, which numba recognises in a fifth of the time."""
    return cast(_T, cast(tuple[Any, ...], record)[:])


def put(table: Any, index: int, rows: np.ndarray) -> Any:
    """Write rows to the head of one environment's part of a table (N, capacity, ...); returns it, grown at need."""
    count, capacity, *shape = table.shape
    if len(rows) > capacity:
        larger_capacity = max(len(rows), 2 * capacity)
        larger = np.zeros((count, larger_capacity, *shape), dtype=table.dtype)
        larger[:, :capacity] = table
        table = larger
    table[index, : len(rows)] = rows
    return table
