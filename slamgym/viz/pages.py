"""HTML pages that are whole in themselves: no other file, no address; they print on A4."""

import base64
from collections.abc import Sequence

import cv2
import numpy as np

from slamgym.core.text import markup
from slamgym.core.types import ByteArray

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""Content security policy of the page: a browser may load nothing for it."""
_LOSSLESS = 101
"""OpenCV takes a WebP quality above 100 as without loss."""
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 76rem; padding: 0 1rem; color: #212529 }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums }
th, td { padding: .2rem .7rem; text-align: right }
th { border-bottom: 2px solid #868e96 } td { border-bottom: 1px solid #dee2e6 }
th:first-child, td:first-child { text-align: left } tr { break-inside: avoid } thead { display: table-header-group }
small { color: #868e96 } img, svg { max-width: 100% } h2, h3 { break-after: avoid }
@page { size: A4; margin: 14mm }
@media print { body { margin: 0; max-width: none; padding: 0; font-size: 10pt; print-color-adjust: exact } }
"""


def make_page(title: str, parts: Sequence[str], style: str = "", scripted: bool = False) -> str:
    """A page of parts that are HTML already.

    Args:
        title: Plain text.
        parts: Below each other.
        style: CSS, in addition to that of all pages.
        scripted: If the parts hold a script, which others must not.
    """
    policy = _POLICY
    if scripted:
        policy += "; script-src 'unsafe-inline'"
    head = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{markup(title)}</title><style>{_STYLE}{style}</style></head><body>",
    ]
    return "\n".join([*head, *parts, "</body></html>"]) + "\n"


def make_table(
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    row_classes: Sequence[str] = (),
    cell_classes: Sequence[Sequence[str]] = (),
) -> str:
    """A table of plain text.

    Args:
        headings: Of the columns.
        rows: As many cells each.
        row_classes: CSS classes of the rows, where they have some.
        cell_classes: The same of their cells, row by row.
    """
    head = "".join(f"<th>{markup(text)}</th>" for text in headings)
    lines = [f"<table><thead><tr>{head}", "</tr></thead><tbody>"]
    for number, row in enumerate(rows):
        row_class = row_classes[number] if row_classes else ""
        classes = cell_classes[number] if cell_classes else [""] * len(row)
        cells = ""
        for text, kind in zip(row, classes, strict=True):
            cells += f"<td{_class(kind)}>{markup(text)}"
        lines.append(f"<tr{_class(row_class)}>{cells}</tr>")
    lines.append("</tbody></table>")
    return "\n".join(lines)


def _class(name: str) -> str:
    return f' class="{markup(name)}"' if name else ""


def paragraph(text: str) -> str:
    """Plain text as a paragraph."""
    return f"<p>{markup(text)}</p>"


def bullets(sentences: Sequence[str], kind: str = "ul") -> str:
    """Plain sentences as a list; nothing if there are none.

    Args:
        sentences: The entries.
        kind: ``ul``, or ``ol`` for a numbered list.
    """
    entries = "".join(f"<li>{markup(sentence)}</li>" for sentence in sentences)
    return f"<{kind}>{entries}</{kind}>" if entries else ""


def inline_picture(picture: ByteArray) -> str:
    """A picture as an address that holds it: WebP without loss, a third to a half of a PNG's bytes.

    Args:
        picture: Grey, shape (rows, cols), or RGB, shape (rows, cols, 3).
    """
    is_grey = picture.ndim == 2
    as_opencv_has_it = picture if is_grey else picture[:, :, ::-1]
    bgr = np.ascontiguousarray(as_opencv_has_it)
    _, data = cv2.imencode(".webp", bgr, (cv2.IMWRITE_WEBP_QUALITY, _LOSSLESS))
    encoded = base64.b64encode(data.tobytes())
    return f"data:image/webp;base64,{encoded.decode()}"


def figure(content: str, caption: str) -> str:
    """A picture or SVG, which is HTML, over its caption, which is plain text."""
    return f"<figure>{content}<figcaption>{markup(caption)}</figcaption></figure>"
