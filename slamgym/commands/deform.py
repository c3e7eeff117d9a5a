"""``slamgym deform``: from a floor plan to the maps that SLAM would have drawn of it."""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro

from slamgym import __version__
from slamgym.core.config import Arguments, Count, CountOrZero, Within, suggest, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.types import GridFrame
from slamgym.parametric.config import ConversionMethod, ParametricConfig, preset

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

if TYPE_CHECKING:
    from slamgym.parametric.model import Deformation
    from slamgym.parametric.trajectory import TimedTrajectory

"""(plan, explorer's name, seed, explorer factory) -> the true path that the explorer drove, world frame."""


class DeformArguments(Arguments):
    """Turn a floor plan and a trajectory into SLAM-like maps with their displacement fields.

    Without --trajectory or --explorer, a path through all rooms is planned over a probabilistic roadmap.
    """

    plan: tyro.conf.Positional[str]
    """A floor plan (HouseExpo JSON, ROS map, image), a folder or archive of plans, bundled or procedural."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder to make; one subfolder per sample."""

    plan_id: str | None = None
    """Which plan of a folder or archive; the first by default."""

    trajectory: Path | None = None
    """The true path: a .csv of waypoints x,y[,t] or a .tum of poses, in the world frame of the plan."""

    prm: bool = False
    """Plan a path over a probabilistic roadmap (the default)."""

    prm_kind: Literal["tour", "pair"] = "tour"
    """Through all rooms, or between two random points as in the paper."""

    explorer: str | None = None
    """Let this explorer drive the simulated robot, and take its path."""

    method: ConversionMethod = "two_phase"
    """How odometry errors become map errors."""

    preset: Literal["faithful", "realistic"] = "faithful"
    """faithful: the paper's model, corrected; realistic: tuned to look like simulated SLAM maps."""

    severity: float = 1.0
    """Multiplies every error magnitude; 0 gives the CAD map back where the robot looked."""

    samples: Annotated[Count, tyro.conf.arg(aliases=["-n"])] = 1
    """Number of hypotheses; each draws its own robot and, unless a file gives it, its own path."""

    seed: CountOrZero = 0
    """Equal seeds give equal bytes."""

    resolution: float = 0.05
    """[m/px]"""

    size: Literal[0] | Annotated[int, Within(ge=16)] = 0
    """Side of the square map [px]; the resolution follows from the plan. 0 leaves the resolution as given."""

    calibration: Path | None = None
    """Coefficients of the two phases that `slamgym calibrate-odometry` measured."""

    overwrite: bool = False
    """Replace the folder if it exists."""

    def _check(self) -> None:
        given = [f"--{name}" for name in ("trajectory", "prm", "explorer") if getattr(self, name)]
        if len(given) > 1:
            raise ConfigError(f"{' and '.join(given)} exclude each other; give one")


def main(argv: list[str]) -> int:
    """Run the command.

    Args:
        argv: Arguments after the command's name.

    Returns:
        The exit code.

    Raises:
        SlamgymError: If something is wrong that the user can fix; nothing is left half written.
    """
    arguments = tyro.cli(DeformArguments, args=argv, prog="slamgym deform")
    from slamgym.parametric.model import deform
    from slamgym.parametric.paths import trajectory_from_file

    plan = _load_plan(arguments)
    config = _config(arguments)
    frame = _square_frame(plan, config, arguments.size) if arguments.size else None
    if frame is not None:
        config = replace(config, resolution=frame.resolution)
    fixed = trajectory_from_file(arguments.trajectory, plan, config.motion) if arguments.trajectory else None
    begun = time.perf_counter()
    with staged_folder(arguments.out, arguments.overwrite) as folder:
        for i in range(arguments.samples):
            rng = np.random.default_rng([arguments.seed, i])
            path = fixed
            if path is None:
                path = _path(arguments, plan, config, rng, i)
            result = deform(plan, path, config, rng, frame)
            write_deformation(folder / f"{i:03d}", result, plan.id, (arguments.seed, i))
            moved = displacement_summary(result)
            sys.stdout.write(
                f"{i:03d}: {result.true.length:.1f} m driven, {len(result.true)} scans, walls displaced "
                f"{moved['rms']:.3f} m rms, {moved['max']:.3f} m at most, "
                f"{sum(result.seconds.values()):.2f} s\n"
            )
    sys.stdout.write(
        f"{arguments.samples} map(s) of {plan.id} in {time.perf_counter() - begun:.1f} s: {arguments.out}\n"
    )
    return 0


def _load_plan(arguments: DeformArguments) -> FloorPlan:
    from slamgym.cad.sources import open_plans

    source = open_plans(arguments.plan)
    plan_id = arguments.plan_id if arguments.plan_id is not None else source.ids[0]
    if plan_id not in source.ids:
        raise ConfigError(f"{arguments.plan} has no plan {plan_id!r}; {suggest(plan_id, source.ids)}")
    return source.load(plan_id)


def _config(arguments: DeformArguments) -> ParametricConfig:
    config = replace(
        preset(arguments.preset),
        method=arguments.method,
        severity=arguments.severity,
        resolution=arguments.resolution,
    )
    if arguments.calibration is not None:
        from slamgym.parametric.calibration import read_calibration

        config = replace(config, two_phase=read_calibration(arguments.calibration, config.two_phase))
    return config


def _square_frame(plan: FloorPlan, config: ParametricConfig, size_px: int) -> GridFrame:
    """A square grid of ``size_px`` that holds the plan and its margin, the plan in the middle."""
    min_x, min_y, max_x, max_y = plan.bounds
    side = max(max_x - min_x, max_y - min_y) + 2.0 * config.margin
    return GridFrame(
        resolution=side / size_px,
        origin_x=0.5 * (min_x + max_x - side),
        origin_y=0.5 * (min_y + max_y - side),
        height_px=size_px,
        width_px=size_px,
    )


def _path(
    arguments: DeformArguments,
    plan: FloorPlan,
    config: ParametricConfig,
    rng: np.random.Generator,
    index: int,
) -> TimedTrajectory:
    from slamgym.parametric.paths import plan_trajectory
    from slamgym.parametric.trajectory import from_recorded

    if arguments.explorer is None:
        return plan_trajectory(plan, config.motion, rng, arguments.prm_kind)
    from slamgym.agents.registry import make_explorer
    from slamgym.envs.episode import record_path

    recorded = record_path(plan, arguments.explorer, arguments.seed + index, make_explorer)
    return from_recorded(recorded, f"the path of {arguments.explorer}")


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
    import cv2

    from slamgym.interop.ros_map import write_ros_map
    from slamgym.interop.tum import write_tum
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.sheets import draw_deformation

    folder.mkdir(parents=True, exist_ok=True)
    write_ros_map(folder, result.grid)
    cv2.imwrite(str(folder / "cad.png"), result.cad.cells)
    overview = draw_deformation(
        result.cad, result.grid, result.field, result.true.poses, result.believed.poses
    )
    write_picture(folder / "overview.png", overview)
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
