"""What ``slamgym deform`` leaves on disk: one folder per hypothesis, complete or absent."""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from slamgym import __version__
from slamgym.core.config import to_dict
from slamgym.core.errors import InputFileError
from slamgym.interop.ros_map import write_ros_map
from slamgym.interop.tum import write_tum
from slamgym.parametric.model import Deformation
from slamgym.viz.deformation_pictures import overview


@contextmanager
def staged_folder(folder: Path, overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary folder to fill; move it to ``folder`` if the block ends well, else remove it.

    Raises:
        InputFileError: If the folder exists with something in it and ``overwrite`` is not set, or it can't be
            written.
    """
    if folder.exists() and not overwrite and (not folder.is_dir() or any(folder.iterdir())):
        raise InputFileError(folder, "exists already; give --overwrite to replace it")
    part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        part.mkdir(parents=True)
        yield part
        if folder.is_dir():
            shutil.rmtree(folder)
        part.replace(folder)
    except OSError as error:
        raise InputFileError(folder, f"can't be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write_deformation(folder: Path, result: Deformation, plan_id: str, seed: tuple[int, int]) -> None:
    """Write one hypothesis.

    ``map.pgm`` + ``map.yaml``: the SLAM-like map; ``cad.png``: the CAD map on the same frame; ``field.npz``:
    the displacement field (2, H, W) float32 [m], x and y, true minus measured, out(q) = in(q + d(q));
    ``true.tum``, ``odometry.tum``, ``believed.tum``: poses of the scans; ``parameters.json``: what was drawn,
    the settings, the seed; ``overview.png``: all of it to look at.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_ros_map(folder, result.grid)
    cv2.imwrite(str(folder / "cad.png"), result.cad.cells)
    cv2.imwrite(str(folder / "overview.png"), overview(result))
    np.savez_compressed(folder / "field.npz", field=result.field)
    for name in ("true", "odometry", "believed"):
        write_tum(folder / f"{name}.tum", getattr(result, name))
    record = {
        "plan": plan_id,
        "seed": list(seed),
        "version": __version__,
        "parameters": result.parameters,
        "config": to_dict(result.config),
        "displacement_m": displacement_summary(result),
    }
    (folder / "parameters.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def displacement_summary(result: Deformation) -> dict[str, float]:
    """How far the map's walls lie from their place: rms, 95th percentile and largest [m]."""
    walls = result.grid.cells == 0
    length = np.hypot(*result.field)[walls]
    if len(length) == 0:
        return {"rms": 0.0, "p95": 0.0, "max": 0.0}
    return {
        "rms": float(np.sqrt(np.mean(length**2))),
        "p95": float(np.percentile(length, 95)),
        "max": float(length.max()),
    }
