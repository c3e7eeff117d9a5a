"""``slamgym localize``: a finished map and a recorded log in, where the robot was on the map out, and how surely."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tyro

from slamgym.commands.frame import Out, begin_results, end_results, require_folder, require_input
from slamgym.commands.log_input import LogAndOut, LogReading, checked_log, faults_of
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Arguments, Positive, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import write_text
from slamgym.core.progress import counted
from slamgym.core.types import Pose2D
from slamgym.slam.config import LocalizationConfig

if TYPE_CHECKING:
    from slamgym.interop.map_files import RobotMap
    from slamgym.interop.records import Log
    from slamgym.slam.localization.hypothesis import Belief
    from slamgym.slam.localization.logs import LocalizationResult


class _Map(Arguments):
    map: tyro.conf.Positional[Path]
    """A ROS map (.yaml, or its image), the folder of a run of `slamgym slam`, Valetudo's .json or .png, or a
    bare image with --resolution."""


class LocalizeArguments(LogReading, LogAndOut, _Map):
    """Find a robot on a finished map by a recorded log."""

    out: Out
    """Folder for trajectory.tum, localization.jsonl, localization.png and summary.json."""

    initial_pose: tuple[float, float, float] | None = None
    """Where the robot starts on the map: x [m], y [m], yaw [rad]. By default it is searched for everywhere."""

    resolution: Positive | None = None
    """Cell size of a map that has no yaml file [m]; its lower left corner is then at (0, 0)."""

    settings: AllSettings = SettingsOptions()
    """Localisation, e.g. ``--set confirm_distance=5``."""


def main(arguments: LocalizeArguments) -> None:
    """Run the command."""
    from slamgym.interop.map_files import read_map
    from slamgym.slam.localization.logs import localize_log

    require_folder(arguments.out)
    require_input(arguments.map, "a map's yaml or image, or the folder of a run of slamgym slam")
    config = arguments.settings.configured(LocalizationConfig(), {})
    if arguments.initial_pose is not None and not all(map(math.isfinite, arguments.initial_pose)):
        raise ConfigError("--initial-pose must be three finite numbers: x, y, yaw")
    initial = None if arguments.initial_pose is None else Pose2D(*arguments.initial_pose)
    known = read_map(arguments.map, arguments.resolution)
    log = checked_log(arguments.log, arguments)
    if not log.has_odometry:
        raise InputFileError(
            arguments.log, "has no odometry to use, by which the robot is followed"
        )
    result = localize_log(log, known.grid, known.placement, config, initial)
    summary = _summary(arguments, log, config, result)
    _write(arguments, known, result)
    end_results(arguments.out, summary, _report(arguments.out, summary))


def _summary(
    arguments: LocalizeArguments, log: Log, config: LocalizationConfig, result: LocalizationResult
) -> dict[str, Any]:
    states = Counter(belief.state for belief in result.beliefs)
    first = next((belief for belief in result.beliefs if belief.state == "localised"), None)
    last = result.beliefs[-1]
    return {
        "map": str(arguments.map),
        "log": str(arguments.log),
        "scans": len(log),
        "processed_scans": len(result.beliefs),
        "localised_after_s": None if first is None else first.stamp - log.records[0].stamp,
        "states": dict(sorted(states.items())),
        "localised_share": states["localised"] / len(result.beliefs),
        "final_state": last.state,
        "final_pose": list(last.pose),
        "final_hypotheses": [[*pose, weight] for pose, weight in last.hypotheses[:MOST_SHOWN]],
        "mean_fit": float(np.mean([belief.fit for belief in result.beliefs])),
        "searches": result.searches,
        "cpu_seconds": result.cpu_seconds,
        "cpu_ms_per_processed_scan": 1e3 * result.cpu_seconds / len(result.beliefs),
        **faults_of(log),
        "config": to_dict(config),
    }


MOST_SHOWN = 10
"""Hypotheses that are written out."""


def _write(arguments: LocalizeArguments, known: RobotMap, result: LocalizationResult) -> None:
    from slamgym.interop.tum import write_tum
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.map_pictures import draw_localization

    folder = arguments.out
    begin_results(folder)
    write_tum(folder / "trajectory.tum", result.trajectory)
    write_text(folder / "localization.jsonl", "".join(_line(belief) for belief in result.beliefs))
    picture = draw_localization(
        known.grid,
        known.placement,
        np.array([belief.pose for belief in result.beliefs]),
        [belief.state for belief in result.beliefs],
        [pose for pose, _ in result.beliefs[-1].hypotheses],
        f"{arguments.log.name} on {arguments.map.name}",
    )
    write_picture(folder / "localization.png", picture)


def _line(belief: Belief) -> str:
    """A belief as a line of JSON."""
    row = {
        "stamp": belief.stamp,
        "state": belief.state,
        "pose": _rounded(belief.pose),
        "covariance": _rounded(belief.covariance[np.triu_indices(3)], 9),
        "fit": round(belief.fit, 3),
        "hypotheses": [
            [*_rounded(pose), round(share, 4)] for pose, share in belief.hypotheses[:MOST_SHOWN]
        ],
    }
    return json.dumps(row) + "\n"


def _rounded(values: Any, digits: int = 6) -> list[float]:
    return [round(float(value), digits) for value in values]


def _report(folder: Path, summary: dict[str, Any]) -> Iterator[str]:
    shares = (
        (count / summary["processed_scans"], state) for state, count in summary["states"].items()
    )
    states = ", ".join(f"{100.0 * share:.0f} % {state}" for share, state in shares)
    yield f"{summary['log']} on {summary['map']}: {counted(summary['scans'], 'scan')}: {states}"
    if summary["localised_after_s"] is not None:
        yield f"  localised {summary['localised_after_s']:.0f} s after the start of the log"
    else:
        yield (
            "  NOT LOCALISED: no place on the map explained enough of the scans without a rival that looks alike; the "
            f"log may be of another building (mean share explained {summary['mean_fit']:.2f})"
        )
    if summary["final_state"] != "localised":
        yield f"  at the end: {summary['final_state']}"
    yield f"  {summary['cpu_ms_per_processed_scan']:.1f} CPU ms a processed scan"
    yield f"  {folder / 'localization.png'}"
