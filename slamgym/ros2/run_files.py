"""The files of a mapper's run: what an earlier run left in the folder is put aside, never overwritten."""

import itertools
from collections.abc import Sequence
from pathlib import Path

from slamgym.core.files import storage_errors

LOG = "log.carmen.gz"
"""Name of the log: what `slamgym slam` maps again."""
TRAJECTORY = "trajectory.tum"
MAP = "map.yaml"
OF_A_DRIVE = (LOG, TRAJECTORY)
"""What is written of a drive, on a finished map, too."""
OF_A_MAP = (*OF_A_DRIVE, MAP, "map.pgm", "drawing")
"""What is written where a map is made."""


def put_files_aside(out: Path, names: Sequence[str]) -> Path | None:
    """Move files into the first of the folders run1, run2, ... that is free; returns it, or None if there are none.

    Raises:
        StorageError: If they can't be moved.
    """
    found = [name for name in names if (out / name).exists()]
    if not found:
        return None
    runs = (out / f"run{number}" for number in itertools.count(1))
    folder = next(path for path in runs if not path.exists())
    with storage_errors(folder):
        folder.mkdir(parents=True)
        for name in found:
            (out / name).replace(folder / name)
    return folder
