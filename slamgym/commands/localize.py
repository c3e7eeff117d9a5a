"""``slamgym localize``: a finished map and a recorded log in, where the robot was on the map out, and how surely."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from slamgym import __version__
from slamgym.core.config import Arguments, Positive, from_dict, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import write_text
from slamgym.core.progress import counted, say, tell
from slamgym.core.types import Pose2D
from slamgym.slam.config import LocalizationConfig

if TYPE_CHECKING:
    from slamgym.interop.map_files import RobotMap
    from slamgym.interop.records import Log
    from slamgym.slam.localization.hypothesis import Belief
    from slamgym.slam.localization.logs import LocalizationResult


class LocalizeArguments(Arguments):
    """Find a robot on a finished map by a recorded log."""

    map: tyro.conf.Positional[Path]
    """A ROS map (.yaml, or the image beside it), the folder of a run of `slamgym slam`, Valetudo's .json or .png, or a
    bare image with --resolution."""

    log: tyro.conf.Positional[Path]
    """CARMEN log, ROS bag or episode, as for `slamgym slam`."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for trajectory.tum, localization.jsonl, localization.png and summary.json."""

    initial_pose: tuple[float, float, float] | None = None
    """Where the robot starts on the map: x [m], y [m], yaw [rad]. By default it is searched for everywhere."""

    resolution: Positive | None = None
    """Cell size of a map that has no yaml file [m]; its lower left corner is then at (0, 0)."""

    seed: int = 0
    """The same seed gives the same result."""

    scan_topic: str | None = None
    """ROS bags: the LaserScan topic."""

    odometry_topic: str | None = None
    """ROS bags: the Odometry topic."""

    settings: Path | None = None
    """JSON file with any settings of the localisation, e.g. {"sigma_hit": 0.1}."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(LocalizeArguments, args=argv, prog="slamgym localize")
    from slamgym.interop.logs import open_log
    from slamgym.interop.map_files import read_map
    from slamgym.slam.localization.logs import localize_log
    from slamgym.slam.replay import read_overrides

    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputFileError(arguments.out, "is a file; name a folder for the results")
    overrides = read_overrides(arguments.settings) if arguments.settings is not None else {}
    config = from_dict(LocalizationConfig, overrides, "slam.localization")
    if arguments.initial_pose is not None and not all(map(math.isfinite, arguments.initial_pose)):
        raise ConfigError("--initial-pose must be three finite numbers: x, y, yaw")
    initial = None if arguments.initial_pose is None else Pose2D(*arguments.initial_pose)
    known = read_map(arguments.map, arguments.resolution)
    log = open_log(arguments.log, scan_topic=arguments.scan_topic, odometry_topic=arguments.odometry_topic)
    for sentence in log.warnings.sentences():
        say(f"slamgym: warning: {sentence}")
    rng = np.random.default_rng(arguments.seed)
    result = localize_log(log, known.grid, known.placement, config, rng, initial)
    summary = _summary(arguments, log, config, result)
    _write(arguments.out, known, result, summary)
    tell(*_report(arguments.out, summary).splitlines())
    return 0


def _summary(
    arguments: LocalizeArguments, log: Log, config: LocalizationConfig, result: LocalizationResult
) -> dict[str, Any]:
    states = Counter(belief.state for belief in result.beliefs)
    first = next((belief for belief in result.beliefs if belief.state == "localised"), None)
    last = result.beliefs[-1]
    return {
        "version": __version__,
        "map": str(arguments.map),
        "log": str(arguments.log),
        "seed": arguments.seed,
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
        "warnings": dict(sorted(log.warnings.counts.items())),
        "config": to_dict(config),
    }


MOST_SHOWN = 10
"""Hypotheses that are written out."""


def _write(folder: Path, known: RobotMap, result: LocalizationResult, summary: dict[str, Any]) -> None:
    """Write the results; the summary goes last, so where it exists everything else is complete."""
    from slamgym.interop.tum import write_tum
    from slamgym.viz.canvas import write_picture
    from slamgym.viz.map_pictures import draw_localization

    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.json").unlink(missing_ok=True)
    except OSError as error:
        raise InputFileError(folder, f"can't be written ({error.strerror or error})") from error
    write_tum(folder / "trajectory.tum", result.trajectory)
    write_text(folder / "localization.jsonl", "".join(_line(belief) for belief in result.beliefs))
    caption = f"{Path(summary['log']).name} on {Path(summary['map']).name}"
    picture = draw_localization(
        known.grid,
        known.placement,
        np.array([belief.pose for belief in result.beliefs]),
        [belief.state for belief in result.beliefs],
        [pose for pose, _ in result.beliefs[-1].hypotheses],
        caption,
    )
    write_picture(folder / "localization.png", picture)
    write_text(folder / "summary.json", json.dumps(summary, indent=1) + "\n")


def _line(belief: Belief) -> str:
    """A belief as a line of JSON."""
    row = {
        "stamp": belief.stamp,
        "state": belief.state,
        "pose": _rounded(belief.pose),
        "covariance": _rounded(belief.covariance[np.triu_indices(3)], 9),
        "fit": round(belief.fit, 3),
        "particles": belief.particles,
        "hypotheses": [
            [*_rounded(pose), round(weight, 4)] for pose, weight in belief.hypotheses[:MOST_SHOWN]
        ],
    }
    return json.dumps(row) + "\n"


def _rounded(values: Any, digits: int = 6) -> list[float]:
    return [round(float(value), digits) for value in values]


def _report(folder: Path, summary: dict[str, Any]) -> str:
    states = ", ".join(
        f"{100.0 * n / summary['processed_scans']:.0f} % {s}" for s, n in summary["states"].items()
    )
    lines = [f"{summary['log']} on {summary['map']}: {counted(summary['scans'], 'scan')}: {states}"]
    after = summary["localised_after_s"]
    if after is None:
        lines.append(
            "  NOT LOCALISED: no place on the map explained enough of the scans without a rival; the log may be of "
            f"another building (mean share explained {summary['mean_fit']:.2f})"
            if "ambiguous" not in summary["states"]
            else "  NOT LOCALISED: places that look alike were never told apart (hypotheses in localization.jsonl)"
        )
    else:
        lines.append(f"  localised {after:.0f} s after the start of the log")
    if summary["final_state"] != "localised":
        lines.append(f"  at the end: {summary['final_state']}")
    lines.append(f"  {summary['cpu_ms_per_processed_scan']:.1f} CPU ms a processed scan")
    lines.append(f"  {folder / 'localization.png'}")
    return "\n".join(lines) + "\n"
