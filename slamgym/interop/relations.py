"""Reference relations of the SLAM benchmark: one ``t1 t2 x y z roll pitch yaw`` per line."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgym.core.errors import InputFileError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray


class Relations(NamedTuple):
    """Known relative poses between moments of a log."""

    start_stamps: FloatArray  # (N,) [s]
    end_stamps: FloatArray  # (N,) [s]
    relative: FloatArray  # (N, 3), pose at the end seen from the pose at the start


def read_relations(path: Path | str) -> Relations:
    """Read a relations file.

    Raises:
        InputFileError: If the file is missing or empty, or a line has no eight finite numbers.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputFileError(path, f"can't be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise InputFileError(path, "is not a text file; a relations file is expected") from error
    rows: list[tuple[float, float, float, float, float]] = []
    for number, line in enumerate(lines, start=1):
        fields = line.split("#", 1)[0].split()
        if not fields:
            continue
        try:
            start, end, x, y, z, roll, pitch, yaw = (float(field) for field in fields)
        except ValueError as error:
            raise InputFileError(
                f"{path}:{number}",
                "is not a line of 't1 t2 x y z roll pitch yaw'; eight numbers are expected",
            ) from error
        if not all(math.isfinite(value) for value in (start, end, x, y, z, roll, pitch, yaw)):
            raise InputFileError(f"{path}:{number}", "holds a value that is not finite")
        rows.append((start, end, x, y, wrap_angle(yaw)))
    if not rows:
        raise InputFileError(path, "holds no relation")
    table = np.array(rows, dtype=np.float64)
    return Relations(table[:, 0], table[:, 1], table[:, 2:])
