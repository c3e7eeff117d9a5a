"""``slamgym dataset merge``: put the shards of a dataset together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from slamgym.core.config import Arguments
from slamgym.core.progress import counted, tell

if TYPE_CHECKING:
    from slamgym.dataset.merge import MergeReport

_SHOWN = 5


class MergeArguments(Arguments):
    """Put the shards that ``slamgym generate --shard`` has made below a folder together, in that folder.

    Files are linked, not copied, where the file system can; the shards stay and may be removed afterwards.
    Run it again whenever shards were added. Afterwards the same ``slamgym generate`` without ``--shard`` adds
    the pairs that are missing, if explorations failed.
    """

    root: tyro.conf.Positional[Path]
    """The folder that holds the shards."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(MergeArguments, args=argv, prog="slamgym dataset merge")
    from slamgym.dataset.merge import merge_shards
    from slamgym.dataset.statistics import describe_pairs

    report = merge_shards(arguments.root)
    tell(_describe(report), *describe_pairs(arguments.root).splitlines())
    return 0


def _describe(report: MergeReport) -> str:
    lines = f"{counted(report.fresh, 'new pair')} of {counted(report.shards, 'shard')}."
    if report.missing:
        more = "" if len(report.missing) <= _SHOWN else f" and {len(report.missing) - _SHOWN} more"
        lines += f" Not there: {', '.join(report.missing[:_SHOWN])}{more}."
    if report.broken:
        lines += (
            f" Left out: {counted(len(report.broken), 'pair')} without one of its files, such as {report.broken[0]}: "
            "run `slamgym generate` for their shards again."
        )
    return lines
