"""``slamgym slam``: a recorded log in, a ROS map, a trajectory and a picture out."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from slamgym.commands.frame import (
    Out,
    begin_results,
    end_results,
    open_window,
    require_folder,
    spare_maps,
)
from slamgym.commands.log_input import LogAndOut, LogReading, checked_log, faults_of
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Count, Seed, to_dict
from slamgym.core.errors import ConfigError
from slamgym.core.progress import counted, show_progress
from slamgym.slam.config import Mode, SlamConfig

if TYPE_CHECKING:
    from slamgym.core.types import Trajectory
    from slamgym.interop.logs import Relations
    from slamgym.interop.records import Log
    from slamgym.slam.mapper import Mapper
    from slamgym.slam.merge.merging import Part
    from slamgym.slam.replay import ReplayResult
    from slamgym.viz.films import ShowPicture


class SlamArguments(LogReading, LogAndOut):
    """Make a map from a recorded log."""

    out: Out
    """Folder for map.pgm, map.yaml, map.png, trajectory.tum, trajectory_doubt.csv, graph.g2o, scans.npz and
    summary.json."""

    mode: Mode | None = None
    """pose_graph, the default: one path, whose loops are closed; rbpf: GMapping's particle filter; dead_reckoning: what
    these would be without."""

    particles: Count | None = None
    """Number of particles (rbpf); 30 by default; 1 is scan matching."""

    seed: Seed = 0
    """The same seed gives the same map."""

    continue_: Annotated[Path | None, tyro.conf.arg(name="continue")] = None
    """Extend a finished map: the folder of an earlier run, whose map moves, too, or a ROS map. The log must find itself
    on it."""

    relations: Path | None = None
    """File of reference relations (t1 t2 x y z roll pitch yaw): prints the errors over them."""

    watch: bool = False
    """Show the map growing in a window (needs slamgym[human])."""

    video: Path | None = None
    """Write a film of the map growing: a name that ends in .mp4 or .gif."""

    settings: AllSettings = SettingsOptions()
    """The mapper: resolution, max_usable_range, linear_update, sigma and all else."""

    def _check(self) -> None:
        from slamgym.viz.films import check_film_name

        if self.video is not None:
            check_film_name(self.video)


MAX_FRAMES = 600
"""Pictures of a film at most."""
MAX_PATHS = 30
"""Paths of particles that a picture shows at most."""
_FRAMES_PER_SECOND = 20.0
"""Frame rate of a film."""


def main(arguments: SlamArguments) -> None:
    """Run the command."""
    from slamgym.core.freed_memory import keep_freed_memory
    from slamgym.interop.logs import read_relations, read_truth
    from slamgym.slam.merge.continuing import continue_map
    from slamgym.slam.merge.stored import stored_part

    keep_freed_memory()
    require_folder(arguments.out)
    _check_settings(arguments)
    older = None
    if arguments.continue_ is not None:
        spare_maps([arguments.continue_], arguments.out, "the map to go on with")
        older = stored_part(arguments.continue_)
    relations = read_relations(arguments.relations) if arguments.relations is not None else None
    log = checked_log(arguments.log, arguments)
    truth = read_truth(arguments.log)
    config = _config(arguments, log, older)
    result = _replay(arguments, log, config)
    if older is not None:
        result = continue_map(older, result, str(arguments.log))
    summary = {
        "log": str(arguments.log),
        "continued": None if arguments.continue_ is None else str(arguments.continue_),
        "seed": arguments.seed,
        **_facts(log, result),
        **_errors_of_relations(result, relations),
        **_errors_of_truth(result, truth),
        **result.extra,
        **faults_of(log),
        "config": to_dict(config),
        "n_eff": [round(value, 3) for value in result.stats.n_eff],
    }
    _write(arguments, result, config.mode)
    end_results(arguments.out, summary, _report(arguments.out, summary))


def _options(arguments: SlamArguments) -> dict[str, Any]:
    return {"mode": arguments.mode, "particles": arguments.particles}


def _check_settings(arguments: SlamArguments) -> None:
    """Refuse wrong settings before a log is read, which may take long."""
    config = arguments.settings.chosen(SlamConfig(), _options(arguments))
    if config.mode == "ground_truth":
        raise ConfigError(
            "--mode ground_truth is for simulation; a log holds no true poses (try dead_reckoning)"
        )
    if config.mode == "map":
        raise ConfigError(
            "--mode map makes no map; use slamgym localize MAP LOG, or --continue MAP to go on with one"
        )


def _config(arguments: SlamArguments, log: Log, older: Part | None) -> SlamConfig:
    suited = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    if older is not None:
        suited = replace(suited, resolution=older.floor.grid.frame.resolution)
    return arguments.settings.configured(suited, _options(arguments))


def _replay(arguments: SlamArguments, log: Log, config: SlamConfig) -> ReplayResult:
    """Replay with a progress bar, a window and a film if wanted."""
    from slamgym.slam.replay import replay
    from slamgym.viz.films import open_film

    with ExitStack() as stack:
        screens: list[ShowPicture] = []
        if arguments.video is not None:
            screens.append(stack.enter_context(open_film(arguments.video, _FRAMES_PER_SECOND)))
        if arguments.watch:
            title = f"slamgym slam {arguments.log.name}"
            window = open_window(title, 0.0, "write a film: --video FILE.mp4")
            stack.callback(window.close)
            screens.append(window.show)
        advance = stack.enter_context(show_progress("scans", 0, len(log)))
        show = _viewer(screens, len(log))

        def on_scan(index: int, mapper: Mapper, is_processed: bool) -> None:  # noqa: ARG001 - every scan counts
            advance()
            show(index, mapper)

        rng = np.random.default_rng(arguments.seed)
        return replay(log, config, rng, on_scan)


def _viewer(screens: list[ShowPicture], total: int) -> Callable[[int, Mapper], None]:
    """A function to call after each scan; it draws a frame now and then, and the last one for a while."""
    from slamgym.slam.particle_filter import ParticleFilter
    from slamgym.viz.map_pictures import GrowingView

    view = GrowingView()
    every = math.ceil(total / MAX_FRAMES)

    def show(index: int, mapper: Mapper) -> None:
        last = index == total - 1
        if not screens or (index % every != 0 and not last):
            return
        paths = [mapper.trajectory().poses]
        if isinstance(mapper, ParticleFilter):
            paths += mapper.particle_paths(MAX_PATHS)
        caption = f"scan {index + 1} of {total}"
        picture = view.draw(mapper.occupancy_grid(), paths, caption)
        for screen in screens:
            for _ in range(40 if last else 1):
                screen(picture)

    return show


def _facts(log: Log, result: ReplayResult) -> dict[str, Any]:
    """Scans, costs, and how sure the mapper is."""
    stats = result.stats
    frame = result.grid.frame
    start = log.records[0].stamp
    way = np.hypot(*np.diff(result.trajectory.poses[:, :2], axis=0).T)
    return {
        "scans": len(log),
        "processed_scans": stats.processed,
        "log_seconds": log.duration,
        "path_length_m": result.trajectory.length,
        "map_size_m": [frame.width_px * frame.resolution, frame.height_px * frame.resolution],
        "cpu_seconds": stats.cpu_seconds,
        "cpu_ms_per_processed_scan": stats.cpu_ms_per_processed_scan,
        "map_memory_bytes": stats.memory_bytes,
        "resamplings": stats.resamplings,
        "refused_matches": stats.refused_matches,
        "recovered_matches": stats.recovered_matches,
        "doubtful_scans": len(stats.doubtful),
        "doubtful_share_of_path": float(way[result.doubtful[1:]].sum() / max(way.sum(), 1e-9)),
        "doubts": [
            {"kind": kind, "begin_s": round(begin - start, 3), "end_s": round(end - start, 3)}
            for begin, end, kind in stats.spans()
        ],
    }


_RELATIONS = {
    "relations": "all",
    "relations_of_revisits": "revisits",
    "relations_at_scans": "at the nearest scan within 0.1 s",
}
"""Which relations are counted, and what the report calls them."""


def _errors_of_relations(
    result: ReplayResult, relations: Relations | None
) -> dict[str, dict[str, float]]:
    from slamgym.metrics import relation_error

    errors: dict[str, dict[str, float]] = {}
    if relations is None:
        return errors
    for name in _RELATIONS:
        path = result.trajectory if name == "relations_at_scans" else result.moments
        try:
            error = relation_error(
                path,
                relations.start_stamps,
                relations.end_stamps,
                relations.relative,
                revisits=name == "relations_of_revisits",
            )
        except ValueError as problem:
            if name == "relations":
                raise ConfigError(f"--relations: {problem}") from problem
            continue  # no place was passed twice, or no moment is a scan's
        errors[name] = {
            "translation_mean_m": error.translation.mean,
            "translation_deviation_m": error.translation.deviation,
            "rotation_mean_deg": float(np.degrees(error.rotation.mean)),
            "rotation_deviation_deg": float(np.degrees(error.rotation.deviation)),
            "count": error.translation.count,
            "missing": error.missing,
        }
    return errors


def _errors_of_truth(result: ReplayResult, truth: Trajectory | None) -> dict[str, dict[str, float]]:
    from slamgym.metrics import absolute_trajectory_error, relative_pose_error

    if truth is None:
        return {}
    aligned = absolute_trajectory_error(result.trajectory, truth)
    plain = absolute_trajectory_error(result.trajectory, truth, align=False)
    errors = {
        "ate_rmse_m": aligned.translation.rmse,
        "ate_unaligned_rmse_m": plain.translation.rmse,
        "ate_rotation_rmse_deg": float(np.degrees(aligned.rotation.rmse)),
    }
    if truth.length > 2.0:
        relative = relative_pose_error(result.trajectory, truth, delta=1.0)
        errors["rpe_per_metre_rmse_m"] = relative.translation.rmse
    return {"truth": errors}


def _write(arguments: SlamArguments, result: ReplayResult, mode: str) -> None:
    from slamgym.interop.ros_map import write_ros_map
    from slamgym.interop.tum import write_doubt, write_tum
    from slamgym.slam.graph.graph_files import GRAPH, NODE_SCANS, write_graph
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.map_pictures import draw_map

    folder = arguments.out
    path = result.trajectory
    begin_results(folder)
    write_ros_map(folder, result.grid)
    for name in (GRAPH, NODE_SCANS):
        (folder / name).unlink(missing_ok=True)  # those of an earlier run
    if result.graph is not None:
        write_graph(folder, result.graph)
    write_tum(folder / "trajectory.tum", path)
    write_doubt(folder / "trajectory_doubt.csv", path.stamps, result.doubtful, result.covariances)
    caption = f"{arguments.log.name}   {mode}   {path.length:.0f} m"
    write_picture(folder / "map.png", draw_map(result.grid, [path.poses], caption, result.doubtful))


def _verdict(summary: dict[str, Any]) -> str:
    """The stretches in doubt, as many as a line holds; summary.json has all."""
    found = []
    for kind, spans in itertools.groupby(summary["doubts"], lambda span: span["kind"]):
        times = ", ".join(f"{span['begin_s']:.0f}-{span['end_s']:.0f} s" for span in spans)
        found.append(f"{kind} {times}")
    share = f" ({100.0 * summary['doubtful_share_of_path']:.0f} % of the path, orange in map.png)"
    return shorten("; ".join(found), 100, placeholder=" ...") + share if found else "sure"


def _report(folder: Path, summary: dict[str, Any]) -> Iterator[str]:
    yield (
        f"{summary['log']}: {counted(summary['scans'], 'scan')}, {summary['path_length_m']:.0f} m, "
        f"map {summary['map_size_m'][0]:.0f} x {summary['map_size_m'][1]:.0f} m"
    )
    yield (
        f"  {summary['config']['mode']}: {counted(summary['processed_scans'], 'scan')} processed in "
        f"{summary['cpu_seconds']:.1f} CPU s, {summary['cpu_ms_per_processed_scan']:.2f} ms each; "
        f"{counted(summary['resamplings'], 'resampling')}; maps {summary['map_memory_bytes'] / 1e6:.0f} MB"
    )
    if summary["doubts"] or summary["config"]["mode"] == "pose_graph":
        yield f"  map: {_verdict(summary)}"
    if "loop_closures" in summary:
        yield f"  loop closures: {summary['loop_closures']}"
    for name, moments in _RELATIONS.items():
        r = summary.get(name)
        if r:
            yield (
                f"  relations, {moments}: "
                f"{r['translation_mean_m']:.4f} +- {r['translation_deviation_m']:.4f} m, "
                f"{r['rotation_mean_deg']:.2f} +- {r['rotation_deviation_deg']:.2f} deg "
                f"(mean +- deviation of {r['count']} of {r['count'] + r['missing']})"
            )
    t = summary.get("truth")
    if t:
        yield (
            f"  against the truth: ATE {t['ate_rmse_m']:.3f} m after alignment, "
            f"{t['ate_unaligned_rmse_m']:.3f} m without"
        )
    yield f"  {folder / 'map.png'}"
