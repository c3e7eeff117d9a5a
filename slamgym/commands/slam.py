"""``slamgym slam``: a recorded log in, a ROS map, a trajectory and a picture out."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from slamgym import __version__
from slamgym.core.config import Arguments, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import write_text
from slamgym.core.progress import counted, say, tell
from slamgym.core.types import FloatArray, Trajectory
from slamgym.slam.config import Matcher, Mode, SlamConfig

if TYPE_CHECKING:
    from slamgym.core.types import OccupancyGrid
    from slamgym.interop.logs import Relations
    from slamgym.interop.records import Log
    from slamgym.metrics import RelationError
    from slamgym.slam.mapper import Mapper
    from slamgym.slam.replay import ReplayResult
    from slamgym.viz.films import ShowPicture


class SlamArguments(Arguments):
    """Make a map from a recorded log."""

    log: tyro.conf.Positional[Path]
    """CARMEN log (.log, .clf, also .gz), ROS bag (.bag, .mcap, .db3 or a rosbag2 folder), or the folder of an
    episode that `slamgym generate` wrote."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for map.pgm, map.yaml, map.png, trajectory.tum, trajectory_doubt.csv and summary.json."""

    mode: Mode = "pose_graph"
    """pose_graph: one path, whose loops are closed; rbpf: GMapping's particle filter; scan_matching, dead_reckoning:
    what these would be without."""

    particles: int | None = None
    """Number of particles (rbpf); 30 by default."""

    seed: int = 0
    """The same seed gives the same map."""

    continue_: Annotated[Path | None, tyro.conf.arg(name="continue")] = None
    """Go on with a finished map: a ROS map or the folder of an earlier run. The log must find itself on it."""

    relations: Path | None = None
    """File of reference relations (t1 t2 x y z roll pitch yaw): prints the errors over them."""

    watch: bool = False
    """Show the map growing in a window (needs slamgym[human])."""

    video: Path | None = None
    """Write a film of the map growing: a name that ends in .mp4 or .gif."""

    scan_topic: str | None = None
    """ROS bags: the LaserScan topic. By default /scan or the one with most messages."""

    odometry_topic: str | None = None
    """ROS bags: the Odometry topic. By default /odom or the one with most messages, else tf."""

    settings: Path | None = None
    """JSON file with any settings of the mapper, e.g. {"sigma": 0.05}."""

    resolution: float | None = None
    """Cell size of the map [m]."""

    max_usable_range: float | None = None
    """Longer returns are not matched [m]. By default from the laser's range."""

    linear_update: float | None = None
    """Process a scan after this distance [m]."""

    angular_update: float | None = None
    """Process a scan after this turn [rad]."""

    matcher: Matcher | None = None
    """Scan matcher; hill_climbing is GMapping's own, slower."""


MAX_FRAMES, MAX_PATHS = 600, 30
FRAMES_PER_SECOND = 20.0
"""Of the film; paths are those of particles that a picture shows."""

OVERRIDES = ("particles", "resolution", "max_usable_range", "linear_update", "angular_update", "matcher")


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(SlamArguments, args=argv, prog="slamgym slam")
    from slamgym.interop.logs import open_log, read_relations, read_truth

    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputFileError(arguments.out, "is a file; name a folder for the results")
    relations = read_relations(arguments.relations) if arguments.relations is not None else None
    log = open_log(arguments.log, scan_topic=arguments.scan_topic, odometry_topic=arguments.odometry_topic)
    truth = read_truth(arguments.log)
    for sentence in log.warnings.sentences():
        say(f"slamgym: warning: {sentence}")
    older = _older_map(arguments)
    config = _config(arguments, log, older)
    result = _replay(arguments, log, config, older)
    accuracy = _accuracy(result, relations, truth)
    summary = _summary(arguments, log, config, result, accuracy)
    _write(arguments.out, result, summary)
    tell(*_report(arguments.out, summary).splitlines())
    return 0


def _older_map(arguments: SlamArguments) -> OccupancyGrid | None:
    """The map to continue."""
    from slamgym.interop.map_files import read_map

    if arguments.continue_ is None:
        return None
    older = read_map(arguments.continue_)
    if older.placement.theta != 0.0:
        raise ConfigError(
            f"--continue {arguments.continue_}: the map is turned by {older.placement.theta:g} rad, and maps are drawn "
            "upright; turn its image and set the yaw to 0"
        )
    return older.grid


def _config(arguments: SlamArguments, log: Log, older: OccupancyGrid | None) -> SlamConfig:
    from slamgym.slam.replay import read_overrides, settings_for

    overrides: dict[str, Any] = {} if older is None else {"resolution": older.frame.resolution}
    if arguments.settings is not None:
        overrides |= read_overrides(arguments.settings)
    overrides["mode"] = arguments.mode
    for name in OVERRIDES:
        if getattr(arguments, name) is not None:
            overrides[name] = getattr(arguments, name)
    if arguments.mode == "ground_truth":
        raise ConfigError(
            "--mode ground_truth is for simulation; a log holds no true poses (try dead_reckoning)"
        )
    if arguments.mode == "map":
        raise ConfigError(
            "--mode map makes no map; use slamgym localize MAP LOG, or --continue MAP to go on with one"
        )
    return settings_for(log.geometry, overrides)


def _replay(
    arguments: SlamArguments, log: Log, config: SlamConfig, older: OccupancyGrid | None
) -> ReplayResult:
    """Replay with a progress bar and whatever view was asked for."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from slamgym.slam.localization.logs import continue_map
    from slamgym.slam.replay import replay
    from slamgym.viz.films import open_film
    from slamgym.viz.window import Window

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with ExitStack() as stack:
        screens: list[ShowPicture] = []
        if arguments.video is not None:
            screens.append(stack.enter_context(open_film(arguments.video, FRAMES_PER_SECOND)))
        if arguments.watch:
            window = stack.enter_context(closing(Window(f"slamgym slam {arguments.log.name}")))
            screens.append(window.show)
        console = Console(stderr=True)
        progress = stack.enter_context(Progress(*columns, console=console, disable=not console.is_terminal))
        task = progress.add_task(f"{config.mode} {arguments.log.name}", total=len(log))
        show = _viewer(screens, len(log))

        def on_scan(index: int, mapper: Mapper, is_processed: bool) -> None:
            progress.update(task, completed=index + 1)
            show(index, mapper, is_processed)

        rng = np.random.default_rng(arguments.seed)
        if older is not None:
            return continue_map(log, older, config, rng, on_scan)
        return replay(log, config, rng, on_scan)


def _viewer(screens: list[ShowPicture], total: int) -> Callable[[int, Mapper, bool], None]:
    """What to call after each scan; it draws a frame now and then, and the last one for a while."""
    from slamgym.slam.particle_filter import ParticleFilter
    from slamgym.viz.map_pictures import GrowingView

    view = GrowingView()
    every = math.ceil(total / MAX_FRAMES)

    def show(index: int, mapper: Mapper, is_processed: bool) -> None:
        del is_processed
        last = index == total - 1
        if not screens or (index % every != 0 and not last):
            return
        paths = [mapper.trajectory().poses]
        if isinstance(mapper, ParticleFilter):
            paths += mapper.particle_paths(MAX_PATHS)
        caption = f"scan {index + 1} of {total}   N_eff {mapper.n_eff:.1f}"
        picture = view.draw(mapper.occupancy_grid(), paths, caption)
        for screen in screens:
            for _ in range(40 if last else 1):
                screen(picture)

    return show


def _accuracy(result: ReplayResult, relations: Relations | None, truth: Trajectory | None) -> dict[str, Any]:
    from slamgym.metrics import absolute_trajectory_error, relation_error, relative_pose_error

    accuracy: dict[str, Any] = {}
    if relations is not None:
        try:
            accuracy["relations"] = _relation_summary(relation_error(result.moments, *relations))
        except ValueError as problem:
            raise ConfigError(f"--relations: {problem}") from problem
        with suppress(ValueError):  # no place was passed twice
            accuracy["relations_of_revisits"] = _relation_summary(
                relation_error(result.moments, *relations, revisits=True)
            )
        with suppress(ValueError):  # no moment is a scan's
            accuracy["relations_at_scans"] = _relation_summary(relation_error(result.trajectory, *relations))
    if truth is not None:
        aligned = absolute_trajectory_error(result.trajectory, truth)
        plain = absolute_trajectory_error(result.trajectory, truth, align=False)
        accuracy["truth"] = {
            "ate_rmse_m": aligned.translation.rmse,
            "ate_unaligned_rmse_m": plain.translation.rmse,
            "ate_rotation_rmse_deg": float(np.degrees(aligned.rotation.rmse)),
        }
        if truth.length > 2.0:
            relative = relative_pose_error(result.trajectory, truth, delta=1.0)
            accuracy["truth"]["rpe_per_metre_rmse_m"] = relative.translation.rmse
    return accuracy


def _relation_summary(error: RelationError) -> dict[str, float]:
    return {
        "translation_mean_m": error.translation.mean,
        "translation_deviation_m": error.translation.deviation,
        "rotation_mean_deg": float(np.degrees(error.rotation.mean)),
        "rotation_deviation_deg": float(np.degrees(error.rotation.deviation)),
        "count": error.translation.count,
        "missing": error.missing,
    }


def _summary(
    arguments: SlamArguments, log: Log, config: SlamConfig, result: ReplayResult, accuracy: dict[str, Any]
) -> dict[str, Any]:
    stats = result.stats
    frame = result.grid.frame
    return {
        "version": __version__,
        "log": str(arguments.log),
        "continued": None if arguments.continue_ is None else str(arguments.continue_),
        "seed": arguments.seed,
        "scans": len(log),
        "processed_scans": stats.processed,
        "log_seconds": log.duration,
        "path_length_m": result.trajectory.length,
        "map_size_m": [frame.width_px * frame.resolution, frame.height_px * frame.resolution],
        "cpu_seconds": stats.cpu_seconds,
        "cpu_ms_per_processed_scan": stats.cpu_ms_per_processed_scan,
        "wall_seconds": result.wall_seconds,
        "map_memory_bytes": stats.memory_bytes,
        "peak_memory_bytes": result.peak_memory_bytes,
        "resamplings": stats.resamplings,
        "refused_matches": stats.refused_matches,
        "recovered_matches": stats.recovered_matches,
        "doubtful_scans": len(stats.doubtful),
        "doubtful_stamps": [round(stamp, 6) for stamp in stats.doubtful],
        **accuracy,
        **result.extra,
        "warnings": dict(sorted(log.warnings.counts.items())),
        "config": to_dict(config),
        "n_eff": [round(value, 3) for value in stats.n_eff],
    }


def _write(folder: Path, result: ReplayResult, summary: dict[str, Any]) -> None:
    """Write the results; the summary goes last, so where it exists everything else is complete."""
    from slamgym.interop.ros_map import write_ros_map
    from slamgym.interop.tum import write_doubt, write_tum
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.map_pictures import draw_map

    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.json").unlink(missing_ok=True)
    except OSError as error:
        raise InputFileError(folder, f"can't be written ({error.strerror or error})") from error
    write_ros_map(folder, result.grid)
    write_tum(folder / "trajectory.tum", result.trajectory)
    stamps = result.trajectory.stamps
    write_doubt(folder / "trajectory_doubt.csv", stamps, result.doubtful, result.covariances)
    caption = f"{Path(summary['log']).name}   {summary['config']['mode']}   {summary['path_length_m']:.0f} m"
    write_picture(
        folder / "map.png", draw_map(result.grid, result.trajectory.poses, caption, _doubtful_poses(result))
    )
    write_text(folder / "summary.json", json.dumps(summary, indent=1) + "\n")


def _doubtful_poses(result: ReplayResult) -> FloatArray:
    """Where the path may be wrong, (D, 3)."""
    return result.trajectory.poses[np.isin(result.trajectory.stamps, result.stats.doubtful)]


def _report(folder: Path, summary: dict[str, Any]) -> str:
    lines = [
        f"{summary['log']}: {counted(summary['scans'], 'scan')}, {summary['path_length_m']:.0f} m, "
        f"map {summary['map_size_m'][0]:.0f} x {summary['map_size_m'][1]:.0f} m",
        f"  {summary['config']['mode']}: {counted(summary['processed_scans'], 'scan')} processed in "
        f"{summary['cpu_seconds']:.1f} CPU s, {summary['cpu_ms_per_processed_scan']:.2f} ms each; "
        f"{counted(summary['resamplings'], 'resampling')}; maps {summary['map_memory_bytes'] / 1e6:.0f} MB",
    ]
    if summary["doubtful_scans"]:
        lines.append(
            f"  scans that fit poorly whatever was tried: {summary['doubtful_scans']}; the path may be wrong there "
            "(red crosses in map.png, doubtful_stamps in summary.json, trajectory_doubt.csv)"
        )
    if "loop_closures" in summary:
        lines.append(f"  loop closures: {summary['loop_closures']}")
    for key, moments in (
        ("relations", "all"),
        ("relations_of_revisits", "revisits"),
        ("relations_at_scans", "at the nearest scan within 0.1 s"),
    ):
        if key in summary:
            r = summary[key]
            lines.append(
                f"  relations, {moments}: "
                f"{r['translation_mean_m']:.4f} +- {r['translation_deviation_m']:.4f} m, "
                f"{r['rotation_mean_deg']:.2f} +- {r['rotation_deviation_deg']:.2f} deg "
                f"(mean +- deviation of {r['count']} of {r['count'] + r['missing']})"
            )
    if "truth" in summary:
        t = summary["truth"]
        lines.append(
            f"  against the truth: ATE {t['ate_rmse_m']:.3f} m after alignment, "
            f"{t['ate_unaligned_rmse_m']:.3f} m without"
        )
    lines.append(f"  {folder / 'map.png'}")
    return "\n".join(lines) + "\n"
