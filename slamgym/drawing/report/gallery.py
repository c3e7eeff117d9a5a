"""A page of cards, one a map, that leads to the reports: what to check comes first."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from slamgym.core.progress import counted
from slamgym.core.text import markup
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.formats.png import Look, draw_picture
from slamgym.drawing.report.page import REPORT_STYLE, checks, figures_part, key_figures
from slamgym.viz.pages import bullets, inline_picture, make_page, paragraph

GALLERY = Path("index.html")
"""Of a folder of drawings."""
THUMBNAIL_PX = 320
_THUMBNAIL = Look((253, 126, 20), (255, 216, 168), (233, 216, 253), is_thumbnail=True)
_LEGEND = "Orange: inferred walls and floor, which nobody has seen; violet: unexplored, or only glimpsed; blue: doors."
_STYLE = """
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(19rem, 1fr)); gap: 1.2rem }
.card { border: 1px solid #dee2e6; border-top: 4px solid #40c057; padding: .6rem .9rem; break-inside: avoid }
.card.doubtful { border-top-color: #fd7e14 } .card h2 { font-size: 1.1em; margin: .2rem 0; overflow-wrap: anywhere }
.card img { display: block; margin: .5rem auto; max-height: 15rem } .card .figures { gap: .2rem 1rem; margin: .4rem 0 }
.card .figures b { font-size: 1.05em } .card ul:not(.figures) { padding-left: 1.1rem; margin: .3rem 0 }
@media print { .cards { display: block } .card { margin-bottom: 6mm } .card img { max-height: 60mm } }
"""


class GalleryCard(NamedTuple):
    """What the gallery shows of a drawing."""

    name: str
    checks: list[str]
    figures: list[tuple[str, str]]
    thumbnail: str
    """The picture as an address that holds it."""
    page: str
    """The file's name of its report, which isn't always one that can be shown."""

    @classmethod
    def of(cls, drawing: Drawing, stem: str) -> "GalleryCard":
        """The card of a drawing, which isn't kept."""
        picture = draw_picture(drawing, THUMBNAIL_PX, _THUMBNAIL)
        return cls(
            drawing.name, checks(drawing), key_figures(drawing), inline_picture(picture), f"{stem}.html"
        )


def format_gallery(title: str, cards: Sequence[GalleryCard], failures: Sequence[str], command: str) -> str:
    """The text of the page; the reports are expected beside it, as ``NAME.html``.

    Args:
        title: What the maps are.
        cards: Those with the most doubts are shown first.
        failures: Why others could not be drawn.
        command: That made it.
    """
    doubtful = sum(bool(card.checks) for card in cards)
    parts = [
        f"<h1>{markup(title)}</h1>",
        paragraph(
            f"{counted(len(cards), 'map')} drawn, {doubtful} of them with something to check, {len(failures)} refused. "
            f"The maps with most to check come first. {_LEGEND}"
        ),
        f"<h2>Refused</h2>{bullets(failures)}" if failures else "",
        '<div class="cards">',
        *(_card_part(card) for card in sorted(cards, key=lambda card: (-len(card.checks), card.name))),
        "</div>",
        f"<p>This page was made by</p><pre><code>{markup(command)}</code></pre>",
    ]
    return make_page(f"Drawings of {title}", parts, REPORT_STYLE + _STYLE)


def _card_part(card: GalleryCard) -> str:
    link = markup(quote(os.fsencode(f"./{card.page}")))
    return (
        f'<article class="card {"doubtful" if card.checks else ""}"><h2><a href="{link}">{markup(card.name)}</a></h2>'
        f"{bullets(card.checks)}"
        f'<a href="{link}"><img alt="drawing of {markup(card.name)}" src="{card.thumbnail}"></a>'
        f"{figures_part(card.figures)}</article>"
    )
