"""Results ranked: the score, its gate, and the page that shows them."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slamgym.agents.bench.manifest import BENCH, BENCH_VERSION, Manifest, Track
from slamgym.agents.bench.results import BenchResult, BenchRow
from slamgym.agents.evaluation.report import with_bounds
from slamgym.core.documents import json_text
from slamgym.core.intervals import (
    Interval,
    crossed_mean,
    crossed_ratio,
    interquartile_mean,
    probability_of_improvement,
    ratio_where_both,
    wilson_interval,
)
from slamgym.core.progress import counted
from slamgym.core.text import markdown
from slamgym.core.types import FloatArray

REFERENCE = "explore_lite"
"""Whom all others are compared with."""
PROMISED = 0.95
"""Share of the explorations in which 98 % must have been seen when the explorer says that it is done."""


@dataclass(frozen=True)
class Standing:
    """An entry on one track."""

    entry: str
    runs: int
    """Results of this name: trainings with different seeds."""
    score: Interval
    """Interquartile mean of the time until done over the par time; below 1 is quicker than par."""
    success: Interval
    """Share of successes."""
    passed: bool
    """True if the interval of the successes reaches :data:`PROMISED`; else the entry has no rank."""
    done: Interval
    """Mean time until done, failures at the time limit [s]."""
    path: Interval
    """Mean path until done [m]."""
    contacts: float
    """Per exploration."""
    map_error: float
    """Mean [m]."""
    cpu: float
    """Mean CPU time of an exploration [s]."""
    quicker: Interval | None
    """Probability of being done sooner than the reference; None without it, and for itself."""
    against: dict[str, Interval]
    """Mean time until done as a share of that of each other entry, failures at the time limit."""
    where_both: dict[str, Interval]
    """The same where both succeed; without those never comparable."""
    versions: tuple[str, ...]
    """Versions of slamgym."""


@dataclass(frozen=True)
class TrackBoard:
    """The entries of a track, the best first, those without a rank behind the others."""

    track: str
    about: str
    quick: bool
    explorations: int
    standings: tuple[Standing, ...]


def rank(results: Sequence[BenchResult], manifest: Manifest) -> list[TrackBoard]:
    """Boards in the manifest's order, each of the whole track before that of its quick subset."""
    boards = []
    for track in manifest.tracks:
        for quick in (False, True):
            own = [one for one in results if one.track == track.name and one.quick == quick]
            if own:
                boards.append(_board(own, track, quick))
    return boards


def _board(results: Sequence[BenchResult], track: Track, quick: bool) -> TrackBoard:
    """The board of a track, or of its quick subset."""
    entries: dict[str, list[BenchResult]] = {}
    for result in results:
        entries.setdefault(result.entry, []).append(result)
    standings = [_standing(name, entries) for name in entries]
    standings.sort(key=lambda standing: (not standing.passed, standing.score.value))
    return TrackBoard(track.name, track.about, quick, len(results[0].rows), tuple(standings))


def _standing(entry: str, entries: Mapping[str, Sequence[BenchResult]]) -> Standing:
    runs = entries[entry]
    rows = [row for result in runs for row in result.rows]
    successes = [row.success for row in rows]
    success = wilson_interval(sum(successes), len(successes))
    others = {name: found for name, found in entries.items() if name != entry}
    done = _table(runs, _done)
    where_both = {name: _ratio_where_both(runs, found) for name, found in others.items()}
    return Standing(
        entry=entry,
        runs=len(runs),
        score=interquartile_mean(_table(runs, _pace)),
        success=success,
        passed=success.high >= PROMISED,
        done=crossed_mean(done),
        path=crossed_mean(_table(runs, lambda row: row.path)),
        contacts=float(np.mean([row.contacts for row in rows])),
        map_error=float(np.mean([row.map_error for row in rows])),
        cpu=float(np.mean([row.cpu for row in rows])),
        quicker=None if entry == REFERENCE else _quicker(runs, entries.get(REFERENCE)),
        against={name: crossed_ratio(done, _table(found, _done)) for name, found in others.items()},
        where_both={name: ratio for name, ratio in where_both.items() if ratio is not None},
        versions=tuple(sorted({result.versions.get("slamgym", "unknown") for result in runs})),
    )


def _quicker(
    runs: Sequence[BenchResult], reference: Sequence[BenchResult] | None
) -> Interval | None:
    """Probability of being done sooner than the reference, where there is one."""
    if reference is None:
        return None
    return probability_of_improvement(_table(runs, _pace), _table(reference, _pace))


def _ratio_where_both(
    runs: Sequence[BenchResult], others: Sequence[BenchResult]
) -> Interval | None:
    """Mean time until done over that of another entry, on the plans where both succeed."""
    ours = _table(runs, _done_if_successful)
    theirs = _table(others, _done_if_successful)
    on_both = np.isfinite(ours).any(axis=0) & np.isfinite(theirs).any(axis=0)
    return ratio_where_both(ours, theirs) if on_both.any() else None


def _pace(row: BenchRow) -> float:
    return row.pace


def _done(row: BenchRow) -> float:
    return row.done


def _done_if_successful(row: BenchRow) -> float:
    return row.done if row.success else np.nan


def _table(runs: Sequence[BenchResult], figure: Callable[[BenchRow], float]) -> FloatArray:
    """A figure of the rows, shape (runs, plans)."""
    return np.array([[figure(row) for row in result.rows] for result in runs], dtype=np.float64)


def leaderboard_page(boards: Sequence[TrackBoard], manifest: Manifest) -> str:
    """The leaderboard as a Markdown page."""
    head = [
        "# Leaderboard\n",
        f"{BENCH} {BENCH_VERSION}, manifest SHA-256 `{manifest.sha256}`. [The benchmark](bench.md) explains "
        "the measures and how to enter an explorer. `slamgym bench leaderboard` makes this page from the result "
        "files.\n",
        "*Score*: interquartile mean of the time until done over the par time of the plan (60 s and 3 s for each m²); "
        "a failure counts as the time limit; smaller is better. *Gate*: an entry is ranked if the interval of its "
        "success reaches 95 %. *Quicker*: probability of being done sooner than "
        f"`{REFERENCE}` on the same plan. The second table of a track compares entries: mean time until done over that "
        "of one behind it, failures at the time limit; the third only on the plans where both succeed. Intervals are "
        "95 %.\n",
    ]
    return "\n".join(head) + "\n" + describe_boards(boards)


def describe_boards(boards: Sequence[TrackBoard]) -> str:
    """The tables alone, as Markdown."""
    parts = []
    for board in boards:
        subset = f", quick subset of {board.explorations}" if board.quick else ""
        remark = "; it shows that things run, and ranks nobody" if board.quick else ""
        explorations = counted(board.explorations, "exploration")
        parts += [
            f"## {board.track}{subset}\n",
            f"{board.about[0].upper()}{board.about[1:]}; {explorations}{remark}.\n",
            _board_table(board),
        ]
        if len(board.standings) > 1:
            of_all = {one.entry: one.against for one in board.standings}
            of_both = {one.entry: one.where_both for one in board.standings}
            parts += [
                _ratio_table("time until done", of_all),
                _ratio_table("both succeed", of_both),
            ]
    return "\n".join(parts)


def _board_table(board: TrackBoard) -> str:
    header = [
        "entry",
        "rank",
        "score",
        "success [%]",
        "time until done [s]",
        "contacts",
        "map error [cm]",
        "quicker [%]",
        "CPU [s]",
    ]
    rows = []
    for place, one in enumerate(board.standings, start=1):
        rank_or_gate = str(place) if one.passed else "gate"
        trainings = f" ({one.runs} trainings)" if one.runs > 1 else ""
        rows.append(
            [
                f"`{one.entry}`{trainings}",
                "-" if board.quick else rank_or_gate,
                with_bounds(one.score),
                with_bounds(one.success, 0, 100.0),
                with_bounds(one.done, 0),
                f"{one.contacts:.2f}",
                f"{100.0 * one.map_error:.1f}",
                with_bounds(one.quicker, 0, 100.0),
                f"{one.cpu:.1f}",
            ]
        )
    return markdown(header, rows)


def _ratio_table(head: str, ratios: Mapping[str, Mapping[str, Interval]]) -> str:
    """Ratios of each entry to those behind it."""
    names = list(ratios)
    rows = []
    for place, (entry, own) in enumerate(ratios.items()):
        behind = names[place + 1 :]
        ahead = [""] * place
        rows.append([f"`{entry}`", *ahead, *(with_bounds(own.get(name)) for name in behind)])
    return markdown([head, *(f"/ `{name}`" for name in names[1:])], rows[:-1])


def boards_as_json(boards: Sequence[TrackBoard], manifest: Manifest) -> str:
    """The same for programs."""
    document = {
        "bench": BENCH,
        "version": BENCH_VERSION,
        "manifest": manifest.sha256,
        "boards": [dataclasses.asdict(board) for board in boards],
    }
    return json_text(document)
