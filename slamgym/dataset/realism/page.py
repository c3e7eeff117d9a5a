"""The realism page: one HTML file with everything in it, its pictures, and the same figures as JSON and Markdown."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import cv2
import numpy as np

from slamgym import __version__
from slamgym.core.intervals import Interval
from slamgym.core.text import markdown, markup
from slamgym.core.types import FREE, ByteArray, IntArray
from slamgym.dataset.realism.comparison import MapSet, MeasuredMap, RealismReport, StatisticRow
from slamgym.metrics.map_statistics import LOOK_CELL
from slamgym.metrics.maps import free_boundary
from slamgym.viz.canvas import UNKNOWN_TINT, blank, colour_cells
from slamgym.viz.pages import bullets, inline_picture, make_page, make_table, paragraph
from slamgym.viz.sheets import Card, draw_sheet

_STYLE = ".apart { background: #ffe3e3 } .null { color: #868e96 }"
EXAMPLES = 4
"""Maps of either side that are shown for a statistic."""
_WINDOW = 128
"""Side of the square of a map that an example shows [cells]."""
_PANEL_PX = 256
"""Side of the picture of an example [px]."""

Figure = tuple[str, ByteArray]
"""Heading and RGB picture, (H, W, 3)."""


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
    statistics = markdown(*statistics_table(report, distances=False))
    tests = markdown(*tests_table(report))
    return f"{statistics}\n{tests}"


def statistics_table(
    report: RealismReport, distances: bool = True
) -> tuple[list[str], list[list[str]]]:
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
    learners = list(dict.fromkeys(test.learner for test in report.tests))
    rows = []
    for (first, second), found in report.test_lines().items():
        name = f"{first} against {second}"
        if first == second:
            name = f"null: {first}, half against half"
        figures = [_figure(found[one]) if one in found else "" for one in learners]
        rows.append([name, *figures])
    return ["balanced accuracy [95 %]", *learners], rows


def realism_page(report: RealismReport, figures: Sequence[Figure]) -> str:
    """Make the page; it names no other file and no address.

    Args:
        report: What was found.
        figures: Pictures below the tables.
    """
    own = markup(report.own.name)
    headings, rows = tests_table(report)
    parts = [
        f"<h1>Realism of {own}</h1>",
        *(f"<p><b>{markup(one.name)}</b>: {markup(one.summary)}</p>" for one in report.sets),
        "<h2>Can a learner tell the maps apart?</h2>",
        "<p>0.5: it can't; 1: always. Held out by building. A null is the same test between halves of one set; "
        "its interval is over halvings, or over buildings where there was one.</p>",
        make_table(headings, rows, ["null" if row[0].startswith("null") else "" for row in rows]),
        *map(paragraph, report.left_out),
        "<h2>Statistics side by side</h2>",
        f"<p>At cells of {100 * LOOK_CELL:g} cm, over the map cut to its largest free part. Red: the interval lies "
        "apart from the dataset's. KS: Kolmogorov-Smirnov distance; a threshold on this statistic alone tells the "
        "sets apart with a balanced accuracy of (1 + KS) / 2.</p>",
        _statistics_part(report),
        "<h2>The most telling</h2>",
        bullets([f"{row.label}: {row.telling:.2f}" for row in report.ranked[:8]], "ol"),
        *(
            f'<h3>{markup(heading)}</h3>\n<img alt="" src="{inline_picture(picture)}">'
            for heading, picture in figures
        ),
        f"<p><small>slamgym {__version__}, seed {report.seed}</small></p>",
    ]
    return make_page(f"Realism of {report.own.name}", parts, _STYLE)


def _statistics_part(report: RealismReport) -> str:
    """The table with a mark where the interval of another set lies apart from the dataset's."""
    headings, rows = statistics_table(report)
    marks = []
    for statistic, row in zip(report.statistics, rows, strict=True):
        mine = statistic.medians[report.own.name]
        classes = [""]
        for other in statistic.medians.values():
            is_apart = other.low > mine.high or other.high < mine.low
            classes.append("apart" if is_apart else "")
        without = len(row) - len(classes)
        marks.append(classes + [""] * without)
    return make_table(headings, rows, cell_classes=marks)


def _figure(found: Interval) -> str:
    return f"{found.value:.3g} [{found.low:.3g}, {found.high:.3g}]"


def draw_examples(own: MapSet, references: Sequence[MapSet], row: StatisticRow) -> Figure:
    """Draw maps of the dataset and of the references at their ends of a statistic."""
    others = [(reference.name, one) for reference in references for one in reference.maps]
    mine = np.array([one.statistics[row.name] for one in own.maps])
    theirs = np.array([one.statistics[row.name] for _, one in others])
    sign = 1.0 if np.median(mine) >= np.median(theirs) else -1.0
    my_end = np.argsort(-sign * mine, kind="stable")
    their_end = np.argsort(sign * theirs, kind="stable")
    chosen = [(own.name, own.maps[i]) for i in my_end[:EXAMPLES]]
    chosen += [others[i] for i in their_end[:EXAMPLES]]
    cards = [
        Card((_window(one),), (f"{one.statistics[row.name]:.3g}  {name}", one.name[-40:]))
        for name, one in chosen
    ]
    heading = f"{row.label}: {own.name} above, references below"
    return heading, draw_sheet(cards, EXAMPLES, _PANEL_PX)


def _window(one: MeasuredMap) -> ByteArray:
    """The square of a map with most border of free space in it, RGB; smaller maps lie in its middle."""
    floor = one.floor
    rows, cols = (min(_WINDOW, count) for count in floor.shape)
    border = free_boundary(floor == FREE).astype(np.uint8)
    sums: IntArray = cv2.integral(border).astype(np.int64)
    inside = sums[rows:, cols:] - sums[:-rows, cols:] - sums[rows:, :-cols] + sums[:-rows, :-cols]
    top, left = np.unravel_index(int(inside.argmax()), inside.shape)
    shown = floor[top : top + rows, left : left + cols]
    picture = blank((_WINDOW, _WINDOW), UNKNOWN_TINT)
    y = (_WINDOW - rows) // 2
    x = (_WINDOW - cols) // 2
    picture[y : y + rows, x : x + cols] = colour_cells(shown)
    return picture
