"""The realism page: one HTML file with everything in it, and the same figures as JSON and Markdown."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from slamgym import __version__
from slamgym.core.intervals import Interval
from slamgym.core.progress import counted
from slamgym.core.text import markdown, markup
from slamgym.dataset.realism.comparison import SetTestRow, StatisticRow
from slamgym.dataset.realism.map_sets import MapSet
from slamgym.dataset.realism.pictures import Figure
from slamgym.metrics.map_look import LOOK_CELL
from slamgym.viz.pages import bullets, inline_picture, make_page, make_table, paragraph

_STYLE = ".apart { background: #ffe3e3 } .null { color: #868e96 }"


@dataclass
class RealismReport:
    """What a comparison found."""

    own: MapSet
    references: list[MapSet]
    seed: int
    statistics: list[StatisticRow]
    tests: list[SetTestRow] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    """Sentences about tests that could not be made."""

    @property
    def sets(self) -> list[MapSet]:
        """The dataset, then the references."""
        return [self.own, *self.references]

    @property
    def ranked(self) -> list[StatisticRow]:
        """The statistics, the most telling first."""
        return sorted(self.statistics, key=lambda row: -row.telling)

    @property
    def learners(self) -> list[str]:
        """Of the tests, in their order."""
        return list(dict.fromkeys(test.learner for test in self.tests))

    def test_lines(self) -> dict[tuple[str, str], dict[str, Interval]]:
        """Tests by their sets, then by learner: those of the dataset first, then nulls, then between references."""
        lines: dict[tuple[str, str], dict[str, Interval]] = {}
        for test in sorted(self.tests, key=lambda t: (t.is_null or t.first != self.own.name, not t.is_null)):
            lines.setdefault((test.first, test.second), {})[test.learner] = test.accuracy
        return lines


def to_json(report: RealismReport) -> dict[str, Any]:
    """The figures in JSON form."""
    return {
        "slamgym": __version__,
        "seed": report.seed,
        "cell_m": LOOK_CELL,
        "dataset": report.own.name,
        "sets": [
            {
                "name": one.name,
                "maps": len(one.maps),
                "buildings": len(set(one.buildings)),
                "skipped": one.skipped,
            }
            for one in report.sets
        ],
        "statistics": [asdict(row) for row in report.statistics],
        "most_telling": [row.name for row in report.ranked],
        "tests": [asdict(test) | {"is_null": test.is_null} for test in report.tests],
        "left_out": report.left_out,
    }


def to_markdown(report: RealismReport) -> str:
    """Both tables as Markdown."""
    return markdown(*statistics_table(report, distances=False)) + "\n" + markdown(*tests_table(report))


def statistics_table(report: RealismReport, distances: bool = True) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: medians with intervals, and how far the dataset lies from each reference, if wanted."""
    headings = ["median [95 %]", *(one.name for one in report.sets)]
    headings += [f"KS from {reference.name}" for reference in report.references if distances]
    rows = [
        [
            row.label,
            *map(_figure, row.medians.values()),
            *(f"{d:.2f}" for d in row.distances.values() if distances),
        ]
        for row in report.statistics
    ]
    return headings, rows


def tests_table(report: RealismReport) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: balanced accuracies of each learner."""
    rows = []
    for (first, second), found in report.test_lines().items():
        name = f"null: {first}, half against half" if first == second else f"{first} against {second}"
        rows.append([name, *(_figure(found[x]) if x in found else "" for x in report.learners)])
    return ["balanced accuracy [95 %]", *report.learners], rows


def realism_page(report: RealismReport, figures: Sequence[Figure]) -> str:
    """Make the page; it names no other file and no address.

    Args:
        report: What was found.
        figures: Pictures below the tables.
    """
    own = markup(report.own.name)
    parts = [
        f"<h1>Realism of {own}</h1>",
        *(_set_line(one) for one in report.sets),
        "<h2>Can a learner tell the maps apart?</h2>",
        "<p>0.5: it can't; 1: always. Held out by building. A null is the same test between halves of one set; "
        "its interval is over halvings, or over buildings where there was one.</p>",
        _tests_part(report),
        *map(paragraph, report.left_out),
        "<h2>Statistics side by side</h2>",
        f"<p>At cells of {100 * LOOK_CELL:g} cm, over the map cut to its largest free part. Red: the interval lies "
        "apart from the dataset's. KS: Kolmogorov-Smirnov distance; a threshold on this statistic alone tells the "
        "sets apart with a balanced accuracy of (1 + KS) / 2.</p>",
        _statistics_part(report),
        "<h2>The most telling</h2>",
        bullets([f"{row.label}: {row.telling:.2f}" for row in report.ranked[:8]], "ol"),
        *(_figure_part(figure) for figure in figures),
        f"<p><small>slamgym {__version__}, seed {report.seed}</small></p>",
    ]
    return make_page(f"Realism of {report.own.name}", parts, _STYLE)


def _set_line(one: MapSet) -> str:
    skipped = ", ".join(f"{count} {reason}" for reason, count in one.skipped.items())
    left_out = f"; left out: {skipped}" if skipped else ""
    text = f"{counted(len(one.maps), 'map')} of {counted(len(set(one.buildings)), 'building')}{left_out}"
    return f"<p><b>{markup(one.name)}</b>: {markup(text)}</p>"


def _tests_part(report: RealismReport) -> str:
    headings, rows = tests_table(report)
    return make_table(headings, rows, ["null" if row[0].startswith("null") else "" for row in rows])


def _statistics_part(report: RealismReport) -> str:
    """The table with a mark where the interval of another set lies apart from the dataset's."""
    headings, rows = statistics_table(report)
    marks = []
    for statistic, row in zip(report.statistics, rows, strict=True):
        mine = statistic.medians[report.own.name]
        apart = [other.low > mine.high or other.high < mine.low for other in statistic.medians.values()]
        marks.append(["", *("apart" if mark else "" for mark in apart)] + [""] * (len(row) - len(apart) - 1))
    return make_table(headings, rows, cell_classes=marks)


def _figure(found: Interval) -> str:
    return f"{found.value:.3g} [{found.low:.3g}, {found.high:.3g}]"


def _figure_part(figure: Figure) -> str:
    return f'<h3>{markup(figure.heading)}</h3>\n<img alt="" src="{inline_picture(figure.picture)}">'
