"""Trajectories in the TUM format: one ``stamp x y z qx qy qz qw`` per line, which evo and others read."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.files import read_text, write_text
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import BoolArray, FloatArray, Trajectory


def write_tum(path: Path | str, trajectory: Trajectory) -> None:
    """Write a planar trajectory (z and the x and y parts of the quaternion are 0).

    Raises:
        InputFileError: If the file can't be written.
    """
    half = 0.5 * trajectory.poses[:, 2]
    columns = (trajectory.stamps, trajectory.poses, np.sin(half), np.cos(half))
    lines = ["# timestamp x y z qx qy qz qw\n"]
    for stamp, (x, y, _), qz, qw in zip(*columns, strict=True):
        lines.append(f"{stamp:.6f} {x:.6f} {y:.6f} 0 0 0 {qz:.9f} {qw:.9f}\n")
    write_text(path, "".join(lines))


def write_doubt(
    path: Path | str, stamps: FloatArray, doubtful: BoolArray, covariances: FloatArray
) -> None:
    """Write what a trajectory file can't hold: where its poses are in doubt, and how far each may be off.

    A CSV file with a line for each of the trajectory's. Tools that read TUM files expect eight columns.

    Args:
        path: The file.
        stamps: (N,) [s].
        doubtful: (N,) true where the pose may be wrong.
        covariances: (N, 3, 3) of x, y [m] and theta [rad]; zero where nothing is known.

    Raises:
        InputFileError: If the file can't be written.
    """
    rows, cols = np.triu_indices(3)
    upper = covariances[:, rows, cols]
    lines = ["timestamp,doubtful,xx,xy,xt,yy,yt,tt\n"]
    for stamp, is_doubtful, row in zip(stamps, doubtful, upper.tolist(), strict=True):
        values = ",".join(f"{value:.9g}" for value in row)
        lines.append(f"{stamp:.6f},{int(is_doubtful)},{values}\n")
    write_text(path, "".join(lines))


def read_tum(path: Path | str) -> Trajectory:
    """Read a trajectory; of a rotation in space, the heading is taken.

    Raises:
        InputFileError: If the file is missing, a line has no eight finite numbers, or time goes backwards.
    """
    stamps: list[float] = []
    poses: list[tuple[float, float, float]] = []
    for where, (stamp, x, y, _, qx, qy, qz, qw) in rows_of_eight(path, "stamp x y z qx qy qz qw"):
        if stamps and stamp < stamps[-1]:
            raise InputFileError(where, "time goes backwards; sort the lines by their stamp")
        stamps.append(stamp)
        sine = 2.0 * (qw * qz + qx * qy)
        cosine = qw * qw + qx * qx - qy * qy - qz * qz
        yaw = math.atan2(sine, cosine)
        poses.append((x, y, wrap_angle(yaw)))
    return Trajectory(
        stamps=np.array(stamps, dtype=np.float64),
        poses=np.array(poses, dtype=np.float64).reshape(-1, 3),
    )


def rows_of_eight(path: Path | str, meaning: str) -> Iterator[tuple[str, list[float]]]:
    """The lines of a file of eight numbers each, separated by blanks or commas, with where they stand.

    Raises:
        InputFileError: If the file can't be read, or a line has no eight finite numbers.
    """
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        before_comment = line.split("#", 1)[0]
        fields = before_comment.replace(",", " ").split()
        where = f"{path}:{number}"
        if not fields:
            continue
        try:
            values = [float(field) for field in fields]
        except ValueError:
            values = []
        if len(values) != 8:
            raise InputFileError(where, f"is not a line of '{meaning}'; eight numbers are expected")
        if not all(map(math.isfinite, values)):
            raise InputFileError(where, "holds a value that is not finite")
        yield where, values
