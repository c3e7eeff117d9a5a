"""The result of an explorer on a track, as a file to read, check and rank."""

import dataclasses
import json
import math
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

from slamgym import __version__
from slamgym.agents.bench.manifest import BENCH, BENCH_VERSION, Manifest, Track, bench_tasks
from slamgym.agents.evaluation.coverage_curve import horizon
from slamgym.agents.evaluation.evaluate import Evaluation, EvaluationConfig, run_trials
from slamgym.agents.evaluation.summary import DONE, censored, succeeded
from slamgym.agents.evaluation.team_trial import TeamName
from slamgym.agents.evaluation.trial import FailedTrial, Trial, TrialConfig
from slamgym.cad import FloorPlan, PlanSource
from slamgym.core.config import Counted, Measured, Share, Within, from_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import replace_file, storage_errors
from slamgym.core.limits import DRAWING_BYTES
from slamgym.core.names import Label, as_file_name
from slamgym.core.parallel.engine import Execution
from slamgym.envs.episode import time_limit

SEEN = 0.98
"""Share of the floor that a success has seen."""
MEASURING_MARGIN = 1.1
"""Speeds and ranges of results may be so much larger than the robot's: wheels slip, readings have noise."""
_PACKAGES = ("numpy", "numba", "pymunk", "shapely", "scipy", "opencv-python-headless")


@dataclass(frozen=True)
class BenchRow:
    """What counts of one exploration: a :class:`~slamgym.agents.evaluation.trial.Trial` until it was done."""

    plan: str
    seed: int
    area: Measured
    """[m2]"""
    success: bool
    """True if at least 98 % of the floor was truly seen when the explorer said that it was done, in time."""
    coverage: Share
    """Share truly seen at the end."""
    done: Annotated[float, Within(ge=1e-3, le=1e9)]
    """Time until done [s]; the time limit where it failed."""
    path: Measured
    """Path until done [m]; where it failed, what the time limit makes of it."""
    contacts: Counted
    map_error: Measured
    """[m]"""
    cpu: Measured
    """CPU time of the whole exploration [s]."""
    error: str = ""
    """Why the exploration crashed, hung or failed; it counts as a failure."""

    @property
    def pace(self) -> float:
        """Time until done as a share of the par time, 60 s and 3 s for each square metre."""
        return self.done / horizon(self.area)

    @staticmethod
    def of_trial(trial: Trial) -> "BenchRow":
        """The row of an exploration that has ended."""
        return BenchRow(
            plan=trial.plan,
            seed=trial.seed,
            area=trial.area,
            success=succeeded(trial),
            coverage=trial.coverage,
            done=round(censored(trial, "time", DONE), 3),
            path=round(censored(trial, "path", DONE), 3),
            contacts=trial.collisions,
            map_error=trial.map_error,
            cpu=trial.cpu,
        )

    @staticmethod
    def of_failure(failed: FailedTrial, plan: FloorPlan, config: TrialConfig) -> "BenchRow":
        """The row of one that crashed: it has driven at top speed until the time limit and seen nothing."""
        limit = round(time_limit(plan, config.minutes), 3)
        return BenchRow(
            plan=failed.plan,
            seed=failed.seed,
            area=round(plan.area, 3),
            success=False,
            coverage=0.0,
            done=limit,
            path=round(limit * config.env.robot.max_linear, 3),
            contacts=0,
            map_error=0.0,
            cpu=0.0,
            error=f"{failed.error}: {failed.reason}",
        )


@dataclass(frozen=True)
class BenchResult:
    """An explorer on a track."""

    track: str
    quick: bool
    """True if only the quick subset was explored."""
    entry: Label
    """Name on the leaderboard; results of one name are several trainings of one explorer."""
    explorer: str
    settings: str
    """Hash of the settings of explorer and trials; of weights, too."""
    manifest: str
    """SHA-256 of the manifest."""
    versions: dict[str, Label]
    rows: tuple[BenchRow, ...]
    bench: str = BENCH
    version: int = BENCH_VERSION


def run_bench(
    explorer: str, track: Track, source: PlanSource, out: Path, execution: Execution = Execution()
) -> Evaluation:
    """Explore every building of a track, or what is left of them from an earlier run.

    Args:
        explorer: Its name, as :func:`slamgym.agents.registry.make_explorer` takes it.
        track: The buildings.
        source: Their plans.
        out: Folder of the results; all tracks and explorers may share one.
        execution: Where the explorations run.

    Raises:
        ConfigError: If a plan is missing or differs from the manifest, or there is no such explorer.
    """
    tasks = bench_tasks(track, source, explorer)
    config = EvaluationConfig(
        explorers=(explorer,), split=None, plans_filter="none", trial=track.trial
    )
    return run_trials(tasks, config, out, execution)


def bench_result(
    evaluation: Evaluation, manifest: Manifest, track: Track, source: PlanSource, entry: str
) -> BenchResult:
    """The result of a track that was explored to its end.

    Args:
        evaluation: All its trials.
        manifest: The benchmark.
        track: The track, or its quick subset.
        source: Its plans: of explorations that crashed the area is asked.
        entry: Name on the leaderboard.
    """
    ended: list[Trial | FailedTrial] = [*evaluation.trials, *evaluation.failed]
    rows = [BenchRow.of_trial(trial) for trial in evaluation.trials]
    rows += [
        BenchRow.of_failure(failed, source.load(failed.plan), track.trial)
        for failed in evaluation.failed
    ]
    by_key = {(row.plan, row.seed): row for row in rows}
    whole = manifest.track(track.name)
    return BenchResult(
        track=track.name,
        quick=len(track.buildings) < len(whole.buildings),
        entry=entry,
        explorer=ended[0].explorer,
        settings=ended[0].settings,
        manifest=manifest.sha256,
        versions=_versions(),
        rows=tuple(by_key[building.plan, building.seed] for building in track.buildings),
    )


def _versions() -> dict[str, str]:
    found = {
        "slamgym": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
    }
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # OpenCV has several
            continue
    return found


def write_result(result: BenchResult, out: Path) -> Path:
    """Write a result into a folder; returns its path.

    Raises:
        StorageError: If it can't be written.
    """
    subset = "-quick" if result.quick else ""
    path = out / as_file_name(f"{result.track}{subset}-{result.entry}-{result.settings}.json", 120)
    document = dataclasses.asdict(result)
    rows = ",\n  ".join(json.dumps(row) for row in document.pop("rows"))
    text = f'{json.dumps(document, indent=1)[:-2]},\n "rows": [\n  {rows}\n ]\n}}\n'
    with storage_errors(path):
        replace_file(path, text.encode())
    return path


def read_results(paths: Sequence[Path], manifest: Manifest) -> list[BenchResult]:
    """Read results, from files and from folders of them.

    Raises:
        InputFileError: If a file is no result, or is one of another manifest or other explorations.
        ConfigError: If there is none.
    """
    results = [_read_result(path, manifest) for path in _files(paths)]
    known: set[tuple[str, bool, str, str]] = set()
    for result in results:
        identity = result.track, result.quick, result.entry, result.settings
        if identity in known:
            raise ConfigError(
                f"two results of {result.entry!r} on the track {result.track!r} have the same settings, so they are "
                "no two trainings; give one of them"
            )
        known.add(identity)
    if not results:
        raise ConfigError(
            f"no results in {', '.join(map(str, paths))}; `slamgym bench run EXPLORER -o FOLDER` writes them"
        )
    return results


def _files(paths: Sequence[Path]) -> Iterator[Path]:
    """Files as they are given; of a folder those that say that they are results."""
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        for inner in sorted(path.glob("*.json")):
            document = read_json(inner, limit=DRAWING_BYTES)
            if isinstance(document, dict) and document.get("bench") == BENCH and "rows" in document:
                yield inner


def _read_result(path: Path, manifest: Manifest) -> BenchResult:
    document: Any = read_json(path, "run the track again", DRAWING_BYTES)
    try:
        result = from_dict(BenchResult, document)
    except (TypeError, ConfigError, ValueError) as error:
        raise InputFileError(
            path, f"is no result of {BENCH} ({error}); run the track again"
        ) from None
    if (result.bench, result.version, result.manifest) != (BENCH, BENCH_VERSION, manifest.sha256):
        raise InputFileError(
            path,
            f"was measured with another manifest than that of {BENCH} {BENCH_VERSION} (SHA-256 "
            f"{result.manifest[:12]}, not {manifest.sha256[:12]}); rank it with its own version, or run it again",
        )
    try:
        track = manifest.track(result.track)
    except ConfigError as error:
        raise InputFileError(path, str(error)) from None
    wanted = track.quick() if result.quick else track
    listed = [(building.plan, building.seed) for building in wanted.buildings]
    if listed != [(row.plan, row.seed) for row in result.rows]:
        raise InputFileError(
            path, f"does not hold the explorations of the track {track.name!r}; run it again"
        )
    for number, row in enumerate(result.rows):
        fault = _impossibility(row, wanted.trial, TeamName.read(result.explorer).robots)
        if fault:
            raise InputFileError(path, f"rows[{number}], {row.plan}: {fault}; run the track again")
    return result


def _impossibility(row: BenchRow, trial: TrialConfig, robots: int) -> str:
    """Why no robots of the benchmark have made an exploration; empty if so many may have."""
    speed = robots * trial.env.robot.max_linear
    whose = "the robot" if robots == 1 else f"{robots} robots"
    if row.path > MEASURING_MARGIN * speed * row.done + 1.0:
        return f"{row.path:g} m in {row.done:g} s is faster than {whose}, {speed:g} m/s"
    if not row.success:
        return ""
    if row.coverage < SEEN - 1e-3:
        return f"a success has seen {SEEN:.0%} of the floor, not {row.coverage:.1%}"
    # What a scanner can see of a way: the floor within its range.
    sight = MEASURING_MARGIN * trial.env.lidar.range_max
    seen = robots * math.pi * sight**2 + 2.0 * sight * row.path
    if seen < SEEN * row.area:
        return f"on a path of {row.path:g} m nobody sees {row.area:g} m2"
    turned = math.pi / trial.env.robot.max_angular
    if row.done < turned / MEASURING_MARGIN:
        return f"the robot can't look around in {row.done:g} s"
    return ""
