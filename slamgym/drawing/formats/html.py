"""The report of a drawing as a page, and the index of several reports: what to check comes first."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import slamgym
from slamgym.core.progress import counted
from slamgym.core.text import markup
from slamgym.drawing.drawing import Drawing, DrawnRoom
from slamgym.drawing.formats.svg import STYLE, Sheet, shape_layers, size_layer
from slamgym.drawing.settings import SEEN_SHARE
from slamgym.viz.pages import bullets, figure, inline_picture, make_page, make_table, paragraph

PAGE = (180.0, 160.0)
"""Width and height that a figure may take of a page [mm]."""
PAPER_SCALES = (20, 50, 75, 100, 150, 200, 300, 500, 750, 1000, 1500, 2000, 5000, 10_000, 50_000)
"""Drawn 1 to one of these."""
SURE = 0.7
"""Walls below this confidence are named as a doubt."""
INDEX = Path("index.html")
"""Page of a folder of reports."""

REPORT_STYLE = """
h1 { margin-bottom: .2rem } .lead { margin-top: 0; font-size: 1.1em } code { overflow-wrap: anywhere }
.doubts { background: #fff4e6; border-left: 5px solid #fd7e14; padding: .4rem 1rem; margin: 1rem 0 }
.doubts { break-inside: avoid } td { white-space: nowrap } td:last-child { white-space: normal }
.doubts.none { background: #ebfbee; border-color: #40c057 } .doubts ul { margin: .3rem 0; padding-left: 1.2rem }
.figures { display: flex; flex-wrap: wrap; gap: .5rem 2.2rem; margin: 1rem 0; padding: 0; list-style: none }
.figures b { display: block; font-size: 1.5em } .legend { list-style: none; padding: 0; display: flex; flex-wrap: wrap }
.legend li { margin-right: 1.4rem } .key { display: inline-block; width: 1.6em; height: .8em; margin-right: .4em;
border: 1px solid #868e96 } .key.line { height: 0; border: 0; border-top: 3px solid; vertical-align: middle }
.INFERRED td:first-child { border-left: 4px solid #fd7e14 }
figure { margin: .5rem 0; break-inside: avoid } figcaption { color: #495057; font-size: .9em; max-width: 60rem }
figure svg { display: block; width: 100%; height: auto; max-height: 92vh; background: #f1f3f5 }
.over .room { fill: none } .over .floor-inferred, .over .unexplored { fill-opacity: .55 }
.over .wall { fill-opacity: .8 }
svg image { image-rendering: pixelated }
@media print { .sheet { break-before: page } figure svg { width: var(--paper); max-height: none } }
"""
_COLOURS = (
    "Black: walls that were seen; grey: inferred; light blue: floor that was never observed; yellow: unexplored, or "
    "partly seen; blue: doors."
)
_ACCURACY = (
    "A drawing is no better than its map. What stands along a wall, a wardrobe or a kitchen, looks like the wall to a "
    "robot: the room is wider then than it is drawn. Measure what has to fit."
)


def format_html(drawing: Drawing) -> str:
    """The text of the file."""
    parts = [
        f"<h1>{markup(drawing.name)}</h1>",
        f'<p class="lead">{_lead(drawing)}</p>',
        doubts_part(checks(drawing)),
        figures_part(key_figures(drawing)),
        _dimensioned_figure(drawing),
        '<h2 class="sheet">The map, what was seen and what is inferred</h2>',
        *_evidence_part(drawing),
        "<h2>Rooms</h2>",
        *_rooms_part(drawing),
        "<h2>Doors</h2>",
        *_doors_part(drawing),
        "<h2>How it was made</h2>",
        *provenance_part(drawing.provenance),
    ]
    return make_page(f"{drawing.name}: a drawing of a robot's map", parts, STYLE + REPORT_STYLE)


def checks(drawing: Drawing) -> list[str]:
    """Points to check first, a sentence each: the drawing's doubts, and the parts that were hardly seen."""
    found = [sentence(doubt) for doubt in drawing.doubts]
    unseen = [room for room in drawing.rooms if room.share_seen < SEEN_SHARE]
    if unseen:
        names = ", ".join(f"{room.id} ({room.share_seen:.0%})" for room in unseen[:8])
        more = f" and {len(unseen) - 8} more" if len(unseen) > 8 else ""
        found.append(f"Rooms of which the robot saw less than half: {names}{more}.")
    if drawing.unexplored:
        area = sum(float(part.area) for part in drawing.unexplored)
        found.append(
            f"{counted(len(drawing.unexplored), 'part').capitalize()} inside of the building or behind its doors, "
            f"{area:.1f} m² together, weren't explored or only partly seen: rooms may be missing there."
        )
    closed = [f"D{number}" for number, door in enumerate(drawing.doors, 1) if door.layer == "INFERRED"]
    if closed:
        found.append(f"Doors that were hardly seen open, or lead to unexplored parts: {', '.join(closed)}.")
    unsure = sum(wall.length for wall in drawing.walls if wall.confidence < SURE)
    total = sum(wall.length for wall in drawing.walls)
    if unsure > 0.25 * total:
        found.append(f"{unsure / total:.0%} of the walls' length is less than {SURE:.0%} sure.")
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


def _lead(drawing: Drawing) -> str:
    source = drawing.provenance.get("source")
    origin = f", drawn from <code>{markup(str(source))}</code>" if source else ""
    cell = 100 * drawing.grid.frame.resolution
    return (
        f"{drawing.area:.1f} m² of floor with {counted(len(drawing.rooms), 'room')} and "
        f"{counted(len(drawing.doors), 'door')}{origin}, a map with cells of {cell:g} cm. Its main walls run at "
        f"{drawing.angle_deg:.1f}° to the map's x axis."
    )


def _svg(sheet: Sheet, parts: Sequence[str], label: str) -> str:
    """A figure with a scale bar, to a round scale on paper."""
    return "\n".join(
        [
            f'<svg role="img" aria-label="{markup(label)}" style="--paper: {1000 * sheet.width / sheet.scale:.1f}mm" '
            f'viewBox="0 0 {1000 * sheet.width:.0f} {1000 * sheet.height:.0f}">',
            *parts,
            *sheet.scale_bar(" on A4"),
            "</svg>",
        ]
    )


def _sheet(bounds: Sequence[tuple[float, float, float, float]]) -> Sheet:
    """A sheet for all of some boxes (min x, min y, max x, max y), to the largest scale that fits on a page."""
    low_x, low_y, high_x, high_y = zip(*bounds, strict=True)
    sheets = [Sheet.of((min(low_x), min(low_y), max(high_x), max(high_y)), scale) for scale in PAPER_SCALES]
    fitting = (
        sheet
        for sheet in sheets
        if 1000 * sheet.width <= PAGE[0] * sheet.scale and 1000 * sheet.height <= PAGE[1] * sheet.scale
    )
    return next(fitting, sheets[-1])


def _dimensioned_figure(drawing: Drawing) -> str:
    ends = [(*end, *end) for line in drawing.dimensions for end in (line.start, line.end)]
    sheet = _sheet([drawing.bounds, *ends])
    parts = [part for layer in shape_layers(drawing, sheet).values() for part in layer]
    caption = f"Lengths in metres. {_COLOURS} Lines that are too short for their figure are left out."
    return figure(_svg(sheet, [*parts, *size_layer(drawing, sheet)], "the drawing with dimensions"), caption)


def _evidence_part(drawing: Drawing) -> Iterator[str]:
    frame = drawing.grid.frame
    left, bottom, right, top = frame.bounds
    sheet = _sheet([frame.bounds, drawing.bounds])
    x, y = sheet.place((left, top)).split(",")
    ground = (
        f'<image x="{x}" y="{y}" width="{1000 * (right - left):.0f}" height="{1000 * (top - bottom):.0f}" '
        f'preserveAspectRatio="none" href="{inline_picture(drawing.grid.cells)}"/>'
    )
    words = (
        f"The known part of the map: {right - left:.1f} m by {top - bottom:.1f} m, {frame.width_px} by "
        f"{frame.height_px} cells; x from {left:.2f} to {right:.2f} m, y from {bottom:.2f} to {top:.2f} m. White: "
        "free, black: occupied, grey: unknown."
    )
    yield figure(_svg(sheet, [ground], f"the map {drawing.name}"), words)
    parts = [part for layer in shape_layers(drawing, sheet).values() for part in layer]
    names = [
        sheet.text((0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])), f"D{number}", "blue")
        for number, (a, b) in enumerate(((door.start, door.end) for door in drawing.doors), 1)
    ]
    over = _svg(sheet, [ground, '<g class="over">', *parts, "</g>", *names], "the drawing over its map")
    yield figure(over, "The drawing over that map, with the numbers of its doors.")
    yield paragraph(
        "A wall counts as seen where the map has an echo within 15 cm along at least half of it. Inferred is what "
        "buildings usually have in such a place; the robot hasn't seen it."
    )


def _rooms_part(drawing: Drawing) -> Iterator[str]:
    yield paragraph(
        "Width and depth are the clear lengths of the dimension lines through the middle of the room. An orange edge "
        f"marks rooms of which less than half was seen. {_ACCURACY}"
    )
    yield make_table(
        ["room", "area", "width", "depth", "seen", "doors"],
        [_room_row(room, drawing) for room in drawing.rooms],
        [room.layer for room in drawing.rooms],
    )


def _room_row(room: DrawnRoom, drawing: Drawing) -> tuple[str, ...]:
    sizes = [f"{line.length:.2f} m" for line in drawing.dimensions if line.of == room.id][:2]
    doors = [f"D{number}" for number, door in enumerate(drawing.doors, 1) if room.id in door.rooms]
    sizes += [""] * (2 - len(sizes))
    return room.id, f"{room.area:.2f} m²", *sizes, f"{room.share_seen:.0%}", ", ".join(doors)


def _doors_part(drawing: Drawing) -> Iterator[str]:
    if not drawing.doors:
        yield paragraph("No door was found.")
        return
    rows = [
        (
            f"D{number}",
            door.kind,
            f"{door.width:.2f} m",
            f"{100 * door.depth:.0f} cm",
            " and ".join(door.rooms),
            f"{door.confidence:.0%}",
        )
        for number, door in enumerate(drawing.doors, 1)
    ]
    headings = ["door", "kind", "clear width", "in a wall of", "joins", "seen open"]
    yield make_table(headings, rows, [door.layer for door in drawing.doors])


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
