"""``slamgym dataset realism``: what tells a dataset's maps from those of robots."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from slamgym.commands.frame import Out, is_installed, show_table
from slamgym.core.config import Arguments, Count, Seed
from slamgym.core.documents import json_text
from slamgym.core.errors import ConfigError
from slamgym.core.progress import say, tell

if TYPE_CHECKING:
    from slamgym.dataset.realism.comparison import RealismReport

SHOWN_STATISTICS = 4
"""The most telling ones, which get examples."""


class RealismArguments(Arguments):
    """Compare the SLAM maps of a dataset with maps of robots: statistics, two-sample tests, examples.

    Writes OUT/realism.html, which holds everything, realism.json and realism.md. The trees need
    scikit-learn (extra `clean`); without it they are left out, and the page says so.
    """

    dataset: tyro.conf.Positional[Path]
    """A dataset of `slamgym generate`, or a folder of ROS maps."""
    against: tuple[Path, ...]
    """Reference sets: folders (with subfolders) of ROS maps, or datasets."""
    out: Out = Path("realism")
    """Folder for the page."""
    building: str | None = None
    """A regular expression that finds the building in the name of a reference map, such as '^[^_]+'; without it
    each map is a separate building. Buildings are never on both sides of a test."""
    halvings: Count = 10
    """Number of halvings of a set, for its null."""
    seed: Seed = 0
    """Seed of folds, halves and learners."""

    def _check(self) -> None:
        if not self.against:
            raise ConfigError(
                "--against names no folder; give the reference maps' folders behind it"
            )


def main(arguments: RealismArguments) -> None:
    """Run the command."""
    from slamgym.core.files import write_text
    from slamgym.dataset.realism.comparison import RealismReport, compare_statistics, read_map_sets
    from slamgym.dataset.realism.page import (
        draw_examples,
        realism_page,
        statistics_table,
        tests_table,
        to_json,
        to_markdown,
    )

    own, *references = read_map_sets((arguments.dataset, *arguments.against), arguments.building)
    for one in (own, *references):
        say(f"{one.name}: {one.summary}")
    statistics = compare_statistics(own, references, arguments.seed)
    report = RealismReport(own, references, arguments.seed, statistics)
    _test(report, arguments)
    figures = [draw_examples(own, references, row) for row in report.ranked[:SHOWN_STATISTICS]]
    out = arguments.out
    write_text(out / "realism.json", json_text(to_json(report)))
    write_text(out / "realism.md", to_markdown(report))
    write_text(out / "realism.html", realism_page(report, figures))
    show_table(*statistics_table(report))
    show_table(*tests_table(report), None, *report.left_out)
    tell(f"{out / 'realism.html'}")


def _test(report: RealismReport, arguments: RealismArguments) -> None:
    """Add the tests between all sets, and of the halves of each set."""
    from slamgym.dataset.realism.comparison import TREES, learn_by_trees

    if not is_installed("sklearn"):
        install = "pip install 'slamgym[clean]'"
        report.left_out.append(f"{TREES}: left out, scikit-learn isn't installed; {install}")
        return
    halves = [(one, one) for one in report.sets]
    for first, second in [*itertools.combinations(report.sets, 2), *halves]:
        repeats = arguments.halvings if first is second else 2
        report.test(TREES, learn_by_trees, first, second, repeats)
