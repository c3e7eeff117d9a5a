"""The report of one drawing: what was drawn, what of it was seen, its sizes, and what to check."""

from collections.abc import Iterator, Sequence
from typing import Any

from slamgym.core.text import markup
from slamgym.drawing.drawing import Drawing, DrawnRoom, DrawnWall
from slamgym.drawing.report.figures import (
    FIGURE_STYLE,
    SURE,
    dimensioned_figure,
    input_and_overlay,
    numbered_figure,
)
from slamgym.viz.pages import bullets, figure, make_page, make_table, paragraph

LISTED_WALLS = 60
"""So many of the longest walls are listed; the other formats have them all."""
LISTED_ROOMS = LISTED_DOORS = 200
BADLY_SEEN = 0.5
"""A room of which less was seen is named as a doubt [share]."""

REPORT_STYLE = """
h1 { margin-bottom: .2rem } .lead { margin-top: 0; font-size: 1.1em }
.doubts { background: #fff4e6; border-left: 5px solid #fd7e14; padding: .4rem 1rem; margin: 1rem 0 }
.doubts { break-inside: avoid } td { white-space: nowrap } td:last-child { white-space: normal }
.doubts.none { background: #ebfbee; border-color: #40c057 } .doubts ul { margin: .3rem 0; padding-left: 1.2rem }
.figures { display: flex; flex-wrap: wrap; gap: .5rem 2.2rem; margin: 1rem 0; padding: 0; list-style: none }
.figures b { display: block; font-size: 1.5em } .legend { list-style: none; padding: 0; display: flex; flex-wrap: wrap }
.legend li { margin-right: 1.4rem } .key { display: inline-block; width: 1.6em; height: .8em; margin-right: .4em;
border: 1px solid #868e96 } .key.line { height: 0; border: 0; border-top: 3px solid; vertical-align: middle }
.columns { display: flex; flex-wrap: wrap; gap: 0 2.5rem; align-items: flex-start } .columns table { margin-top: 0 }
.INFERRED td:first-child { border-left: 4px solid #fd7e14 } code { overflow-wrap: anywhere }
.pair { display: flex; gap: 1rem } .pair figure { flex: 1 }
@media print { .sheet { break-before: page } .columns { gap: 0 1.5rem } }
@media print { .columns th, .columns td { padding: .1rem .4rem } }
"""


def format_html(drawing: Drawing) -> str:
    """The text of the file."""
    parts = [
        f"<h1>{markup(drawing.name)}</h1>",
        f'<p class="lead">{_lead(drawing)}</p>',
        doubts_part(checks(drawing)),
        figures_part(key_figures(drawing)),
        figure(dimensioned_figure(drawing), _DIMENSIONS) if drawing.dimensions else "",
        '<h2 class="sheet">The map, what was seen and what is inferred</h2>',
        *_evidence_part(drawing),
        "<h2>Rooms</h2>",
        *_rooms_part(drawing),
        "<h2>Doors</h2>",
        *_doors_part(drawing),
        '<h2 class="sheet">Walls</h2>',
        *_walls_part(drawing),
        "<h2>How it was made</h2>",
        *provenance_part(drawing.provenance),
    ]
    return make_page(f"{drawing.name}: a drawing of a robot's map", parts, FIGURE_STYLE + REPORT_STYLE)


_DIMENSIONS = (
    "Lengths in metres. Black: walls that were seen; orange: walls and floor that are inferred; blue: doors; violet: "
    "parts that nobody has seen. Lines that are too short for their figure are left out; the tables have them."
)
_ACCURACY = (
    "A drawing is no better than its map. What stands along a wall, a wardrobe or a kitchen, looks like the wall to a "
    "robot: the room is wider then than it is drawn. Measure what has to fit."
)


def checks(drawing: Drawing) -> list[str]:
    """What a person should check first, a sentence each: the drawing's doubts, and what of it was hardly seen."""
    found = [sentence(doubt) for doubt in drawing.doubts]
    unseen = [room for room in drawing.rooms if room.share_seen < BADLY_SEEN]
    if unseen:
        names = ", ".join(f"{room.id} ({room.share_seen:.0%})" for room in unseen[:8])
        more = f" and {len(unseen) - 8} more" if len(unseen) > 8 else ""
        found.append(f"Rooms of which the robot saw less than half: {names}{more}.")
    if drawing.unexplored:
        area = sum(float(part.area) for part in drawing.unexplored)
        parts = _count(len(drawing.unexplored), "part").capitalize()
        found.append(
            f"{parts} inside of the building or behind its doors, {area:.1f} m² together, weren't explored or only "
            "glimpsed: rooms may be missing there."
        )
    closed = [f"D{number}" for number, door in enumerate(drawing.doors, 1) if door.layer == "INFERRED"]
    if closed:
        found.append(
            f"Doors that were hardly seen open, or lead to where the robot only glimpsed: {', '.join(closed)}."
        )
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
    """Figures and what they are of, beside each other."""
    entries = "".join(f"<li><b>{markup(value)}</b>{markup(of)}</li>" for value, of in figures)
    return f'<ul class="figures">{entries}</ul>'


def key_figures(drawing: Drawing) -> list[tuple[str, str]]:
    """The figures of a drawing that count, and what they are of."""
    seen = 1.0 - _unseen(drawing) / max(drawing.area, 1e-9)
    sizes = [dimension.length for dimension in drawing.dimensions if dimension.of == "building"]
    return [
        (f"{drawing.area:.1f} m²", "floor"),
        (f"{seen:.0%}", "of it seen"),
        (str(len(drawing.rooms)), "rooms"),
        (str(len(drawing.doors)), "doors"),
        (" x ".join(f"{size:.1f}" for size in sizes) + " m", "overall"),
        (f"{sum(wall.length for wall in drawing.walls):.0f} m", "of wall"),
    ]


def provenance_part(provenance: dict[str, Any]) -> Iterator[str]:
    """The command, the version and the settings."""
    if "command" in provenance:
        yield f"<p>This page was made by</p><pre><code>{markup(str(provenance['command']))}</code></pre>"
    model = f", model {provenance['model']}" if "model" in provenance else ""
    yield paragraph(f"slamgym {provenance.get('slamgym', '')}{model}.")
    settings = provenance.get("settings", {})
    if settings:
        rows = [(name, ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value))
                for name, value in settings.items()]  # fmt: skip
        half = -(-len(rows) // 2)
        yield _columns(
            [make_table(["setting", "value"], part) for part in (rows[:half], rows[half:]) if part]
        )


def _lead(drawing: Drawing) -> str:
    source = drawing.provenance.get("source")
    origin = f", drawn from <code>{markup(str(source))}</code>" if source else ""
    cell = 100 * drawing.grid.frame.resolution
    return (
        f"{drawing.area:.1f} m² of floor with {_count(len(drawing.rooms), 'room')} and "
        f"{_count(len(drawing.doors), 'door')}{origin}, a map with cells of {cell:g} cm. Its main walls run at "
        f"{drawing.angle_deg:.1f}° to the map's x axis."
    )


def _map_words(drawing: Drawing) -> str:
    frame = drawing.grid.frame
    min_x, min_y, max_x, max_y = frame.bounds
    return (
        f"The known part of the map: {max_x - min_x:.1f} m by {max_y - min_y:.1f} m, {frame.width_px} by "
        f"{frame.height_px} cells of {100 * frame.resolution:g} cm; x from {min_x:.2f} to {max_x:.2f} m, y from "
        f"{min_y:.2f} to {max_y:.2f} m. White: free, black: occupied, grey: unknown."
    )


def _evidence_part(drawing: Drawing) -> Iterator[str]:
    pair = input_and_overlay(drawing)
    figures = figure(pair.first, _map_words(drawing)) + figure(pair.second, "The drawing over that map.")
    yield f'<div class="{"pair" if pair.are_beside else ""}">{figures}</div>'
    yield (
        '<ul class="legend"><li><span class="key" style="background:#2b2f36"></span>wall, seen</li>'
        '<li><span class="key" style="background:#fd7e14"></span>wall, inferred</li>'
        '<li><span class="key" style="background:#ffd8a8"></span>floor, inferred: never observed</li>'
        '<li><span class="key" style="background:#e9d8fd"></span>unexplored, or only glimpsed</li>'
        '<li><span class="key line" style="color:#1971c2"></span>door</li>'
        '<li><span class="key line" style="color:#fd7e14"></span>door, inferred</li></ul>'
    )
    yield paragraph(
        "A wall counts as seen where the map has an echo within 15 cm along at least half of it. Inferred is what "
        "buildings usually have in such a place; nobody has seen it."
    )
    yield make_table(["", "seen", "inferred"], list(_evidence_rows(drawing)))
    nowhere = sum(float(part.area) for part in drawing.unexplored)
    if nowhere:
        yield paragraph(
            f"Another {nowhere:.1f} m² inside of the building are unexplored and not drawn as floor."
        )


def _evidence_rows(drawing: Drawing) -> Iterator[tuple[str, str, str]]:
    unseen = _unseen(drawing)
    yield "floor", *_shares(drawing.area - unseen, unseen, "m²")
    for name, things in (("rooms", drawing.rooms), ("doors", drawing.doors)):
        seen = sum(thing.layer == "SEEN" for thing in things)
        yield name, str(seen), str(len(things) - seen)
    lengths = [
        sum(wall.length for wall in drawing.walls if wall.layer == layer) for layer in ("SEEN", "INFERRED")
    ]
    yield "walls", *_shares(lengths[0], lengths[1], "m")


def _shares(first: float, second: float, unit: str) -> tuple[str, str]:
    total = max(first + second, 1e-9)
    return f"{first:.1f} {unit} ({first / total:.0%})", f"{second:.1f} {unit} ({second / total:.0%})"


def _rooms_part(drawing: Drawing) -> Iterator[str]:
    if not drawing.rooms:
        yield paragraph("No room was found.")
        return
    rooms = drawing.rooms[:LISTED_ROOMS]
    rows = [_room_row(room, drawing) for room in rooms]
    table = make_table(["room", "area", "width", "depth", "seen", "doors"], rows, [r.layer for r in rooms])
    yield paragraph(
        "Width and depth are the clear lengths of the dimension lines through the middle of the room; corners and "
        "niches lie beside them. An orange edge marks rooms of which less than half was seen."
    )
    yield table
    yield from _left_out(len(drawing.rooms), LISTED_ROOMS, "rooms")
    yield paragraph(_ACCURACY)


def _room_row(room: DrawnRoom, drawing: Drawing) -> tuple[str, ...]:
    sizes = [f"{line.length:.2f} m" for line in drawing.dimensions if line.of == room.id][:2]
    doors = [f"D{number}" for number, door in enumerate(drawing.doors, 1) if room.id in door.rooms]
    sizes += [""] * (2 - len(sizes))
    return room.id, f"{room.area:.2f} m²", *sizes, f"{room.share_seen:.0%}", ", ".join(doors)


def _doors_part(drawing: Drawing) -> Iterator[str]:
    if not drawing.doors:
        yield paragraph("No door was found.")
        return
    doors = drawing.doors[:LISTED_DOORS]
    rows = [
        (
            f"D{number}",
            door.kind,
            f"{door.width:.2f} m",
            f"{100 * door.depth:.0f} cm",
            " and ".join(door.rooms),
            f"{door.confidence:.0%}",
        )
        for number, door in enumerate(doors, 1)
    ]
    yield make_table(
        ["door", "kind", "clear width", "in a wall of", "joins", "seen open"], rows, [d.layer for d in doors]
    )
    yield from _left_out(len(drawing.doors), LISTED_DOORS, "doors")


def _walls_part(drawing: Drawing) -> Iterator[str]:
    by_length = sorted(range(len(drawing.walls)), key=lambda index: -drawing.walls[index].length)
    listed = sorted(by_length[:LISTED_WALLS])
    yield figure(
        numbered_figure(drawing, listed),
        f"Numbers of walls (W) and doors (D). Dark: at least {SURE:.0%} sure; light: less.",
    )
    yield paragraph(
        "Confidence is the chance that a true wall lies within 20 cm. A thickness with an asterisk is assumed, because "
        "only one face of the wall is known. A wall is split where it is seen no more."
    )
    rows = [_wall_row(index, drawing.walls[index]) for index in listed]
    half = -(-len(rows) // 2)
    headings = ["wall", "length", "thick", "confidence", "seen"]
    yield _columns(
        [
            make_table(headings, rows[part], [drawing.walls[index].layer for index in listed[part]])
            for part in (slice(half), slice(half, None))
            if rows[part]
        ]
    )
    yield from _left_out(len(drawing.walls), LISTED_WALLS, "walls", "the longest")


def _wall_row(index: int, wall: DrawnWall) -> tuple[str, ...]:
    assumed = "" if wall.thickness_known else "*"
    thickness = f"{100 * wall.thickness:.0f}{assumed} cm"
    return (
        f"W{index + 1}",
        f"{wall.length:.2f} m",
        thickness,
        f"{wall.confidence:.0%}",
        f"{wall.share_seen:.0%}",
    )


def _left_out(count: int, listed: int, what: str, which: str = "the first") -> Iterator[str]:
    if count > listed:
        yield paragraph(
            f"Listed are {which} {listed} of {count} {what}; the JSON and GeoJSON files have them all."
        )


def _columns(parts: Sequence[str]) -> str:
    return f'<div class="columns">{"".join(f"<div>{part}</div>" for part in parts)}</div>'


def _unseen(drawing: Drawing) -> float:
    return sum(float(part.area) for part in drawing.inferred_floor)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"
