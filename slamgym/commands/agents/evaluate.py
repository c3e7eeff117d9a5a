"""``slamgym agents evaluate`` and ``slamgym bench``: explorers on the same plans, starts and seeds."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from slamgym.cad.plan_filter import PlanFilter
from slamgym.commands.frame import Out, is_installed
from slamgym.commands.settings import CLEARED, AllSettings, SettingsOptions
from slamgym.core.config import Arguments, Count, CountOrZero, Positive, Seed
from slamgym.core.errors import ConfigError
from slamgym.core.names import Label
from slamgym.core.parallel.backlog import TASK_TIMEOUT, available_cores
from slamgym.core.parallel.engine import Execution
from slamgym.core.progress import counted, say, tell

if TYPE_CHECKING:
    from slamgym.agents.evaluation.evaluate import EvaluationConfig


class EvaluateArguments(Arguments):
    """Compare explorers on the same floor plans, starts and noise.

    Every exploration runs until the explorer is done or the time limit is over. What is done is kept in
    ``trials.jsonl``: run the command again to resume; with more plans or explorers it does
    only what is new. Tables are printed and written to ``results.md`` and ``results.json``.
    """

    out: Out
    """Folder of the results; made if it is missing, continued if it is there."""
    plans: str = "bundled"
    """Floor plans, as `slamgym generate` takes them."""
    count: Count | None = None
    """Number of plans, drawn by the seed; by default 200."""
    split: Literal["test", "validation", "train", "all"] | None = None
    """Plans by their ids: ``test``, the default, were never trained on."""
    plans_filter: PlanFilter | None = None
    """``useful``, the default, takes plans that are worth exploring; ``none`` all."""
    explorers: str | None = None
    """Names of explorers, with commas between them; by default all."""
    robots: str = "1"
    """How many robots explore a building together, with commas between numbers: ``1,2,3`` evaluates each explorer
    alone, as a pair (``rl*2``) and as three."""
    against: str = ""
    """The reference explorer, one of them; by default ``explore_lite``, or the first where it is not among them."""
    oracle: bool = False
    """Privileged: also plan what one who knows the floor plan would need at least, for each share of the floor."""
    promise: str | None = None
    """Explorers stop once the map keeps it: so much seen, and how sure that is, by default ``98%:95%``; or ``2m2:90%``
    for what may be left. ``none``: when nothing is left to try. `explore_lite` ends as its source does."""
    minutes: Literal["auto"] | Positive | None = None
    """Limit of robot time [min]; ``auto``, the default, grows with the floor area."""
    seed: Seed | None = None
    """Decides which plans, starts and noise; by default 0."""
    workers: CountOrZero = 0
    """Processes; 0 takes one per core."""
    task_timeout: Positive = TASK_TIMEOUT
    """Longest wall time of an exploration [s]; one that hangs is ended and noted in ``failed.jsonl``."""
    settings: AllSettings = SettingsOptions()
    """Robot, sensors, SLAM, furniture and people, and all else."""


def main(arguments: EvaluateArguments) -> None:
    """Run the command."""
    from slamgym.agents.evaluation.evaluate import evaluate
    from slamgym.agents.evaluation.report import write_report
    from slamgym.cad import open_plans

    config = evaluation_config(arguments)
    evaluation = evaluate(
        open_plans(arguments.plans),
        config,
        arguments.out,
        Execution(arguments.workers or available_cores(), task_timeout=arguments.task_timeout),
    )
    if evaluation.skipped:
        say(
            f"skipped {counted(len(evaluation.skipped), 'plan')}, the first: {evaluation.skipped[0].reason}"
        )
    if evaluation.failed:
        failed = counted(len(evaluation.failed), "exploration")
        say(f"{failed} crashed, hung or failed; {arguments.out / 'failed.jsonl'} says which")
    sys.stdout.write(
        write_report(arguments.out, evaluation, config, _reference(arguments.against, config))
    )
    if is_installed("matplotlib"):  # which the extra agents brings
        from slamgym.agents.evaluation.report import draw_coverage

        path = arguments.out / "coverage_over_time.png"
        draw_coverage(evaluation.trials, path)
        tell(f"plot: {path}")


def evaluation_config(arguments: EvaluateArguments) -> EvaluationConfig:
    """The settings.

    Raises:
        ConfigError: If a setting makes no sense, or the reference is not among the explorers.
    """
    from slamgym.agents.evaluation.evaluate import EvaluationConfig
    from slamgym.agents.evaluation.team_trial import TeamName
    from slamgym.agents.registry import EXPLORERS
    from slamgym.planning.promise import Promise

    names = list(EXPLORERS)
    if arguments.explorers is not None:
        asked = [name.strip() for name in arguments.explorers.split(",")]
        names = [name for name in asked if name]
    counts = [count.strip() for count in arguments.robots.split(",")]
    teams = [str(TeamName.read(f"{name}*{count}")) for count in counts for name in names]
    options = {
        "count": arguments.count,
        "split": CLEARED if arguments.split == "all" else arguments.split,
        "plans_filter": arguments.plans_filter,
        "seed": arguments.seed,
        "minutes": arguments.minutes,
        "explorers": tuple(teams) if arguments.explorers is not None or counts != ["1"] else None,
        "oracle": arguments.oracle or None,
    }
    promise = arguments.promise
    if promise is not None:
        options["trial.promise"] = CLEARED if promise == "none" else Promise.parse(promise)
    config = arguments.settings.configured(EvaluationConfig(tuple(EXPLORERS)), options)
    _reference(arguments.against, config)
    return config


def _reference(against: str, config: EvaluationConfig) -> str:
    """The reference explorer.

    Raises:
        ConfigError: If it is not among the explorers.
    """
    if not against:
        return "explore_lite" if "explore_lite" in config.names else config.names[0]
    if against not in config.names:
        raise ConfigError(
            f"--against {against} is not among the explorers {', '.join(config.names)}; add it"
        )
    return against


class BenchRunArguments(Arguments):
    """Explore the buildings of slamgym-bench with one explorer and write its result files.

    Buildings, starts, seeds, sensors and SLAM are fixed. What is done is kept in ``trials.jsonl``: run the
    command again to resume.
    """

    explorer: tyro.conf.Positional[str]
    """Its name, as everywhere (``nearest``, ``rl@98%:90%``, ``rl:FILE``); ``module:function`` for your own.
    Without an ``@`` it stops at the promise 98%:95%."""
    out: Out
    """Folder of the results; all explorers and tracks may share it."""
    track: Literal["homes", "loops", "large", "furnished", "people", "teams", "all"] = "homes"
    """Which buildings; ``teams``, which is not among ``all``, is for several robots, as ``rl*2``."""
    plans: str = "json.tar.gz"
    """Your copy of HouseExpo, for all tracks but ``loops`` and ``large``; `slamgym plans fetch` downloads it."""
    quick: bool = False
    """Only the first twelve buildings of a track, to see that it runs."""
    entry: Label | None = None
    """Name on the leaderboard; by default the explorer's. Give the trainings of one explorer the same name."""
    workers: CountOrZero = 0
    """Processes; 0 takes one per core."""
    task_timeout: Positive = TASK_TIMEOUT
    """Longest wall time of an exploration [s]; one that hangs is ended and counts as a failure."""


class LeaderboardArguments(Arguments):
    """Rank results: a Markdown page, and the same as JSON."""

    results: tyro.conf.Positional[tuple[Path, ...]]
    """Result files, or folders of them."""
    out: Out = Path("leaderboard.md")
    """The page."""


def bench_command(arguments: BenchRunArguments) -> None:
    """Run ``slamgym bench run``."""
    from slamgym.agents.bench.leaderboard import describe_boards, rank
    from slamgym.agents.bench.manifest import TEAMS, open_bench_plans, read_bench
    from slamgym.agents.bench.results import bench_result, run_bench, write_result

    bench = read_bench()
    tracks = tuple(track for track in bench.tracks if track.name != TEAMS)
    if arguments.track != "all":
        tracks = (bench.track(arguments.track),)
    # Opened before any work: a missing copy is said at once.
    opened = [
        (track, open_bench_plans(track, arguments.plans))
        for track in (whole.quick() if arguments.quick else whole for whole in tracks)
    ]
    results = []
    for track, source in opened:
        say(f"{track.name}: {len(track.buildings)} buildings")
        evaluation = run_bench(
            arguments.explorer,
            track,
            source,
            arguments.out,
            Execution(arguments.workers or available_cores(), task_timeout=arguments.task_timeout),
        )
        result = bench_result(
            evaluation, bench, track, source, arguments.entry or arguments.explorer
        )
        results.append(result)
        say(f"result: {write_result(result, arguments.out)}")
    sys.stdout.write(describe_boards(rank(results, bench)))


def leaderboard_command(arguments: LeaderboardArguments) -> None:
    """Run ``slamgym bench leaderboard``."""
    from slamgym.agents.bench.leaderboard import boards_as_json, leaderboard_page, rank
    from slamgym.agents.bench.manifest import read_bench
    from slamgym.agents.bench.results import read_results
    from slamgym.core.files import write_text

    bench = read_bench()
    boards = rank(read_results(arguments.results, bench), bench)
    page = leaderboard_page(boards, bench)
    write_text(arguments.out, page)
    write_text(arguments.out.with_suffix(".json"), boards_as_json(boards, bench))
    sys.stdout.write(page)
