"""``slamgym merge``: several maps of one building in, one map out, if it is sure that they belong together."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from slamgym.commands.frame import (
    Out,
    begin_results,
    end_results,
    require_folder,
    require_input,
    spare_maps,
)
from slamgym.commands.log_input import LogReading, checked_log
from slamgym.core.config import Arguments
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.progress import say

if TYPE_CHECKING:
    from slamgym.slam.merge.merged import Merged, Placed, Refusal
    from slamgym.slam.merge.merging import Part


class _Inputs(Arguments):
    inputs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Two or more: folders of `slamgym slam` or `ros2 map`, episodes of `generate`, recorded logs, or bare maps, of
    which the picture alone is laid on the others."""

    out: Out
    """Folder for map.pgm, map.yaml, map.png, graph.g2o, scans.npz, trajectory_1.tum and so on, and summary.json."""


class MergeMapsArguments(LogReading, _Inputs):
    """Merge maps of one building whose starts aren't known; other lasers, cells and directions are no hindrance."""

    guess: bool = False
    """Merge at the best place even if it isn't sure that the maps belong together; summary.json says so."""


def main(arguments: MergeMapsArguments) -> int:
    """Run the command.

    Returns:
        The exit code: 1 if the maps aren't merged, as it isn't sure that they belong together.
    """
    from slamgym.slam.merge.merged import Refusal, merge_parts

    _check(arguments)
    parts = [_read(path, arguments) for path in arguments.inputs]
    merged = merge_parts(parts, arguments.guess)
    if isinstance(merged, Refusal):
        say(f"slamgym: not merged: {_why(merged)}")
        return 1
    placed = [_entry(one) for one in merged.placed]
    is_sure = all(one["doubt"] == "" for one in placed)
    _write(arguments.out, merged)
    summary = {"sure": is_sure, "inputs": placed}
    end_results(arguments.out, summary, _report(arguments.out, summary))
    return 0


def _check(arguments: MergeMapsArguments) -> None:
    """Refuse what can't be merged before any work is done."""
    inputs = arguments.inputs
    if len(inputs) < 2:
        raise ConfigError(f"merge needs two maps or more, and is given {len(inputs)}")
    require_folder(arguments.out)
    seen: dict[Path, Path] = {}
    for path in inputs:
        require_input(path, "the folder of a map, a log or a bare map")
        twin = seen.setdefault(path.resolve(), path)
        if twin is not path:
            raise InputFileError(path, f"is {twin} once more; name each map once")
    spare_maps(inputs, arguments.out, "an input")


def _read(path: Path, reading: LogReading) -> Part:
    """One input, whatever it is."""
    from slamgym.interop.logs import episode_log
    from slamgym.interop.map_files import MAP_SUFFIXES
    from slamgym.ros2.run_files import LOG
    from slamgym.slam.graph.graph_files import GRAPH
    from slamgym.slam.merge.stored import stored_part

    log = path / LOG
    if (path / GRAPH).exists():
        return stored_part(path)
    if log.is_file():
        return _map_log(log, str(path), reading)
    is_bag = episode_log(path) or (path / "metadata.yaml").exists()
    if path.suffix.lower() in MAP_SUFFIXES or (
        path.is_dir() and any(path.glob("*.y*ml")) and not is_bag
    ):
        part = stored_part(path)
        say(f"slamgym: {path}: a bare map: its picture alone is laid on the others")
        return part
    return _map_log(path, str(path), reading)


def _map_log(path: Path, name: str, reading: LogReading) -> Part:
    """A log, mapped."""
    from slamgym.slam import SlamConfig
    from slamgym.slam.merge.merging import Part
    from slamgym.slam.replay import replay

    log = checked_log(path, reading)
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    graph = replay(log, config, np.random.default_rng(0)).graph
    assert graph is not None, "this mode has one"
    return Part.of_graph(name, graph)


def _why(refusal: Refusal) -> str:
    """Why maps aren't merged, in a sentence."""
    names = ", ".join(one.part.name for one in refusal.merged.placed)
    return f"{refusal.part.name} isn't sure to belong to {names}: {refusal.verdict.doubt}"


def _entry(placed: Placed) -> dict[str, Any]:
    """What the summary says of an input."""
    entry: dict[str, Any] = {
        "name": placed.part.name,
        "is_picture": placed.part.graph is None,
        "pose": list(placed.pose),
        "covariance": placed.covariance.tolist(),
        "doubt": "",
    }
    if placed.verdict is None or placed.verdict.best is None:
        return entry
    best = placed.verdict.best
    entry |= {
        "doubt": placed.verdict.doubt,
        "evidence_nats": best.evidence,
        "evidence_of_next_place_nats": max(placed.verdict.rival, -1e9),
        "walls_m": best.agreement._asdict(),
        "submaps_tied": 0 if best.joint is None else best.joint.ties,
    }
    return entry


def _write(folder: Path, merged: Merged) -> None:
    from slamgym.core.types import Trajectory
    from slamgym.interop.ros_map import write_ros_map
    from slamgym.interop.tum import write_tum
    from slamgym.slam.graph.graph_files import write_graph
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.map_pictures import draw_map

    begin_results(folder)
    grid = merged.grid()
    write_ros_map(folder, grid)
    paths = []
    if merged.graph is not None:
        write_graph(folder, merged.graph)
        for number, drive in enumerate(merged.graph.drives, 1):
            poses = merged.graph.poses[drive.nodes]
            write_tum(folder / f"trajectory_{number}.tum", Trajectory(drive.stamps, poses))
            paths.append(poses)
    caption = ", ".join(Path(one.part.name).name for one in merged.placed)
    write_picture(folder / "map.png", draw_map(grid, paths, caption))


def _report(folder: Path, summary: dict[str, Any]) -> Iterator[str]:
    first, *others = summary["inputs"]
    yield f"{first['name']}: its frame is that of the merged map"
    for entry in others:
        x, y, turn = entry["pose"]
        walls = entry["walls_m"]
        said = f"a GUESS: {entry['doubt']}" if entry["doubt"] else "sure"
        yield (
            f"{entry['name']}: at {x:.2f}, {y:.2f} m, turned by {np.degrees(turn):.1f} degrees: {said}"
        )
        yield (
            f"  {walls['agreed']:.0f} m of wall agree, {walls['contradicted']:.1f} m contradict; evidence "
            f"{entry['evidence_nats']:.1f} nats, at the next place {entry['evidence_of_next_place_nats']:.1f}"
        )
    yield f"  {folder / 'map.png'}"
