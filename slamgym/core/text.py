"""Texts from outside, made safe for a terminal, a page or a line of a file; tables in Markdown."""

import html
from collections.abc import Iterable, Sequence


def printable(text: str) -> str:
    """A text in one line that any terminal, page or file can hold: what can't be seen is written as in Python.

    That is control characters, line ends, marks that turn the direction of writing, and bytes of a file's name
    that are no UTF-8 (halves of surrogate pairs): a name from outside neither steers a terminal nor looks like another.
    """
    return (
        text
        if text.isprintable()
        else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    )


def markup(text: str) -> str:
    """The same as a part of HTML or XML, between tags or in an attribute."""
    return html.escape(printable(text))


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown whose columns line up, the first flush left and the others right, ended by a line break."""
    table = [[printable(cell).replace("|", r"\|") for cell in row] for row in (headings, *rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]

    def line(first: str, *others: str) -> str:
        padded = (cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))
        return "| " + " | ".join([first.ljust(widths[0]), *padded]) + " |\n"

    rule = (
        "|"
        + "|".join(["-" * (widths[0] + 2), *("-" * (width + 1) + ":" for width in widths[1:])])
        + "|\n"
    )
    return line(*headings) + rule + "".join(line(*row) for row in table[1:])
