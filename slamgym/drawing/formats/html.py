"""The report of a drawing as a page, and the index of several reports: what to check comes first."""

import itertools
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import shapely

import slamgym
from slamgym.core.progress import counted
from slamgym.core.text import markup
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.formats.json import drawing_facts
from slamgym.drawing.formats.look import DRAWING_STYLE, Sheet, drawn_scene, format_part
from slamgym.drawing.formats.svg import LETTERS, drawn_layers, svg_point
from slamgym.drawing.formats.upright import upright
from slamgym.drawing.settings import MAJORITY
from slamgym.viz.pages import bullets, inline_picture, make_page, make_table, paragraph

PAGE = (0.18, 0.16)
"""Width and height that a figure may take of a page [m]."""
PAPER_SCALES = (20, 50, 75, 100, 150, 200, 300, 500, 750, 1000, 1500, 2000, 5000, 10_000, 50_000)
"""Drawn 1 to one of these."""
SCRIPTS = ("plan.js", "clicks.js", "report.js")
"""The parts of a report's script, in their order."""
INDEX = Path("index.html")
"""Page of a folder of reports."""

REPORT_STYLE = format_part("report.css")
"""CSS of reports."""


def format_html(drawing: Drawing) -> str:
    """The text of the file."""
    # In a script element only "<" could end the element early.
    facts = json.dumps(drawing_facts(drawing), separators=(",", ":")).replace("<", "\\u003c")
    values = {
        "name": markup(drawing.name),
        "source": markup(str(drawing.provenance.get("source", drawing.name))),
        "cell": f"{100 * drawing.grid.frame.resolution:g}",
        "angle": f"{drawing.angle_deg:.1f}",
        "doubts": doubts_part(checks(drawing)),
        "figures": figures_part(key_figures(drawing)),
        "dimensioned": _svg(upright(drawing), "the drawing with dimensions"),
        "over": _svg(drawing, "the drawing over its map", with_map=True),
        "data": facts,
        "script": "".join(map(format_part, SCRIPTS)),
        "rooms": _rooms_table(drawing),
        "doors": _doors_table(drawing),
        "provenance": "".join(provenance_part(drawing.provenance)),
    }
    body = format_part("report.html", values)
    title = f"{drawing.name}: a drawing of a robot's map"
    return make_page(title, [body], DRAWING_STYLE + REPORT_STYLE, scripted=True)


def checks(drawing: Drawing) -> list[str]:
    """Points to check first, a sentence each: the drawing's doubts, and the parts that were hardly seen."""
    found = [sentence(doubt) for doubt in drawing.doubts]
    unseen = [room for room in drawing.rooms if room.share_seen < MAJORITY]
    if unseen:
        names = ", ".join(f"{room.name} ({room.share_seen:.0%})" for room in unseen)
        found.append(f"Rooms of which the robot saw less than half: {names}.")
    numbered = enumerate(drawing.doors, 1)
    closed = [f"D{number}" for number, door in numbered if door.layer == "INFERRED"]
    if closed:
        found.append(f"Doors that were hardly seen open: {', '.join(closed)}.")
    return found


def doubts_part(doubts: Sequence[str]) -> str:
    """A box with what to check, or the statement that nothing was found."""
    if not doubts:
        return '<div class="doubts none">No doubt was found. Doubts are found by rules, which can miss one.</div>'
    return f'<div class="doubts"><b>Check first</b>{bullets(doubts)}</div>'


def figures_part(figures: Sequence[tuple[str, str]]) -> str:
    """Figures and what they are of, in a row."""
    entries = "".join(f"<li><b>{markup(value)}</b>{markup(of)}</li>" for value, of in figures)
    return f'<ul class="figures">{entries}</ul>'


def key_figures(drawing: Drawing) -> list[tuple[str, str]]:
    """The figures of a drawing that count, and what they are of."""
    unseen = sum(float(part.area) for part in drawing.inferred_floor)
    sizes = [dimension.length for dimension in drawing.dimensions if dimension.of == "building"]
    length = sum(wall.length for wall in drawing.walls)
    inferred = sum(wall.length for wall in drawing.walls if wall.layer == "INFERRED")
    return [
        (f"{drawing.area:.1f} m²", "floor"),
        (f"{1.0 - unseen / max(drawing.area, 1e-9):.0%}", "of it seen"),
        (str(len(drawing.rooms)), "rooms"),
        (str(len(drawing.doors)), "doors"),
        (" x ".join(f"{size:.1f}" for size in sizes) + " m", "overall"),
        (f"{length:.0f} m", "of wall"),
        (f"{1.0 - inferred / max(length, 1e-9):.0%}", "of them seen"),
    ]


def provenance_part(provenance: dict[str, Any]) -> Iterator[str]:
    """The command, the version and the model."""
    if "command" in provenance:
        yield f"<p>This page was made by</p><pre><code>{markup(str(provenance['command']))}</code></pre>"
    model = f", model {provenance['model']}" if "model" in provenance else ""
    yield paragraph(f"slamgym {provenance.get('slamgym', '')}{model}.")


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"


def _svg(drawing: Drawing, label: str, with_map: bool = False) -> str:
    """A figure of what is drawn, or of the whole map too, to the largest round scale that fits on a page."""
    left, bottom, right, top = drawing.grid.frame.bounds
    shown = [shapely.box(*drawing.bounds)]
    if with_map:
        shown.append(shapely.box(left, bottom, right, top))
    box = shapely.total_bounds(shown).tolist()
    for scale in PAPER_SCALES:
        sheet = Sheet.of(box, 1e-3 * LETTERS * scale)
        if sheet.width <= PAGE[0] * scale and sheet.height <= PAGE[1] * scale:
            break
    head = (
        f'<svg role="img" aria-label="{label}" style="--paper: {1000 * sheet.width / scale:.1f}mm" '
        f'viewBox="0 0 {1000 * sheet.width:.0f} {1000 * sheet.height:.0f}" '
        f'data-left="{sheet.left}" data-top="{sheet.top}">'
    )
    ground = ["<g>"]
    if with_map:
        x, y = svg_point((left, top), sheet).split(",")
        picture = (
            f'<image x="{x}" y="{y}" width="{1000 * (right - left):.0f}" height="{1000 * (top - bottom):.0f}" '
            f'preserveAspectRatio="none" href="{inline_picture(drawing.grid.cells)}"/>'
        )
        ground = [picture, '<g class="over">']
    shapes, labels = drawn_scene(drawing, sheet, f" · 1:{scale} on A4")
    layers = drawn_layers(shapes, labels, sheet).values()
    return "\n".join([head, *ground, *itertools.chain(*layers), "</g></svg>"])


def _rooms_table(drawing: Drawing) -> str:
    rows = []
    for room in drawing.rooms:
        sizes = [f"{line.length:.2f} m" for line in drawing.dimensions if line.of == room.id]
        doors = ", ".join(
            f"D{k}" for k, door in enumerate(drawing.doors, 1) if room.id in door.rooms
        )
        width, depth = (*sizes, "", "")[:2]
        area = f"{room.area:.2f} m²"
        seen = f"{room.share_seen:.0%}"
        rows.append((room.name, area, width, depth, seen, doors))
    headings = ["room", "area", "width", "depth", "seen", "doors"]
    return make_table(headings, rows, [room.layer for room in drawing.rooms])


def _doors_table(drawing: Drawing) -> str:
    if not drawing.doors:
        return paragraph("No door was found.")
    names = {room.id: room.name for room in drawing.rooms}
    rows = []
    for number, door in enumerate(drawing.doors, 1):
        joins = " and ".join(names[room] for room in door.rooms)
        width = f"{door.width:.2f} m"
        depth = f"{100 * door.depth:.0f} cm"
        rows.append((f"D{number}", door.kind, width, depth, joins, f"{door.confidence:.0%}"))
    headings = ["door", "kind", "clear width", "in a wall of", "joins", "seen open"]
    return make_table(headings, rows, [door.layer for door in drawing.doors])


def format_index(
    title: str, reports: Sequence[tuple[str, Sequence[str]]], failures: Sequence[str], command: str
) -> str:
    """The text of a page that links to the reports in its folder, ``NAME.html``.

    Args:
        title: What the maps are.
        reports: Name and what to check of each; those with most to check are shown first.
        failures: Why others could not be drawn.
        command: That made it.
    """
    doubtful = sum(bool(doubts) for _, doubts in reports)
    parts = [
        f"<h1>{markup(title)}</h1>",
        paragraph(
            f"{counted(len(reports), 'map')} drawn, {doubtful} of them with something to check, {len(failures)} "
            "refused. The maps with most to check come first."
        ),
        f"<h2>Refused</h2>{bullets(failures)}" if failures else "",
    ]
    for name, doubts in sorted(reports, key=lambda report: (-len(report[1]), report[0])):
        link = markup(quote(os.fsencode(f"./{name}.html")))
        parts.append(f'<h2><a href="{link}">{markup(name)}</a></h2>{bullets(doubts)}')
    parts += provenance_part({"command": command, "slamgym": slamgym.__version__})
    return make_page(f"Drawings of {title}", parts, REPORT_STYLE)
