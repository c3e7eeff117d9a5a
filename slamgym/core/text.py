"""Texts from outside, made safe for a terminal, a page or a line of a file; tables in Markdown."""

import html
from collections.abc import Iterable, Sequence


def printable(text: str) -> str:
    """A text in one line that any terminal, page or file can hold: what can't be seen is written as in Python.

    That is control characters, line ends, marks that turn the direction of writing, and bytes of a file's name
    that are no UTF-8 (halves of surrogate pairs): a name from outside neither steers a terminal nor looks like another.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def markup(text: str) -> str:
    """The same as a part of HTML or XML, between tags or in an attribute."""
    return html.escape(printable(text))


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown whose columns line up, the first flush left and the others right, ended by a line break."""
    table = [[_table_cell(text) for text in row] for row in (headings, *rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    head, *body = [_table_line(row, widths) for row in table]
    rules = ["-" * (widths[0] + 2)]
    rules += ["-" * (width + 1) + ":" for width in widths[1:]]
    return head + "|" + "|".join(rules) + "|\n" + "".join(body)


def _table_cell(text: str) -> str:
    return printable(text).replace("|", r"\|")


def _table_line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = [cells[0].ljust(widths[0])]
    for cell, width in zip(cells[1:], widths[1:], strict=True):
        padded.append(cell.rjust(width))
    return "| " + " | ".join(padded) + " |\n"
