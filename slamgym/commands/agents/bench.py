"""``slamgym bench``: the frozen benchmark for explorers, and its leaderboard."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from slamgym.core.config import Arguments, CountOrZero, Positive
from slamgym.core.names import Label
from slamgym.core.parallel.backlog import TASK_TIMEOUT, available_cores
from slamgym.core.parallel.engine import Execution
from slamgym.core.progress import say


class BenchRunArguments(Arguments):
    """Explore the buildings of slamgym-bench with one explorer and write its result files.

    Buildings, starts, seeds, sensors and SLAM are fixed. What is done is kept in ``trials.jsonl``: after Ctrl-C or
    a kill the same command goes on.
    """

    explorer: tyro.conf.Positional[Label]
    """Its name, as everywhere (``nearest``, ``rl@98%:90%``, ``rl:FILE``); ``module:function`` for one of your own.
    Without an ``@`` it stops at the promise 98%:95%."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the results; all explorers and tracks may share it."""
    track: Literal["homes", "loops", "large", "furnished", "people", "all"] = "homes"
    """Which buildings."""
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
    """Rank results: a Markdown page, and the same as JSON beside it."""

    results: tyro.conf.Positional[tuple[Path, ...]]
    """Result files, or folders of them."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("leaderboard.md")
    """The page."""


def run_command(argv: list[str]) -> int:
    """Run ``slamgym bench run``; returns the exit code."""
    arguments = tyro.cli(BenchRunArguments, args=argv, prog="slamgym bench run")
    from slamgym.agents.bench.leaderboard import describe_boards, rank
    from slamgym.agents.bench.manifest import open_bench_plans, read_bench
    from slamgym.agents.bench.results import bench_result, run_bench, write_result

    bench = read_bench()
    tracks = bench.tracks if arguments.track == "all" else (bench.track(arguments.track),)
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
        result = bench_result(evaluation, bench, track, source, arguments.entry or arguments.explorer)
        results.append(result)
        say(f"result: {write_result(result, arguments.out)}")
    sys.stdout.write(describe_boards(rank(results, bench)))
    return 0


def leaderboard_command(argv: list[str]) -> int:
    """Run ``slamgym bench leaderboard``; returns the exit code."""
    arguments = tyro.cli(LeaderboardArguments, args=argv, prog="slamgym bench leaderboard")
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
    return 0
