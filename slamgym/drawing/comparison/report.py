"""A comparison of a map with a plan as a page."""

from collections.abc import Iterator

import numpy as np

import slamgym
from slamgym.cad.floorplan import FloorPlan
from slamgym.core.text import markup
from slamgym.core.types import OccupancyGrid
from slamgym.drawing.comparison.picture import COLOURS, draw_comparison
from slamgym.drawing.comparison.records import COLUMNS, PlanComparison
from slamgym.drawing.formats.html import (
    REPORT_STYLE,
    doubts_part,
    figures_part,
    provenance_part,
    sentence,
)
from slamgym.viz.pages import figure, inline_picture, make_page, make_table, paragraph


def format_comparison(
    found: PlanComparison, plan: FloorPlan, grid: OccupancyGrid, command: str
) -> str:
    """The text of the page on a plan and a map, with the command that made it."""
    picture = f'<img alt="the map over its plan" src="{inline_picture(draw_comparison(found, plan, grid))}">'
    words = (
        "Green: as planned. "
        if found.is_confident
        else "The map where it fits best; don't rely on it. "
    )
    parts = [
        f"<h1>{markup(verdict(found))}</h1>",
        f'<p class="lead"><code>{markup(found.map)}</code>, a robot\'s map, against the plan '
        f"<code>{markup(found.plan)}</code>.</p>",
        doubts_part([sentence(doubt) for doubt in found.doubts]),
        figures_part(_figures(found)),
        figure(picture, f"{words}The map is grey: white is free, unknown is darker."),
        _legend(found),
        *_tables(found),
        "<h2>How it was made</h2>",
        *provenance_part({"command": command, "slamgym": slamgym.__version__}),
    ]
    return make_page(f"{found.map} against {found.plan}", parts, REPORT_STYLE)


def _figures(found: PlanComparison) -> list[tuple[str, str]]:
    kinds = [wall.kind for wall in found.walls]
    pose = found.registration.plan_from_map
    shown = [(f"{found.registration.explained:.0%}", "of the walls in view are there")]
    if found.is_confident:
        shown += [
            (str(len(found.changes)), "changes"),
            (f"{kinds.count('wall_present')} of {len(kinds)}", "walls at their place"),
            (str(kinds.count("wall_not_seen")), "walls not seen"),
        ]
    turn = np.degrees(pose.theta)
    return [
        *shown,
        (f"{pose.x:.2f}, {pose.y:.2f} m, {turn:.1f}°", "the map's origin lies on the plan at"),
    ]


def verdict(found: PlanComparison) -> str:
    """The result in a few words."""
    return (
        f"{len(found.changes)} changes" if found.is_confident else "NOT THE SAME BUILDING, it seems"
    )


def _legend(found: PlanComparison) -> str:
    """The colours that the picture uses, and what they mean."""
    kinds = {finding.kind for finding in (*found.walls, *found.changes)}
    entries = "".join(
        f'<li><span class="key line" style="color: rgb{colour}"></span>{markup(text)}</li>'
        for kind, (colour, text) in COLOURS.items() if kind in kinds
    )  # fmt: skip
    return f'<ul class="legend">{entries}</ul>'


def _tables(found: PlanComparison) -> Iterator[str]:
    yield "<h2>Changes</h2>"
    if not found.is_confident:
        yield paragraph("None is reported, because plan and map don't seem to be of one building.")
    elif not found.changes:
        yield paragraph("None was found. Walls that nobody has seen may have changed all the same.")
    else:
        yield paragraph(
            "A wall moves to the left of its line, a door along it. The offset is without the map's own drift, "
            "with its standard error; the raw offset is what the map shows."
        )
        yield make_table([name.replace("_", " ") for name in COLUMNS], found.table())
    if found.rooms:
        yield "<h2>Rooms of the plan</h2>"
        yield make_table(
            ["room", "seen"], [(room.what, f"{room.seen:.0%}") for room in found.rooms]
        )
