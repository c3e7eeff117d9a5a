"""Trajectories in the TUM format: one ``stamp x y z qx qy qz qw`` per line, which evo and others read."""

import math
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
    lines = [
        f"{stamp:.6f} {x:.6f} {y:.6f} 0 0 0 {qz:.9f} {qw:.9f}\n"
        for stamp, (x, y, _), qz, qw in zip(
            trajectory.stamps, trajectory.poses, np.sin(half), np.cos(half), strict=True
        )
    ]
    write_text(path, "# timestamp x y z qx qy qz qw\n" + "".join(lines))


def write_doubt(path: Path | str, stamps: FloatArray, doubtful: BoolArray, covariances: FloatArray) -> None:
    """Write what a trajectory file can't hold: where its poses are in doubt, and how far each may be off.

    A CSV file with a line for each of the trajectory's. Tools that read TUM files expect eight columns.

    Args:
        path: The file.
        stamps: (N,) [s].
        doubtful: (N,) whether the pose may be wrong.
        covariances: (N, 3, 3) of x, y [m] and theta [rad]; zero where nothing is known.

    Raises:
        InputFileError: If the file can't be written.
    """
    rows, cols = np.triu_indices(3)
    upper = covariances[:, rows, cols]
    lines = [
        f"{stamp:.6f},{int(doubt)},{','.join(f'{value:.9g}' for value in row)}\n"
        for stamp, doubt, row in zip(stamps, doubtful, upper.tolist(), strict=True)
    ]
    write_text(path, "timestamp,doubtful,xx,xy,xt,yy,yt,tt\n" + "".join(lines))


def read_tum(path: Path | str) -> Trajectory:
    """Read a trajectory; of a rotation in space, the heading is taken.

    Raises:
        InputFileError: If the file is missing, a line has no eight finite numbers, or time goes backwards.
    """
    text = read_text(path)
    stamps: list[float] = []
    poses: list[tuple[float, float, float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split("#", 1)[0].replace(",", " ").split()
        if not fields:
            continue
        try:
            stamp, x, y, _, qx, qy, qz, qw = (float(field) for field in fields)
        except ValueError as error:
            raise InputFileError(
                f"{path}:{number}", "is not a line of 'stamp x y z qx qy qz qw'; eight numbers are expected"
            ) from error
        if not all(math.isfinite(value) for value in (stamp, x, y, qx, qy, qz, qw)):
            raise InputFileError(f"{path}:{number}", "holds a value that is not finite")
        if stamps and stamp < stamps[-1]:
            raise InputFileError(f"{path}:{number}", "time goes backwards; sort the lines by their stamp")
        stamps.append(stamp)
        yaw = math.atan2(2.0 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)
        poses.append((x, y, wrap_angle(yaw)))
    return Trajectory(np.array(stamps, dtype=np.float64), np.array(poses, dtype=np.float64).reshape(-1, 3))
